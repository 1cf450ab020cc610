//! What the measurement is told: pattern, artefact, tie targets, prior.

use beampose_core::InstrumentName;
use beampose_core::units::{Celsius, Degree, Millimetre, Nanometre};

use crate::fault::At;
use crate::quantity::Pixel;
use crate::reader::{not_negative, positive};

record! {
    /// What solving is told beside pictures and readings.
    pub struct Measurement {
        /// The fan of beams: a pattern file, relative to the rig's.
        pattern: At<String>,
        /// The artefact: it defines the world frame. A rig that finds no pose needs none.
        artefact: Option<Artefact>,
        /// Coded targets of unknown place: any code that is not the artefact's.
        tie_targets: Option<TieTargets>,
        /// Roughly how the module is turned.
        module_prior: Option<ModulePrior>,
        /// How the wavelength follows the diode's temperature, as a wavelength drift finds it: the fan
        /// is corrected by it where the wavelength itself was not read.
        wavelength_from_temperature: Option<WavelengthFromTemperature>,
        /// The module turned before a far plane, where its angles are measured.
        goniometer: Option<Goniometer>,
    }
}

record! {
    /// The line of the wavelength over the temperature of the diode.
    pub struct WavelengthFromTemperature {
        /// The thermometer on the diode.
        of: At<InstrumentName>,
        /// A temperature on the line.
        at: Celsius,
        /// The wavelength there, in vacuum.
        wavelength: Nanometre => positive,
        /// Its standard uncertainty.
        wavelength_u: Nanometre => not_negative,
        /// By how much the wavelength grows with a degree.
        per_degree: Nanometre,
        /// Its standard uncertainty.
        per_degree_u: Nanometre => not_negative,
    }
}

record! {
    /// A rotary axis that carries the module, a far plane, and a camera that sees a part of it.
    pub struct Goniometer {
        /// The axis.
        axis: At<InstrumentName>,
        /// The camera.
        camera: At<InstrumentName>,
        /// The reference pixel, at the camera's full size: dots are brought there.
        target: [Pixel; 2],
        /// Roughly how far a dot moves in the picture when the axis turns by a degree; each
        /// closing-in measures it.
        px_per_degree: [Pixel; 2],
        /// Whereto the fan turns when the axis counts up, as the module sees it.
        turns: FanTurns,
        /// Roughly where the axis stands when the zero order is at the reference pixel.
        zero: Degree,
        /// How roughly; less than half the angle between neighbours.
        within: Degree => positive,
        /// From the axis to the plane along the beam, mirrors unfolded.
        distance: Millimetre => positive,
        /// Standard uncertainty of that.
        distance_u: Millimetre => not_negative,
        /// Standard uncertainty of where the grating stands off the axis: across the beam, along it,
        /// along the axis.
        misalignment_u: [Millimetre; 3],
        /// Standard uncertainty of the place of a dot on the plane: along the way that the axis
        /// moves it, and across.
        dot_u: [Millimetre; 2],
    }
}

words! {
    /// A way to turn.
    pub enum FanTurns ("`left` or `right`") {
        /// To the left: the axis counts up to bring beams further to the right.
        "left" => Left,
        /// To the right: the axis counts down to bring beams further to the right.
        "right" => Right,
    }
}

record! {
    /// The reference artefact.
    pub struct Artefact {
        /// Its targets.
        targets: At<Vec<At<ArtefactTarget>>>,
        /// Relative standard uncertainty of its scale as a whole.
        scale_relative_u: f64 => not_negative,
    }
}

record! {
    /// A ring-coded target of known place.
    pub struct ArtefactTarget {
        /// Its code: the smallest value over the twelve cyclic rotations.
        code: At<u16>,
        /// Its centre in the world.
        xyz: [Millimetre; 3],
        /// Standard uncertainty of each coordinate.
        u: Millimetre => positive,
        /// Radius of its centre disc; the code ring is from two to three times that.
        radius: Millimetre => positive,
    }
}

record! {
    /// Coded targets of unknown place.
    pub struct TieTargets {
        /// Radius of their centre discs.
        radius: Millimetre => positive,
    }
}

record! {
    /// Roughly how the module is turned, to choose among quarter turns of its pattern.
    pub struct ModulePrior {
        /// Omega, phi, kappa; all zero for a module that looks straight at the wall.
        rotation_omega_phi_kappa: [Degree; 3],
        /// How far it may be from that.
        within: Degree => positive,
    }
}
