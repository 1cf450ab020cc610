//! A driver, its simulator, and a world so simple that it is known.

use std::collections::BTreeMap;
use std::fmt;
use std::future::Future;
use std::net::{Ipv4Addr, SocketAddr};
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use beampose_core::instrument::AxisUnit;
use beampose_core::{Axis, Camera, Clock, InstrumentError, Laser, Quantity, Sensor, VirtualClock};

use crate::options::{Options, Value};
use crate::registry::{Connected, Driver, Moved, Role, Setting, Simulator};
use crate::sim::{
    Host, Hosted, Part, Simulated, Stage, TestDiode, TestProbe, TestShutter, TestStage, Trouble,
};
use crate::transport::{Line, Wire};

/// The name of the instrument.
const NAME: &str = "it";

/// How the bytes go.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Way {
    /// Over TCP.
    Tcp,
    /// Over a pty, as over a serial port.
    Pty,
    /// As the driver's own simulator has it.
    Own,
}

impl fmt::Display for Way {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Tcp => "tcp",
            Self::Pty => "pty",
            Self::Own => "its own way",
        })
    }
}

impl Way {
    /// How long an answer may take: many times what one takes on a machine that is busy otherwise.
    /// On TCP checks wait for answers that do not come in this time. On a pty none does: the kernel
    /// passes its bytes on by a worker of its own, which was seen to take seconds while all processors
    /// were busy.
    pub(super) const fn deadline(self) -> Duration {
        match self {
            Self::Tcp | Self::Own => Duration::from_millis(500),
            Self::Pty => Duration::from_secs(4),
        }
    }

    /// The ways of a driver.
    #[must_use]
    pub const fn of(driver: &Driver) -> &'static [Self] {
        match driver.simulator {
            Simulator::Device(_) => &[Self::Tcp, Self::Pty],
            Simulator::Hosted(_) => &[Self::Own],
        }
    }
}

enum Served {
    Line(Host),
    Own(Box<dyn Hosted>),
}

/// One driver before its simulator.
pub struct Bench {
    pub(super) driver: &'static Driver,
    pub(super) way: Way,
    pub(super) clock: VirtualClock,
    served: Served,
    pub(super) stage: Option<Arc<TestStage>>,
    pub(super) diode: Option<Arc<TestDiode>>,
    pub(super) probe: Option<Arc<TestProbe>>,
    pub(super) shutter: Option<Arc<TestShutter>>,
    scratch: tempfile::TempDir,
}

impl Bench {
    /// A device fresh from the factory.
    ///
    /// # Errors
    /// Why its simulator cannot be had.
    pub fn new(driver: &'static Driver, way: Way) -> Result<Self, String> {
        let clock = VirtualClock::starting_at(jiff::Timestamp::UNIX_EPOCH);
        let shared: Arc<dyn Clock> = Arc::new(clock.clone());
        let (mut stage, mut diode, mut probe, mut shutter) = (None, None, None, None);
        let role = role(driver);
        let part = match role {
            Role::Axis { limits, speed, .. } => {
                let it = Arc::new(TestStage::new(shared.clone(), limits, speed));
                stage = Some(it.clone());
                Part::Stage(it)
            }
            Role::Laser { .. } => {
                let it = Arc::new(TestDiode::new(shared.clone()));
                diode = Some(it.clone());
                Part::Diode(it)
            }
            Role::Sensor { quantity, .. } => {
                let it = Arc::new(match quantity {
                    Quantity::Wavelength => TestProbe::new(658.0, 0.125),
                    Quantity::Temperature => TestProbe::new(21.0, 0.25),
                    _ => TestProbe::new(10.0, 0.5),
                });
                probe = Some(it.clone());
                Part::Probe(it)
            }
            Role::Camera { .. } => {
                let it = Arc::new(TestShutter::default());
                shutter = Some(it.clone());
                Part::Shutter(it)
            }
        };
        let all = [Simulated {
            name: NAME.to_owned(),
            options: options(driver)?,
            role,
            part,
            clock: shared,
        }];
        let io = |error: std::io::Error| error.to_string();
        let served = match (driver.simulator, way) {
            (Simulator::Device(make), Way::Pty) => {
                Served::Line(Host::pty(make(&all)?).map_err(io)?)
            }
            (Simulator::Device(make), _) => {
                let any = SocketAddr::from((Ipv4Addr::LOCALHOST, 0));
                Served::Line(Host::tcp(make(&all)?, any).map_err(io)?)
            }
            (Simulator::Hosted(make), _) => Served::Own(make(&all)?),
        };
        let scratch = tempfile::tempdir().map_err(io)?;
        Ok(Self { driver, way, clock, served, stage, diode, probe, shutter, scratch })
    }

    /// How long an answer may take: many times what one takes on a machine that is busy otherwise.
    /// What is to be late comes later than this.
    pub(super) const fn deadline(&self) -> Duration {
        self.way.deadline()
    }

    /// One more connection to the device.
    pub(super) fn connect(&self) -> Result<Connected, String> {
        self.connect_as(role(self.driver))
    }

    /// As [`Bench::connect`], with another role than usual.
    pub(super) fn connect_as(&self, role: Role) -> Result<Connected, String> {
        let clock: Arc<dyn Clock> = Arc::new(self.clock.clone());
        let address = match &self.served {
            Served::Line(host) => host.address().clone(),
            Served::Own(hosted) => hosted.address(NAME).ok_or("no address")?,
        };
        let options = options(self.driver)?;
        let port = self.driver.port_settings(&options).map_err(|error| error.to_string())?;
        let line = port.map(|port| {
            let wire = Wire::new(NAME, address.clone(), port, clock.clone(), None);
            Arc::new(Line::new(Arc::new(wire), self.deadline()))
        });
        let setting = Setting {
            name: NAME.to_owned(),
            address,
            line,
            clock,
            options,
            role,
            deadline: self.deadline(),
            simulated: true,
            scratch: Path::to_owned(self.scratch.path()),
        };
        (self.driver.connect)(setting).map_err(|error| error.to_string())
    }

    /// Runs to the end, in virtual time.
    pub(super) fn run<'a, T: Send + 'a>(&self, future: impl Future<Output = T> + Send + 'a) -> T {
        futures::executor::block_on(self.clock.drive(Box::pin(future)))
    }

    /// Lets real time pass in which a host notices what was done to it.
    pub(super) fn pause(&self) {
        std::thread::sleep(Duration::from_millis(250));
    }

    /// Whether something that was sent without waiting comes about, in real time.
    pub(super) fn soon(&self, is_so: impl Fn() -> bool) -> bool {
        let end = Instant::now() + self.deadline();
        while !is_so() && Instant::now() < end {
            std::thread::sleep(Duration::from_millis(5));
        }
        is_so()
    }

    /// The host of the line; `None` for instruments without a line of bytes.
    pub(super) fn host(&self) -> Option<&Host> {
        if let Served::Line(host) = &self.served { Some(host) } else { None }
    }

    pub(super) fn trouble(&self) -> Option<&Trouble> {
        self.host().map(Host::trouble)
    }

    /// What this machine lacks for the driver to be tried: see [`Hosted::lacks`].
    #[must_use]
    pub fn lacks(&self) -> Option<String> {
        if let Served::Own(hosted) = &self.served { hosted.lacks() } else { None }
    }

    /// A picture on its way gets lost.
    pub(super) fn lose_next(&self) {
        if let Served::Own(hosted) = &self.served {
            hosted.lose_next();
        }
    }

    /// Brings an axis to a place: by its motor, or, where it is moved by hand, as a person would.
    pub(super) fn bring(&self, axis: &Arc<dyn Axis>, target: f64) -> Result<(), String> {
        let failed = |error: InstrumentError| format!("to {target}: {error}");
        self.run(axis.move_to(target)).map_err(failed)?;
        if self.driver.moved == Moved::ByHand {
            let stage = self.stage.as_ref().ok_or("no stage")?;
            stage.go(target)?;
            while stage.is_moving() {
                self.run(self.clock.sleep(Duration::from_millis(50)));
            }
        }
        Ok(())
    }

    pub(super) fn axis(&self) -> Result<Arc<dyn Axis>, String> {
        match self.connect()? {
            Connected::Axis(it) => Ok(it),
            _ => Err("the driver of an axis gave something else".to_owned()),
        }
    }

    pub(super) fn laser(&self) -> Result<Arc<dyn Laser>, String> {
        self.laser_as(role(self.driver))
    }

    pub(super) fn laser_as(&self, role: Role) -> Result<Arc<dyn Laser>, String> {
        match self.connect_as(role)? {
            Connected::Laser(it) => Ok(it),
            _ => Err("the driver of a laser gave something else".to_owned()),
        }
    }

    pub(super) fn sensor(&self) -> Result<Arc<dyn Sensor>, String> {
        match self.connect()? {
            Connected::Sensor(it) => Ok(it),
            _ => Err("the driver of a sensor gave something else".to_owned()),
        }
    }

    pub(super) fn camera(&self) -> Result<Arc<dyn Camera>, String> {
        match self.connect()? {
            Connected::Camera(it) => Ok(it),
            _ => Err("the driver of a camera gave something else".to_owned()),
        }
    }

    /// The simplest question that every instrument of this kind answers, after a first connection.
    pub(super) fn asker(&self) -> Result<Asker, String> {
        self.asker_of(self.connect()?)
    }

    /// The same, of an instrument that is there.
    pub(super) fn asker_of(&self, connected: Connected) -> Result<Asker, String> {
        let asker = Asker(connected);
        // The set-up at connect is not what is tried.
        self.run(asker.ask()).map_err(|error| format!("the first question: {error}"))?;
        Ok(asker)
    }
}

/// Asks an instrument something that has an answer.
pub(super) struct Asker(Connected);

impl Asker {
    pub(super) const fn new(connected: Connected) -> Self {
        Self(connected)
    }

    pub(super) async fn ask(&self) -> Result<(), InstrumentError> {
        match &self.0 {
            Connected::Axis(it) => it.position().await.map(drop),
            Connected::Sensor(it) => it.read().await.map(drop),
            Connected::Camera(it) => it.trigger().await.map(drop),
            Connected::Laser(it) => {
                let interlock = it.interlock();
                match interlock {
                    Some(interlock) => interlock.is_closed().await.map(drop),
                    None => it.identify().await.map(drop),
                }
            }
        }
    }

    pub(super) async fn identify(&self) -> Result<beampose_core::Identity, InstrumentError> {
        match &self.0 {
            Connected::Axis(it) => it.identify().await,
            Connected::Sensor(it) => it.identify().await,
            Connected::Camera(it) => it.identify().await,
            Connected::Laser(it) => it.identify().await,
        }
    }
}

fn options(driver: &'static Driver) -> Result<Options, String> {
    let needed = driver.options.iter().filter(|spec| spec.default.is_none());
    let text = |value: Value| match value {
        Value::Number(x) => x.to_string(),
        Value::Text(x) => x.to_owned(),
        Value::Switch(x) => x.to_string(),
    };
    let written: BTreeMap<String, String> =
        needed.map(|spec| (spec.name.to_owned(), text(spec.example))).collect();
    Options::read(driver.options, &written).map_err(|(key, why)| format!("option {key}: {why}"))
}

pub(super) fn role(driver: &Driver) -> Role {
    match driver.kind {
        "linear_axis" => {
            Role::Axis { unit: AxisUnit::Millimetre, limits: [0.0, 300.0], speed: 50.0 }
        }
        "rotary_axis" => Role::Axis { unit: AxisUnit::Degree, limits: [-90.0, 90.0], speed: 20.0 },
        "laser" => Role::Laser { current_ma: Some(60.0), emission_delay: Duration::from_secs(3) },
        "camera" => Role::Camera {
            exposure: Some(Duration::from_millis(100)),
            delivery: Some(Duration::from_millis(200)),
        },
        _ => Role::Sensor { quantity: driver.reads.unwrap_or(Quantity::Temperature), u: None },
    }
}
