//! Who answers questions: a file of answers, then the terminal.

use std::collections::BTreeMap;
use std::io::{BufRead as _, IsTerminal as _};
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

use async_trait::async_trait;
use beampose_engine::{Control, Operator, Question};
use beampose_plan::policy::Asks;
use tokio::sync::oneshot;

use crate::output::complain;

/// Answers by the prompts' names, as a file has them.
pub type Answers = BTreeMap<String, String>;

/// More than any plan asks.
const MAX_BYTES: u64 = 1 << 20;

/// Reads a file of answers: a YAML map from the prompts' names to answers.
///
/// # Errors
/// What is wrong with it, for people.
pub fn answers(path: &Path) -> Result<Answers, String> {
    let name = path.display();
    let size = std::fs::metadata(path).map_err(|error| format!("{name}: {error}"))?.len();
    if size > MAX_BYTES {
        return Err(format!("{name}: {size} bytes; at most {MAX_BYTES} are read"));
    }
    let text = std::fs::read_to_string(path).map_err(|error| format!("{name}: {error}"))?;
    let given: BTreeMap<String, Given> = serde_yaml::from_str(&text).map_err(|error| {
        format!("{name}: {error}\n  help: a file of answers is a map, as `fixture: rolled`")
    })?;
    Ok(given.into_iter().map(|(prompt, given)| (prompt, given.text())).collect())
}

/// An answer as YAML has it: nobody quotes a number.
#[derive(serde::Deserialize)]
#[serde(untagged)]
enum Given {
    Yes(bool),
    Number(f64),
    Text(String),
}

impl Given {
    fn text(self) -> String {
        match self {
            Self::Yes(yes) => if yes { "yes" } else { "no" }.to_owned(),
            Self::Number(number) => number.to_string(),
            Self::Text(text) => text,
        }
    }
}

/// The operator of a run.
pub struct Desk {
    answers: Answers,
    terminal: Option<Terminal>,
}

impl Desk {
    /// With a file's answers, and the terminal if standard input is one. Enter lets a run that
    /// pauses go on.
    pub fn new(answers: Answers, control: &Control) -> Self {
        let is_terminal = std::io::stdin().is_terminal();
        Self { answers, terminal: is_terminal.then(|| Terminal::new(control.clone())) }
    }
}

#[async_trait]
impl Operator for Desk {
    async fn answer(&self, question: &Question) -> Option<(String, String)> {
        if let Some(answer) = self.answers.get(&question.name) {
            return Some((answer.clone(), "answers file".to_owned()));
        }
        let line = self.terminal.as_ref()?.ask(question).await?;
        let given = match (&question.default, line.trim()) {
            (Some(default), "") => default.clone(),
            _ => line,
        };
        Some((given, "terminal".to_owned()))
    }

    fn is_person(&self) -> bool {
        self.terminal.is_some()
    }
}

/// Lines from the terminal: to the question that waits, else they let a pause end.
struct Terminal {
    waiting: Arc<Mutex<Option<oneshot::Sender<String>>>>,
}

impl Terminal {
    fn new(control: Control) -> Self {
        let waiting: Arc<Mutex<Option<oneshot::Sender<String>>>> = Arc::default();
        let shared = waiting.clone();
        // A thread of its own: nothing else can wait for a terminal without holding up the end of
        // the program.
        std::thread::spawn(move || {
            for line in std::io::stdin().lock().lines() {
                let Ok(line) = line else { break };
                let asked = shared.lock().unwrap_or_else(PoisonError::into_inner).take();
                match asked {
                    // Who asked may have given up: then nobody listens.
                    Some(asked) => drop(asked.send(line)),
                    None => control.go_on(),
                }
            }
            // Whoever waits hears that nothing will come.
            shared.lock().unwrap_or_else(PoisonError::into_inner).take();
        });
        Self { waiting }
    }

    async fn ask(&self, question: &Question) -> Option<String> {
        complain(&spoken(question));
        let (send, receive) = oneshot::channel();
        *self.waiting.lock().unwrap_or_else(PoisonError::into_inner) = Some(send);
        receive.await.ok()
    }
}

/// The question as it stands on the terminal.
fn spoken(question: &Question) -> String {
    let wanted = match &question.asks {
        Asks::Text => "text".to_owned(),
        Asks::Confirm => "yes or no".to_owned(),
        Asks::Choice(choices) => choices.join(" / "),
        Asks::Number { from: Some(from), to: Some(to) } => format!("a number from {from} to {to}"),
        Asks::Number { .. } => "a number".to_owned(),
    };
    let complaint = question.complaint.iter().map(|c| format!("{c}\n")).collect::<String>();
    let default = question.default.iter().map(|d| format!(", Enter for {d}")).collect::<String>();
    format!("{complaint}? {}: {} [{wanted}{default}]", question.name, question.text)
}
