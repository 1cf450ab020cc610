//! Words of the Arroyo command language, as a client says and reads them. Each command goes on a
//! line of its own, so that no path is remembered from one to the next, and the 128 characters of
//! the input buffer are never near.

/// What every session begins with: no echo, answers that end with CR LF, whole numbers in decimal,
/// floating-point ones as text (manual: TERMINAL, TERM, RADix, HEXFLOAT). All are settings that
/// somebody may have left otherwise. Models without hex floats answer the last with an error, which
/// is read away.
pub(super) const OPENING: &[u8] = b"\nTERMINAL 0\nTERM 0\nRAD DEC\nHEXFLOAT 0\n";

/// Output off and set point zero, from any state of the line.
pub(super) const OFF: &[u8] = b"\nLAS:OUT 0\nLAS:LDI 0\n";

/// Bits of `LASer:COND?`.
pub(super) const INTERLOCK_OPEN: u32 = 1 << 4;
/// Current flows.
pub(super) const OUTPUT_ON: u32 = 1 << 10;

/// Bits of `LASer:ENABle:OUTOFF`: temperature control off, and its temperature limit.
pub(super) const OFF_WITHOUT_TEC: u32 = (1 << 10) | (1 << 11);

/// Bits of `TEC:COND?` with which there is no temperature: sensor limit, shorted, open.
pub(super) const NO_SENSOR: u32 = (1 << 2) | (1 << 5) | (1 << 6);

/// Longest on-delay that can be set, ms.
pub(super) const LONGEST_DELAY_MS: u32 = 30_000;

/// A command with its end.
pub(super) fn line(words: &str) -> Vec<u8> {
    format!("{words}\n").into_bytes()
}

/// An answer without its end; `None` where it is no text.
pub(super) fn answer(line: &[u8]) -> Option<&str> {
    let text = std::str::from_utf8(line).ok()?.trim();
    let is_plain = |byte: u8| (b' '..=b'~').contains(&byte);
    (!text.is_empty() && text.bytes().all(is_plain)).then_some(text)
}

/// A floating-point number.
pub(super) fn number(text: &str) -> Option<f64> {
    text.parse().ok().filter(|value: &f64| value.is_finite())
}

/// A whole number, a register.
pub(super) fn whole(text: &str) -> Option<u32> {
    text.parse().ok()
}

/// 0 or 1.
pub(super) fn switch(text: &str) -> Option<bool> {
    match text {
        "0" => Some(false),
        "1" => Some(true),
        _ => None,
    }
}

/// The codes of `ERR?`; empty for none.
pub(super) fn errors(text: &str) -> Option<Vec<u32>> {
    let codes: Option<Vec<u32>> = text.split(',').map(|code| code.trim().parse().ok()).collect();
    codes.map(|codes| codes.into_iter().filter(|code| *code != 0).collect())
}

/// Model with version, and serial number, of `*IDN?`: `Arroyo Model SN Ver Build`.
pub(super) fn identity(text: &str) -> Option<(String, Option<String>)> {
    let mut words = text.split_whitespace();
    let (maker, model) = (words.next()?, words.next()?);
    let serial = words.next().map(str::to_owned);
    let version = words.next().unwrap_or_default();
    Some((format!("{maker} {model} {version}").trim().to_owned(), serial))
}

/// What a code of `ERR?` means (manual, "Error Messages").
pub(super) fn meaning(code: u32) -> &'static str {
    match code {
        100 => "general error",
        102 => "message too long",
        104 => "type not allowed",
        123 => "it does not know the command",
        124 => "data of the wrong form",
        126 => "too few or too many values",
        127 => "cannot be changed",
        201 => "value out of its range",
        202 => "value of the wrong type",
        204 => "number base of the wrong form",
        303 => "input buffer overrun",
        402 => "temperature sensor open",
        403 => "temperature module open",
        404 => "temperature control at its current limit",
        405 => "temperature control at its voltage limit",
        406 | 407 => "temperature limit exceeded",
        410 => "temperature out of tolerance",
        415 => "temperature sensor shorted",
        438 | 439 => "thermal run-away",
        501 => "interlock open",
        504 => "laser off at its current limit",
        505 => "laser off at its voltage limit",
        506 | 507 => "laser off at its photodiode limit",
        508 => "laser off because the temperature control is off",
        509 => "laser off: short circuit",
        510 => "laser off: out of tolerance",
        511 => "laser off: control error",
        514 => "laser off: its mode was changed",
        521 => "laser off at the temperature limit",
        537..=539 => "laser off: too hot",
        998 => "not supported by this model",
        _ => "see the manual",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn answers_in_the_forms_of_the_manual_are_read() {
        assert_eq!(errors("0"), Some(vec![]));
        assert_eq!(errors("201,124"), Some(vec![201, 124]));
        assert_eq!(answer(b"40350\r\n").and_then(whole), Some(40_350));
        assert_eq!(answer(b"10.00\r\n").and_then(number), Some(10.0));
        assert_eq!((switch("1"), switch("0")), (Some(true), Some(false)));
        let (model, serial) = identity("Arroyo 6305 1104123 2.43 1205").unwrap_or_default();
        assert_eq!((model.as_str(), serial.as_deref()), ("Arroyo 6305 2.43", Some("1104123")));
    }

    /// The manual's examples of other bases: with those, something has undone the opening.
    #[test]
    fn other_number_bases_are_not_taken_for_decimal() {
        for text in ["#HBA13", "#O135023", "#B1011101000010011"] {
            assert_eq!((whole(text), switch(text), errors(text)), (None, None, None), "{text}");
        }
        assert_eq!(number("#E42F6E666"), None);
        assert_eq!(number("nan"), None);
        assert_eq!((answer(b"\r\n"), answer(b"\x95\x94\r\n")), (None, None));
    }

    /// The default of the output-off register is printed in the manual as a sum and bit by bit.
    #[test]
    fn the_default_of_the_output_off_register_has_the_temperature_control_in_it() {
        assert_eq!(40_350 & OFF_WITHOUT_TEC, OFF_WITHOUT_TEC);
        assert_eq!(40_350 & INTERLOCK_OPEN, INTERLOCK_OPEN);
    }

    #[test]
    fn nothing_comes_near_the_input_buffer() {
        for bytes in [OPENING, OFF] {
            assert!(bytes.len() < 128 && bytes.ends_with(b"\n"));
        }
    }
}
