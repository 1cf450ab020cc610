//! Faults: what is wrong in a file, where, what was expected and what may help.
//!
//! Every fault of a file is collected before anything is refused. A fault carries the line it
//! speaks of, so that it can be shown long after the file was read.

use std::fmt;
use std::sync::Arc;

use serde::Serialize;

/// A place in a file: line and column count from 1, in characters.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub struct Mark {
    /// The line; 0 where the fault is of the file as a whole.
    pub line: u32,
    /// The column of the first character.
    pub column: u32,
    /// How many characters, for the carets.
    pub length: u32,
}

/// A value and where it was written.
#[derive(Debug, Clone, PartialEq)]
pub struct At<T> {
    /// The value.
    pub value: T,
    /// Its place.
    pub mark: Mark,
}

impl<T> At<T> {
    /// Another value at the same place.
    pub(crate) fn with<U>(&self, value: U) -> At<U> {
        At { value, mark: self.mark }
    }
}

/// As text a value is what counts, not where it stood.
impl<T: Serialize> Serialize for At<T> {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        self.value.serialize(serializer)
    }
}

/// A file's name, as people should see it, and its text.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Source {
    name: Arc<str>,
    text: Arc<str>,
}

impl Source {
    /// A file of this name and text.
    #[must_use]
    pub fn new(name: &str, text: &str) -> Self {
        Self { name: name.into(), text: text.into() }
    }

    /// The name, as given by whoever read the file.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The text.
    #[must_use]
    pub fn text(&self) -> &str {
        &self.text
    }

    /// An error at a place in this file.
    pub fn error(&self, mark: Mark, message: impl Into<String>) -> Fault {
        self.fault(Severity::Error, mark, message.into())
    }

    /// A warning at a place in this file.
    pub fn warning(&self, mark: Mark, message: impl Into<String>) -> Fault {
        self.fault(Severity::Warning, mark, message.into())
    }

    fn fault(&self, severity: Severity, mark: Mark, message: String) -> Fault {
        let line = (mark.line as usize).checked_sub(1).and_then(|n| self.text.lines().nth(n));
        let (line, shown_from) = line.map_or((None, 0), |text| {
            let (shown, from) = crop(text, mark.column);
            (Some(shown), from)
        });
        Fault { file: self.name.to_string(), severity, mark, message, help: None, line, shown_from }
    }
}

/// The part of a long line that is worth showing, and how many characters were left out before it.
fn crop(line: &str, column: u32) -> (String, u32) {
    const BEFORE: u32 = 60;
    const WIDTH: usize = 120;
    let from = if line.chars().count() <= WIDTH { 0 } else { column.saturating_sub(BEFORE) };
    let shown = line.chars().skip(from as usize).take(WIDTH).map(printable).collect();
    (shown, from)
}

/// A file may hold what a terminal would obey: one such character becomes one question mark.
pub(crate) fn printable(c: char) -> char {
    match c {
        '\t' => ' ',
        c if c.is_control() => '\u{fffd}',
        c => c,
    }
}

/// Whether a fault forbids the run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Severity {
    /// It does.
    Error,
    /// It does not, but somebody should look.
    Warning,
}

/// One thing that is wrong. Equal to another that says the same of the same place.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Fault {
    /// The file's name, as given by whoever read it.
    pub file: String,
    /// Whether it forbids the run.
    pub severity: Severity,
    /// Where.
    pub mark: Mark,
    /// What was expected and what was found.
    pub message: String,
    /// What may help.
    pub help: Option<String>,
    line: Option<String>,
    shown_from: u32,
}

impl Fault {
    /// A fault of a file as a whole.
    pub fn of_file(name: &str, message: impl Into<String>) -> Self {
        Source::new(name, "").error(Mark::default(), message)
    }

    /// The same, but it does not forbid the run.
    #[must_use]
    pub(crate) const fn into_warning(mut self) -> Self {
        self.severity = Severity::Warning;
        self
    }

    /// The same fault with a help.
    #[must_use]
    pub fn help(mut self, help: impl Into<String>) -> Self {
        self.help = Some(help.into());
        self
    }

    /// The same fault with a help, if there is one.
    #[must_use]
    pub fn maybe_help(mut self, help: Option<String>) -> Self {
        self.help = help.or(self.help);
        self
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.file)?;
        if self.mark.line > 0 {
            write!(f, ":{}:{}", self.mark.line, self.mark.column)?;
        }
        let word = if self.severity == Severity::Warning { "warning: " } else { "" };
        write!(f, ": {word}{}", self.message)?;
        let margin = self.mark.line.to_string().len();
        if let Some(line) = &self.line {
            let before =
                self.mark.column.saturating_sub(1).saturating_sub(self.shown_from) as usize;
            let room = line.chars().count().saturating_sub(before).max(1);
            let carets = "^".repeat((self.mark.length.max(1) as usize).min(room));
            write!(f, "\n {} | {line}", self.mark.line)?;
            write!(f, "\n {:margin$} | {:before$}{carets}", "", "")?;
        }
        if let Some(help) = &self.help {
            write!(f, "\n {:margin$} = help: {help}", "")?;
        }
        Ok(())
    }
}

/// Nobody reads more than this, and a file that is not a plan at all would give thousands.
const MOST_FAULTS: usize = 100;

/// All that is wrong, in the order of the files' lines.
#[derive(Debug, Clone, PartialEq, Eq, Default, thiserror::Error)]
pub struct Faults {
    faults: Vec<Fault>,
}

impl Faults {
    /// Adds one, unless the same is already there (a loop meets the same fault in every turn).
    pub fn push(&mut self, fault: Fault) {
        if !self.is_full() && !self.faults.contains(&fault) {
            self.faults.push(fault);
        }
    }

    /// True when no more are kept.
    pub(crate) fn is_full(&self) -> bool {
        self.faults.len() >= MOST_FAULTS
    }

    /// Adds all of another collection.
    pub fn extend(&mut self, other: Self) {
        other.faults.into_iter().for_each(|fault| self.push(fault));
    }

    /// Adds those of another collection that stand in lines which have no fault yet: a stand-in for
    /// a broken value must not be complained of again.
    pub(crate) fn extend_elsewhere(&mut self, other: Self) {
        let taken: std::collections::BTreeSet<(String, u32)> =
            self.faults.iter().map(|f| (f.file.clone(), f.mark.line)).collect();
        let free = |f: &Fault| !taken.contains(&(f.file.clone(), f.mark.line));
        other.faults.into_iter().filter(free).for_each(|fault| self.push(fault));
    }

    /// The faults, sorted by file and place.
    #[must_use]
    pub fn sorted(&self) -> Vec<&Fault> {
        let mut sorted: Vec<&Fault> = self.faults.iter().collect();
        sorted.sort_by(|a, b| (&a.file, a.mark).cmp(&(&b.file, b.mark)));
        sorted
    }

    /// True when nothing is wrong.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.faults.is_empty()
    }

    /// How many there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.faults.len()
    }

    /// `value` when nothing is wrong.
    ///
    /// # Errors
    /// The faults, when there are any, or when there is no value: then one says so.
    pub(crate) fn into_result<T>(mut self, value: Option<T>, name: &str) -> Result<T, Self> {
        match value {
            Some(value) if self.is_empty() => Ok(value),
            Some(_) => Err(self),
            None => {
                if self.is_empty() {
                    self.push(Fault::of_file(name, "cannot be understood"));
                }
                Err(self)
            }
        }
    }
}

/// What a file says as far as it can be understood, and what is wrong with it.
#[derive(Debug, Clone)]
pub struct AsRead<T> {
    /// With stand-ins where a value is broken; nothing where the file is no plan or rig at all.
    pub value: Option<T>,
    /// What is wrong.
    pub faults: Faults,
}

impl<T> AsRead<T> {
    /// A file that could not even be read.
    #[must_use]
    pub fn unreadable(fault: Fault) -> Self {
        Self { value: None, faults: fault.into() }
    }
}

impl From<Fault> for Faults {
    fn from(fault: Fault) -> Self {
        Self { faults: vec![fault] }
    }
}

impl fmt::Display for Faults {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for fault in self.sorted() {
            writeln!(f, "{fault}\n")?;
        }
        match self.len() {
            MOST_FAULTS => write!(f, "{MOST_FAULTS} faults or more"),
            1 => write!(f, "1 fault"),
            n => write!(f, "{n} faults"),
        }
    }
}
