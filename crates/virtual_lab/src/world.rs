//! The world that all simulated instruments share.

use std::collections::BTreeMap;
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::Duration;

use beampose_core::{Emission, Stamp};
use beampose_photogrammetry::rotation::{from_wxyz, wxyz};
use beampose_photogrammetry::{Beam, CalibratedCamera, GrayImage, InteriorSigma};
use nalgebra::{UnitQuaternion, Vector2, Vector3};

use crate::config::{PointingConfig, WorldConfig};
use crate::diode::{self, Switches};
use crate::error::WorldError;
use crate::geometry::{View, scaled};
use crate::motion::Motion;
use crate::render::{self, StaticLayer};
use crate::room::Room;
use crate::stage::module_pose;
use crate::streams::Streams;
use crate::truth::{self, DotTruth, TrueParameters, Truth};

/// Everything about the module that a picture shows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ModuleState {
    /// The grating's position in the world, mm.
    pub position: Vector3<f64>,
    /// Module axes x right, y down, z forward.
    pub world_from_module: UnitQuaternion<f64>,
    /// True wavelength in vacuum, nm.
    pub wavelength_nm: f64,
    /// Whether it shines.
    pub emission: Emission,
}

/// A dot as a camera sees it, without noise.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImagedDot {
    /// The beam.
    pub order: beampose_photogrammetry::Order,
    /// The image of the point where the beam's axis meets the wall, pixels.
    pub pixel: Vector2<f64>,
    /// Standard deviations of its image along the principal axes (large, small), pixels.
    pub sigma_px: [f64; 2],
    /// Peak above the background, grey levels, before clipping.
    pub amplitude_grey: f64,
}

/// A target as a camera sees it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImagedTarget {
    /// Its code, canonical.
    pub code: u16,
    /// The image of its centre, pixels (not the centre of its ellipse).
    pub pixel: Vector2<f64>,
}

/// The simulated world. Made once, shared by all its instruments.
#[derive(Debug)]
pub struct World {
    pub(crate) config: WorldConfig,
    pub(crate) streams: Streams,
    pub(crate) truth: TrueParameters,
    pub(crate) room: Room,
    pub(crate) cameras: Vec<PlacedCamera>,
    live: Mutex<Live>,
    history: History,
}

/// What an earlier run of a session did with the instruments: the numbers that choose noise go on
/// from there, so that a run that was interrupted sees what it would have seen.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct History {
    /// The rail.
    pub rail: StageHistory,
    /// The rotation stage.
    pub rotation: StageHistory,
    /// Readings of the wavelength meter.
    pub wavelength_reads: u64,
    /// Readings of the thermometer.
    pub temperature_reads: u64,
    /// Readings of the thermometer on the diode.
    pub diode_temperature_reads: u64,
    /// Pictures of each camera.
    pub triggers: BTreeMap<String, u64>,
    /// How far the fixture was rolled, degrees.
    pub roll_deg: f64,
}

/// What an earlier run did with a stage.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct StageHistory {
    /// Where it was told to stand last; `None` where it never was.
    pub target: Option<f64>,
    /// How often it was told to move.
    pub moves: usize,
    /// How often its encoder was read.
    pub reads: u64,
}

/// A camera of the world, with what never changes in its pictures once that was rendered.
#[derive(Debug)]
pub(crate) struct PlacedCamera {
    pub(crate) view: View,
    pub(crate) layer: OnceLock<StaticLayer>,
}

/// What happened so far.
#[derive(Debug)]
pub(crate) struct Live {
    pub(crate) rail: Motion,
    pub(crate) rotation: Motion,
    pub(crate) switches: Switches,
    /// From when on the fixture is rolled how far, degrees; the first from the beginning.
    pub(crate) rolls: Vec<(Duration, f64)>,
}

impl Live {
    fn roll_deg(&self, time: Duration) -> f64 {
        self.rolls.iter().rev().find(|(from, _)| *from <= time).map_or(0.0, |(_, roll)| *roll)
    }
}

impl World {
    /// A world as `config` declares it, with its errors drawn from `seed`; time 0 of its history is
    /// the start of the clock whose stamps it is asked with.
    ///
    /// # Errors
    /// [`WorldError::Value`] for a number that makes no sense.
    pub fn new(config: WorldConfig, seed: u64) -> Result<Self, WorldError> {
        Self::after(config, seed, History::default())
    }

    /// The same world after an earlier run: its stages stand where they were told to, its laser is
    /// off.
    ///
    /// # Errors
    /// As [`World::new`].
    pub fn after(config: WorldConfig, seed: u64, history: History) -> Result<Self, WorldError> {
        config.check()?;
        let streams = Streams::new(seed);
        let truth = truth::draw(&config, &streams);
        let cameras = truth
            .cameras
            .values()
            .map(|camera| PlacedCamera {
                view: View {
                    camera: camera.interior,
                    position: Vector3::from(camera.position_mm),
                    world_from_camera: from_wxyz(camera.quaternion_wxyz),
                },
                layer: OnceLock::new(),
            })
            .collect();
        let start = |stage: Option<f64>, earlier: &StageHistory| {
            Motion::resumed(earlier.target.or(stage).unwrap_or(0.0), earlier.moves)
        };
        let live = Live {
            rail: start(config.rail.map(|r| r.stage.start), &history.rail),
            rotation: start(config.rotation.map(|r| r.stage.start), &history.rotation),
            switches: Switches::default(),
            rolls: vec![(Duration::ZERO, history.roll_deg)],
        };
        let room = Room::new(&config.walls, &config.mirrors);
        Ok(Self { config, streams, truth, room, cameras, live: Mutex::new(live), history })
    }

    /// What an earlier run did.
    pub(crate) fn history(&self) -> &History {
        &self.history
    }

    /// The configuration that the world was made from.
    #[must_use]
    pub fn config(&self) -> &WorldConfig {
        &self.config
    }

    /// All errors of this world, and what follows from them.
    #[must_use]
    pub fn true_parameters(&self) -> &TrueParameters {
        &self.truth
    }

    /// What a solver may be told of the cameras: their calibrations at the pictures' size.
    #[must_use]
    pub fn calibrations(&self) -> BTreeMap<String, CalibratedCamera> {
        let scale = self.config.picture_scale;
        let told = |c: &CalibratedCamera| CalibratedCamera {
            model: scaled(&c.model, scale),
            sigma: InteriorSigma {
                focal_px: c.sigma.focal_px * scale,
                principal_point_px: c.sigma.principal_point_px.map(|s| s * scale),
            },
        };
        self.config.cameras.iter().map(|(n, c)| (n.clone(), told(&c.calibration))).collect()
    }

    /// The truth at a moment, past or present (the whole history is kept).
    #[must_use]
    pub fn truth_at(&self, at: Stamp) -> Truth {
        let time = at.monotonic;
        let module = self.module_at(time);
        let live = self.live();
        let (diode, room) = (&self.config.diode, &self.config.room);
        Truth {
            position_mm: module.position.into(),
            quaternion_wxyz: wxyz(&module.world_from_module),
            rail_mm: self.config.rail.map(|_| live.rail.at(time)),
            rotation_deg: self.config.rotation.map(|_| live.rotation.at(time)),
            wavelength_nm: module.wavelength_nm,
            diode_degc: diode::diode_degc(diode, room, &live.switches, time),
            room_degc: diode::room_degc(room, time),
            emitting: module.emission == Emission::On,
            dots: self.dots(&module),
        }
    }

    /// The module as it would be with its stages' encoders at these places, mm and degrees (for
    /// pictures without a session). A stage that the world does not have is passed over.
    #[must_use]
    pub fn module_state(
        &self,
        rail_mm: f64,
        rotation_deg: f64,
        wavelength_nm: f64,
        emission: Emission,
    ) -> ModuleState {
        self.rolled_state(0.0, [rail_mm, rotation_deg], wavelength_nm, emission)
    }

    fn rolled_state(
        &self,
        roll_deg: f64,
        [rail_mm, rotation_deg]: [f64; 2],
        wavelength_nm: f64,
        emission: Emission,
    ) -> ModuleState {
        let config = &self.config;
        let rail = config.rail.as_ref().map(|r| (r, &self.truth.rail_phases_rad, rail_mm));
        let rotation = config.rotation.as_ref().map(|r| (r, &self.truth.turntable, rotation_deg));
        let (position, world_from_module) = module_pose(&config.module, roll_deg, rotation, rail);
        ModuleState { position, world_from_module, wavelength_nm, emission }
    }

    /// Somebody rolls the module in its fixture, from a moment on: degrees counter-clockwise as the
    /// module sees it, from how it stands in the rig.
    pub fn roll_module(&self, at: Stamp, roll_deg: f64) {
        self.live().rolls.push((at.monotonic, roll_deg));
    }

    /// Every beam's direction in the module frame and where it meets a wall.
    #[must_use]
    pub fn dots(&self, module: &ModuleState) -> Vec<DotTruth> {
        let dot = |beam: Beam| {
            let along = module.world_from_module * beam.direction;
            let lit = self.room.lit(&module.position, &along);
            DotTruth {
                order: beam.order,
                direction: beam.direction.into(),
                xyz_mm: lit.map(|lit| lit.hit.point.into()),
            }
        };
        self.true_beams(module.wavelength_nm).into_iter().map(dot).collect()
    }

    /// Where each dot is in a camera's picture, those that fall into it.
    ///
    /// # Errors
    /// [`WorldError::UnknownCamera`].
    pub fn imaged_dots(
        &self,
        camera: &str,
        module: &ModuleState,
    ) -> Result<Vec<ImagedDot>, WorldError> {
        Ok(render::imaged_dots(self, self.camera_index(camera)?, module))
    }

    /// Where each target's centre is in a camera's picture, those that it sees from the front.
    ///
    /// # Errors
    /// [`WorldError::UnknownCamera`].
    pub fn imaged_targets(&self, camera: &str) -> Result<Vec<ImagedTarget>, WorldError> {
        Ok(render::imaged_targets(self, self.camera_index(camera)?))
    }

    /// A camera's picture of the module in a given state. `capture_index` chooses the noise and the
    /// speckle: the same index gives the same picture.
    ///
    /// # Errors
    /// [`WorldError::UnknownCamera`].
    pub fn render(
        &self,
        camera: &str,
        module: &ModuleState,
        capture_index: u64,
    ) -> Result<GrayImage, WorldError> {
        Ok(render::render(self, self.camera_index(camera)?, module, capture_index))
    }

    /// As [`World::render`], as a JPEG file.
    ///
    /// # Errors
    /// [`WorldError::UnknownCamera`], [`WorldError::Encode`].
    pub fn render_jpeg(
        &self,
        camera: &str,
        module: &ModuleState,
        capture_index: u64,
    ) -> Result<Vec<u8>, WorldError> {
        let image = self.render(camera, module, capture_index)?;
        render::jpeg(&image, self.config.picture.jpeg_quality)
    }

    /// The module at a time of the history.
    pub(crate) fn module_at(&self, time: Duration) -> ModuleState {
        let live = self.live();
        let degc = diode::diode_degc(&self.config.diode, &self.config.room, &live.switches, time);
        let wavelength_nm = diode::wavelength_nm(&self.config.diode, time, degc);
        let emission = if live.switches.emitting(time) { Emission::On } else { Emission::Off };
        let stages = [live.rail.at(time), live.rotation.at(time)];
        let roll_deg = live.roll_deg(time);
        drop(live);
        let state = self.rolled_state(roll_deg, stages, wavelength_nm, emission);
        match &self.config.beam.pointing {
            Some(pointing) => {
                let wander = wander_deg(pointing, &self.truth.pointing_phases_rad, time);
                let [right, up] = wander.map(f64::to_radians);
                let turn = UnitQuaternion::from_scaled_axis(Vector3::new(up, right, 0.0));
                ModuleState { world_from_module: state.world_from_module * turn, ..state }
            }
            None => state,
        }
    }

    /// The diode's temperature at a time of the history, degrees Celsius.
    pub(crate) fn diode_degc_at(&self, time: Duration) -> f64 {
        let (diode, room) = (&self.config.diode, &self.config.room);
        diode::diode_degc(diode, room, &self.live().switches, time)
    }

    /// The true beams at a wavelength.
    pub(crate) fn true_beams(&self, wavelength_nm: f64) -> Vec<Beam> {
        let pattern = &self.truth.pattern;
        let common = 1.0 + self.truth.pattern_common_error;
        pattern.beams((1.0 + pattern.scale_at(wavelength_nm)) * common - 1.0)
    }

    pub(crate) fn camera_index(&self, name: &str) -> Result<usize, WorldError> {
        self.config
            .cameras
            .keys()
            .position(|key| key == name)
            .ok_or_else(|| WorldError::UnknownCamera(name.to_owned()))
    }

    pub(crate) fn live(&self) -> MutexGuard<'_, Live> {
        self.live.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// How far the fan points aside at a time, about two axes, degrees: three waves each, whose periods
/// have no common multiple that a session would see.
fn wander_deg(pointing: &PointingConfig, phases: &[[f64; 3]; 2], time: Duration) -> [f64; 2] {
    const PERIODS: [f64; 3] = [0.71, 1.0, 1.618];
    // Three waves of equal amplitude: the variance of each is half of its square.
    let amplitude = pointing.wander_deg * (2.0_f64 / 3.0).sqrt();
    phases.map(|phases| {
        let waves = PERIODS.iter().zip(phases).map(|(period, phase)| {
            let turns = time.as_secs_f64() / (period * pointing.period_s);
            (std::f64::consts::TAU * turns + phase).sin()
        });
        amplitude * waves.sum::<f64>()
    })
}
