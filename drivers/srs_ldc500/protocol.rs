//! Words of the LDC500 command language, as a client says and reads them. A command is four letters;
//! commands end with LF and stay far below the 64 bytes of the input buffer.

/// Ends each command. A lone one is ignored, and ends what another client may have left half sent.
const END: &str = "\n";

/// The opening of a session (manual 4.4): a blank line, then the unlocking. Then answers are made
/// what [`answer`] reads: each its own line, tokens as words. These settings are the interface's own
/// and outlive power off, so they cannot be assumed.
pub(super) const OPENING: &[u8] = b"\nULOC 1\nTERM CRLF\nTOKN ON\n";

/// Output off and set point zero, from any state of the line.
pub(super) const OFF: &[u8] = b"\nLDON OFF\nSILD 0\n";

/// A question.
pub(super) fn question(word: &str) -> Vec<u8> {
    format!("{word}?{END}").into_bytes()
}

/// A setting, as `SILD 40`.
pub(super) fn setting(word: &str, value: &str) -> Vec<u8> {
    format!("{word} {value}{END}").into_bytes()
}

/// A number in a setting: plain digits.
pub(super) fn milliampere(ma: f64) -> String {
    format!("{ma:.3}")
}

/// An answer without its end; `None` where it is no text.
pub(super) fn answer(line: &[u8]) -> Option<&str> {
    let text = std::str::from_utf8(line).ok()?.trim();
    let is_plain = |byte: u8| (b' '..=b'~').contains(&byte);
    (!text.is_empty() && text.bytes().all(is_plain)).then_some(text)
}

/// A number that was answered. What the device writes where it has no reading is no number.
pub(super) fn number(text: &str) -> Option<f64> {
    text.parse().ok().filter(|value: &f64| value.is_finite())
}

/// A token that is on or off.
pub(super) fn switch(text: &str) -> Option<bool> {
    match text {
        "ON" => Some(true),
        "OFF" => Some(false),
        _ => None,
    }
}

/// The token of the safety contact.
pub(super) fn contact(text: &str) -> Option<bool> {
    match text {
        "CLOSED" => Some(true),
        "OPEN" => Some(false),
        _ => None,
    }
}

/// Model with version, and serial number, of `*IDN?`.
pub(super) fn identity(text: &str) -> Option<(String, Option<String>)> {
    let mut parts = text.split(',').map(str::trim);
    let (maker, model) = (parts.next()?.replace('_', " "), parts.next()?);
    let serial = parts.next().map(|it| it.trim_start_matches("s/n").to_owned());
    let version = parts.next().unwrap_or_default();
    Some((format!("{maker} {model} {version}").trim().to_owned(), serial))
}

/// What a code of `LCME?` means (manual 4-54).
pub(super) fn command_error(code: u32) -> &'static str {
    match code {
        1 => "illegal command",
        2 => "undefined command",
        3 => "illegal query",
        4 => "illegal set",
        5 => "missing parameter",
        6 => "extra parameter",
        7 => "null parameter",
        8 => "parameter buffer overflow",
        9 => "bad floating-point number",
        10 => "bad integer",
        11 => "bad integer token",
        12 => "bad token value",
        13 => "bad hex block",
        14 => "unknown token",
        _ => "unknown code",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The strings are those of pymeasure's own tests of its client, and of the recorded wire.
    #[test]
    fn commands_are_those_that_another_client_sends() {
        assert_eq!(question("ILOC"), b"ILOC?\n");
        assert_eq!(setting("LDON", "ON"), b"LDON ON\n");
        assert_eq!(setting("SMOD", "CC"), b"SMOD CC\n");
        assert_eq!(setting("SILD", &milliampere(15.0)), b"SILD 15.000\n");
    }

    #[test]
    fn answers_of_the_manual_and_of_the_wire_are_read() {
        assert_eq!(answer(b"CLOSED\r\n").and_then(contact), Some(true));
        assert_eq!(answer(b"OPEN\n").and_then(contact), Some(false));
        assert_eq!(answer(b"ON\n").and_then(switch), Some(true));
        assert_eq!(answer(b"123.000\r\n").and_then(number), Some(123.0));
        let (model, serial) =
            identity("Stanford_Research_Systems,LDC501,s/n098023,ver2.00").unwrap_or_default();
        assert_eq!(model, "Stanford Research Systems LDC501 ver2.00");
        assert_eq!(serial.as_deref(), Some("098023"));
    }

    #[test]
    fn what_is_damaged_or_no_reading_is_none() {
        for line in [&b"\xe4\xe9\r\n"[..], b"\r\n", b"\xff"] {
            assert_eq!(answer(line), None, "{line:?}");
        }
        assert_eq!(number("NAN"), None);
        assert_eq!((switch("1"), contact("0"), contact("CLOSE")), (None, None, None));
        assert_eq!(identity("nonsense"), None);
    }

    #[test]
    fn nothing_comes_near_the_input_buffer() {
        for bytes in [OPENING, OFF] {
            assert!(bytes.split(|byte| *byte == b'\n').all(|command| command.len() < 32));
            assert!(bytes.len() < 64);
        }
    }
}
