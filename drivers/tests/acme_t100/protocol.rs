//! Words of the Acme T100, as a client says and reads them. Only values: no line, no clock.

/// A question or setting with its end.
pub(super) fn command(words: &str) -> Vec<u8> {
    format!("{words}\r\n").into_bytes()
}

/// What it answers.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Answer {
    /// It did as told.
    Done,
    /// A temperature, degrees Celsius.
    Celsius(f64),
    /// There is no sensor on this channel.
    Open,
    /// It refused, with this code.
    Refused(u8),
    /// Who it is: model and serial number.
    Name(String, String),
}

/// Reads a line; `None` where it is none of the manual's.
pub(super) fn answer(line: &[u8]) -> Option<Answer> {
    let text = std::str::from_utf8(line).ok()?.strip_suffix("\r\n")?;
    let words: Vec<&str> = text.split(' ').collect();
    match words.as_slice() {
        ["OK"] => Some(Answer::Done),
        ["OPEN"] => Some(Answer::Open),
        ["ERR", code] => code.parse().ok().map(Answer::Refused),
        ["ACME", model, serial] => Some(Answer::Name((*model).to_owned(), (*serial).to_owned())),
        // Fahrenheit is no answer: somebody changed the unit behind our back.
        [number, "C"] => number.parse().ok().filter(|t: &f64| t.is_finite()).map(Answer::Celsius),
        _ => None,
    }
}

/// What a code means (manual, table 3).
pub(super) fn meaning(code: u8) -> &'static str {
    match code {
        1 => "it does not know the command",
        2 => "it is busy; ask again in a second",
        _ => "a code that its manual does not have",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The lines of the manual's examples, byte for byte.
    #[test]
    fn the_manuals_examples_are_read() {
        assert_eq!(command("T? 2"), b"T? 2\r\n");
        assert_eq!(answer(b"+21.250 C\r\n"), Some(Answer::Celsius(21.25)));
        assert_eq!(answer(b"OPEN\r\n"), Some(Answer::Open));
        assert_eq!(answer(b"ERR 2\r\n"), Some(Answer::Refused(2)));
        let name = Answer::Name("T100".to_owned(), "4711".to_owned());
        assert_eq!(answer(b"ACME T100 4711\r\n"), Some(name));
    }

    #[test]
    fn what_is_damaged_or_in_fahrenheit_is_no_answer() {
        for line in [&b"+70.250 F\r\n"[..], b"+21.2", b"+21.2\r\n", b"nan C\r\n", b"\x8e\r\n"] {
            assert_eq!(answer(line), None, "{line:?}");
        }
    }
}
