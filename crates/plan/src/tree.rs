//! YAML as a tree in which every key and value knows its place.
//!
//! Serde stops at the first error, so the text is first read into this tree, which fits any YAML
//! within the budget, and the readers walk it and collect every fault. Duplicate keys stay in the
//! tree: they are a fault of the reader, not the end of reading.

use std::fmt;

use serde::de::{Deserialize, Deserializer, MapAccess, SeqAccess, Visitor};
use serde_yaml::{Location, Spanned};

use crate::fault::{Fault, Faults, Mark, Source};

/// More than any plan needs; what is bigger is not a plan.
const MAX_BYTES: usize = 1 << 20;
/// A step in five loops has twenty levels, the deepest rig seven. The parser needs some 45 kB of
/// stack for each level, and a thread may have no more than 2 MB.
const MAX_DEPTH: usize = 24;

/// A value in the file.
#[derive(Debug, Clone)]
pub(crate) struct Node {
    pub mark: Mark,
    pub value: Value,
}

/// What kind of value, with what is in it.
#[derive(Debug, Clone)]
pub(crate) enum Value {
    Null,
    Bool(bool),
    Number(f64),
    Text(String),
    List(Vec<Node>),
    Map(Vec<(Key, Node)>),
}

/// A key and its place.
#[derive(Debug, Clone)]
pub(crate) struct Key {
    pub mark: Mark,
    pub name: String,
}

impl Node {
    /// What it is, for messages.
    pub(crate) fn describe(&self) -> String {
        match &self.value {
            Value::Null => "nothing".to_owned(),
            Value::Bool(b) => format!("`{b}`"),
            Value::Number(n) => format!("`{n}`"),
            Value::Text(text) => format!("`{}`", shortened(text)),
            Value::List(items) if items.is_empty() => "an empty list".to_owned(),
            Value::List(_) => "a list".to_owned(),
            Value::Map(entries) if entries.is_empty() => "an empty map".to_owned(),
            Value::Map(_) => "a map".to_owned(),
        }
    }
}

/// Text fit for a message.
pub(crate) fn shortened(text: &str) -> String {
    const LENGTH: usize = 60;
    let mut short: String = text.chars().take(LENGTH).map(crate::fault::printable).collect();
    if text.chars().count() > LENGTH {
        short.push('…');
    }
    short
}

/// Reads YAML within a budget: no alias bombs, no abysses, no giants.
pub(crate) fn parse(source: &Source) -> Result<Node, Faults> {
    if source.text().len() > MAX_BYTES {
        let size = source.text().len();
        let message = format!("the file has {size} bytes; at most {MAX_BYTES} are read");
        return Err(Fault::of_file(source.name(), message).into());
    }
    let parsed = serde_yaml::from_str_with_options::<Spanned<Raw>>(source.text(), options());
    match parsed {
        Ok(raw) => Ok(raw.into_node()),
        Err(error) => {
            let error = error.without_snippet();
            let mark = error.location().map(point).unwrap_or_default();
            Err(source.error(mark, message_of(error)).into())
        }
    }
}

fn options() -> serde_yaml::Options {
    serde_yaml::options! {
        budget: serde_yaml::budget! {
            max_depth: MAX_DEPTH,
            flow_nesting_limit: MAX_DEPTH,
            max_nodes: 50_000,
            max_aliases: 200,
            max_documents: 1,
        },
        alias_limits: serde_yaml::alias_limits! {
            max_total_replayed_events: 20_000,
            max_replay_stack_depth: 8,
        },
        duplicate_keys: serde_yaml::options::DuplicateKeyPolicy::PassThrough,
        merge_keys: serde_yaml::options::MergeKeyPolicy::AsOrdinary,
        // `on` and `off` are words of the plan, not booleans.
        strict_booleans: true,
    }
}

/// The parser's message without the place, which the fault says anyway.
fn message_of(error: &serde_yaml::Error) -> String {
    let text = error.to_string();
    // Budgets are breached in several rooms of the parser, each with an error of its own.
    if text.contains("Depth {") || text.contains("recursion limit") {
        return format!("nested more than {MAX_DEPTH} deep");
    }
    if text.contains("budget breached") || text.contains("alias replay") {
        return "bigger than any plan: too many values, or aliases that repeat too much".to_owned();
    }
    let first = text.lines().next().unwrap_or_default();
    let first = first.split(" at line ").next().unwrap_or(first);
    format!("not readable as YAML: {}", shortened_message(first))
}

fn shortened_message(text: &str) -> String {
    text.chars().take(200).map(crate::fault::printable).collect()
}

fn point(location: Location) -> Mark {
    let small = |n: u64| u32::try_from(n).unwrap_or(u32::MAX);
    Mark { line: small(location.line()), column: small(location.column()), length: 1 }
}

fn mark(location: Location) -> Mark {
    let length = u32::try_from(location.span().len()).unwrap_or(u32::MAX);
    Mark { length: length.max(1), ..point(location) }
}

/// The tree as serde builds it, before marks are attached.
enum Raw {
    Null,
    Bool(bool),
    Number(f64),
    Text(String),
    List(Vec<Spanned<Raw>>),
    Map(Vec<(Spanned<RawKey>, Spanned<Raw>)>),
}

struct RawKey(String);

trait IntoNode {
    fn into_node(self) -> Node;
}

impl IntoNode for Spanned<Raw> {
    fn into_node(self) -> Node {
        let mut mark = mark(self.referenced);
        let value = match self.value {
            Raw::Null => Value::Null,
            Raw::Bool(b) => Value::Bool(b),
            Raw::Number(n) => Value::Number(n),
            Raw::Text(text) => Value::Text(text),
            Raw::List(items) => Value::List(items.into_iter().map(IntoNode::into_node).collect()),
            Raw::Map(entries) => Value::Map(
                entries
                    .into_iter()
                    .map(|(key, value)| (into_key(&key), value.into_node()))
                    .collect(),
            ),
        };
        // Carets under a whole block say less than one under its beginning.
        if matches!(value, Value::List(_) | Value::Map(_) | Value::Null) {
            mark.length = 1;
        }
        Node { mark, value }
    }
}

fn into_key(key: &Spanned<RawKey>) -> Key {
    Key { mark: mark(key.referenced), name: key.value.0.clone() }
}

impl<'de> Deserialize<'de> for Raw {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(RawVisitor)
    }
}

struct RawVisitor;

impl<'de> Visitor<'de> for RawVisitor {
    type Value = Raw;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a value")
    }

    fn visit_bool<E>(self, v: bool) -> Result<Raw, E> {
        Ok(Raw::Bool(v))
    }

    fn visit_i64<E>(self, v: i64) -> Result<Raw, E> {
        Ok(Raw::Number(v as f64))
    }

    fn visit_u64<E>(self, v: u64) -> Result<Raw, E> {
        Ok(Raw::Number(v as f64))
    }

    fn visit_i128<E>(self, v: i128) -> Result<Raw, E> {
        Ok(Raw::Number(v as f64))
    }

    fn visit_u128<E>(self, v: u128) -> Result<Raw, E> {
        Ok(Raw::Number(v as f64))
    }

    fn visit_f64<E>(self, v: f64) -> Result<Raw, E> {
        Ok(Raw::Number(v))
    }

    fn visit_str<E>(self, v: &str) -> Result<Raw, E> {
        Ok(Raw::Text(v.to_owned()))
    }

    fn visit_unit<E>(self) -> Result<Raw, E> {
        Ok(Raw::Null)
    }

    fn visit_none<E>(self) -> Result<Raw, E> {
        Ok(Raw::Null)
    }

    fn visit_some<D: Deserializer<'de>>(self, deserializer: D) -> Result<Raw, D::Error> {
        Raw::deserialize(deserializer)
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<Raw, A::Error> {
        let mut items = Vec::new();
        while let Some(item) = seq.next_element()? {
            items.push(item);
        }
        Ok(Raw::List(items))
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Raw, A::Error> {
        let mut entries = Vec::new();
        while let Some(entry) = map.next_entry()? {
            entries.push(entry);
        }
        Ok(Raw::Map(entries))
    }
}

impl<'de> Deserialize<'de> for RawKey {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        String::deserialize(deserializer).map(RawKey)
    }
}
