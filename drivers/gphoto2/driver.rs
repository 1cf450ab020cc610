//! A camera of libgphoto2, through its helper program.

use std::path::PathBuf;
use std::sync::{Arc, PoisonError};
use std::task::Poll;
use std::time::{Duration, Instant};

use async_trait::async_trait;
use beampose_core::{Camera, Clock, Frame, Identity, Instrument, InstrumentError, Stamp};
use futures::lock::Mutex;
use rustix::time::{ClockId, clock_gettime};

use super::helper::{self, Helper, Said};
use super::protocol::{self, Reply};
use crate::aside::aside;
use crate::registry::{Connected, Role, Setting};
use crate::transport::Address;

/// A lens comes out, a network is searched. Real time, as all here.
const START: Duration = Duration::from_secs(20);
/// What the camera has said by itself is passed over within this.
const ARMING: Duration = Duration::from_secs(5);
/// From the request until the camera has taken it: it may focus, and it may expose first.
const RELEASE: Duration = Duration::from_secs(30);
/// A picture is waited for at least so long.
const SHORTEST: Duration = Duration::from_secs(2);
/// Until a picture is here, where the rig does not say.
const DELIVERY: Duration = Duration::from_millis(2500);
/// From the request to the release: until then every helper has woken up and waits for it.
const LEAD: Duration = Duration::from_millis(20);
/// An earlier picture that comes ahead of ours is told from it by what comes within this.
const QUIET: Duration = Duration::from_millis(500);

/// A camera at a port of libgphoto2.
pub struct Gphoto2Camera {
    name: String,
    /// The helper; looked for where it is not said.
    program: Option<PathBuf>,
    port: String,
    model: String,
    keep: bool,
    wait: Duration,
    quiet: Duration,
    complaints: PathBuf,
    clock: Arc<dyn Clock>,
    simulated: bool,
    slot: Mutex<Slot>,
}

#[derive(Default)]
struct Slot {
    session: Option<Session>,
    /// Released for, and not here.
    missing: usize,
}

/// A helper whose camera is ready.
struct Session {
    helper: Helper,
    model: String,
    serial: String,
}

pub(super) fn connect(setting: Setting) -> Result<Connected, InstrumentError> {
    Ok(Connected::Camera(Arc::new(camera(setting, None)?)))
}

fn camera(setting: Setting, program: Option<PathBuf>) -> Result<Gphoto2Camera, InstrumentError> {
    let refused = |why: &str| InstrumentError::Refused(format!("{}: {why}", setting.name));
    let Role::Camera { delivery, .. } = setting.role else {
        return Err(refused("it is no camera"));
    };
    let Address::Device(port) = &setting.address else {
        return Err(refused(
            "its address must be device: and a port of gphoto2, as in device:usb:001,002 or \
             device:ptpip:192.168.1.7",
        ));
    };
    let delivery = delivery.unwrap_or(DELIVERY);
    Ok(Gphoto2Camera {
        program,
        port: port.clone(),
        model: setting.options.text("model")?.to_owned(),
        keep: setting.options.switch("keep")?,
        wait: (delivery * 4).max(SHORTEST),
        quiet: delivery.max(QUIET),
        complaints: setting.scratch.join(format!("{}-helper.txt", setting.name)),
        clock: setting.clock,
        simulated: setting.simulated,
        slot: Mutex::default(),
        name: setting.name,
    })
}

impl Session {
    fn open(mut helper: Helper, keep: bool) -> Result<Self, InstrumentError> {
        let (model, serial) = match helper.next(Instant::now() + START)? {
            Said::Reply(Reply::Ready { model, serial }) => (model, serial),
            other => return Err(unexpected("READY", other)),
        };
        helper.ask(&protocol::keep(keep))?;
        match helper.next(Instant::now() + ARMING)? {
            Said::Reply(Reply::Done) => Ok(Self { helper, model, serial }),
            other => Err(unexpected("OK", other)),
        }
    }

    /// What came before; how many pictures of them.
    fn arm(&mut self, camera: &str) -> Result<usize, InstrumentError> {
        self.helper.ask(protocol::ARM)?;
        let until = Instant::now() + ARMING;
        let mut late = 0;
        loop {
            match self.helper.next(until)? {
                Said::Reply(Reply::Done) => return Ok(late),
                Said::Reply(Reply::Late(name)) => {
                    tracing::warn!(%camera, %name, "came too late for its trigger; left on the card");
                    late += 1;
                }
                other => return Err(unexpected("OK", other)),
            }
        }
    }

    /// The picture, and when its release went out.
    fn picture(&mut self, wait: Duration) -> Result<(Vec<u8>, Duration), InstrumentError> {
        let timeout = |error| match error {
            InstrumentError::Timeout(_) => InstrumentError::Timeout(wait),
            other => other,
        };
        let released = match self.helper.next(Instant::now() + RELEASE.max(wait))? {
            Said::Reply(Reply::Released(at)) => at,
            other => return Err(unexpected("RELEASED", other)),
        };
        match self.helper.next(Instant::now() + wait).map_err(timeout)? {
            Said::Picture { bytes, name } => {
                tracing::debug!(%name, "picture");
                Ok((bytes, released))
            }
            other => Err(unexpected("PICTURE", other)),
        }
    }
}

fn unexpected(expected: &str, said: Said) -> InstrumentError {
    let found = match said {
        Said::Reply(Reply::Failed(error)) => return error,
        Said::Reply(reply) => format!("{reply:?}"),
        Said::Picture { name, bytes } => format!("{name}, {} bytes", bytes.len()),
        Said::Garbage(text) => text,
    };
    let expected = format!("{expected} from the camera's helper program");
    InstrumentError::Garbled { expected, found }
}

impl Gphoto2Camera {
    /// A session that is there, or a new one.
    async fn session(&self, slot: &mut Slot) -> Result<Session, InstrumentError> {
        if let Some(session) = slot.session.take() {
            return Ok(session);
        }
        let found = || helper::find().map_err(InstrumentError::Disconnected);
        let program = self.program.clone().map_or_else(found, Ok)?;
        let (port, model, keep) = (self.port.clone(), self.model.clone(), self.keep);
        let complaints = self.complaints.clone();
        aside(&*self.clock, &self.name, move || {
            Session::open(Helper::start(&program, &[&port, &model], &complaints)?, keep)
        })
        .await
    }

    /// Works with the session on a thread of its own. Whoever gives up waiting has no session any
    /// more: the next call begins a new one, which owes nothing.
    async fn with<T: Send + 'static>(
        &self,
        slot: &mut Slot,
        mut session: Session,
        work: impl FnOnce(&mut Session) -> Result<T, InstrumentError> + Send + 'static,
    ) -> Result<T, InstrumentError> {
        let done = aside(&*self.clock, &self.name, move || {
            let result = work(&mut session);
            let keeps = matches!(result, Ok(_) | Err(InstrumentError::Refused(_)));
            Ok((keeps.then_some(session), result))
        });
        let (session, result) = done.await?;
        slot.session = session;
        result
    }
}

/// The monotonic clock of this computer, which helpers read too.
fn monotonic() -> Duration {
    let now = clock_gettime(ClockId::Monotonic);
    Duration::try_from(now).unwrap_or_default()
}

/// When the cameras that are asked within a moment are released, all of this program.
static RELEASE_AT: std::sync::Mutex<Duration> = std::sync::Mutex::new(Duration::ZERO);

/// The instant for a camera that is asked now: the same as for those that were asked just before.
fn release_at(now: Duration) -> Duration {
    let mut at = RELEASE_AT.lock().unwrap_or_else(PoisonError::into_inner);
    if *at <= now {
        *at = now + LEAD;
    }
    *at
}

/// Lets whoever is polled together with this be polled first.
async fn others_first() {
    let mut polled = false;
    std::future::poll_fn(|context| {
        if std::mem::replace(&mut polled, true) {
            return Poll::Ready(());
        }
        context.waker().wake_by_ref();
        Poll::Pending
    })
    .await;
}

fn later(stamp: Stamp, by: Duration) -> Stamp {
    let utc = jiff::SignedDuration::try_from(by).ok().and_then(|by| stamp.utc.checked_add(by).ok());
    Stamp { monotonic: stamp.monotonic.saturating_add(by), utc: utc.unwrap_or(stamp.utc) }
}

#[async_trait]
impl Instrument for Gphoto2Camera {
    async fn identify(&self) -> Result<Identity, InstrumentError> {
        let mut slot = self.slot.lock().await;
        let session = self.session(&mut slot).await?;
        let serial = (!session.serial.is_empty()).then(|| session.serial.clone());
        let identity = Identity { model: session.model.clone(), serial, simulated: self.simulated };
        slot.session = Some(session);
        Ok(identity)
    }
}

#[async_trait]
impl Camera for Gphoto2Camera {
    async fn arm(&self) -> Result<(), InstrumentError> {
        let mut slot = self.slot.lock().await;
        let session = self.session(&mut slot).await?;
        let name = self.name.clone();
        let late = self.with(&mut slot, session, move |it| it.arm(&name)).await?;
        slot.missing = slot.missing.saturating_sub(late);
        Ok(())
    }

    async fn trigger(&self) -> Result<Frame, InstrumentError> {
        let mut slot = self.slot.lock().await;
        let mut session = self.session(&mut slot).await?;
        let (asked, asked_monotonic) = (self.clock.now(), monotonic());
        // Sent here and now, for one instant for several cameras.
        let at = release_at(asked_monotonic);
        session.helper.ask(&protocol::trigger(at, slot.missing, self.quiet))?;
        let (before, wait) = (slot.missing, self.wait);
        slot.missing += 1;
        // Nothing is begun that takes processors from the others before all have been asked.
        others_first().await;
        let result = self.with(&mut slot, session, move |it| it.picture(wait)).await;
        match &result {
            Ok(_) => slot.missing = 0,
            Err(InstrumentError::Refused(_)) => slot.missing = before,
            Err(_) => {}
        }
        let (bytes, released) = result?;
        // A virtual clock stands still meanwhile.
        let late = released.saturating_sub(asked_monotonic);
        let requested = if self.simulated { asked } else { later(asked, late) };
        Ok(Frame { bytes, requested, delivered: self.clock.now() })
    }
}

#[cfg(test)]
mod tests;
