//! Words of the OptoRS readouts, as a client says and reads them.

/// Millimetres in an inch.
const INCH_MM: f64 = 25.4;

/// A line from the readout.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Message {
    /// A position, with its unit where the long form says one.
    Value(f64, Option<Unit>),
    Unit(Unit),
    /// `ERR0` to `ERR3`.
    Error(u8),
    /// More than its digits can show.
    Overflow,
}

/// The unit of positions.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Unit {
    Millimetre,
    Inch,
}

impl Unit {
    pub(super) fn millimetres(self, value: f64) -> f64 {
        match self {
            Self::Millimetre => value,
            Self::Inch => value * INCH_MM,
        }
    }

    fn named(word: &str) -> Option<Self> {
        match word.to_ascii_uppercase().as_str() {
            "MM" => Some(Self::Millimetre),
            "IN" | "INCH" => Some(Self::Inch),
            _ => None,
        }
    }
}

/// A number as they write it: blanks for leading zeros, blank or `+` for plus, `-` glued to the
/// first digit, a point.
fn number(word: &str) -> Option<f64> {
    let digits = word.strip_prefix(['-', '+']).unwrap_or(word);
    let (whole, part) = digits.split_once('.')?;
    let are_digits = |text: &str| !text.is_empty() && text.bytes().all(|b| b.is_ascii_digit());
    (are_digits(whole) && are_digits(part)).then(|| word.parse().ok())?
}

/// Reads a line; `None` where it is none of theirs.
pub(super) fn message(line: &str) -> Option<Message> {
    let words: Vec<&str> = line.split_whitespace().collect();
    match words[..] {
        ["OV"] => Some(Message::Overflow),
        [word] => {
            if let Some(digit) = word.strip_prefix("ERR") {
                return digit.parse().ok().map(Message::Error);
            }
            let unit = Unit::named(word).map(Message::Unit);
            unit.or_else(|| number(word).map(|value| Message::Value(value, None)))
        }
        // The long form of Mestra: number of the value, four digits of tolerance, value, unit.
        [count, tolerance, value, unit] => {
            let hex = |text: &str| text.bytes().all(|byte| byte.is_ascii_hexdigit());
            if count.len() != 3 || tolerance.len() != 4 || !hex(count) || !hex(tolerance) {
                return None;
            }
            Some(Message::Value(number(value)?, Some(Unit::named(unit)?)))
        }
        _ => None,
    }
}

/// What an error means.
pub(super) fn error(number: u8) -> &'static str {
    match number {
        0 => "its sensor lost count (moved too fast, or dirty): set its zero again",
        1 => "it does not know the command",
        2 => "it received a wrong parity: its line must be 4800 baud, 7 bits, even, 2 stop bits",
        3 => "the value is outside its range",
        _ => "unknown error",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_of_the_manuals_are_read() {
        for (line, value) in [
            ("   123.456", 123.456),
            ("  -12.340", -12.34),
            ("     0.000", 0.0),
            ("+0123.456", 123.456),
            ("-0000.010", -0.01),
        ] {
            assert_eq!(message(line), Some(Message::Value(value, None)), "{line}");
        }
        let long = Some(Message::Value(-12.34, Some(Unit::Inch)));
        assert_eq!(message("001 0000   -12.340 IN"), long);
    }

    #[test]
    fn other_lines_are_what_they_are() {
        assert_eq!(message("MM"), Some(Message::Unit(Unit::Millimetre)));
        assert_eq!(message(" in "), Some(Message::Unit(Unit::Inch)));
        assert_eq!(message("ERR2"), Some(Message::Error(2)));
        assert_eq!(message("OV"), Some(Message::Overflow));
        // A sign that is not glued to its digits, half a value, no value.
        for line in ["- 12.340", "123", "12.", ".5", "SYLVAC - TRIMOS V600", "", "ERR", "1e5.0"] {
            assert_eq!(message(line), None, "{line:?}");
        }
        assert!((Unit::Inch.millimetres(10.0) - 254.0).abs() < 1e-12);
        assert!(error(0).contains("zero"));
        assert!(message("ERR300").is_none());
        message("ERR0").unwrap();
    }
}
