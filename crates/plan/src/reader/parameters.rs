//! Named quantities of a plan, referred to as `$name` wherever a number or quantity stands.
//!
//! `$name` and not `${name}`: braces would end a plain word inside `{rail: ...}`.

use schemars::{Schema, SchemaGenerator};

use super::{Read, Reader};
use crate::fault::{Fault, Mark};
use crate::quantity;
use crate::suggest;
use crate::tree::{Node, Value};

/// A parameter's value and whether anything refers to it.
#[derive(Debug)]
pub(crate) struct Parameter {
    node: Node,
    defined: Mark,
    used: bool,
}

/// The plan's `parameters:`. Reading them makes them known to all that is read later; the values
/// themselves are not kept here.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Parameters;

impl Read for Parameters {
    fn read(node: &Node, reader: &mut Reader) -> Option<Self> {
        reader.refuse_repetitions(node);
        for (key, value) in reader.map(node, "a map of named quantities, as `step: 100 mm`")? {
            let name = key.name.clone();
            if !is_name(&name) {
                reader.fault(key.mark, "a parameter's name has letters, digits and `_` only");
            }
            let fits = match &value.value {
                Value::Number(_) => true,
                Value::Text(text) => quantity::is_quantity(text),
                _ => false,
            };
            if !fits {
                reader.expected::<()>(value, "a number or a quantity such as `100 mm`");
            }
            let parameter = Parameter { node: value.clone(), defined: key.mark, used: !fits };
            reader.parameters.entry(name).or_insert(parameter);
        }
        Some(Self)
    }

    fn absent() -> Option<Self> {
        Some(Self)
    }

    fn broken() -> Option<Self> {
        Some(Self)
    }

    fn schema(_: &mut SchemaGenerator) -> Schema {
        schemars::json_schema!({
            "type": "object",
            "additionalProperties": { "type": ["string", "number"] },
        })
    }
}

/// Letters, digits and underscores, not beginning with a digit.
pub(crate) fn is_name(name: &str) -> bool {
    let letter = |c: char| c.is_ascii_alphabetic() || c == '_';
    name.starts_with(letter) && name.chars().all(|c| letter(c) || c.is_ascii_digit())
}

/// A node with `$name` replaced, and a help that says so.
pub(crate) struct Resolved {
    pub node: Node,
    pub help: Option<String>,
}

impl Reader {
    /// Replaces `$name` by the parameter's value; the place stays that of the reference.
    pub(crate) fn resolve(&mut self, node: &Node) -> Option<Resolved> {
        let Value::Text(text) = &node.value else {
            return Some(Resolved { node: node.clone(), help: None });
        };
        let Some(name) = text.strip_prefix('$') else {
            return Some(Resolved { node: node.clone(), help: None });
        };
        if let Some(parameter) = self.parameters.get_mut(name) {
            parameter.used = true;
            let (found, line) = (parameter.node.describe(), parameter.defined.line);
            let help = Some(format!("`${name}` is {found}, set in line {line}"));
            let node = Node { mark: node.mark, value: parameter.node.value.clone() };
            return Some(Resolved { node, help });
        }
        let help = suggest::help(name, self.parameters.keys().map(String::as_str))
            .or_else(|| Some("parameters are set under `parameters:` in a plan".to_owned()));
        self.fault_help(node.mark, format!("unknown parameter {}", node.describe()), help);
        None
    }

    /// A warning for each parameter that nothing refers to.
    pub(crate) fn unused_parameters(&self) -> Vec<Fault> {
        self.parameters
            .iter()
            .filter(|(_, parameter)| !parameter.used)
            .map(|(name, p)| {
                self.source.warning(p.defined, format!("parameter `{name}` is never used"))
            })
            .collect()
    }
}
