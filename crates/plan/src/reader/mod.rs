//! From the tree to typed records, collecting every fault on the way.
//!
//! One definition ([`record!`](macros), `choice!`, `words!`) makes the type, its reader and its
//! JSON Schema, so none can fall behind the others. A reader that meets a fault notes it and goes
//! on: a list drops the item, an optional key counts as broken, so that what follows is still read.

#[macro_use]
pub(crate) mod macros;
mod checks;
mod fields;
mod parameters;
mod units;
mod values;

use std::collections::BTreeMap;

use schemars::{Schema, SchemaGenerator};

pub(crate) use checks::{fraction, not_negative, percent, positive, unit_range};
pub(crate) use fields::{Fields, Property, object_schema};
pub use parameters::Parameters;
pub(crate) use parameters::is_name;
pub(crate) use units::quantity_of;
pub use values::{Maybe, Needed};

use crate::fault::{At, Fault, Faults, Mark, Source};
use crate::tree::{Node, Value};

/// What can be read from a node of the tree.
pub(crate) trait Read: Sized {
    /// The value, or `None` after noting why not.
    fn read(node: &Node, reader: &mut Reader) -> Option<Self>;

    /// What it is when its key is absent; `None` where the key is required.
    fn absent() -> Option<Self> {
        None
    }

    /// What stands in for it when its key is missing or holds a fault, which is then noted
    /// already: so the rest of the record can still be checked. Never leaves this room.
    fn broken() -> Option<Self> {
        None
    }

    /// Its JSON Schema.
    fn schema(generator: &mut SchemaGenerator) -> Schema;

    /// Whether the key must be there.
    fn required() -> bool {
        Self::absent().is_none()
    }
}

/// A map with known keys, as `record!` makes it.
pub(crate) trait Record: Read {
    /// Its keys.
    const KEYS: &'static [&'static str];
    /// Its keys, for the schema.
    fn properties(generator: &mut SchemaGenerator) -> Vec<Property>;
}

/// A map with one key that says which, as `choice!` makes it.
pub(crate) trait Choice: Read {
    /// The keys of which one is there.
    const KEYS: &'static [&'static str];
    /// Its schema, where keys of another record may stand beside the one.
    fn schema_with(
        beside: fn(&mut SchemaGenerator) -> Vec<Property>,
        generator: &mut SchemaGenerator,
    ) -> Schema;
}

/// The state of one reading: the file, the faults so far, the plan's parameters.
#[derive(Debug)]
pub(crate) struct Reader {
    pub source: Source,
    pub faults: Faults,
    parameters: BTreeMap<String, parameters::Parameter>,
}

impl Reader {
    pub(crate) fn new(source: Source) -> Self {
        Self { source, faults: Faults::default(), parameters: BTreeMap::new() }
    }

    /// Notes a fault.
    pub(crate) fn fault(&mut self, mark: Mark, message: impl Into<String>) {
        self.fault_help(mark, message.into(), None);
    }

    /// Notes a fault with a help.
    pub(crate) fn fault_help(&mut self, mark: Mark, message: String, help: Option<String>) {
        if !self.faults.is_full() {
            self.faults.push(self.source.error(mark, message).maybe_help(help));
        }
    }

    /// Notes that something else was expected here.
    pub(crate) fn expected<T>(&mut self, node: &Node, what: &str) -> Option<T> {
        self.fault(node.mark, format!("expected {what}, found {}", node.describe()));
        None
    }

    /// The entries of a map, or a fault.
    pub(crate) fn map<'n>(
        &mut self,
        node: &'n Node,
        what: &str,
    ) -> Option<&'n Vec<(crate::tree::Key, Node)>> {
        match &node.value {
            Value::Map(entries) => Some(entries),
            _ => self.expected(node, what),
        }
    }
}

/// Reads a whole document: `Err` when it is not even YAML.
pub(crate) fn document<T: Read>(source: &Source) -> Result<(Option<T>, Reader), Faults> {
    let node = crate::tree::parse(source)?;
    let mut reader = Reader::new(source.clone());
    if matches!(node.value, Value::Null) {
        return Err(Fault::of_file(source.name(), "the file is empty").into());
    }
    let value = T::read(&node, &mut reader);
    Ok((value, reader))
}

/// Notes a version that this program does not read.
pub(crate) fn expect_version(found: &Needed<At<u32>>, known: u32, reader: &mut Reader) {
    if let Some(version) = found.0.as_ref().filter(|version| version.value != known) {
        let message = format!("expected version {known}, found `{}`", version.value);
        reader.fault(version.mark, message);
    }
}
