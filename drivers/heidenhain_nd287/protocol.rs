//! Words of the ND 287, as a client says and reads them (manual, page 108).

/// Comes before each text.
pub(super) const STX: u8 = 0x02;
/// "Invalid command", a byte alone.
pub(super) const NAK: u8 = 0x15;

/// Who it is: three lines of ten characters.
pub(super) const IDENTITY: &[u8] = b"\x1bA0000\r";
/// The position as it is displayed.
pub(super) const POSITION: &[u8] = b"\x1bA0100\r";
/// The error that is displayed, if any.
pub(super) const ERROR: &[u8] = b"\x1bA0301\r";
/// The status bar.
pub(super) const STATUS: &[u8] = b"\x1bA0800\r";

/// Millimetres in an inch.
const INCH_MM: f64 = 25.4;

/// Reads the status bar: how many millimetres the unit has. Eight digits: operating mode, display
/// mode, scale factor, compensation, stopwatch, unit, datum, page of soft keys.
///
/// # Errors
/// What is against reading positions, for people; nothing where it is no status bar.
pub(super) fn millimetres(status: &str) -> Result<f64, Option<&'static str>> {
    let digits: Vec<char> = status.chars().filter(|c| !c.is_whitespace()).collect();
    let [mode, _, scale, _, _, unit, _, _] = digits[..] else { return Err(None) };
    if digits.iter().any(|digit| !digit.is_ascii_digit()) {
        return Err(None);
    }
    if mode != '0' {
        return Err(Some("it shows the distance to go: switch it to ACTUAL VALUE"));
    }
    if scale != '0' {
        return Err(Some("its scale factor (SCL) is active: switch it off"));
    }
    match unit {
        '0' => Ok(1.0),
        '1' => Ok(INCH_MM),
        _ => Err(Some("it shows an angle: it is set up for a rotary encoder")),
    }
}

/// Reads a displayed position, `-12345.6789`, in its unit.
pub(super) fn position(text: &str) -> Option<f64> {
    let text: String = text.chars().filter(|c| *c != ' ').collect();
    let digits = text.strip_prefix(['-', '+']).unwrap_or(&text);
    let (whole, part) = digits.split_once('.')?;
    let are_digits = |text: &str| !text.is_empty() && text.bytes().all(|b| b.is_ascii_digit());
    (are_digits(whole) && are_digits(part)).then(|| text.parse().ok())?
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positions_are_read_with_their_point() {
        // The manual's example.
        assert_eq!(position("-12345.6789"), Some(-12345.6789));
        assert_eq!(position("     12.5000"), Some(12.5));
        assert_eq!(position("+0.0000"), Some(0.0));
        for text in ["123456789", "12.34.56", "SIGNAL X1", "", "1.", "-.5", "1e5.0"] {
            assert_eq!(position(text), None, "{text}");
        }
    }

    #[test]
    fn the_status_bar_tells_the_unit() {
        assert_eq!(millimetres("00000011"), Ok(1.0));
        assert_eq!(millimetres("0 0 0 1 0 1 2 1"), Ok(25.4));
        for (status, part) in
            [("10000011", "distance"), ("00100011", "scale"), ("00000211", "angle")]
        {
            assert!(
                matches!(millimetres(status), Err(Some(why)) if why.contains(part)),
                "{status}"
            );
        }
        for status in ["", "0000001", "000000111", "0000x011"] {
            assert_eq!(millimetres(status), Err(None), "{status}");
        }
    }
}
