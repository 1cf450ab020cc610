//! What a person does: answers, and moves what no motor moves.

use std::time::Duration;

use beampose_core::clock::within;
use beampose_core::instrument::ByHand;
use beampose_core::{Answer, Axis, EventKind, InstrumentName};
use beampose_plan::policy::Asks;

use super::{Doing, Fault, suffix};
use crate::observe::Notice;
use crate::operator::Question;

/// How often a stage that is moved by hand is read.
const READBACK: Duration = Duration::from_millis(250);

impl Doing<'_, '_> {
    /// Asks until the answer is one, within the step's deadline.
    pub(super) async fn prompt(
        &mut self,
        name: &str,
        text: &str,
        asks: &Asks,
        default: Option<&str>,
    ) -> Result<(), Fault> {
        self.journal.note(EventKind::Asked, format!("{name}: {text}"));
        let mut question = Question {
            name: name.to_owned(),
            text: text.to_owned(),
            asks: asks.clone(),
            default: default.map(str::to_owned),
            complaint: None,
        };
        let answer = loop {
            let given = {
                let _stands_still = self.operator.is_person().then(|| self.clock.external());
                within(self.clock, self.left(), self.operator.answer(&question)).await
            };
            let deadline = self.step.deadline.duration();
            let (name, default) = (name.to_owned(), default.map(str::to_owned));
            match (given, default) {
                (Ok(Some((given, by))), _) => match asks.accept(&given) {
                    Ok(value) => break Answer { name, value, by },
                    Err(expected) => {
                        question.complaint = Some(format!("expected {expected}, found {given:?}"));
                        // A file says the same however often it is asked.
                        if !self.operator.is_person() {
                            return Err(Fault::Refused { name, expected, given });
                        }
                    }
                },
                (_, Some(value)) => break Answer { name, value, by: "default".to_owned() },
                (Ok(None), None) => return Err(Fault::Nobody { name }),
                (Err(_), None) => return Err(Fault::Unanswered { name, within: deadline }),
            }
        };
        let message = format!("{}: {} ({})", answer.name, answer.value, answer.by);
        self.journal.note(EventKind::Answered, message);
        self.situation.answers.insert(answer.name.clone(), answer.value.clone());
        self.acquired.answer = Some(answer);
        Ok(())
    }

    /// Waits until somebody has moved a stage to where it should be, and it stands there.
    pub(super) async fn stand_by_hand(
        &mut self,
        name: &InstrumentName,
        axis: &dyn Axis,
        target: f64,
        by_hand: ByHand,
    ) -> Result<(), Fault> {
        let unit = suffix(axis.unit());
        let tolerance = by_hand.tolerance;
        let text = format!("{name}: move to {target} {unit} by hand, within {tolerance} {unit}");
        self.journal.note(EventKind::Asked, text);
        let (mut there_since, mut place) = (None, f64::NAN);
        loop {
            let reading = self.look(name).await?;
            let now = reading.at.monotonic;
            let told = Notice::ByHand {
                axis: name.clone(),
                unit: axis.unit(),
                target,
                reading: reading.value,
            };
            self.journal.observers.tell(&told);
            // What still creeps does not stand.
            let is_there = (reading.value - target).abs() <= tolerance;
            let moved = (reading.value - place).abs() > 0.2 * tolerance;
            if !is_there || (there_since.is_some() && moved) {
                there_since = None;
            }
            if is_there && there_since.is_none() {
                (there_since, place) = (Some(now), reading.value);
            }
            if there_since.is_some_and(|since| now.saturating_sub(since) >= by_hand.still_for) {
                return Ok(());
            }
            if self.left().is_zero() {
                return Err(Fault::Deadline(self.step.deadline.duration()));
            }
            self.clock.sleep(READBACK).await;
        }
    }
}
