//! The person at a simulated rig: answers prompts that nobody else does, and rolls the module.

use std::collections::BTreeMap;
use std::sync::Arc;

use async_trait::async_trait;
use beampose_core::Clock;
use beampose_engine::{Operator, Question};
use beampose_plan::rig::simulation::SimulatedAnswer;
use beampose_plan::{Action, Rig, Step};
use beampose_virtual_lab::World;

use super::Laboratory;

/// What a simulated person does at each prompt.
fn answers(rig: &Rig) -> BTreeMap<&str, &SimulatedAnswer> {
    let person = rig.simulation.as_ref().and_then(|simulation| simulation.person.as_ref());
    person.into_iter().flatten().map(|(name, at)| (name.as_str(), &at.value)).collect()
}

/// How far the module is rolled when these steps are done, degrees.
pub fn roll_deg<'a>(rig: &Rig, done: impl Iterator<Item = &'a Step>) -> f64 {
    let answers = answers(rig);
    let rolled = done.filter_map(|step| match &step.action {
        Action::Prompt { name, .. } => answers.get(name.as_str())?.roll,
        _ => None,
    });
    rolled.last().map_or(0.0, |roll| roll.0)
}

/// An operator, and beside it the simulated person.
pub struct WithPerson<'a> {
    operator: &'a dyn Operator,
    answers: BTreeMap<&'a str, &'a SimulatedAnswer>,
    world: Option<(Arc<World>, Arc<dyn Clock>)>,
}

impl<'a> WithPerson<'a> {
    /// `operator`, with the person that `rig` simulates, if it does.
    pub fn new(operator: &'a dyn Operator, rig: &'a Rig, laboratory: &Laboratory) -> Self {
        let world = laboratory.world.clone().map(|world| (world, laboratory.clock.shared()));
        Self { operator, answers: answers(rig), world }
    }
}

#[async_trait]
impl Operator for WithPerson<'_> {
    async fn answer(&self, question: &Question) -> Option<(String, String)> {
        let simulated = self.answers.get(question.name.as_str());
        let given = match simulated {
            Some(answer) => Some((answer.answer.clone(), "simulated person".to_owned())),
            None => self.operator.answer(question).await,
        };
        // The hands do what the mouth says.
        if let (Some(roll), Some((world, clock))) = (simulated.and_then(|it| it.roll), &self.world)
        {
            world.roll_module(clock.now(), roll.0);
        }
        given
    }

    fn is_person(&self) -> bool {
        self.operator.is_person()
    }
}
