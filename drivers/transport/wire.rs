//! One line of bytes: a thread that owns the port, and a queue of what it is to do.

use std::io::{self, Write};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use async_trait::async_trait;
use beampose_core::transport::Transport;
use beampose_core::{Clock, InstrumentError};
use futures::channel::oneshot;

use super::errors::{cannot_open, gone};
use super::port::{self, Port, PortSettings};
use super::{Address, Direction, Recorder};

/// More than this without a terminator is no answer.
const LONGEST: usize = 1 << 16;
/// How long one read waits at most, so that a deadline is met to about this.
const SLICE: Duration = Duration::from_millis(20);

/// A serial port or a TCP connection.
pub struct Wire {
    jobs: Sender<Job>,
    /// Of the open port: for what must not wait.
    urgent: Arc<Mutex<Option<Box<dyn Write + Send>>>>,
    clock: Arc<dyn Clock>,
    recorder: Option<Arc<Recorder>>,
    name: String,
}

struct Job {
    what: What,
    deadline: Duration,
    reply: oneshot::Sender<Result<Vec<u8>, InstrumentError>>,
}

enum What {
    Open,
    Send(Vec<u8>),
    Until(u8),
    Exactly(usize),
    Discard,
    Close,
}

impl Wire {
    /// A line that is not open yet. `name` stands in a recording.
    #[must_use]
    pub fn new(
        name: &str,
        address: Address,
        settings: PortSettings,
        clock: Arc<dyn Clock>,
        recorder: Option<Arc<Recorder>>,
    ) -> Self {
        let (jobs, queue) = channel();
        let urgent = Arc::new(Mutex::default());
        let owner = Owner {
            address,
            settings,
            port: None,
            buffer: Vec::new(),
            opened: 0,
            urgent: Arc::clone(&urgent),
            recorder: recorder.clone(),
            name: name.to_owned(),
        };
        // A thread that cannot be had leaves a queue that nobody serves: every call then says so.
        let _ = std::thread::Builder::new()
            .name(format!("line {name}"))
            .spawn(move || owner.serve(&queue));
        Self { jobs, urgent, clock, recorder, name: name.to_owned() }
    }

    async fn ask(&self, what: What, deadline: Duration) -> Result<Vec<u8>, InstrumentError> {
        let (reply, answer) = oneshot::channel();
        let ended = || InstrumentError::Disconnected("the line's thread has ended".to_owned());
        let _time_stands_still = self.clock.external();
        self.jobs.send(Job { what, deadline, reply }).map_err(|_| ended())?;
        answer.await.map_err(|_| ended())?
    }
}

#[async_trait]
impl Transport for Wire {
    async fn open(&self, deadline: Duration) -> Result<u64, InstrumentError> {
        let opened = self.ask(What::Open, deadline).await?;
        let mut count = [0; 8];
        count.copy_from_slice(&opened);
        Ok(u64::from_le_bytes(count))
    }

    async fn send(&self, bytes: &[u8], deadline: Duration) -> Result<(), InstrumentError> {
        self.ask(What::Send(bytes.to_vec()), deadline).await.map(drop)
    }

    async fn receive_until(
        &self,
        terminator: u8,
        deadline: Duration,
    ) -> Result<Vec<u8>, InstrumentError> {
        self.ask(What::Until(terminator), deadline).await
    }

    async fn receive_exactly(
        &self,
        count: usize,
        deadline: Duration,
    ) -> Result<Vec<u8>, InstrumentError> {
        self.ask(What::Exactly(count), deadline).await
    }

    async fn discard(&self, quiet: Duration) -> Result<(), InstrumentError> {
        self.ask(What::Discard, quiet).await.map(drop)
    }

    async fn close(&self) {
        let _ = self.ask(What::Close, Duration::ZERO).await;
    }

    fn send_without_waiting(&self, bytes: &[u8]) {
        let mut urgent = self.urgent.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(port) = urgent.as_mut() {
            // What becomes of it nobody can say here; whoever calls assumes the worst.
            let _ = port.write_all(bytes).and_then(|()| port.flush());
            if let Some(recorder) = &self.recorder {
                recorder.note(&self.name, Direction::Sent, bytes);
            }
        }
    }
}

/// What the thread owns.
struct Owner {
    address: Address,
    settings: PortSettings,
    port: Option<Box<dyn Port>>,
    /// Came, and not yet received by anybody.
    buffer: Vec<u8>,
    opened: u64,
    urgent: Arc<Mutex<Option<Box<dyn Write + Send>>>>,
    recorder: Option<Arc<Recorder>>,
    name: String,
}

impl Owner {
    fn serve(mut self, queue: &Receiver<Job>) {
        while let Ok(job) = queue.recv() {
            let until = Instant::now() + job.deadline;
            let answer = match job.what {
                What::Open => self.open(job.deadline),
                What::Send(bytes) => self.send(&bytes, job.deadline),
                What::Until(end) => self.until(end, until, job.deadline),
                What::Exactly(count) => self.exactly(count, until, job.deadline),
                What::Discard => self.discard(job.deadline),
                What::Close => {
                    self.drop_port();
                    Ok(Vec::new())
                }
            };
            // Whoever asked may have gone.
            let _ = job.reply.send(answer);
        }
    }

    fn drop_port(&mut self) {
        self.port = None;
        self.buffer.clear();
        *self.urgent.lock().unwrap_or_else(PoisonError::into_inner) = None;
    }

    fn open(&mut self, deadline: Duration) -> Result<Vec<u8>, InstrumentError> {
        if self.port.is_none() {
            let opened = port::open(&self.address, &self.settings, deadline)
                .and_then(|port| Ok((port.writer()?, port)));
            let (writer, port) = opened.map_err(|error| cannot_open(&self.address, &error))?;
            self.buffer.clear();
            self.port = Some(port);
            self.opened += 1;
            *self.urgent.lock().unwrap_or_else(PoisonError::into_inner) = Some(writer);
        }
        Ok(self.opened.to_le_bytes().to_vec())
    }

    fn port(&mut self) -> Result<&mut Box<dyn Port>, InstrumentError> {
        let address = &self.address;
        let closed = || InstrumentError::Disconnected(format!("{address} is not open"));
        self.port.as_mut().ok_or_else(closed)
    }

    fn send(&mut self, bytes: &[u8], deadline: Duration) -> Result<Vec<u8>, InstrumentError> {
        let port = self.port()?;
        let wait = deadline.max(Duration::from_millis(1));
        let sent = port.wait_at_most(wait).and_then(|()| port.write_all(bytes));
        if let Err(error) = sent.and_then(|()| port.flush()) {
            // Perhaps half of it is out: what follows would be taken for its end.
            self.drop_port();
            return Err(if is_quiet(&error) {
                InstrumentError::Timeout(deadline)
            } else {
                gone(&self.address, &error)
            });
        }
        if let Some(recorder) = &self.recorder {
            recorder.note(&self.name, Direction::Sent, bytes);
        }
        Ok(Vec::new())
    }

    /// Reads what is there, waiting at most until `until`. Whether anything came.
    fn read_some(&mut self, until: Instant) -> Result<bool, InstrumentError> {
        let left = until.saturating_duration_since(Instant::now());
        let wait = left.min(SLICE).max(Duration::from_millis(1));
        let mut bytes = [0; 4096];
        let port = self.port()?;
        let read = port.wait_at_most(wait).and_then(|()| port.read(&mut bytes));
        match read {
            Ok(0) => {
                let closed =
                    io::Error::new(io::ErrorKind::UnexpectedEof, "the other end closed it");
                self.drop_port();
                Err(gone(&self.address, &closed))
            }
            Ok(count) => {
                if let Some(recorder) = &self.recorder {
                    recorder.note(&self.name, Direction::Received, &bytes[..count]);
                }
                self.buffer.extend_from_slice(&bytes[..count]);
                Ok(true)
            }
            Err(error) if is_quiet(&error) => Ok(false),
            Err(error) => {
                self.drop_port();
                Err(gone(&self.address, &error))
            }
        }
    }

    fn until(
        &mut self,
        end: u8,
        until: Instant,
        deadline: Duration,
    ) -> Result<Vec<u8>, InstrumentError> {
        let mut seen = 0;
        loop {
            if let Some(at) = self.buffer[seen..].iter().position(|byte| *byte == end) {
                return Ok(self.buffer.drain(..=seen + at).collect());
            }
            seen = self.buffer.len();
            if seen > LONGEST {
                self.buffer.clear();
                return Err(InstrumentError::Garbled {
                    expected: format!("a line that ends with {:?}", char::from(end)),
                    found: format!("{seen} bytes without an end"),
                });
            }
            if !self.read_some(until)? && Instant::now() >= until {
                return Err(InstrumentError::Timeout(deadline));
            }
        }
    }

    fn exactly(
        &mut self,
        count: usize,
        until: Instant,
        deadline: Duration,
    ) -> Result<Vec<u8>, InstrumentError> {
        while self.buffer.len() < count {
            if !self.read_some(until)? && Instant::now() >= until {
                return Err(InstrumentError::Timeout(deadline));
            }
        }
        Ok(self.buffer.drain(..count).collect())
    }

    fn discard(&mut self, quiet: Duration) -> Result<Vec<u8>, InstrumentError> {
        self.buffer.clear();
        // An instrument that never stops talking is not waited for.
        let give_up = Instant::now() + quiet * 10;
        let mut until = Instant::now() + quiet;
        while Instant::now() < until.min(give_up) {
            if self.read_some(until)? {
                until = Instant::now() + quiet;
            }
            self.buffer.clear();
        }
        Ok(Vec::new())
    }
}

fn is_quiet(error: &io::Error) -> bool {
    matches!(
        error.kind(),
        io::ErrorKind::TimedOut | io::ErrorKind::WouldBlock | io::ErrorKind::Interrupted
    )
}
