//! From what was seen in the pictures of one capture to poses, with no manual step.
//!
//! Orient the cameras on the artefact's targets, find the tie targets in space, name the beams,
//! adjust everything, and find the module by each method asked for. What cannot be solved says why.

mod by_angles;
mod capture;
mod eccentricity;
mod knocks;
mod orient;
mod outcome;
mod points;
mod session;
mod types;

pub use capture::{Sighting, solve_capture};
pub use eccentricity::circle_image_offset;
pub use session::{Knock, SessionSolution, SolvedCapture, solve_session, solve_session_with};
pub use types::{
    CameraSolution, CaptureSolution, DotInSpace, Method, MethodResult, Observation, StageSeconds,
    Subject,
};
