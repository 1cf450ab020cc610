//! Words of the Zaber ASCII protocol, as a client says and reads them.

/// What stands in a reply.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Reply {
    pub(super) device: u8,
    pub(super) axis: u8,
    /// The number of the command it answers.
    pub(super) id: Option<u8>,
    pub(super) accepted: bool,
    pub(super) busy: bool,
    /// The most important warning flag; `--` for none.
    pub(super) warning: String,
    pub(super) data: String,
}

/// A line from the device.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Message {
    Reply(Reply),
    /// An alert or an information line: nobody's answer.
    Aside,
}

/// A command as bytes, with its check sum.
pub(super) fn command(device: u32, axis: u32, id: u8, words: &str) -> Vec<u8> {
    let space = if words.is_empty() { "" } else { " " };
    let body = format!("{device} {axis} {id:02}{space}{words}");
    format!("/{body}:{:02X}\n", check_sum(body.as_bytes())).into_bytes()
}

/// The two's complement of the sum of the bytes between first character and colon.
pub(super) fn check_sum(bytes: &[u8]) -> u8 {
    bytes.iter().fold(0_u8, |sum, byte| sum.wrapping_add(*byte)).wrapping_neg()
}

/// Reads a line without its end; `None` where it is none of the protocol's or its check sum is wrong.
pub(super) fn message(line: &[u8]) -> Option<Message> {
    let text = std::str::from_utf8(line).ok()?.trim_end_matches(['\r', '\n']);
    let (first, rest) = text.split_at_checked(1)?;
    let body = match rest.rsplit_once(':') {
        Some((body, sum)) if sum.len() == 2 => {
            let sum = u8::from_str_radix(sum, 16).ok()?;
            if sum != check_sum(body.as_bytes()) {
                return None;
            }
            body
        }
        _ => rest,
    };
    match first {
        "!" | "#" => Some(Message::Aside),
        "@" => reply(body).map(Message::Reply),
        _ => None,
    }
}

fn reply(body: &str) -> Option<Reply> {
    let mut words = body.split(' ');
    let device = words.next()?.parse().ok()?;
    let axis = words.next()?.parse().ok()?;
    let mut word = words.next()?;
    let id = word.parse::<u8>().ok();
    if id.is_some() {
        word = words.next()?;
    }
    let accepted = match word {
        "OK" => true,
        "RJ" => false,
        _ => return None,
    };
    let busy = match words.next()? {
        "BUSY" => true,
        "IDLE" => false,
        _ => return None,
    };
    let warning = words.next()?.to_owned();
    let data = words.collect::<Vec<_>>().join(" ");
    Some(Reply { device, axis, id, accepted, busy, warning, data })
}

/// What a rejection means.
pub(super) fn rejection(word: &str) -> &str {
    match word {
        "AGAIN" => "it cannot process this now",
        "BADAXIS" => "it has no such axis",
        "BADCOMMAND" => "it does not know the command",
        "BADDATA" => "the value is out of its range",
        "BADMESSAGEID" => "bad message number",
        "DEVICEONLY" => "the command is for the device, not for an axis",
        "AXISONLY" => "the command is for an axis, not for the device",
        "DRIVERDISABLED" => "the motor driver is disabled",
        "FULL" => "its queue is full",
        "PARKED" => "the axis is parked",
        "PERIPHERALINACTIVE" => "the peripheral is not active",
        "STATUSBUSY" => "it is busy",
        other => other,
    }
}

/// The flag of a move that was interrupted.
pub(super) const INTERRUPTED: &str = "NI";

/// Why a move that ended did not end well, from the warning flag of the reply.
pub(super) fn failure(flag: &str) -> Option<&'static str> {
    Some(match flag {
        "FF" => "critical system error",
        "FN" | "FZ" => "fault of the peripheral",
        "FH" => "emergency stop is pressed",
        "FV" => "supply voltage out of range",
        "FO" | "FD" => "the motor driver is off",
        "FC" => "inrush current fault",
        "FM" => "motor too hot",
        "FQ" => "encoder error",
        "FI" => "index error",
        "FA" => "analog encoder error",
        "FR" => "overdrive limit exceeded",
        "FS" => "it stalled",
        "FB" | "FP" => "stream fault",
        "FE" => "limit error",
        "FT" => "excessive twist",
        "WL" => "it met a limit sensor unexpectedly",
        "WS" => "it stalled and recovered",
        INTERRUPTED => "stopped on the way",
        _ => return None,
    })
}

/// Whether the flag says that positions mean nothing yet.
pub(super) fn has_no_reference(flag: &str) -> bool {
    matches!(flag, "WR" | "WH")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn check_sums_are_those_of_the_manual() {
        for (body, sum) in [
            ("0 0 00", 0x00),
            ("1 0 1 get pos", 0x5c),
            ("1 1 02 home", 0x33),
            ("01 0 00 OK IDLE WR 0", 0xbe),
        ] {
            assert_eq!(check_sum(body.as_bytes()), sum, "{body}");
        }
        assert_eq!(command(1, 1, 2, "home"), b"/1 1 02 home:33\n");
        assert_eq!(command(1, 1, 3, ""), b"/1 1 03:FB\n");
    }

    #[test]
    fn replies_are_read_with_and_without_number_and_check_sum() {
        let with = message(b"@01 1 04 OK BUSY -- 0:E3\r\n");
        let Some(Message::Reply(reply)) = with else { unreachable!("{with:?}") };
        assert_eq!((reply.device, reply.axis, reply.id), (1, 1, Some(4)));
        assert!(reply.accepted && reply.busy && reply.warning == "--" && reply.data == "0");
        let without = message(b"@01 0 RJ IDLE WR BADDATA");
        let Some(Message::Reply(reply)) = without else { unreachable!("{without:?}") };
        assert_eq!((reply.id, reply.accepted, reply.data.as_str()), (None, false, "BADDATA"));
        assert_eq!(message(b"!01 1 IDLE --\r\n"), Some(Message::Aside));
        assert_eq!(message(b"#01 0 cont text\r\n"), Some(Message::Aside));
    }

    #[test]
    fn what_is_damaged_is_no_message() {
        for line in ["@01 1 04 OK BUSY -- 1:E3", "01 1 OK", "@01 1 04 OK", "@x 1 OK IDLE -- 0", ""]
        {
            assert_eq!(message(line.as_bytes()), None, "{line}");
        }
    }
}
