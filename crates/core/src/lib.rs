//! The words of beampose: units, ids, instrument traits, the clock, what a run acquires and
//! where it goes. Values and traits only: no files, no network, no threads, no SQL.
//!
//! Every other room imports this one; it imports none of them.

pub mod clock;
pub mod frames;
pub mod ids;
pub mod instrument;
pub mod record;
pub mod transport;
pub mod units;

pub use clock::{Clock, Stamp, VirtualClock};
pub use frames::Pose;
pub use ids::{CaptureId, InstrumentName, SessionId, StepNumber};
pub use instrument::{
    Axis, ByHand, Camera, Emission, Frame, Identity, Instrument, InstrumentError, Interlock, Laser,
    Sensor,
};
pub use record::{
    Answer, CaptureRecord, Event, EventKind, Gap, Look, Missing, Picture, Quantity, Reading,
    RunSink, SessionHeader, SessionOutcome, SinkError, StepOutcome, StepRecord, UsedFile,
};
