//! Readers of quantities: a number and a unit of the kind that belongs there.

use beampose_core::units::{Celsius, Degree, Milliampere, Millimetre, Nanometre, Second};
use schemars::{Schema, SchemaGenerator, json_schema};

use super::{Read, Reader};
use crate::quantity::{
    self, ANGLE, AxisPosition, Byte, DegreePerSecond, Dimension, Kelvin, LENGTH,
    MillimetrePerSecond, NotThat, Pixel, Quantity,
};
use crate::tree::{Node, Value};

macro_rules! quantities {
    ($($name:ident),*) => {$(
        impl Read for $name {
            fn read(node: &Node, reader: &mut Reader) -> Option<Self> {
                quantity_of(node, <$name as Quantity>::DIMENSION, reader).map(Self::from_number)
            }

            fn broken() -> Option<Self> {
                Some(Self::from_number(f64::NAN))
            }

            fn schema(_: &mut SchemaGenerator) -> Schema {
                quantity_schema(&[<$name as Quantity>::DIMENSION])
            }
        }
    )*};
}
quantities!(
    Millimetre,
    Degree,
    Second,
    Nanometre,
    Celsius,
    Milliampere,
    Kelvin,
    MillimetrePerSecond,
    DegreePerSecond,
    Byte,
    Pixel
);

/// The number, in the stored unit, of a quantity of the given kind.
pub(crate) fn quantity_of(
    node: &Node,
    dimension: &'static Dimension,
    reader: &mut Reader,
) -> Option<f64> {
    let resolved = reader.resolve(node)?;
    let expected = format!("expected {} such as `{}`", dimension.article_name, dimension.example);
    let found = resolved.node.describe();
    let reason = match &resolved.node.value {
        Value::Text(text) => match quantity::parse(text, dimension) {
            Ok(number) => return Some(number),
            Err(reason) => reason,
        },
        Value::Number(number) => NotThat::NoUnit(*number),
        _ => NotThat::NoNumber,
    };
    let (message, help) = why(&reason, dimension, &expected, &found);
    reader.fault_help(node.mark, message, resolved.help.or(help));
    None
}

/// The message and its help.
fn why(
    reason: &NotThat,
    dimension: &Dimension,
    expected: &str,
    found: &str,
) -> (String, Option<String>) {
    let symbols: Vec<&str> = dimension.units.iter().map(|(symbol, _)| *symbol).collect();
    let list = crate::suggest::quoted(&symbols);
    let units = Some(format!("units of {} are {list}", dimension.article_name));
    match reason {
        NotThat::NoNumber => (format!("{expected}, found {found}"), None),
        NotThat::NoUnit(n) => {
            let help = format!("is it `{n} {}`?", symbols.first().copied().unwrap_or_default());
            (format!("missing unit: {expected}, found {found}"), Some(help))
        }
        NotThat::UnknownUnit(unit) => {
            let unit = crate::tree::shortened(unit);
            (format!("unknown unit `{unit}`: {expected}, found {found}"), units)
        }
        NotThat::Other(other) => {
            let name = other.article_name;
            (format!("{expected}, found {found}, which is {name}"), units)
        }
    }
}

fn quantity_schema(dimensions: &[&Dimension]) -> Schema {
    let symbols: Vec<&str> =
        dimensions.iter().flat_map(|d| d.units.iter().map(|(symbol, _)| *symbol)).collect();
    let number = r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?";
    let pattern = format!(r"^({number}\s*({})|\$[A-Za-z_]\w*)$", symbols.join("|"));
    let examples: Vec<&str> = dimensions.iter().map(|d| d.example).collect();
    json_schema!({ "type": "string", "pattern": pattern, "examples": examples })
}

impl Read for AxisPosition {
    fn read(node: &Node, reader: &mut Reader) -> Option<Self> {
        let resolved = reader.resolve(node)?;
        let is_angle = matches!(&resolved.node.value, Value::Text(text)
            if quantity::parse(text, &ANGLE).is_ok());
        if is_angle {
            return quantity_of(node, &ANGLE, reader).map(|n| Self::Angle(Degree(n)));
        }
        quantity_of(node, &LENGTH, reader).map(|n| Self::Length(Millimetre(n)))
    }

    fn schema(_: &mut SchemaGenerator) -> Schema {
        quantity_schema(&[&LENGTH, &ANGLE])
    }
}
