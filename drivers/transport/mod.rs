//! Lines of bytes: serial ports, TCP, and recordings of both.
//!
//! Each line has one thread of its own with a queue, so that nothing here blocks whoever drives the
//! instruments, and a virtual clock stands still while bytes are under way.

mod address;
mod errors;
mod line;
mod port;
mod ports;
mod record;
mod wire;

pub use address::{Address, AddressError};
pub use line::{Line, Party, Talk};
pub use port::{FlowControl, Parity, PortSettings};
pub use ports::{AttachedPort, attached_ports};
pub use record::{Direction, Recorder, Replay, Said};
pub use wire::Wire;
