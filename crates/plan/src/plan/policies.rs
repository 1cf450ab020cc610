//! From policies, conditions and prompts as written to those as understood.

use beampose_core::units::Second;

use super::file::{PlanFile, StepFile};
use super::policy::{
    AsksFile, BandFile, ConditionFile, HoldsFile, Level, OnErrorFile, OnErrorWord, PolicyFile,
    PromptFile, RunIfFile,
};
use super::validate::Scope;
use super::{PlanBand, PlanCondition, PlanHolds, PlanPolicy, PlanRunIf, PlanStep, PlanStepKind};
use crate::fault::At;
use crate::policy::{Asks, OnError, Retry};
use crate::reader::{Reader, is_name};
use crate::suggest;

/// Before the first retry, where the plan says nothing.
const BACKOFF: Second = Second(1.0);
/// More retries than this are a slip of the finger.
const MAX_RETRIES: u32 = 1000;

impl Scope {
    /// What holds for all main steps.
    pub(super) fn policy_of_plan(&mut self, file: &PlanFile, reader: &mut Reader) -> PlanPolicy {
        let of_plan = PolicyFile {
            timeout: file.timeout.clone(),
            on_error: file.on_error.clone(),
            recover: file.recover.clone(),
            accept: None,
            run_if: None,
        };
        self.policy(&of_plan, reader)
    }

    pub(super) fn policy(&mut self, file: &PolicyFile, reader: &mut Reader) -> PlanPolicy {
        if let Some(time) = file.timeout.as_ref().filter(|time| time.value.0 <= 0.0) {
            let message = format!("a timeout must be above zero, found `{}`", time.value);
            reader.fault(time.mark, message);
        }
        let on_error = file.on_error.as_ref().map(|on_error| on_error.with(so(on_error, reader)));
        let recover = file.recover.as_ref().map(|steps| self.recovery(steps, reader));
        if recover.is_some() && on_error.as_ref().is_some_and(|it| it.value.0.is_none()) {
            let mark = file.on_error.as_ref().map(|it| it.mark).unwrap_or_default();
            let help = Some("as in `on_error: {retry: {times: 2}}`".to_owned());
            reader.fault_help(mark, "`recover` is done before a retry".to_owned(), help);
        }
        let accept = file.accept.iter().flatten();
        let accept = accept.filter_map(|it| Some(it.with(band(&it.value, reader)?))).collect();
        let run_if = file.run_if.as_ref().and_then(|run_if| self.run_if(run_if, reader));
        PlanPolicy {
            timeout: file.timeout.as_ref().map(|t| t.value),
            on_error,
            recover,
            accept,
            run_if,
        }
    }

    fn recovery(&mut self, steps: &[At<StepFile>], reader: &mut Reader) -> Vec<PlanStep> {
        for step in steps {
            let plain = matches!(
                step.value,
                StepFile::Laser(_) | StepFile::Wait(_) | StepFile::Move(_) | StepFile::Read(_)
            );
            if !plain {
                let message = "`recover` switches lasers, waits, moves and reads; nothing else";
                reader.fault(step.mark, message);
            }
        }
        steps.iter().flat_map(|step| self.step(step, reader)).collect()
    }

    fn run_if(&self, file: &At<RunIfFile>, reader: &mut Reader) -> Option<PlanRunIf> {
        let answer = match &file.value {
            RunIfFile::Reading(limits) => return band(limits, reader).map(PlanRunIf::Reading),
            RunIfFile::Answer(answer) => answer,
        };
        let name = &answer.answer;
        let Some(asks) = self.prompts.get(&name.value) else {
            let help = suggest::help(&name.value, self.prompts.keys().map(String::as_str));
            let message = format!("no prompt before this step is called `{}`", name.value);
            reader.fault_help(name.mark, message, help);
            return None;
        };
        match asks.accept(&answer.is) {
            Ok(is) => Some(PlanRunIf::Answer { name: name.value.clone(), is }),
            Err(expected) => {
                let message = format!("`{}` is no answer to `{}`", answer.is, name.value);
                reader.fault_help(file.mark, message, Some(format!("that is {expected}")));
                None
            }
        }
    }

    pub(super) fn prompt(
        &mut self,
        file: &PromptFile,
        reader: &mut Reader,
    ) -> Option<PlanStepKind> {
        let name = &file.name;
        if !is_name(&name.value) {
            reader.fault(name.mark, "a prompt's name has letters, digits and `_` only");
        }
        let asks = asks(file, reader)?;
        if self.prompts.insert(name.value.clone(), asks.clone()).is_some() {
            reader.fault(name.mark, format!("another prompt is called `{}`", name.value));
        }
        let default = file.default.as_ref().and_then(|default| {
            let accepted = asks.accept(&default.value);
            if let Err(expected) = &accepted {
                let message = format!("expected {expected}, found `{}`", default.value);
                reader.fault(default.mark, message);
            }
            accepted.ok()
        });
        Some(PlanStepKind::Prompt {
            name: name.value.clone(),
            text: file.text.clone(),
            asks,
            default,
            deadline: file.deadline,
        })
    }
}

fn asks(file: &PromptFile, reader: &mut Reader) -> Option<Asks> {
    let Some(asks) = &file.ask else { return Some(Asks::Confirm) };
    Some(match &asks.value {
        AsksFile::Text(_) => Asks::Text,
        AsksFile::Confirm(_) => Asks::Confirm,
        AsksFile::Number(number) => {
            if let (Some(from), Some(to)) = (number.from, number.to)
                && from > to
            {
                reader.fault(asks.mark, format!("no number is from {from} to {to}"));
                return None;
            }
            Asks::Number { from: number.from, to: number.to }
        }
        AsksFile::Choice(choices) => {
            for (i, choice) in choices.iter().enumerate() {
                let same = |c: &At<String>| c.value.eq_ignore_ascii_case(&choice.value);
                if choices.iter().take(i).any(same) {
                    reader.fault(choice.mark, format!("`{}` is a choice twice", choice.value));
                }
            }
            Asks::Choice(choices.iter().map(|choice| choice.value.clone()).collect())
        }
    })
}

fn so(file: &At<OnErrorFile>, reader: &mut Reader) -> (Option<Retry>, OnError) {
    match &file.value {
        OnErrorFile::Word(word) => (None, word_of(*word)),
        OnErrorFile::Retry(retry) => {
            if !(1..=MAX_RETRIES).contains(&retry.times.value) {
                let found = retry.times.value;
                let message = format!("expected 1 to {MAX_RETRIES} retries, found `{found}`");
                reader.fault(retry.times.mark, message);
            }
            let backoff = retry.backoff.unwrap_or(BACKOFF);
            let then = retry.then.map_or(OnError::Abort, word_of);
            (Some(Retry { times: retry.times.value, backoff }), then)
        }
    }
}

const fn word_of(word: OnErrorWord) -> OnError {
    match word {
        OnErrorWord::Abort => OnError::Abort,
        OnErrorWord::Skip => OnError::Skip,
        OnErrorWord::Pause => OnError::Pause,
        OnErrorWord::RecordMissing => OnError::RecordMissing,
    }
}

fn band(file: &BandFile, reader: &mut Reader) -> Option<PlanBand> {
    let (above, below) = (file.above.as_ref(), file.below.as_ref());
    let Some(one) = above.or(below) else {
        let help = Some("as in `above: 657.9 nm` or `below: 658.1 nm`".to_owned());
        reader.fault_help(file.instrument.mark, "limits without a limit".to_owned(), help);
        return None;
    };
    let quantity = one.value.quantity();
    if let (Some(above), Some(below)) = (above, below) {
        if below.value.quantity() != quantity {
            let message = format!("expected a limit of {}, as `above` is", quantity.name());
            reader.fault(below.mark, message);
            return None;
        }
        if above.value.number() > below.value.number() {
            reader.fault(below.mark, "nothing is above the one limit and below the other");
        }
    }
    let number = |level: &At<Level>| level.value.number();
    Some(PlanBand {
        instrument: file.instrument.clone(),
        quantity,
        above: above.map(number),
        below: below.map(number),
    })
}

/// The plan's conditions.
pub(super) fn conditions(
    files: Option<&[At<ConditionFile>]>,
    reader: &mut Reader,
) -> Vec<PlanCondition> {
    let understood = files.unwrap_or_default().iter().filter_map(|condition| {
        let what = match &condition.value.holds {
            HoldsFile::Reading(limits) => PlanHolds::Reading(band(limits, reader)?),
            HoldsFile::Interlock(laser) => PlanHolds::Interlock(laser.clone()),
            HoldsFile::DiskFree(bytes) => PlanHolds::DiskFree(bytes.0),
        };
        Some(PlanCondition { what, patience: condition.value.patience.clone() })
    });
    understood.collect()
}
