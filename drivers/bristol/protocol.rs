//! Words of the Bristol SCPI dialect, as a client says and reads them.

/// The next measurement's frequency, THz.
pub(super) const FREQUENCY: &str = ":READ:FREQuency?";
/// What is questionable about the last measurement.
pub(super) const CONDITION: &str = ":STATus:QUEStionable:CONDition?";
/// Takes the oldest error from the queue.
pub(super) const ERROR: &str = ":SYSTem:ERRor?";

/// Speed of light, nm times THz.
const LIGHT_NM_THZ: f64 = 299_792.458;
/// What these meters measure, with room on both sides: 350 nm to 13 um.
const RANGE_THZ: std::ops::RangeInclusive<f64> = 23.0..=860.0;
/// Fewer digits than these would be a resolution coarser than 1 ppm.
const FEWEST_DIGITS: usize = 7;

/// Telnet's escape, WILL to DONT, and the two ends of a subnegotiation.
const IAC: u8 = 0xff;
const OPTIONS: std::ops::RangeInclusive<u8> = 0xfb..=0xfe;
const SUBNEGOTIATION: u8 = 0xfa;
const END: u8 = 0xf0;

/// A line without telnet's commands and without its end.
pub(super) fn text(line: &[u8]) -> String {
    let mut out = Vec::with_capacity(line.len());
    let mut rest = line.iter().copied();
    while let Some(byte) = rest.next() {
        if byte != IAC {
            out.push(byte);
            continue;
        }
        match rest.next() {
            Some(IAC) => out.push(IAC),
            Some(command) if OPTIONS.contains(&command) => drop(rest.next()),
            Some(SUBNEGOTIATION) => while rest.next().is_some_and(|byte| byte != END) {},
            _ => {}
        }
    }
    String::from_utf8_lossy(&out).trim().to_owned()
}

/// What an answer to [`FREQUENCY`] says.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Frequency {
    /// Nothing was measured.
    None,
    /// The wavelength in vacuum, nm.
    Vacuum(f64),
}

/// Reads a frequency; `None` where it is none that such a meter could mean in THz.
pub(super) fn frequency(answer: &str) -> Option<Frequency> {
    let thz: f64 = answer.parse().ok()?;
    if thz == 0.0 {
        return Some(Frequency::None);
    }
    let mantissa = answer.split(['e', 'E']).next().unwrap_or_default();
    let digits = mantissa.bytes().filter(u8::is_ascii_digit).count();
    let known = RANGE_THZ.contains(&thz) && digits >= FEWEST_DIGITS;
    known.then(|| Frequency::Vacuum(LIGHT_NM_THZ / thz))
}

/// What is wrong with the last measurement, from the questionable register. That a value was read
/// before (bit 0) says nothing against it.
pub(super) fn complaint(register: u32) -> Option<String> {
    const BITS: [(u32, &str); 9] = [
        (8, "no measurable signal"),
        (7, "the signal is low"),
        (6, "the detector is saturated"),
        (5, "the wavelength is outside its range"),
        (4, "its temperature is outside its range"),
        (9, "the air pressure is outside its range"),
        (3, "the power is outside its range"),
        (2, "its last calibration failed"),
        (10, "its hardware reports a fault"),
    ];
    let set: Vec<&str> =
        BITS.iter().filter(|(bit, _)| register >> bit & 1 == 1).map(|(_, why)| *why).collect();
    let unknown = register & !0x7fd;
    match (set.is_empty(), unknown) {
        (true, 0) => None,
        (true, _) => Some(format!("questionable register {register}, which is not documented")),
        (false, _) => Some(set.join(", ")),
    }
}

/// An entry of the error queue, `-113,"Undefined header"`: its number and words.
pub(super) fn error(answer: &str) -> Option<(i32, String)> {
    let (number, words) = answer.split_once(',')?;
    Some((number.trim().parse().ok()?, words.trim().trim_matches('"').to_owned()))
}

/// Model, serial number and firmware from `BRISTOL WAVELENGTH METER, 671, 1135, 1.03`.
pub(super) fn identity(answer: &str) -> Option<(String, String, String)> {
    let mut words = answer.split(',').map(|word| word.trim().to_owned());
    let maker = words.next()?;
    let (model, serial, firmware) = (words.next()?, words.next()?, words.next()?);
    maker.starts_with("BRISTOL").then_some((model, serial, firmware))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn telnet_is_stripped_wherever_it_stands() {
        assert_eq!(text(b"\xff\xfb\x01\xff\xfb\x03Welcome\r\n"), "Welcome");
        assert_eq!(text(b"455.6\xff\xfd\x1812345\r\n"), "455.612345");
        assert_eq!(text(b"\xff\xfa\x18\x01\xff\xf0ready\r\n"), "ready");
        assert_eq!(text(b"ends early\xff\xfb"), "ends early");
    }

    #[test]
    fn a_frequency_becomes_the_wavelength_in_vacuum() {
        // The helium-neon line: 473.612353604 THz is 632.99121258 nm in vacuum (BIPM).
        let Some(Frequency::Vacuum(nm)) = frequency("473.612353604") else { unreachable!() };
        assert!((nm - 632.991_212_58).abs() < 1e-8, "{nm}");
        assert_eq!(frequency("0.0000000"), Some(Frequency::None));
        // Gigahertz, a wavelength, too few digits, no number.
        for answer in ["473612.3536", "4.73e-7", "473.6", "1e999", "nan", "ERR", ""] {
            assert_eq!(frequency(answer), None, "{answer}");
        }
    }

    #[test]
    fn what_is_questionable_is_said() {
        assert_eq!(complaint(0), None);
        assert_eq!(complaint(1), None, "it was read before");
        assert_eq!(complaint(257).unwrap(), "no measurable signal");
        assert_eq!(
            complaint(128 | 8).unwrap(),
            "the signal is low, the power is outside its range"
        );
        assert!(complaint(1 << 20).unwrap().contains("not documented"));
    }

    #[test]
    fn answers_of_the_manual_are_read() {
        let (model, serial, firmware) =
            identity("BRISTOL WAVELENGTH METER, 671, 1135, 1.03").unwrap();
        assert_eq!((model.as_str(), serial.as_str(), firmware.as_str()), ("671", "1135", "1.03"));
        assert_eq!(identity("ACME, 1, 2, 3"), None);
        assert_eq!(error("0,\"No Error\""), Some((0, "No Error".to_owned())));
        assert_eq!(
            error("-113, \"Undefined header\""),
            Some((-113, "Undefined header".to_owned()))
        );
        assert_eq!(error("455.6"), None);
    }
}
