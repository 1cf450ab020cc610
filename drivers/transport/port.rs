//! The two kinds of line that the operating system gives: serial ports and TCP.

use std::io::{self, Read, Write};
use std::net::{TcpStream, ToSocketAddrs};
use std::time::{Duration, Instant};

use serialport::{DataBits, SerialPort, StopBits};

use super::Address;

/// How a serial port is set. TCP ignores it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PortSettings {
    /// Bits per second.
    pub baud: u32,
    /// 7 or 8.
    pub data_bits: u8,
    /// The parity bit.
    pub parity: Parity,
    /// 1 or 2.
    pub stop_bits: u8,
    /// Who says when to send.
    pub flow: FlowControl,
    /// Whether RTS goes off and on again at connect: the documented beginning of some USB chips.
    pub cycle_rts: bool,
}

/// A parity bit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Parity {
    /// None.
    None,
    /// Odd.
    Odd,
    /// Even.
    Even,
}

/// Flow control of a serial port.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FlowControl {
    /// None.
    None,
    /// XON and XOFF.
    Software,
    /// RTS and CTS.
    Hardware,
}

impl PortSettings {
    /// 8 data bits, no parity, 1 stop bit, no flow control: what most instruments have.
    #[must_use]
    pub const fn at(baud: u32) -> Self {
        Self {
            baud,
            data_bits: 8,
            parity: Parity::None,
            stop_bits: 1,
            flow: FlowControl::None,
            cycle_rts: false,
        }
    }
}

/// What a line's thread reads and writes.
pub(super) trait Port: Read + Write + Send {
    /// How long the next read, or the next write, may wait.
    fn wait_at_most(&mut self, duration: Duration) -> io::Result<()>;
    /// A second handle, to write past a read that waits.
    fn writer(&self) -> io::Result<Box<dyn Write + Send>>;
}

/// Opens what `address` says.
pub(super) fn open(
    address: &Address,
    settings: &PortSettings,
    deadline: Duration,
) -> io::Result<Box<dyn Port>> {
    match address {
        Address::Serial { path, baud } => {
            let settings = PortSettings { baud: baud.unwrap_or(settings.baud), ..*settings };
            serial(path, &settings)
        }
        Address::Tcp { host, port } => tcp(host, *port, deadline),
        other => Err(io::Error::other(format!("{other} is no line of bytes"))),
    }
}

fn tcp(host: &str, port: u16, deadline: Duration) -> io::Result<Box<dyn Port>> {
    let until = Instant::now() + deadline;
    let mut last = io::Error::new(io::ErrorKind::NotFound, "the name has no address");
    for address in (host, port).to_socket_addrs()? {
        let left = until.saturating_duration_since(Instant::now()).max(Duration::from_millis(1));
        match TcpStream::connect_timeout(&address, left) {
            Ok(stream) => {
                stream.set_nodelay(true)?;
                return Ok(Box::new(stream));
            }
            Err(error) => last = error,
        }
    }
    Err(last)
}

impl Port for TcpStream {
    fn wait_at_most(&mut self, duration: Duration) -> io::Result<()> {
        self.set_read_timeout(Some(duration))?;
        self.set_write_timeout(Some(duration))
    }

    fn writer(&self) -> io::Result<Box<dyn Write + Send>> {
        Ok(Box::new(self.try_clone()?))
    }
}

struct Serial(Box<dyn SerialPort>);

/// So many bytes a serial port takes once the kernel says that there is room.
const ROOM: usize = 256;

fn serial(path: &str, settings: &PortSettings) -> io::Result<Box<dyn Port>> {
    let data_bits = if settings.data_bits == 7 { DataBits::Seven } else { DataBits::Eight };
    let stop_bits = if settings.stop_bits == 2 { StopBits::Two } else { StopBits::One };
    let parity = match settings.parity {
        Parity::None => serialport::Parity::None,
        Parity::Odd => serialport::Parity::Odd,
        Parity::Even => serialport::Parity::Even,
    };
    let flow = match settings.flow {
        FlowControl::None => serialport::FlowControl::None,
        FlowControl::Software => serialport::FlowControl::Software,
        FlowControl::Hardware => serialport::FlowControl::Hardware,
    };
    let mut port = serialport::new(path, settings.baud)
        .data_bits(data_bits)
        .stop_bits(stop_bits)
        .parity(parity)
        .flow_control(flow)
        .timeout(Duration::from_millis(20))
        .open()?;
    let differs = |what: &str| io::Error::other(format!("the port did not take the {what}"));
    // A pseudo terminal has always eight bits and no parity.
    if !is_pseudo(path) {
        if port.data_bits()? != data_bits || port.stop_bits()? != stop_bits {
            return Err(differs("data and stop bits"));
        }
        if port.parity()? != parity {
            return Err(differs("parity"));
        }
    }
    if port.baud_rate()?.abs_diff(settings.baud) * 50 > settings.baud {
        return Err(differs("baud rate"));
    }
    if port.flow_control()? != flow {
        return Err(differs("flow control"));
    }
    if settings.cycle_rts {
        // A port without that wire says so; the instrument then has none to listen to.
        let _ = port.write_request_to_send(false);
        std::thread::sleep(Duration::from_millis(50));
        let _ = port.write_request_to_send(true);
    }
    Ok(Box::new(Serial(port)))
}

fn is_pseudo(path: &str) -> bool {
    std::fs::canonicalize(path).is_ok_and(|path| path.starts_with("/dev/pts"))
}

impl Read for Serial {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        self.0.read(buffer)
    }
}

impl Write for Serial {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        // The crate waits until there is room, for as long as it may, and then writes: that blocks
        // where there is less room than bytes.
        self.0.write(&bytes[..bytes.len().min(ROOM)])
    }

    fn flush(&mut self) -> io::Result<()> {
        // The crate would wait until the last bit is out: for ever, where flow control holds it.
        Ok(())
    }
}

impl Port for Serial {
    fn wait_at_most(&mut self, duration: Duration) -> io::Result<()> {
        self.0.set_timeout(duration).map_err(io::Error::from)
    }

    fn writer(&self) -> io::Result<Box<dyn Write + Send>> {
        Ok(Box::new(Serial(self.0.try_clone()?)))
    }
}
