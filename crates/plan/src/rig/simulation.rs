//! The simulated world, for simulated drivers: how things are, not what the measurement is told.
//!
//! Plain data; `virtual_lab` makes a world of it. Pictures' grey values are fractions of full
//! scale, so that they mean the same for any depth.

use std::collections::BTreeMap;

use beampose_core::InstrumentName;
use beampose_core::units::{Celsius, Degree, Millimetre, Nanometre, Second};
use schemars::{Schema, SchemaGenerator, json_schema};
use serde::Serialize;

use crate::fault::At;
use crate::quantity::{Kelvin, Pixel, TEMPERATURE, TIME, parse};
use crate::reader::{
    Read, Reader, fraction, not_negative, percent, positive, quantity_of, unit_range,
};
use crate::tree::{Node, Value};

record! {
    /// The simulated world.
    pub struct Simulation {
        /// Of all that is drawn. The same seed gives the same world and the same pictures.
        seed: u64,
        /// Whether truth differs from what solving is told: cameras' interior orientations,
        /// artefact, pattern and wavelength reading are then drawn from their uncertainties.
        draw_errors: bool,
        /// How the module is carried.
        module: SimulatedModule,
        /// The laser in the module.
        laser: SimulatedLaser,
        /// What the beams fall on.
        walls: Vec<At<Wall>>,
        /// Mirrors that fold the way of the beams, in any order; without them none. Cameras see no dot
        /// and no target in them.
        mirrors: Option<Vec<At<Mirror>>>,
        /// Where each simulated camera stands.
        cameras: BTreeMap<String, At<SimulatedCamera>>,
        /// The tie targets on the walls. The artefact's stand where the measurement says, but for
        /// drawn errors. Each faces along the normal of the wall nearest to it.
        tie_targets: Option<Vec<At<PlacedTarget>>>,
        /// What a picture is like.
        picture: SimulatedPicture,
        /// Who answers prompts, by their names, where nobody else does.
        person: Option<BTreeMap<String, At<SimulatedAnswer>>>,
        /// What goes wrong, and when.
        faults: Option<Vec<At<SimulatedFault>>>,
    }
}

words! {
    /// What goes wrong.
    pub enum FaultKind ("a fault") {
        /// Whatever it is asked, it does not answer.
        "no_answer" => NoAnswer,
        /// It answers, or does what it should, three seconds late.
        "late_answer" => LateAnswer,
        /// It answers what cannot be understood.
        "garbled" => Garbled,
        /// The line to it is gone.
        "disconnect" => Disconnect,
        /// It understands, and refuses.
        "refused" => Refused,
        /// It goes off and on again, and has forgotten what it was told.
        "reboot" => Reboot,
        /// An axis reads 5 units off, a sensor reads no number, a laser reads back as on.
        "wrong_readback" => WrongReadback,
        /// An axis sets off and does not arrive.
        "stall" => Stall,
        /// An axis stands 1 unit beyond its target, and says it arrived.
        "overshoot" => Overshoot,
        /// A camera loses a picture, and says so.
        "dropped_frame" => DroppedFrame,
        /// Of a picture only the first half arrives.
        "truncated_frame" => TruncatedFrame,
        /// A camera delivers a black picture.
        "black_frame" => BlackFrame,
        /// A camera answers nothing more once it is triggered, until it is reset.
        "camera_hangs" => CameraHangs,
        /// A laser's interlock opens.
        "interlock_trip" => InterlockTrip,
        /// The wavelength that a sensor reads hops by 0.3 nm.
        "wavelength_hop" => WavelengthHop,
        /// The store has no room.
        "disk_full" => DiskFull,
        /// Another program holds the database.
        "database_busy" => DatabaseBusy,
        /// A stored picture changes on the disk, once its step is stored.
        "corrupt_blob" => CorruptBlob,
        /// The wall clock jumps by an hour.
        "clock_jump" => ClockJump,
    }
}

record! {
    /// A fault on demand.
    pub struct SimulatedFault {
        /// Of what: an instrument, `store` or `clock`.
        of: At<String>,
        /// What goes wrong.
        fault: At<FaultKind>,
        /// Only in the step of this number.
        at_step: Option<u32>,
        /// Only after this time of the session.
        after: Option<Second> => not_negative,
        /// So long from the moment in which it comes.
        lasts as "for": Option<Second> => positive,
        /// With this probability each time that it could come; without it always.
        probability: Option<f64> => fraction,
        /// So many times at most.
        times: Option<u32>,
    }
}

record! {
    /// How the module is carried.
    pub struct SimulatedModule {
        /// The linear axis that carries it, if one does.
        axis: Option<At<InstrumentName>>,
        /// Its fan of beams, a pattern file, relative to the rig's; without it the one that the
        /// measurement is told. True values are drawn about either.
        pattern: Option<At<String>>,
        /// Where it is in the world when the axis is at zero.
        origin: [Millimetre; 3],
        /// Which way it moves in the world when the axis counts up; of any length.
        direction: At<[f64; 3]>,
        /// How it is turned: omega, phi, kappa.
        rotation_omega_phi_kappa: [Degree; 3],
        /// The rotary axis that it stands on, if it does; the linear axis carries both.
        turntable: Option<Turntable>,
        /// How much longer the way is than the axis says, relatively.
        scale_relative: f64,
        /// How the way departs from a straight line.
        straightness: Straightness,
    }
}

record! {
    /// A rotary axis under the module.
    pub struct Turntable {
        /// Which.
        axis: At<InstrumentName>,
        /// A point on the line that it turns about, in the world, with the linear axis at zero.
        about: [Millimetre; 3],
        /// Direction of that line in the world (right-hand rule); of any length.
        direction: At<[f64; 3]>,
        /// Standard deviation of where it stops; without it 0.0005 deg.
        positioning: Option<Degree> => not_negative,
        /// Play between drive and table; without it none.
        lost_motion: Option<Degree> => not_negative,
        /// Amplitude of the encoder's graduation error, a slow wave; where it is given, the axis' `u`
        /// says nothing of single readings.
        graduation: Option<Degree> => not_negative,
        /// Standard uncertainty of where the module stands off the line, beyond what is written here,
        /// along the world's X, Y and Z; without it none.
        misalignment_u: Option<[Millimetre; 3]>,
        /// Standard uncertainty of how far the line leans, about each of two directions across it;
        /// without it none.
        tilt_u: Option<Degree> => not_negative,
    }
}

record! {
    /// What a simulated person says, and does.
    pub struct SimulatedAnswer {
        /// What is said.
        answer: String,
        /// The module is then rolled in its fixture so far from how it stands in the rig,
        /// counter-clockwise as it sees it: at 90 degrees its lower beams come to the right.
        roll: Option<Degree>,
    }
}

record! {
    /// A sine across the way, alike to both sides of it (a quarter of a period apart).
    pub struct Straightness {
        /// Its amplitude.
        amplitude: Millimetre => not_negative,
        /// Its period along the way.
        period: Millimetre => positive,
    }
}

record! {
    /// The laser in the module.
    pub struct SimulatedLaser {
        /// The wavelength at one temperature of the diode.
        wavelength_at: WavelengthAt,
        /// How much longer per degree.
        per_degree: Nanometre,
        /// Temperature of the room when the session begins.
        ambient: Celsius,
        /// How the diode warms after it is switched on: exponentially.
        warm_up: WarmUp,
        /// How the room's temperature drifts from the session's beginning.
        room: RoomDrift,
        /// Where its wavelength hops from mode to mode; without it nowhere.
        mode_hops: Option<Vec<ModeHop>>,
        /// The beams.
        beam: Beam,
    }
}

record! {
    /// From there on the wavelength is another one.
    pub struct ModeHop {
        /// When, from the session's beginning (`40 min`); or at which temperature of the diode
        /// (`25 degC`): it hops back when the diode cools below it.
        at: HopAt,
        /// By how much longer it is then; below zero where it is shorter.
        by: Nanometre,
    }
}

/// Where a wavelength hops: the unit says whether it is a moment or a temperature.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum HopAt {
    /// A time since the session began.
    Time(Second),
    /// A temperature of the diode.
    Temperature(Celsius),
}

impl Read for HopAt {
    fn read(node: &Node, reader: &mut Reader) -> Option<Self> {
        let is_temperature =
            matches!(&node.value, Value::Text(text) if parse(text, &TEMPERATURE).is_ok());
        if is_temperature {
            return quantity_of(node, &TEMPERATURE, reader).map(|n| Self::Temperature(Celsius(n)));
        }
        quantity_of(node, &TIME, reader).map(|n| Self::Time(Second(n)))
    }

    fn schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({ "type": "string", "examples": ["40 min", "25 degC"] })
    }
}

record! {
    /// One point of the wavelength's course over temperature.
    pub struct WavelengthAt {
        /// The temperature.
        temperature: Celsius,
        /// The wavelength there, in vacuum.
        value: Nanometre => positive,
    }
}

record! {
    /// An exponential approach.
    pub struct WarmUp {
        /// How much warmer than the room in the end.
        rise: Kelvin,
        /// After this time 63 % of it.
        time_constant: Second => positive,
    }
}

record! {
    /// A steady drift.
    pub struct RoomDrift {
        /// How much warmer it gets each hour; below zero where it cools.
        drift_per_hour: Kelvin,
    }
}

record! {
    /// The beams: Gaussian, all alike but for the order zero.
    pub struct Beam {
        /// Diameter at the module, where the intensity is 1/e^2.
        diameter: Millimetre => positive,
        /// Full angle of divergence.
        divergence: Degree => not_negative,
        /// How the fan as a whole wanders; without it not at all.
        pointing: Option<Pointing>,
    }
}

record! {
    /// Pointing stability of the laser in its mount.
    pub struct Pointing {
        /// Standard deviation about each of two axes across the beam.
        wander: Degree => not_negative,
        /// Its usual period.
        period: Second => positive,
    }
}

record! {
    /// A plane.
    pub struct Wall {
        /// One of its points.
        point: [Millimetre; 3],
        /// Its normal, to the side of the cameras; of any length.
        normal: At<[f64; 3]>,
    }
}

record! {
    /// A flat mirror without loss.
    pub struct Mirror {
        /// Its middle.
        point: [Millimetre; 3],
        /// Its normal, out of its front; of any length. The back is black.
        normal: At<[f64; 3]>,
        /// Half its width and half its height (along the world's Y as far as it can): a beam that
        /// misses it goes on.
        half_size: [Millimetre; 2] => positive,
    }
}

record! {
    /// Where a camera stands and where it looks.
    pub struct SimulatedCamera {
        /// Its projection centre.
        position: [Millimetre; 3],
        /// A point on its optical axis.
        look_at: At<[Millimetre; 3]>,
        /// How it is turned about its optical axis: at zero the rows of its pictures are level
        /// (world Y up), and above zero it leans clockwise for whoever stands behind it.
        roll: Degree,
    }
}

record! {
    /// A coded target on a wall.
    pub struct PlacedTarget {
        /// Its code.
        code: At<u16>,
        /// Its centre.
        position: [Millimetre; 3],
    }
}

record! {
    /// What a picture is like. Grey values are fractions of full scale.
    pub struct SimulatedPicture {
        /// Size of the pictures against that of the calibrations; 0.5 halves both sides.
        scale: f64 => unit_range,
        /// Grey of the bare wall.
        background: f64 => fraction,
        /// By how much it differs from one side of the picture to the other.
        gradient: f64 => fraction,
        /// Grey of a dot's peak above the wall, for a beam other than the order zero that falls
        /// perpendicularly on a wall 0.9 m away.
        dot_amplitude: f64 => fraction,
        /// The laser's speckle.
        speckle: Speckle,
        /// Standard deviation of the read noise.
        read_noise: f64 => fraction,
        /// Electrons at full scale, for the photon noise.
        full_well_electrons: f64 => positive,
        /// Difference of grey between the two colours of a target.
        target_contrast: f64 => fraction,
        /// Quality of JPEG, from 1 to 100.
        jpeg_quality: u32 => percent,
    }
}

record! {
    /// Speckle in a dot.
    pub struct Speckle {
        /// Standard deviation of the intensity against its mean.
        contrast: f64 => fraction,
        /// Size of a grain in the full-size picture.
        grain: Pixel => positive,
    }
}

impl Simulation {
    /// The wall nearest to a place: targets there face along its normal.
    #[must_use]
    pub fn nearest_wall(&self, place: [Millimetre; 3]) -> Option<&Wall> {
        let walls = self.walls.iter().map(|wall| &wall.value);
        walls.min_by(|a, b| a.distance(place).0.total_cmp(&b.distance(place).0))
    }
}

impl Wall {
    /// How far a place is from this plane.
    #[must_use]
    pub fn distance(&self, place: [Millimetre; 3]) -> Millimetre {
        let normal = self.normal.value;
        let length = normal.iter().map(|n| n * n).sum::<f64>().sqrt();
        let along: f64 = (0..3).map(|i| (place[i].0 - self.point[i].0) * normal[i]).sum();
        Millimetre((along / length).abs())
    }
}
