//! The person at the rig, or what stands in for one.

use async_trait::async_trait;
use beampose_plan::policy::Asks;

/// What an operator is asked.
#[derive(Debug, Clone, PartialEq)]
pub struct Question {
    /// What the answer is called.
    pub name: String,
    /// The question, or what is to be done.
    pub text: String,
    /// What would be an answer.
    pub asks: Asks,
    /// The answer if nobody gives one in time.
    pub default: Option<String>,
    /// What was wrong with the answer before.
    pub complaint: Option<String>,
}

/// Who answers questions.
#[async_trait]
pub trait Operator: Send + Sync {
    /// An answer as given, and by whom (`terminal`); `None` when nobody will ever give one.
    async fn answer(&self, question: &Question) -> Option<(String, String)>;
    /// Whether it takes real time: a virtual clock then stands still.
    fn is_person(&self) -> bool {
        true
    }
}

/// Nobody is there: defaults stand in.
#[derive(Debug, Clone, Copy, Default)]
pub struct Nobody;

#[async_trait]
impl Operator for Nobody {
    async fn answer(&self, _: &Question) -> Option<(String, String)> {
        None
    }

    fn is_person(&self) -> bool {
        false
    }
}
