//! Words of Lake Shore's protocol, as a client says and reads them.

/// From kelvin to degrees Celsius.
pub(super) const ZERO_CELSIUS_K: f64 = 273.15;

/// Which reading is asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Scale {
    Celsius,
    Kelvin,
}

impl Scale {
    pub(super) const fn command(self) -> &'static str {
        match self {
            Self::Celsius => "CRDG?",
            Self::Kelvin => "KRDG?",
        }
    }

    /// A reading as degrees Celsius; `None` where it is none, or colder than there is.
    pub(super) fn celsius(self, answer: &str) -> Option<f64> {
        let number =
            answer.bytes().all(|byte| matches!(byte, b'0'..=b'9' | b'+' | b'-' | b'.' | b'E'));
        let value: f64 = answer.parse().ok().filter(|_| number)?;
        let celsius = match self {
            Self::Celsius => value,
            Self::Kelvin => value - ZERO_CELSIUS_K,
        };
        (celsius > -ZERO_CELSIUS_K).then_some(celsius)
    }
}

/// Whether it can be the name of an input: `1`, `A`, `C3`.
pub(super) fn is_channel(name: &str) -> bool {
    (1..=2).contains(&name.len()) && name.bytes().all(|byte| byte.is_ascii_alphanumeric())
}

/// What is wrong with the last reading, from `RDGST?`.
pub(super) fn complaint(status: u16) -> Option<String> {
    const BITS: [(u16, &str); 6] = [
        (0, "the reading is invalid"),
        (1, "the reading is old"),
        (4, "below the temperatures of its curve"),
        (5, "above the temperatures of its curve"),
        (6, "the sensor gives nothing: it is shorted, or none is connected"),
        (7, "the sensor gives too much: it is open, or none is connected"),
    ];
    let set: Vec<&str> =
        BITS.iter().filter(|(bit, _)| status >> bit & 1 == 1).map(|(_, why)| *why).collect();
    match (set.is_empty(), status) {
        (true, 0) => None,
        (true, _) => Some(format!("status {status}, which is not documented")),
        (false, _) => Some(set.join(", ")),
    }
}

/// What the event status register holds against the last command; `None` for nothing.
pub(super) fn refusal(register: u8) -> Option<&'static str> {
    match register {
        it if it & 32 != 0 => Some("it does not know the command"),
        it if it & 16 != 0 => Some("it cannot carry out the command; is there such an input?"),
        it if it & 4 != 0 => Some("query error"),
        _ => None,
    }
}

/// Model, serial number and firmware from `LSCI,MODEL218S,21A1234,080603`.
pub(super) fn identity(answer: &str) -> Option<(String, Option<String>, String)> {
    let mut words = answer.split(',').map(str::trim);
    let (maker, model) = (words.next()?, words.next()?);
    if maker != "LSCI" || model.is_empty() {
        return None;
    }
    let serial = words.next().filter(|word| !word.is_empty()).map(str::to_owned);
    Some((model.to_owned(), serial, words.next().unwrap_or("unknown").to_owned()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn readings_are_degrees_celsius_whichever_is_asked_for() {
        assert_eq!(Scale::Celsius.celsius("+025.250"), Some(25.25));
        assert_eq!(Scale::Celsius.celsius("-000.125"), Some(-0.125));
        assert_eq!(Scale::Kelvin.celsius("+273.150"), Some(0.0));
        // As the emulator of ISIS says it.
        assert_eq!(Scale::Kelvin.celsius("1.0"), Some(-272.15));
        for answer in ["", "+0A5.1", "nan", "inf", "+25.1 C", "1,2"] {
            assert_eq!(Scale::Celsius.celsius(answer), None, "{answer}");
        }
        assert_eq!(Scale::Kelvin.celsius("+000.000"), None, "no curve is assigned");
    }

    #[test]
    fn a_status_is_said_in_words() {
        assert_eq!(complaint(0), None);
        assert!(complaint(128).unwrap().contains("open"));
        assert_eq!(
            complaint(17).unwrap(),
            "the reading is invalid, below the temperatures of its curve"
        );
        assert!(complaint(256).unwrap().contains("256"));
        assert_eq!(refusal(0), None);
        assert_eq!(refusal(128), None, "power on");
        assert!(refusal(32).is_some() && refusal(16).is_some());
    }

    #[test]
    fn identities_of_the_manuals_are_read() {
        let (model, serial, firmware) = identity("LSCI,MODEL218S,21A1234,080603").unwrap();
        assert_eq!((model.as_str(), firmware.as_str()), ("MODEL218S", "080603"));
        assert_eq!(serial.unwrap(), "21A1234");
        assert_eq!(identity("LSCI,MODEL336").unwrap().1, None);
        assert_eq!(identity("KEITHLEY,MODEL 2000,1,2"), None);
    }
}
