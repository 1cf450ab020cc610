//! The simulator's side of PTP/IP: packets and data sets, from the specifications.
//!
//! Packets: CIPA DC-005-2005 (PTP/IP), 2.3. Data sets: ISO 15740 (PTP), 5.3.2 and 5.5. All numbers
//! are little-endian; every packet begins with its length and its type.

use std::io::{self, Read, Write};

/// Packet types: CIPA DC-005, table 2.
pub(super) mod kind {
    pub(in super::super) const INIT_COMMAND: u32 = 1;
    pub(in super::super) const INIT_COMMAND_ACK: u32 = 2;
    pub(in super::super) const INIT_EVENT: u32 = 3;
    pub(in super::super) const INIT_EVENT_ACK: u32 = 4;
    pub(in super::super) const INIT_FAIL: u32 = 5;
    pub(in super::super) const OPERATION: u32 = 6;
    pub(in super::super) const RESPONSE: u32 = 7;
    pub(in super::super) const EVENT: u32 = 8;
    pub(in super::super) const START_DATA: u32 = 9;
    pub(in super::super) const DATA: u32 = 10;
    pub(in super::super) const END_DATA: u32 = 12;
    pub(in super::super) const PROBE: u32 = 13;
    pub(in super::super) const PROBE_ANSWER: u32 = 14;
}

/// Longer than any packet of a client: a handful of parameters, or one property's value.
const LONGEST: usize = 1 << 20;
/// Data goes out in packets of this many bytes.
const PIECE: usize = 1 << 15;

/// One packet.
pub(super) struct Packet {
    pub(super) kind: u32,
    pub(super) body: Vec<u8>,
}

impl Packet {
    /// Reads one; `None` at the end of the connection, or where `ended` says so.
    pub(super) fn read(from: &mut impl Read, ended: &dyn Fn() -> bool) -> io::Result<Option<Self>> {
        let Some(head) = exactly(from, 8, ended)? else { return Ok(None) };
        let (length, kind) = (number(&head, 0) as usize, number(&head, 4));
        if !(8..LONGEST).contains(&length) {
            return Err(io::Error::other("no packet of PTP/IP"));
        }
        let body = exactly(from, length - 8, ended)?;
        Ok(body.map(|body| Self { kind, body }))
    }

    /// The number at a place of the body, 0 behind its end.
    pub(super) fn number(&self, at: usize) -> u32 {
        number(&self.body, at)
    }
}

fn number(bytes: &[u8], at: usize) -> u32 {
    let four = bytes.get(at..at + 4).and_then(|four| four.try_into().ok());
    four.map_or(0, u32::from_le_bytes)
}

/// The read timeout of the stream is how often `ended` is asked.
fn exactly(
    from: &mut impl Read,
    count: usize,
    ended: &dyn Fn() -> bool,
) -> io::Result<Option<Vec<u8>>> {
    let mut bytes = vec![0; count];
    let mut have = 0;
    while have < count {
        match from.read(&mut bytes[have..]) {
            Ok(0) => return Ok(None),
            Ok(more) => have += more,
            Err(error)
                if matches!(
                    error.kind(),
                    io::ErrorKind::WouldBlock
                        | io::ErrorKind::TimedOut
                        | io::ErrorKind::Interrupted
                ) =>
            {
                if ended() {
                    return Ok(None);
                }
            }
            Err(error) => return Err(error),
        }
    }
    Ok(Some(bytes))
}

/// Writes a packet at once, so that it leaves in one piece.
pub(super) fn write(to: &mut impl Write, kind: u32, body: &[u8]) -> io::Result<()> {
    let mut bytes = Vec::with_capacity(body.len() + 8);
    bytes.extend((body.len() as u32 + 8).to_le_bytes());
    bytes.extend(kind.to_le_bytes());
    bytes.extend(body);
    to.write_all(&bytes)
}

/// The data phase of an answer: its start with the whole length, pieces, the last piece as its end.
pub(super) fn write_data(to: &mut impl Write, transaction: u32, data: &[u8]) -> io::Result<()> {
    let begin = DataSet::default().u32(transaction).u64(data.len() as u64);
    write(to, kind::START_DATA, &begin.0)?;
    let last = data.len().saturating_sub(1) / PIECE;
    let mut pieces: Vec<&[u8]> = data.chunks(PIECE).collect();
    if pieces.is_empty() {
        pieces.push(&[]);
    }
    for (number, piece) in pieces.into_iter().enumerate() {
        let kind = if number == last { kind::END_DATA } else { kind::DATA };
        let mut body = DataSet::default().u32(transaction);
        body.0.extend(piece);
        write(to, kind, &body.0)?;
    }
    Ok(())
}

/// A data set as it grows.
#[derive(Default)]
pub(super) struct DataSet(pub(super) Vec<u8>);

impl DataSet {
    pub(super) fn u8(mut self, x: u8) -> Self {
        self.0.push(x);
        self
    }

    pub(super) fn u16(mut self, x: u16) -> Self {
        self.0.extend(x.to_le_bytes());
        self
    }

    pub(super) fn u32(mut self, x: u32) -> Self {
        self.0.extend(x.to_le_bytes());
        self
    }

    pub(super) fn u64(mut self, x: u64) -> Self {
        self.0.extend(x.to_le_bytes());
        self
    }

    /// ISO 15740, 5.3.3: the number of characters with the final null, then those; nothing at all
    /// of an empty one but its zero.
    pub(super) fn text(mut self, text: &str) -> Self {
        let letters: Vec<u16> = text.encode_utf16().take(254).collect();
        if letters.is_empty() {
            return self.u8(0);
        }
        self.0.push(letters.len() as u8 + 1);
        for letter in letters.into_iter().chain([0]) {
            self.0.extend(letter.to_le_bytes());
        }
        self
    }

    pub(super) fn u16s(self, all: &[u16]) -> Self {
        all.iter().fold(self.u32(all.len() as u32), |set, x| set.u16(*x))
    }

    pub(super) fn u32s(self, all: &[u32]) -> Self {
        all.iter().fold(self.u32(all.len() as u32), |set, x| set.u32(*x))
    }

    /// Text of PTP/IP itself: UTF-16 with a null at its end, no length.
    pub(super) fn host_name(self, text: &str) -> Self {
        text.encode_utf16().chain([0]).fold(self, Self::u16)
    }
}
