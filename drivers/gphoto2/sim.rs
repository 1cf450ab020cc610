//! Cameras on the network: PTP/IP responders that any PTP/IP client can use, as the `gphoto2`
//! program does.
//!
//! Traps kept: the port is the same for every camera (so each has a loopback address of its own);
//! one client at a time, a second is refused as busy; nothing but its description before a session
//! is open; somebody else's picture is on the card; a picture that got lost is put on the card,
//! with its event, right before the next one.

use std::io;
use std::net::{Ipv4Addr, Shutdown, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use super::card::{Answer, Body, response};
use super::packets::{DataSet, Packet, kind, write, write_data};
use crate::sim::{Hosted, Simulated};
use crate::transport::Address;

/// CIPA DC-005, 2.2: the port of PTP/IP.
const PORT: u16 = 15740;
/// How often a thread that reads looks whether all is over.
const TICK: Duration = Duration::from_millis(20);
/// Its priority: -20 is the highest.
const CAMERA_FIRST: i32 = -15;
/// Why a client is not let in: CIPA DC-005, table 9.
const BUSY: u32 = 2;

/// Cameras, each at a loopback address of its own.
pub struct PtpIpCameras {
    cameras: Vec<Arc<Responder>>,
    threads: Vec<JoinHandle<()>>,
    ended: Arc<AtomicBool>,
}

struct Responder {
    name: String,
    host: Ipv4Addr,
    body: Mutex<Body>,
    /// The stream for events of the client that is connected.
    events: Mutex<Option<TcpStream>>,
    connection: AtomicU32,
    taken: AtomicBool,
    ended: Arc<AtomicBool>,
    released: Mutex<Vec<Instant>>,
}

pub(super) fn simulate(all: &[Simulated]) -> Result<Box<dyn Hosted>, String> {
    let mut it = PtpIpCameras { cameras: Vec::new(), threads: Vec::new(), ended: Arc::default() };
    for (number, camera) in all.iter().enumerate() {
        let (listener, host) = free_host()?;
        let serial = format!("SIM{number:05}");
        let body = Body::new(serial, camera.part.shutter()?, Arc::clone(&camera.clock));
        let responder = Arc::new(Responder {
            name: camera.name.clone(),
            host,
            body: Mutex::new(body),
            events: Mutex::default(),
            connection: AtomicU32::new(0),
            taken: AtomicBool::new(false),
            ended: Arc::clone(&it.ended),
            released: Mutex::default(),
        });
        it.cameras.push(Arc::clone(&responder));
        let serve = move || responder.accept(&listener);
        let thread = std::thread::Builder::new().name("simulator".to_owned()).spawn(serve);
        it.threads.push(thread.map_err(|error| error.to_string())?);
    }
    Ok(Box::new(it))
}

/// The next loopback address at which nobody has the port.
fn free_host() -> Result<(TcpListener, Ipv4Addr), String> {
    let mut last = String::new();
    for number in 2..=250 {
        let host = Ipv4Addr::new(127, 0, 0, number);
        match TcpListener::bind((host, PORT)) {
            Ok(listener) => {
                listener.set_nonblocking(true).map_err(|error| error.to_string())?;
                return Ok((listener, host));
            }
            Err(error) => last = error.to_string(),
        }
    }
    Err(format!("no loopback address has port {PORT} free: {last}"))
}

impl Hosted for PtpIpCameras {
    fn address(&self, name: &str) -> Option<Address> {
        let camera = self.cameras.iter().find(|camera| camera.name == name)?;
        Some(Address::Device(format!("ptpip:{}", camera.host)))
    }

    fn lose_next(&self) {
        for camera in &self.cameras {
            camera.body().lose_next();
        }
    }

    fn lacks(&self) -> Option<String> {
        super::helper::find().err()
    }

    fn releases(&self, name: &str) -> Vec<Instant> {
        let camera = self.cameras.iter().find(|camera| camera.name == name);
        camera.map(|camera| lock(&camera.released).clone()).unwrap_or_default()
    }
}

impl Drop for PtpIpCameras {
    fn drop(&mut self) {
        self.ended.store(true, Ordering::SeqCst);
        for thread in self.threads.drain(..) {
            let _ = thread.join();
        }
    }
}

fn lock<T>(it: &Mutex<T>) -> MutexGuard<'_, T> {
    it.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Responder {
    fn body(&self) -> MutexGuard<'_, Body> {
        lock(&self.body)
    }

    fn has_ended(&self) -> bool {
        self.ended.load(Ordering::SeqCst)
    }

    fn accept(self: &Arc<Self>, listener: &TcpListener) {
        let mut clients = Vec::new();
        while !self.has_ended() {
            match listener.accept() {
                Ok((stream, _)) => {
                    let it = Arc::clone(self);
                    // A client that leaves is no fault of ours.
                    let serve = move || drop(it.serve(stream));
                    clients.extend(std::thread::Builder::new().spawn(serve));
                }
                Err(_) => std::thread::sleep(Duration::from_millis(2)),
            }
        }
        for client in clients {
            let _ = client.join();
        }
    }

    /// The first packet says what a connection is for.
    fn serve(&self, mut stream: TcpStream) -> io::Result<()> {
        // A camera has a processor of its own: this thread comes first, where that is allowed.
        let _ = rustix::process::setpriority_process(None, CAMERA_FIRST);
        stream.set_nonblocking(false)?;
        stream.set_nodelay(true)?;
        stream.set_read_timeout(Some(TICK))?;
        let ended = || self.has_ended();
        let Some(first) = Packet::read(&mut stream, &ended)? else { return Ok(()) };
        match first.kind {
            kind::INIT_COMMAND => {
                if self.taken.swap(true, Ordering::SeqCst) {
                    return write(&mut stream, kind::INIT_FAIL, &BUSY.to_le_bytes());
                }
                let served = self.commands(&mut stream);
                if let Some(events) = lock(&self.events).take() {
                    let _ = events.shutdown(Shutdown::Both);
                }
                self.taken.store(false, Ordering::SeqCst);
                served
            }
            kind::INIT_EVENT if first.number(0) == self.connection.load(Ordering::SeqCst) => {
                {
                    // Known before the client hears of it: a release may follow at once.
                    let mut events = lock(&self.events);
                    *events = Some(stream.try_clone()?);
                    write(&mut stream, kind::INIT_EVENT_ACK, &[])?;
                }
                while let Some(packet) = Packet::read(&mut stream, &ended)? {
                    if packet.kind == kind::PROBE {
                        write(&mut stream, kind::PROBE_ANSWER, &[])?;
                    }
                }
                Ok(())
            }
            _ => write(&mut stream, kind::INIT_FAIL, &1_u32.to_le_bytes()),
        }
    }

    fn commands(&self, stream: &mut TcpStream) -> io::Result<()> {
        let number = self.connection.fetch_add(1, Ordering::SeqCst) + 1;
        let mut ack = DataSet::default().u32(number);
        ack.0.extend(*b"beampose-camera-");
        write(stream, kind::INIT_COMMAND_ACK, &ack.host_name("camera").u32(0x0001_0000).0)?;
        let mut session = false;
        while let Some(packet) = Packet::read(stream, &|| self.has_ended())? {
            match packet.kind {
                kind::OPERATION => self.operation(stream, &packet, &mut session)?,
                kind::PROBE => write(stream, kind::PROBE_ANSWER, &[])?,
                // Data of the client: no operation here takes any.
                _ => {}
            }
        }
        Ok(())
    }

    fn operation(
        &self,
        stream: &mut TcpStream,
        packet: &Packet,
        session: &mut bool,
    ) -> io::Result<()> {
        let now = Instant::now();
        let code = (packet.number(4) & 0xffff) as u16;
        let transaction = packet.number(6);
        let parameters: Vec<u32> =
            (10..packet.body.len()).step_by(4).map(|at| packet.number(at)).collect();
        let answer = match (code, *session) {
            (0x1002, true) => Answer::code(response::SESSION_ALREADY_OPEN),
            (0x1002, false) if parameters.first().is_none_or(|id| *id == 0) => {
                Answer::code(response::INVALID_PARAMETER)
            }
            (0x1002, false) => {
                *session = true;
                Answer::code(response::OK)
            }
            (0x1003, true) => {
                *session = false;
                Answer::code(response::OK)
            }
            (0x1001, _) | (_, true) => {
                if code == 0x100e {
                    lock(&self.released).push(now);
                }
                self.body().operate(code, &parameters)
            }
            _ => Answer::code(response::SESSION_NOT_OPEN),
        };
        if let Some(data) = &answer.data {
            write_data(stream, transaction, data)?;
        }
        let body = DataSet::default().u16(answer.code).u32(transaction);
        let body = answer.parameters.iter().fold(body, |body, it| body.u32(*it));
        write(stream, kind::RESPONSE, &body.0)?;
        let mut events = lock(&self.events);
        for (code, parameters) in &answer.events {
            if let Some(events) = events.as_mut() {
                let body = DataSet::default().u16(*code).u32(transaction);
                let body = parameters.iter().fold(body, |body, it| body.u32(*it));
                write(events, kind::EVENT, &body.0)?;
            }
        }
        Ok(())
    }
}
