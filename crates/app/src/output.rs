//! Everything that goes to standard output, and how the program ends.
//!
//! A reader that closes the pipe early (`| head`) is no error: the program then ends quietly.

use std::io::Write as _;
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};

use indicatif::MultiProgress;

/// How the program ends; documented in `--help`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Exit {
    /// All done; a verdict, if any, is pass or inconclusive.
    Success,
    /// All done; the verdict is fail.
    VerdictFail,
    /// The command line, plan, rig or another input is at fault. Nothing was done.
    Input,
    /// The session was stopped, aborted or halted by the operator or a signal; the lasers are off.
    Aborted,
    /// An instrument, the store or the program failed; what was acquired is kept.
    Failed,
}

impl From<Exit> for ExitCode {
    fn from(exit: Exit) -> Self {
        Self::from(match exit {
            Exit::Success => 0,
            Exit::VerdictFail => 1,
            Exit::Input => 2,
            Exit::Aborted => 3,
            Exit::Failed => 4,
        })
    }
}

/// Set when something could not be printed for another reason than a closed pipe.
static LOST: AtomicBool = AtomicBool::new(false);

/// Prints a text and a line feed to standard output. A reader that reads no further misses it; that
/// it could not be written otherwise, [`lost`] tells at the end.
pub fn print(text: &str) {
    let mut out = std::io::stdout().lock();
    let written = writeln!(out, "{text}").and_then(|()| out.flush());
    if let Err(error) = written
        && error.kind() != std::io::ErrorKind::BrokenPipe
        && !LOST.swap(true, Ordering::Relaxed)
    {
        // Who prints may have moved the bars aside already.
        say(&format!("beampose: the output cannot be written: {error}"));
    }
}

fn say(text: &str) {
    let _nobody_left_to_tell = writeln!(std::io::stderr().lock(), "{text}");
}

/// Whether output was lost.
pub fn lost() -> bool {
    LOST.load(Ordering::Relaxed)
}

/// The progress bars that stand on the terminal, if any do.
static BARS: Mutex<Option<MultiProgress>> = Mutex::new(None);

/// From now on these bars make room for what is said; `None`: there are none any more.
pub fn make_room(bars: Option<MultiProgress>) {
    *BARS.lock().unwrap_or_else(PoisonError::into_inner) = bars;
}

/// Prints a text and a line feed to standard error, above the progress bars where there are any;
/// there is nobody to tell if that fails.
pub fn complain(text: &str) {
    // Not held meanwhile: whoever draws the bars may have something to say too.
    let bars = BARS.lock().unwrap_or_else(PoisonError::into_inner).clone();
    match bars {
        Some(bars) => bars.suspend(|| say(text)),
        None => say(text),
    }
}
