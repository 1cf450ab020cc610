//! Maps with known keys: unknown, missing and repeated keys are faults.

use schemars::Schema;
use serde_json::{Map, json};

use super::{Read, Reader};
use crate::fault::Mark;
use crate::suggest;
use crate::tree::{Node, Value};

/// The entries of a map that have a known key.
pub(crate) struct Fields<'n> {
    mark: Mark,
    entries: Vec<(&'static str, &'n Node)>,
    /// Keys that unknown ones were probably meant to be: they are not missing as well.
    meant: Vec<&'static str>,
}

impl<'n> Fields<'n> {
    /// Sorts a map's entries into the known keys, noting the others and repetitions.
    pub(crate) fn of(
        node: &'n Node,
        keys: &'static [&'static str],
        reader: &mut Reader,
    ) -> Option<Self> {
        let what = format!("a map with {}", list(keys));
        let mut entries: Vec<(&'static str, &'n Node)> = Vec::new();
        let mut meant = Vec::new();
        reader.refuse_repetitions(node);
        for (key, value) in reader.map(node, &what)? {
            match keys.iter().find(|known| **known == key.name) {
                None => {
                    reader.unknown_key(key.mark, &key.name, keys);
                    meant.extend(suggest::nearest(&key.name, keys));
                }
                Some(known) if entries.iter().any(|(k, _)| k == known) => {}
                Some(known) => entries.push((known, value)),
            }
        }
        Some(Self { mark: node.mark, entries, meant })
    }

    /// Reads the value of one key and checks it.
    pub(crate) fn take<T: Read>(
        &mut self,
        key: &'static str,
        check: fn(&T) -> Result<(), &'static str>,
        reader: &mut Reader,
    ) -> Option<T> {
        let Some((_, node)) = self.entries.iter().find(|(known, _)| *known == key) else {
            if let Some(value) = T::absent() {
                return Some(value);
            }
            if !self.meant.contains(&key) {
                reader.fault(self.mark, format!("missing key `{key}`"));
            }
            return T::broken();
        };
        let Some(value) = T::read(node, reader) else {
            return T::broken();
        };
        if let Err(complaint) = check(&value) {
            let found = node.describe();
            reader.fault(node.mark, format!("`{key}` {complaint}, found {found}"));
        }
        Some(value)
    }
}

/// A few keys by name, more by their number.
fn list(keys: &[&str]) -> String {
    match keys.len() {
        0..=6 => suggest::quoted(keys),
        n => format!("some of {n} keys, as {}", suggest::quoted(&keys[..5])),
    }
}

impl Reader {
    /// Notes a key that does not belong there.
    pub(crate) fn unknown_key(&mut self, mark: Mark, name: &str, known: &[&str]) {
        let name = crate::tree::shortened(name);
        let help = suggest::help(&name, known.iter().copied());
        self.fault_help(mark, format!("unknown key `{name}`"), help);
    }

    /// Notes every key of a map that was there before.
    pub(crate) fn refuse_repetitions(&mut self, node: &Node) {
        let Value::Map(entries) = &node.value else { return };
        let mut first_line = std::collections::BTreeMap::new();
        for (key, _) in entries {
            if let Some(line) = first_line.insert(key.name.as_str(), key.mark.line) {
                let name = crate::tree::shortened(&key.name);
                self.fault(key.mark, format!("key `{name}` repeats; it was first in line {line}"));
                first_line.insert(key.name.as_str(), line);
            }
        }
    }

    /// The only entry of a map whose key says which of several things it is.
    pub(crate) fn one_of<'n>(
        &mut self,
        node: &'n Node,
        what: &str,
        keys: &[&'static str],
    ) -> Option<(&'static str, &'n Node)> {
        if let Value::Text(word) = &node.value {
            let help = match keys.iter().find(|key| *key == word) {
                Some(key) => Some(format!("write `{key}: ...`")),
                None => suggest::help(word, keys.iter().copied()),
            };
            let message = format!("expected {what} as `name: value`, found {}", node.describe());
            self.fault_help(node.mark, message, help);
            return None;
        }
        let entries = self.map(node, what)?;
        let known = |name: &str| keys.iter().find(|key| **key == name).copied();
        for (key, _) in entries.iter().filter(|(key, _)| known(&key.name).is_none()) {
            self.unknown_key(key.mark, &key.name, keys);
        }
        if let Some((second, _)) = entries.get(1) {
            let message = format!("expected {what} with one key, found {}", entries.len());
            let help = Some("begin each with `-`, or indent what belongs to it".to_owned());
            self.fault_help(second.mark, message, help);
        }
        if entries.is_empty() {
            return self.expected(node, what);
        }
        entries.iter().find_map(|(key, value)| known(&key.name).map(|known| (known, value)))
    }

    /// One of a few words.
    pub(crate) fn word<'k>(
        &mut self,
        node: &Node,
        what: &str,
        words: &[&'k str],
    ) -> Option<&'k str> {
        let Value::Text(text) = &node.value else {
            return self.expected(node, &format!("{what}: {}", suggest::quoted(words)));
        };
        let word = words.iter().find(|word| *word == text).copied();
        if word.is_none() {
            let message = format!("expected {what}, found {}", node.describe());
            self.fault_help(node.mark, message, suggest::help(text, words.iter().copied()));
        }
        word
    }
}

/// One key of a map, for the schema.
pub(crate) struct Property {
    pub key: &'static str,
    pub doc: &'static str,
    pub required: bool,
    pub schema: Schema,
}

/// The schema of a map with known keys.
pub(crate) fn object_schema(doc: &str, properties: Vec<Property>) -> Schema {
    let required: Vec<&str> = properties.iter().filter(|p| p.required).map(|p| p.key).collect();
    let mut members = Map::new();
    for mut property in properties {
        property.schema.insert("description".to_owned(), json!(text(property.doc)));
        members.insert(property.key.to_owned(), property.schema.to_value());
    }
    schemars::json_schema!({
        "description": text(doc),
        "type": "object",
        "properties": members,
        "required": required,
        "additionalProperties": false,
    })
}

/// Documentation as one paragraph, without the space after each `///`.
fn text(doc: &str) -> String {
    doc.lines().map(str::trim).filter(|line| !line.is_empty()).collect::<Vec<_>>().join(" ")
}
