//! Gives a device a TCP port or a pty, and its line the trouble that lines have.

use std::io::{self, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::os::fd::AsFd;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use rustix::event::{PollFd, PollFlags, Timespec, poll};

use super::Device;
use super::pty::{LineSettings, Pty};
use super::trouble::{Fault, Trouble};
use crate::transport::Address;

/// How long a read waits before the device may speak by itself.
const TICK: Duration = Duration::from_millis(5);

/// A device that answers at an address, until it is dropped.
pub struct Host {
    address: Address,
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
    /// Holds the link of a pty.
    _folder: Option<tempfile::TempDir>,
}

struct Shared {
    device: Mutex<Box<dyn Device>>,
    trouble: Trouble,
    ended: AtomicBool,
    settings: Mutex<Option<LineSettings>>,
}

impl Shared {
    fn device(&self) -> MutexGuard<'_, Box<dyn Device>> {
        self.device.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn has_ended(&self) -> bool {
        self.ended.load(Ordering::SeqCst)
    }

    /// Serves one client until it leaves, the cable is cut, or the host ends.
    fn serve(&self, port: &mut dyn ClientPort) -> io::Result<()> {
        let cuts = self.trouble.cuts();
        let mut pending = Vec::new();
        let greeting = self.device().greets();
        port.write_all(&greeting)?;
        let mut bytes = [0; 4096];
        loop {
            if self.has_ended() || self.trouble.cuts() != cuts {
                return Ok(());
            }
            let (out, chatter, fault) = match port.read_within(&mut bytes, TICK)? {
                Came::Nothing => (self.device().says(), Vec::new(), None),
                Came::End => return Ok(()),
                Came::Bytes(count) => {
                    pending.extend_from_slice(&bytes[..count]);
                    let fault = self.trouble.take();
                    let mut device = self.device();
                    match fault {
                        Some(Fault::Cut) => return Ok(()),
                        Some(Fault::Reboot) => {
                            device.reboot();
                            return Ok(());
                        }
                        Some(Fault::Refused) => drop(device.refuse_next()),
                        _ => {}
                    }
                    let out = device.receive(&mut pending);
                    (out, device.chatter(), fault)
                }
            };
            if out.is_empty() {
                // A command without an answer: the fault is the next answer's.
                fault
                    .filter(|it| *it != Fault::Refused)
                    .into_iter()
                    .for_each(|it| self.trouble.keep(it));
                continue;
            }
            // Pulled while the device was at work.
            if self.trouble.cuts() != cuts {
                return Ok(());
            }
            match fault {
                None | Some(Fault::Refused | Fault::Cut | Fault::Reboot) => port.write_all(&out)?,
                Some(Fault::Silent) => {}
                Some(Fault::Late(by)) => {
                    std::thread::sleep(by);
                    port.write_all(&out)?;
                }
                Some(Fault::Garbled) => port.write_all(&garbled(&out))?,
                Some(Fault::Half) => port.write_all(&out[..out.len() / 2])?,
                Some(Fault::Chatter) => {
                    port.write_all(&chatter)?;
                    port.write_all(&out)?;
                }
            }
        }
    }
}

/// Every byte but the line's end is another: no checksum and no parser takes it for an answer.
fn garbled(bytes: &[u8]) -> Vec<u8> {
    let other = |byte: &u8| if matches!(byte, b'\r' | b'\n') { *byte } else { byte ^ 0xa5 };
    bytes.iter().map(other).collect()
}

enum Came {
    Nothing,
    Bytes(usize),
    End,
}

trait ClientPort {
    fn read_within(&mut self, bytes: &mut [u8], wait: Duration) -> io::Result<Came>;
    fn write_all(&mut self, bytes: &[u8]) -> io::Result<()>;
}

impl ClientPort for TcpStream {
    fn read_within(&mut self, bytes: &mut [u8], wait: Duration) -> io::Result<Came> {
        self.set_read_timeout(Some(wait))?;
        match self.read(bytes) {
            Ok(0) => Ok(Came::End),
            Ok(count) => Ok(Came::Bytes(count)),
            Err(error)
                if matches!(
                    error.kind(),
                    io::ErrorKind::WouldBlock
                        | io::ErrorKind::TimedOut
                        | io::ErrorKind::Interrupted
                ) =>
            {
                Ok(Came::Nothing)
            }
            Err(error) => Err(error),
        }
    }

    fn write_all(&mut self, bytes: &[u8]) -> io::Result<()> {
        Write::write_all(self, bytes)
    }
}

impl ClientPort for Pty {
    fn read_within(&mut self, bytes: &mut [u8], wait: Duration) -> io::Result<Came> {
        let mut fds = [PollFd::new(&self.master, PollFlags::IN)];
        let wait = Timespec { tv_sec: 0, tv_nsec: i64::from(wait.subsec_nanos()) };
        if poll(&mut fds, Some(&wait))? == 0 {
            return Ok(Came::Nothing);
        }
        match rustix::io::read(self.master.as_fd(), bytes) {
            // The client closed its end; the next one gets a new pty, free of the old one's locks.
            Err(rustix::io::Errno::IO) | Ok(0) => Ok(Came::End),
            Ok(count) => Ok(Came::Bytes(count)),
            Err(error) => Err(error.into()),
        }
    }

    fn write_all(&mut self, bytes: &[u8]) -> io::Result<()> {
        let mut rest = bytes;
        while !rest.is_empty() {
            let count = rustix::io::write(self.master.as_fd(), rest)?;
            rest = &rest[count..];
        }
        Ok(())
    }
}

impl Host {
    /// On a TCP port; `bind` with port 0 for any that is free.
    ///
    /// # Errors
    /// What the operating system says.
    pub fn tcp(device: Box<dyn Device>, bind: SocketAddr) -> io::Result<Self> {
        let listener = TcpListener::bind(bind)?;
        listener.set_nonblocking(true)?;
        let bound = listener.local_addr()?;
        let address = Address::Tcp { host: bound.ip().to_string(), port: bound.port() };
        let shared = Shared::new(device);
        let of_thread = Arc::clone(&shared);
        let thread = std::thread::Builder::new()
            .name("simulator".to_owned())
            .spawn(move || accept(&listener, &of_thread))?;
        Ok(Self { address, shared, thread: Some(thread), _folder: None })
    }

    /// On a pty, under a link of its own in a temporary folder.
    ///
    /// # Errors
    /// What the operating system says.
    pub fn pty(device: Box<dyn Device>) -> io::Result<Self> {
        let folder = tempfile::Builder::new().prefix("beampose-pty-").tempdir()?;
        let link = folder.path().join("port");
        Self::pty_at(device, link, Some(folder))
    }

    /// On a pty that is linked from `link`.
    ///
    /// # Errors
    /// What the operating system says.
    pub fn pty_linked(device: Box<dyn Device>, link: PathBuf) -> io::Result<Self> {
        Self::pty_at(device, link, None)
    }

    fn pty_at(
        device: Box<dyn Device>,
        link: PathBuf,
        folder: Option<tempfile::TempDir>,
    ) -> io::Result<Self> {
        let address = Address::Serial { path: link.to_string_lossy().into_owned(), baud: None };
        let shared = Shared::new(device);
        let of_thread = Arc::clone(&shared);
        let first = Pty::linked(&link)?;
        let thread = std::thread::Builder::new()
            .name("simulator".to_owned())
            .spawn(move || serve_ptys(first, &link, &of_thread))?;
        Ok(Self { address, shared, thread: Some(thread), _folder: folder })
    }

    /// Where it answers.
    #[must_use]
    pub fn address(&self) -> &Address {
        &self.address
    }

    /// What goes wrong on its line.
    #[must_use]
    pub fn trouble(&self) -> &Trouble {
        &self.shared.trouble
    }

    /// The device refuses the next command in its own words. Whether it can.
    pub fn refuse_next(&self) -> bool {
        self.shared.device().refuse_next()
    }

    /// The device goes off and on again; connections are cut.
    pub fn reboot(&self) {
        self.shared.device().reboot();
        self.shared.trouble.cut();
    }

    /// Whether the device ever sends something unasked.
    #[must_use]
    pub fn can_chatter(&self) -> bool {
        !self.shared.device().chatter().is_empty()
    }

    /// How the last client set the serial port; `None` on TCP.
    #[must_use]
    pub fn line_settings(&self) -> Option<LineSettings> {
        *self.shared.settings.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Shared {
    fn new(device: Box<dyn Device>) -> Arc<Self> {
        Arc::new(Self {
            device: Mutex::new(device),
            trouble: Trouble::default(),
            ended: AtomicBool::new(false),
            settings: Mutex::new(None),
        })
    }
}

impl Drop for Host {
    fn drop(&mut self) {
        self.shared.ended.store(true, Ordering::SeqCst);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

fn accept(listener: &TcpListener, shared: &Arc<Shared>) {
    let mut clients = Vec::new();
    while !shared.has_ended() {
        match listener.accept() {
            Ok((stream, _)) if shared.trouble.is_unplugged() => drop(stream),
            Ok((mut stream, _)) => {
                let shared = Arc::clone(shared);
                let serve = move || {
                    // A client that leaves is no fault of ours.
                    let _ = stream
                        .set_nonblocking(false)
                        .and_then(|()| stream.set_nodelay(true))
                        .and_then(|()| shared.serve(&mut stream));
                };
                clients.extend(std::thread::Builder::new().spawn(serve));
            }
            Err(_) => std::thread::sleep(Duration::from_millis(2)),
        }
    }
    for client in clients {
        let _ = client.join();
    }
}

fn serve_ptys(first: Pty, link: &std::path::Path, shared: &Shared) {
    let mut next = Some(first);
    while !shared.has_ended() {
        if shared.trouble.is_unplugged() {
            let _ = std::fs::remove_file(link);
            next = None;
            std::thread::sleep(TICK);
            continue;
        }
        let Some(mut pty) = next.take().or_else(|| Pty::linked(link).ok()) else {
            std::thread::sleep(TICK);
            continue;
        };
        let mut watched = Watched { pty: &mut pty, shared };
        let _ = shared.serve(&mut watched);
        // Before the old one goes: a client that finds it gone finds the new one.
        if !shared.has_ended() && !shared.trouble.is_unplugged() {
            next = Pty::linked(link).ok();
        }
    }
    let _ = std::fs::remove_file(link);
}

/// A pty whose settings are noted as bytes come.
struct Watched<'a> {
    pty: &'a mut Pty,
    shared: &'a Shared,
}

impl ClientPort for Watched<'_> {
    fn read_within(&mut self, bytes: &mut [u8], wait: Duration) -> io::Result<Came> {
        let came = self.pty.read_within(bytes, wait)?;
        if matches!(came, Came::Bytes(_)) {
            *self.shared.settings.lock().unwrap_or_else(PoisonError::into_inner) =
                self.pty.settings();
        }
        Ok(came)
    }

    fn write_all(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.pty.write_all(bytes)
    }
}
