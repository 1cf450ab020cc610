//! Words of the SMC100's line protocol, as a client says and reads them.

/// A command to one controller as bytes.
pub(super) fn command(address: u32, words: &str) -> Vec<u8> {
    format!("{address}{words}\r\n").into_bytes()
}

/// What stands behind the echo of the question; `None` where the line is no answer to it.
pub(super) fn answer(address: u32, question: &str, line: &[u8]) -> Option<String> {
    let text = std::str::from_utf8(line).ok()?.trim();
    let behind = text.strip_prefix(&address.to_string())?.strip_prefix(question)?;
    Some(behind.trim().to_owned())
}

/// The state of a controller, without how it came into it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum State {
    /// After power on, a reset, or a search that failed.
    NotReferenced,
    /// Its configuration is being written.
    Configuration,
    /// It searches its reference.
    Homing,
    /// On its way.
    Moving,
    /// It stands and holds.
    Ready,
    /// It stands with its motor off.
    Disabled,
    /// Moved by its keypad.
    Jogging,
}

impl State {
    /// For people.
    pub(super) const fn words(self) -> &'static str {
        match self {
            Self::NotReferenced => "not homed",
            Self::Configuration => "being configured",
            Self::Homing => "searching its reference",
            Self::Moving => "moving",
            Self::Ready => "ready",
            Self::Disabled => "without power on its motor",
            Self::Jogging => "moved by its keypad",
        }
    }
}

/// What `TS` answers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Status {
    pub(super) faults: u16,
    pub(super) state: State,
}

/// Reads the answer to `TS`: four hexadecimal digits of faults and two of the state.
pub(super) fn status(text: &str) -> Option<Status> {
    if text.len() != 6 || !text.bytes().all(|byte| byte.is_ascii_hexdigit()) {
        return None;
    }
    let faults = u16::from_str_radix(&text[..4], 16).ok()?;
    let state = match u8::from_str_radix(&text[4..], 16).ok()? {
        0x0a..=0x11 => State::NotReferenced,
        0x14 => State::Configuration,
        0x1e | 0x1f => State::Homing,
        0x28 => State::Moving,
        0x32..=0x35 => State::Ready,
        0x3c..=0x3e => State::Disabled,
        0x46 | 0x47 => State::Jogging,
        _ => return None,
    };
    Some(Status { faults, state })
}

/// What the letter of `TE` says is wrong; `None` for `@`, which is nothing.
pub(super) fn error(letter: &str) -> Option<&str> {
    Some(match letter {
        "@" => return None,
        "A" => "it does not know the command",
        "B" => "the controller's address is wrong",
        "C" => "the value is missing or out of its range",
        "D" => "it does not allow the command",
        "E" => "it searches its reference already",
        "F" => "it does not know the stage",
        "G" => "the target is beyond the controller's own limits",
        "H" => "it has not been homed",
        "I" => "it is being configured",
        "J" => "its motor is off",
        "K" => "it is ready, and takes this only when it is not",
        "L" => "it searches its reference",
        "M" => "it is moving",
        "N" => "it stands beyond the controller's own limits",
        "S" => "it lost part of the command",
        "U" => "its memory failed",
        "V" => "it failed to carry it out",
        "W" | "X" => "this model has no such command",
        other => other,
    })
}

/// What the fault bits of `TS` say.
pub(super) fn faults(bits: u16) -> String {
    const NAMES: [(u16, &str); 10] = [
        (0x0001, "at the negative end of its travel"),
        (0x0002, "at the positive end of its travel"),
        (0x0004, "peak current too high"),
        (0x0008, "mean current too high"),
        (0x0010, "short circuit"),
        (0x0020, "it did not follow: blocked or overloaded"),
        (0x0040, "the search for its reference took too long"),
        (0x0080, "it is not the stage that the controller is set up for"),
        (0x0100, "supply voltage too low"),
        (0x0200, "output power too high"),
    ];
    let named: Vec<&str> =
        NAMES.iter().filter(|(bit, _)| bits & bit != 0).map(|(_, name)| *name).collect();
    if named.is_empty() { format!("fault bits {bits:04X}") } else { named.join(", ") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn answers_stand_behind_the_echo_of_their_question() {
        assert_eq!(command(1, "TP"), b"1TP\r\n");
        assert_eq!(answer(1, "TP", b"1TP4.81698\r\n").as_deref(), Some("4.81698"));
        assert_eq!(answer(31, "TE", b"31TE@\r\n").as_deref(), Some("@"));
        for (address, question, line) in
            [(1, "TP", "1TE@\r\n"), (2, "TP", "1TP0.0\r\n"), (1, "TP", "TP0.0\r\n"), (1, "TP", "")]
        {
            assert_eq!(answer(address, question, line.as_bytes()), None, "{line}");
        }
        assert_eq!(answer(1, "TP", b"\x94\xf1\xf5\x95\r\n"), None);
    }

    #[test]
    fn the_state_is_read_apart_from_the_faults() {
        // As in the recording of yaqd-newport.
        for (text, state) in [
            ("00000A", State::NotReferenced),
            ("000011", State::NotReferenced),
            ("00001E", State::Homing),
            ("000028", State::Moving),
            ("000032", State::Ready),
            ("000033", State::Ready),
            ("00003D", State::Disabled),
        ] {
            assert_eq!(status(text), Some(Status { faults: 0, state }), "{text}");
        }
        let blocked = Status { faults: 0x20, state: State::Disabled };
        assert_eq!(status("00203D"), Some(blocked));
        assert!(faults(0x20).contains("did not follow"));
        for text in ["", "000099", "0000", "+00033", "00000A00"] {
            assert_eq!(status(text), None, "{text}");
        }
    }

    #[test]
    fn every_letter_but_one_is_an_error() {
        assert_eq!(error("@"), None);
        for letter in ["A", "G", "H", "Z", ""] {
            assert!(error(letter).is_some(), "{letter}");
        }
    }
}
