//! Readers of plain values: text, numbers, lists, maps of names.

use std::collections::BTreeMap;

use beampose_core::InstrumentName;
use schemars::{Schema, SchemaGenerator, json_schema};
use serde::Serialize;

use super::{Read, Reader};
use crate::fault::{At, Mark};
use crate::tree::{Node, Value};

/// A key that must be there, in a record that is of use even where it is not.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(transparent)]
pub struct Needed<T>(pub Option<T>);

impl<T: Read> Read for Needed<T> {
    fn read(node: &Node, reader: &mut Reader) -> Option<Self> {
        Some(Self(T::read(node, reader)))
    }

    fn broken() -> Option<Self> {
        Some(Self(None))
    }

    fn schema(generator: &mut SchemaGenerator) -> Schema {
        T::schema(generator)
    }
}

/// A key that may be there; unlike with `Option`, a broken one is not taken for an absent one.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Maybe<T> {
    /// The key is not there.
    Absent,
    /// It is, but holds a fault, which is already noted.
    Broken,
    /// Its value.
    Given(T),
}

impl<T: Read> Read for Maybe<T> {
    fn read(node: &Node, reader: &mut Reader) -> Option<Self> {
        T::read(node, reader).map(Self::Given)
    }

    fn absent() -> Option<Self> {
        Some(Self::Absent)
    }

    fn broken() -> Option<Self> {
        Some(Self::Broken)
    }

    fn schema(generator: &mut SchemaGenerator) -> Schema {
        T::schema(generator)
    }
}

impl<T: Read> Read for Option<T> {
    fn read(node: &Node, reader: &mut Reader) -> Option<Self> {
        T::read(node, reader).map(Some)
    }

    fn absent() -> Option<Self> {
        Some(None)
    }

    fn broken() -> Option<Self> {
        Some(None)
    }

    fn schema(generator: &mut SchemaGenerator) -> Schema {
        T::schema(generator)
    }
}

impl<T: Read> Read for At<T> {
    fn read(node: &Node, reader: &mut Reader) -> Option<Self> {
        Some(Self { value: T::read(node, reader)?, mark: node.mark })
    }

    fn broken() -> Option<Self> {
        Some(Self { value: T::broken()?, mark: Mark::default() })
    }

    fn schema(generator: &mut SchemaGenerator) -> Schema {
        T::schema(generator)
    }
}

/// A list that is written is not empty. Items with faults are left out.
impl<T: Read> Read for Vec<T> {
    fn read(node: &Node, reader: &mut Reader) -> Option<Self> {
        let Value::List(items) = &node.value else {
            return reader.expected(node, "a list");
        };
        if items.is_empty() {
            reader.fault(node.mark, "expected at least one value, found an empty list");
        }
        Some(items.iter().filter_map(|item| T::read(item, reader)).collect())
    }

    fn broken() -> Option<Self> {
        Some(Self::new())
    }

    fn schema(generator: &mut SchemaGenerator) -> Schema {
        let items = T::schema(generator);
        json_schema!({ "type": "array", "items": items, "minItems": 1 })
    }
}

impl<T: Read, const N: usize> Read for [T; N] {
    fn read(node: &Node, reader: &mut Reader) -> Option<Self> {
        let Value::List(items) = &node.value else {
            return reader.expected(node, &format!("a list of {N} values"));
        };
        if items.len() != N {
            reader.fault(node.mark, format!("expected {N} values, found {}", items.len()));
        }
        let read: Vec<T> = items.iter().filter_map(|item| T::read(item, reader)).collect();
        read.try_into().ok()
    }

    fn broken() -> Option<Self> {
        (0..N).map(|_| T::broken()).collect::<Option<Vec<T>>>()?.try_into().ok()
    }

    fn schema(generator: &mut SchemaGenerator) -> Schema {
        let items = T::schema(generator);
        json_schema!({ "type": "array", "items": items, "minItems": N, "maxItems": N })
    }
}

/// A map of names that people choose, each with the place of its name.
impl<T: Read> Read for BTreeMap<String, At<T>> {
    fn read(node: &Node, reader: &mut Reader) -> Option<Self> {
        reader.refuse_repetitions(node);
        let mut map = Self::new();
        let entries = reader.map(node, "a map of names")?;
        if entries.is_empty() {
            reader.fault(node.mark, "expected at least one name, found an empty map");
        }
        for (key, value) in entries {
            if !super::parameters::is_name(&key.name) {
                reader.fault(key.mark, "a name has letters, digits and `_` only");
            }
            if let Some(value) = T::read(value, reader) {
                map.entry(key.name.clone()).or_insert(At { value, mark: key.mark });
            }
        }
        Some(map)
    }

    fn broken() -> Option<Self> {
        Some(Self::new())
    }

    fn schema(generator: &mut SchemaGenerator) -> Schema {
        let values = T::schema(generator);
        json_schema!({ "type": "object", "additionalProperties": values, "minProperties": 1 })
    }
}

impl Read for String {
    fn read(node: &Node, reader: &mut Reader) -> Option<Self> {
        match &node.value {
            Value::Text(text) if !text.trim().is_empty() => Some(text.trim().to_owned()),
            // `title: 2026` is a title all the same.
            Value::Number(number) => Some(number.to_string()),
            _ => reader.expected(node, "text"),
        }
    }

    fn broken() -> Option<Self> {
        Some(Self::new())
    }

    fn schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({ "type": "string" })
    }
}

impl Read for InstrumentName {
    fn read(node: &Node, reader: &mut Reader) -> Option<Self> {
        let Value::Text(text) = &node.value else {
            return reader.expected(node, "an instrument's name");
        };
        Some(Self(text.clone()))
    }

    fn broken() -> Option<Self> {
        Some(Self(String::new()))
    }

    fn schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({ "type": "string" })
    }
}

impl Read for bool {
    fn read(node: &Node, reader: &mut Reader) -> Option<Self> {
        match &node.value {
            Value::Bool(value) => Some(*value),
            _ => reader.expected(node, "`true` or `false`"),
        }
    }

    fn broken() -> Option<Self> {
        Some(false)
    }

    fn schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({ "type": "boolean" })
    }
}

impl Read for f64 {
    fn read(node: &Node, reader: &mut Reader) -> Option<Self> {
        let resolved = reader.resolve(node)?;
        match &resolved.node.value {
            Value::Number(number) if number.is_finite() => Some(*number),
            _ => {
                let message = format!("expected a number, found {}", resolved.node.describe());
                reader.fault_help(node.mark, message, resolved.help);
                None
            }
        }
    }

    fn broken() -> Option<Self> {
        Some(Self::NAN)
    }

    fn schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({ "type": ["number", "string"], "pattern": r"^\$[A-Za-z_]\w*$" })
    }
}

/// Whole numbers up to this are exact in the tree.
const EXACT: f64 = 9_007_199_254_740_992.0;

macro_rules! whole {
    ($($ty:ident up to $max:expr),*) => {$(
        impl Read for $ty {
            fn read(node: &Node, reader: &mut Reader) -> Option<Self> {
                let resolved = reader.resolve(node)?;
                match &resolved.node.value {
                    Value::Number(n) if n.fract() == 0.0 && (0.0..=$max).contains(n) => {
                        Some(*n as $ty)
                    }
                    _ => {
                        let found = resolved.node.describe();
                        let what = if matches!(resolved.node.value, Value::Number(n) if n > $max) {
                            format!("a number up to {}", $max)
                        } else {
                            "a whole number, zero or above".to_owned()
                        };
                        let message = format!("expected {what}, found {found}");
                        reader.fault_help(node.mark, message, resolved.help);
                        None
                    }
                }
            }

            fn broken() -> Option<Self> {
                Some(0)
            }

            fn schema(_: &mut SchemaGenerator) -> Schema {
                json_schema!({
                    "type": ["integer", "string"], "minimum": 0, "pattern": r"^\$[A-Za-z_]\w*$"
                })
            }
        }
    )*};
}
whole!(u16 up to f64::from(u16::MAX), u32 up to f64::from(u32::MAX), u64 up to EXACT);

impl Read for beampose_core::Quantity {
    fn read(node: &Node, reader: &mut Reader) -> Option<Self> {
        const WORDS: [(&str, beampose_core::Quantity); 3] = [
            ("wavelength", beampose_core::Quantity::Wavelength),
            ("temperature", beampose_core::Quantity::Temperature),
            ("current", beampose_core::Quantity::Current),
        ];
        let words = WORDS.map(|(word, _)| word);
        let word = reader.word(node, "what the sensor reads", &words)?;
        WORDS.iter().find(|(known, _)| *known == word).map(|(_, quantity)| *quantity)
    }

    fn schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({ "enum": ["wavelength", "temperature", "current"] })
    }
}
