//! Policies as written: keys beside a step's own, and the plan's `conditions`.

use beampose_core::units::{Celsius, Degree, Milliampere, Millimetre, Nanometre, Second};
use beampose_core::{InstrumentName, Quantity};
use schemars::{Schema, SchemaGenerator, json_schema};
use serde::Serialize;

use super::file::StepFile;
use crate::fault::At;
use crate::quantity::{ANGLE, Byte, CURRENT, LENGTH, TEMPERATURE, WAVELENGTH, parse};
use crate::reader::{Choice, Property, Read, Reader, Record, not_negative, positive, quantity_of};
use crate::tree::{Node, Value};

record! {
    /// What may stand beside a step's own key.
    pub struct PolicyFile {
        /// After this time the step (or the whole block) has failed.
        timeout: Option<At<Second>>,
        /// What becomes of an error.
        on_error: Option<At<OnErrorFile>>,
        /// What is done before each retry.
        recover: Option<Vec<At<StepFile>>>,
        /// Limits of what is read: outside, the verdict is fail.
        accept: Option<Vec<At<BandFile>>>,
        /// Without this the step is skipped.
        run_if: Option<At<RunIfFile>>,
    }
}

/// One step, with what holds for it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StepEntry {
    /// What it does.
    pub step: StepFile,
    /// What holds for it.
    pub policy: PolicyFile,
}

type Entries = Vec<(crate::tree::Key, Node)>;

/// The entries of a map that belong to a record, and those that belong to a choice beside it. A key
/// that is of neither is taken for one of the record, if the choice is made.
fn parted<R: Record, C: Choice>(node: &Node) -> (Entries, Entries) {
    let Value::Map(entries) = &node.value else { return (Vec::new(), Vec::new()) };
    let is_choice = |name: &str| C::KEYS.contains(&name);
    let chosen = entries.iter().any(|(key, _)| is_choice(&key.name));
    let of_record = |name: &str| R::KEYS.contains(&name) || (chosen && !is_choice(name));
    entries.iter().cloned().partition(|(key, _)| of_record(&key.name))
}

impl Read for StepEntry {
    fn read(node: &Node, reader: &mut Reader) -> Option<Self> {
        let (policy, step) = parted::<PolicyFile, StepFile>(node);
        let part = |entries| Node { mark: node.mark, value: Value::Map(entries) };
        let policy = PolicyFile::read(&part(policy), reader);
        let step = match node.value {
            Value::Map(_) => StepFile::read(&part(step), reader),
            _ => StepFile::read(node, reader),
        };
        Some(Self { step: step?, policy: policy? })
    }

    fn schema(generator: &mut SchemaGenerator) -> Schema {
        generator.subschema_for::<Self>()
    }
}

impl schemars::JsonSchema for StepEntry {
    fn schema_name() -> std::borrow::Cow<'static, str> {
        "Step".into()
    }

    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        let policies: fn(&mut SchemaGenerator) -> Vec<Property> = PolicyFile::properties;
        StepFile::schema_with(policies, generator)
    }
}

words! {
    /// What becomes of an error.
    pub enum OnErrorWord ("what becomes of an error") {
        /// Everything is made safe and `finally` runs.
        "abort" => Abort,
        /// The step is passed over.
        "skip" => Skip,
        /// The run pauses until somebody lets it go on; the step is then tried again.
        "pause" => Pause,
        /// What is missing is recorded as missing (of `read` and `capture`).
        "record_missing" => RecordMissing,
    }
}

record! {
    /// Trying again.
    pub struct RetryFile {
        /// How often, beside the first time.
        times: At<u32>,
        /// How long to wait before the first retry; each further one waits twice as long.
        backoff: Option<Second> => not_negative,
        /// What becomes of the error when no retry helped; without it `abort`.
        then: Option<OnErrorWord>,
    }
}

record! {
    /// An error is tried to be mended.
    pub struct RetryOnly {
        /// By trying again.
        retry: RetryFile,
    }
}

/// A word, or a retry.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum OnErrorFile {
    /// At once.
    Word(OnErrorWord),
    /// After some retries.
    Retry(RetryFile),
}

impl Read for OnErrorFile {
    fn read(node: &Node, reader: &mut Reader) -> Option<Self> {
        match node.value {
            Value::Map(_) => RetryOnly::read(node, reader).map(|only| Self::Retry(only.retry)),
            _ => OnErrorWord::read(node, reader).map(Self::Word),
        }
    }

    fn schema(generator: &mut SchemaGenerator) -> Schema {
        let (word, retry) = (OnErrorWord::schema(generator), RetryOnly::schema(generator));
        json_schema!({ "anyOf": [word, retry] })
    }
}

/// A level of whatever an instrument reads: the unit says of what.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Level {
    /// Of a wavelength.
    Wavelength(Nanometre),
    /// Of a temperature.
    Temperature(Celsius),
    /// Of a current.
    Current(Milliampere),
    /// Of a position.
    Position(Millimetre),
    /// Of an angle.
    Angle(Degree),
}

impl Level {
    /// What it is a level of.
    #[must_use]
    pub const fn quantity(self) -> Quantity {
        match self {
            Self::Wavelength(_) => Quantity::Wavelength,
            Self::Temperature(_) => Quantity::Temperature,
            Self::Current(_) => Quantity::Current,
            Self::Position(_) => Quantity::Position,
            Self::Angle(_) => Quantity::Angle,
        }
    }

    /// The number, in the unit of [`Level::quantity`].
    #[must_use]
    pub const fn number(self) -> f64 {
        match self {
            Self::Wavelength(x) => x.0,
            Self::Temperature(x) => x.0,
            Self::Current(x) => x.0,
            Self::Position(x) => x.0,
            Self::Angle(x) => x.0,
        }
    }
}

impl Read for Level {
    fn read(node: &Node, reader: &mut Reader) -> Option<Self> {
        let is = |dimension| matches!(&node.value, Value::Text(t) if parse(t, dimension).is_ok());
        let mut number = |dimension| quantity_of(node, dimension, reader);
        if is(&WAVELENGTH) {
            return number(&WAVELENGTH).map(|n| Self::Wavelength(Nanometre(n)));
        }
        if is(&TEMPERATURE) {
            return number(&TEMPERATURE).map(|n| Self::Temperature(Celsius(n)));
        }
        if is(&CURRENT) {
            return number(&CURRENT).map(|n| Self::Current(Milliampere(n)));
        }
        if is(&ANGLE) {
            return number(&ANGLE).map(|n| Self::Angle(Degree(n)));
        }
        number(&LENGTH).map(|n| Self::Position(Millimetre(n)))
    }

    fn schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({ "type": "string", "examples": ["657.9 nm", "25 degC", "300 mm"] })
    }
}

record! {
    /// Limits of a reading.
    pub struct BandFile {
        /// Whose.
        instrument: At<InstrumentName>,
        /// The lower limit.
        above: Option<At<Level>>,
        /// The upper limit.
        below: Option<At<Level>>,
    }
}

record! {
    /// An answer of the operator.
    pub struct AnswerIs {
        /// The name of the prompt.
        answer: At<String>,
        /// The answer.
        is: String,
    }
}

/// Whether a step runs.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum RunIfFile {
    /// The operator answered so.
    Answer(AnswerIs),
    /// The last reading is within limits.
    Reading(BandFile),
}

impl Read for RunIfFile {
    fn read(node: &Node, reader: &mut Reader) -> Option<Self> {
        match &node.value {
            Value::Map(entries) if entries.iter().any(|(key, _)| key.name == "answer") => {
                AnswerIs::read(node, reader).map(Self::Answer)
            }
            _ => BandFile::read(node, reader).map(Self::Reading),
        }
    }

    fn schema(generator: &mut SchemaGenerator) -> Schema {
        let (answer, reading) = (AnswerIs::schema(generator), BandFile::schema(generator));
        json_schema!({ "anyOf": [answer, reading] })
    }
}

choice! {
    /// What must hold before each step.
    pub enum HoldsFile ("a condition") {
        /// A reading is within limits; a wavelength is not asked for while the laser is off.
        "reading" => Reading(BandFile),
        /// A laser's interlock is closed; while it is open everything is made safe.
        "interlock" => Interlock(At<InstrumentName>),
        /// The disk has at least this much room.
        "disk_free" => DiskFree(Byte),
    }
}

record! {
    /// For how long, and with what patience.
    pub struct PatienceFile {
        /// How long it must have held before the run goes on.
        hold_for as "for": Option<Second> => not_negative,
        /// How long to wait beyond that.
        settle: Option<Second> => not_negative,
        /// How often it is looked at; without it every 10 s.
        every: Option<Second> => positive,
        /// After so long the run gives up.
        give_up: Second => positive,
    }
}

/// One condition, with its patience beside it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ConditionFile {
    /// What must hold.
    pub holds: HoldsFile,
    /// For how long, and with what patience.
    pub patience: PatienceFile,
}

impl Read for ConditionFile {
    fn read(node: &Node, reader: &mut Reader) -> Option<Self> {
        let Value::Map(_) = &node.value else {
            return reader.expected(node, "a map with a condition and `give_up`");
        };
        let (patience, holds) = parted::<PatienceFile, HoldsFile>(node);
        let part = |entries| Node { mark: node.mark, value: Value::Map(entries) };
        let patience = PatienceFile::read(&part(patience), reader);
        let holds = HoldsFile::read(&part(holds), reader);
        Some(Self { holds: holds?, patience: patience? })
    }

    fn schema(generator: &mut SchemaGenerator) -> Schema {
        generator.subschema_for::<Self>()
    }
}

impl schemars::JsonSchema for ConditionFile {
    fn schema_name() -> std::borrow::Cow<'static, str> {
        "Condition".into()
    }

    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        HoldsFile::schema_with(PatienceFile::properties, generator)
    }
}

choice! {
    /// What the operator is asked for.
    pub enum AsksFile ("what is asked for") {
        /// Text: what it stands for, as `serial number`.
        "text" => Text(String),
        /// A number.
        "number" => Number(NumberFile),
        /// One of these.
        "choice" => Choice(Vec<At<String>>),
        /// `yes` or `no`; the text is the question itself.
        "confirm" => Confirm(String),
    }
}

record! {
    /// A number, and its unit for people.
    pub struct NumberFile {
        /// Its unit, as `mm`.
        unit: Option<String>,
        /// The lower limit.
        from: Option<f64>,
        /// The upper limit.
        to: Option<f64>,
    }
}

record! {
    /// A question to the operator.
    pub struct PromptFile {
        /// What the answer is called, in `run_if`, in the report and in a file of answers.
        name: At<String>,
        /// The question, or what is to be done.
        text: String,
        /// What is asked for; without it a confirmation.
        ask: Option<At<AsksFile>>,
        /// What is taken for the answer when nobody gave one in time; without it that is an error.
        default: Option<At<String>>,
        /// How long to wait for an answer; without it a day.
        deadline: Option<Second> => positive,
    }
}
