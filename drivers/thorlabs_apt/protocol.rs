//! Messages of the APT protocol, as a host writes and reads them. Names are those of the
//! protocol's document without `MGMSG`.

use std::ops::RangeInclusive;

pub(super) const HW_RESPONSE: u16 = 0x0080;
pub(super) const HW_RICH_RESPONSE: u16 = 0x0081;
pub(super) const HW_STOP_UPDATE_MESSAGES: u16 = 0x0012;
pub(super) const HW_REQ_INFO: u16 = 0x0005;
pub(super) const HW_GET_INFO: u16 = 0x0006;
pub(super) const MOD_SET_CHANNEL_ENABLE: u16 = 0x0210;
pub(super) const MOT_REQ_POSITION_COUNTER: u16 = 0x0411;
pub(super) const MOT_GET_POSITION_COUNTER: u16 = 0x0412;
pub(super) const MOT_SET_VELOCITY: u16 = 0x0413;
pub(super) const MOT_REQ_VELOCITY: u16 = 0x0414;
pub(super) const MOT_GET_VELOCITY: u16 = 0x0415;
pub(super) const MOT_REQ_STATUS_BITS: u16 = 0x0429;
pub(super) const MOT_GET_STATUS_BITS: u16 = 0x042a;
pub(super) const MOT_MOVE_HOME: u16 = 0x0443;
pub(super) const MOT_MOVE_ABSOLUTE: u16 = 0x0453;
pub(super) const MOT_MOVE_STOP: u16 = 0x0465;

const HOST: u8 = 0x01;
/// A controller with its own USB connector.
const UNIT: u8 = 0x50;
/// In the destination: data follow.
const LONG: u8 = 0x80;
/// More than any message of a motor controller has. What claims more is no header.
const LONGEST: usize = 128;

/// The length of a header, and of a message without data.
pub(super) const HEADER: usize = 6;

/// A message without data.
pub(super) fn short(id: u16, first: u8, second: u8) -> Vec<u8> {
    let [low, high] = id.to_le_bytes();
    vec![low, high, first, second, UNIT, HOST]
}

/// A message with data.
pub(super) fn long(id: u16, data: &[u8]) -> Vec<u8> {
    let ([low, high], length) = (id.to_le_bytes(), data.len() as u8);
    let mut bytes = vec![low, high, length, 0, UNIT | LONG, HOST];
    bytes.extend_from_slice(data);
    bytes
}

/// What a header says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Header {
    pub(super) id: u16,
    /// How many bytes of data follow.
    pub(super) data: usize,
}

/// Reads a header to us; `None` where it is none. There is no check sum, and no byte that a message
/// begins with: what is no header means that the place is lost.
pub(super) fn header(bytes: &[u8]) -> Option<Header> {
    // The source is not looked at: some firmware leaves it zero.
    let [id_low, id_high, first, second, to, _] = *bytes else { return None };
    if to & !LONG != HOST {
        return None;
    }
    let data = if to & LONG == 0 { 0 } else { usize::from(u16::from_le_bytes([first, second])) };
    (data <= LONGEST).then_some(Header { id: u16::from_le_bytes([id_low, id_high]), data })
}

/// The bytes of a field.
fn field<const N: usize>(data: &[u8], at: usize) -> Option<[u8; N]> {
    data.get(at..at + N)?.try_into().ok()
}

/// The channel that data are of.
pub(super) fn channel(data: &[u8]) -> Option<u16> {
    field(data, 0).map(u16::from_le_bytes)
}

/// The position in a position counter or a status update.
pub(super) fn position(data: &[u8]) -> Option<i32> {
    field(data, 2).map(i32::from_le_bytes)
}

/// The bits of a status.
pub(super) fn bits(data: &[u8]) -> Option<Bits> {
    field(data, 2).map(u32::from_le_bytes).map(Bits)
}

/// How a channel moves, in the controller's own units.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Velocity {
    pub(super) lowest: i32,
    pub(super) acceleration: i32,
    pub(super) highest: i32,
}

pub(super) fn velocity(data: &[u8]) -> Option<Velocity> {
    let number = |at| field(data, at).map(i32::from_le_bytes);
    Some(Velocity { lowest: number(2)?, acceleration: number(6)?, highest: number(10)? })
}

pub(super) fn velocity_data(channel: u16, it: Velocity) -> Vec<u8> {
    let mut data = channel.to_le_bytes().to_vec();
    for number in [it.lowest, it.acceleration, it.highest] {
        data.extend(number.to_le_bytes());
    }
    data
}

/// The data of a move to a place.
pub(super) fn target_data(channel: u16, counts: i32) -> Vec<u8> {
    [&channel.to_le_bytes()[..], &counts.to_le_bytes()[..]].concat()
}

/// Who a controller is.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Info {
    pub(super) serial: u32,
    pub(super) model: String,
    pub(super) firmware: String,
}

pub(super) fn info(data: &[u8]) -> Option<Info> {
    let serial = field(data, 0).map(u32::from_le_bytes)?;
    let model = text(data, 4..=11)?;
    let [interim, minor, major] = field(data, 14)?;
    Some(Info { serial, model, firmware: format!("{major}.{minor}.{interim}") })
}

/// What a controller has to say of a command that it did not carry out.
pub(super) fn complaint(data: &[u8]) -> String {
    let code = field(data, 2).map_or(0, u16::from_le_bytes);
    let notes = text(data, 4..=data.len().saturating_sub(1)).unwrap_or_default();
    format!("{notes} (code {code})")
}

fn text(data: &[u8], at: RangeInclusive<usize>) -> Option<String> {
    let bytes: Vec<u8> = data.get(at)?.iter().copied().take_while(|byte| *byte != 0).collect();
    Some(String::from_utf8_lossy(&bytes).trim().to_owned())
}

/// The status of a channel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Bits(pub(super) u32);

impl Bits {
    const fn any(self, mask: u32) -> bool {
        self.0 & mask != 0
    }

    /// Moving or jogging, in either direction.
    pub(super) const fn is_moving(self) -> bool {
        self.any(0x0000_00f0)
    }

    pub(super) const fn is_homing(self) -> bool {
        self.any(0x0000_0200)
    }

    pub(super) const fn is_homed(self) -> bool {
        self.any(0x0000_0400)
    }

    pub(super) const fn is_enabled(self) -> bool {
        self.any(0x8000_0000)
    }

    /// At one of its limit switches.
    pub(super) const fn is_at_limit(self) -> bool {
        self.any(0x0000_0003)
    }

    /// What is wrong with it. Bits that come and go in every move are not here: the current limit,
    /// the interlock, of which models differ in the sense.
    pub(super) fn fault(self) -> Option<&'static str> {
        const FAULTS: [(u32, &str); 4] = [
            (0x0000_4000, "it did not follow: blocked or overloaded"),
            (0x0002_0000, "motor too hot"),
            (0x0000_8000, "fault of the motor's electronics"),
            (0x4000_0000, "error"),
        ];
        FAULTS.iter().find(|(bit, _)| self.any(*bit)).map(|(_, why)| *why)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_are_those_that_real_clients_send() {
        // thorlabs-apt-device, and pylablib.
        assert_eq!(short(0x0490, 1, 0), [0x90, 0x04, 0x01, 0x00, 0x50, 0x01]);
        assert_eq!(short(MOT_MOVE_HOME, 1, 0), [0x43, 0x04, 0x01, 0x00, 0x50, 0x01]);
        assert_eq!(short(MOT_MOVE_STOP, 1, 2), [0x65, 0x04, 0x01, 0x02, 0x50, 0x01]);
        assert_eq!(
            long(MOT_MOVE_ABSOLUTE, &target_data(1, 100_000)),
            [0x53, 0x04, 0x06, 0x00, 0xd0, 0x01, 0x01, 0x00, 0xa0, 0x86, 0x01, 0x00]
        );
    }

    #[test]
    fn answers_are_read_as_recorded() {
        let status = [0x2a, 0x04, 0x06, 0x00, 0x81, 0x50];
        assert_eq!(header(&status), Some(Header { id: MOT_GET_STATUS_BITS, data: 6 }));
        assert_eq!(header(&[0x44, 0x04, 0x01, 0x00, 0x01, 0x50]).map(|it| it.data), Some(0));
        let moving = bits(&[1, 0, 0x10, 0x04, 0x00, 0x80]).unwrap();
        assert!(moving.is_moving() && moving.is_homed() && moving.is_enabled());
        assert!(!moving.is_homing() && moving.fault().is_none());
        let fresh = bits(&[1, 0, 0, 0, 0, 0x80]).unwrap();
        assert!(!fresh.is_moving() && !fresh.is_homed());
        assert_eq!(position(&[1, 0, 0xa0, 0x86, 0x01, 0x00]), Some(100_000));
        let mut data = vec![0xc1, 0xfc, 0x9b, 0x01];
        data.extend(b"KDC101\0\0\x10\0\x01\x02\x03\0");
        let who = info(&data).unwrap();
        assert_eq!((who.serial, who.model.as_str()), (27_000_001, "KDC101"));
        assert_eq!(who.firmware, "3.2.1");
    }

    #[test]
    fn what_is_no_header_is_found_out() {
        for bytes in [
            // Another receiver, a length that no message has, one byte short.
            [0x2a, 0x04, 0x06, 0x00, 0x24, 0x50].as_slice(),
            &[0x2a, 0x04, 0x06, 0x04, 0x81, 0x50],
            &[0x2a, 0x04, 0x06, 0x00, 0x81],
        ] {
            assert_eq!(header(bytes), None, "{bytes:x?}");
        }
        assert_eq!(bits(&[1, 0, 0]), None);
        assert_eq!(velocity(&[0; 13]), None);
    }

    #[test]
    fn velocities_come_back_as_they_were_written() {
        let it = Velocity { lowest: 0, acceleration: 263, highest: 772_981 };
        assert_eq!(velocity(&velocity_data(1, it)), Some(it));
    }
}
