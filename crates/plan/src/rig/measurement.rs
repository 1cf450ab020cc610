//! What the measurement is told: pattern, artefact, tie targets, prior.

use beampose_core::units::{Degree, Millimetre};

use crate::fault::At;
use crate::reader::{not_negative, positive};

record! {
    /// What solving is told beside pictures and readings.
    pub struct Measurement {
        /// The fan of beams: a pattern file, relative to the rig's.
        pattern: At<String>,
        /// The artefact: it defines the world frame.
        artefact: Artefact,
        /// Coded targets of unknown place: any code that is not the artefact's.
        tie_targets: Option<TieTargets>,
        /// Roughly how the module is turned.
        module_prior: Option<ModulePrior>,
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
