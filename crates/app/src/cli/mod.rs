//! The command line. Each command is a file here and a line in `Command`.

mod calibrate;
mod calibrations;
mod check;
mod export;
mod filter;
mod import;
pub mod report;
mod resume;
mod rig;
mod run;
mod score;
pub mod sessions;
pub mod solve;
mod targets;
mod tell;

use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;

use beampose_photogrammetry::solve::Method;
use beampose_store::{Store, StoreError};
use clap::{Parser, Subcommand};

use crate::output::{Exit, complain, lost};

/// Runs an optical position sensor by itself, from a plan in YAML to a report with uncertainties.
///
/// A module (laser and diffraction grating) projects a known fan of beams on the walls; cameras
/// photograph the dots and a reference artefact; from the pictures beampose finds where the module
/// is and how it is turned, with covariance, and runs the laboratory around that measurement.
#[derive(Parser)]
#[command(name = "beampose", version, max_term_width = 100, after_long_help = AFTER_HELP)]
struct Cli {
    #[command(subcommand)]
    command: Command,

    /// Tell more on standard error (-v, -vv); RUST_LOG has the last word
    #[arg(short, long, global = true, action = clap::ArgAction::Count)]
    verbose: u8,

    /// How lines of the log look, on standard error and in the session's file
    #[arg(long, global = true, value_enum, value_name = "FORMAT", default_value = "text")]
    log_format: crate::log::Format,
}

const AFTER_HELP: &str = "\
Exit codes:
  0  done; a verdict, if there is one, is pass or inconclusive
  1  done; the verdict is fail
  2  the command line, the plan, the rig or another input is at fault; nothing was done
  3  the session was stopped, aborted or halted (Ctrl-C, SIGTERM, `tell`); the laser is off, what
     was acquired is kept
  4  an instrument, the store or the program failed; what was acquired is kept

First steps (no hardware needed):
  beampose check experiments/plans/translation-test.yaml
  beampose run   experiments/plans/translation-test.yaml
  beampose sessions
  beampose report latest --json";

// What each does is told in its own file: a comment here would hide the longer help there.
#[derive(Subcommand)]
enum Command {
    Run(run::Run),
    Resume(resume::Resume),
    Tell(tell::Tell),
    Check(check::Check),
    Sessions(sessions::Sessions),
    Import(import::Import),
    Export(export::Export),
    Solve(solve::Solve),
    Report(report::Report),
    Score(score::Score),
    Calibrate(calibrate::Calibrate),
    Calibrations(calibrations::Calibrations),
    Targets(targets::Targets),
    Rig(rig::Rig),
    SimInstruments(rig::simulate::SimInstruments),
}

/// Which database.
#[derive(Debug, Clone, clap::Args)]
pub struct Database {
    /// The database of sessions (a file; made if there is none)
    #[arg(long, value_name = "FILE", env = "DATABASE_URL", default_value = "beampose.db")]
    db: String,
}

impl Database {
    /// Opens it.
    ///
    /// # Errors
    /// Why it cannot be opened.
    pub async fn open(&self) -> Result<Arc<Store>, Ended> {
        match Store::open(&beampose_store::path_of(&self.db)).await {
            Ok(store) => Ok(Arc::new(store)),
            Err(busy @ StoreError::Busy { .. }) => Err(busy.into()),
            Err(error) => Err(Ended::input(error.to_string())),
        }
    }

    /// Opens it if it exists: a command that only reads makes none.
    ///
    /// # Errors
    /// Why it cannot be opened.
    pub async fn open_existing(&self) -> Result<Arc<Store>, Ended> {
        let path = beampose_store::path_of(&self.db);
        if !path.exists() {
            return Err(Ended::input(format!(
                "there is no database {}\n  help: `beampose run PLAN` makes one; --db names another",
                path.display()
            )));
        }
        self.open().await
    }
}

/// Closes the database, so that its file alone is whole. Who still holds it keeps it open.
pub async fn close(store: Arc<Store>) {
    if let Ok(store) = Arc::try_unwrap(store) {
        store.close().await;
    }
}

/// A method's name on the command line.
fn method(text: &str) -> Result<Method, String> {
    let known = Method::ALL.map(Method::name);
    Method::ALL
        .into_iter()
        .find(|m| m.name() == text)
        .ok_or_else(|| format!("expected one of {}", known.join(", ")))
}

/// A command that did not get to its end: what to say, and the exit code.
pub struct Ended {
    text: String,
    exit: Exit,
}

impl Ended {
    /// An input is at fault.
    pub fn input(text: impl Into<String>) -> Self {
        Self { text: text.into(), exit: Exit::Input }
    }
}

impl<E: Into<anyhow::Error>> From<E> for Ended {
    fn from(error: E) -> Self {
        Self { text: format!("{:#}", error.into()), exit: Exit::Failed }
    }
}

/// Finds a session; one that cannot be found is a fault of the command line.
async fn find(store: &Store, wanted: &str) -> Result<beampose_core::SessionId, Ended> {
    store.find_session(wanted).await.map_err(|error| Ended::input(error.to_string()))
}

/// Parses the command line and does what it says.
pub fn main() -> ExitCode {
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(error) => {
            // Help and version go to standard output and are no error; a closed pipe is none too.
            let code = if error.use_stderr() { Exit::Input } else { Exit::Success };
            let _closed_pipe = error.print();
            return code.into();
        }
    };
    crate::log::begin(cli.verbose, cli.log_format);
    let ended = match cli.command {
        Command::Check(check) => with_runtime(check.execute()),
        Command::Calibrate(calibrate) => with_runtime(calibrate.execute()),
        Command::Calibrations(calibrations) => with_runtime(calibrations.execute()),
        Command::Targets(targets) => targets.execute(),
        Command::Run(run) => with_runtime(run.execute()),
        Command::Resume(resume) => with_runtime(resume.execute()),
        Command::Tell(tell) => with_runtime(tell.execute()),
        Command::Sessions(sessions) => with_runtime(sessions.execute()),
        Command::Import(import) => with_runtime(import.execute()),
        Command::Export(export) => with_runtime(export.execute()),
        Command::Solve(solve) => with_runtime(solve.execute()),
        Command::Report(report) => with_runtime(report.execute()),
        Command::Score(score) => with_runtime(score.execute()),
        Command::Rig(rig) => with_runtime(rig.execute()),
        Command::SimInstruments(simulators) => with_runtime(simulators.execute()),
    };
    match ended {
        Ok(Exit::Success) if lost() => Exit::Failed.into(),
        Ok(exit) => exit.into(),
        Err(Ended { text, exit }) => {
            complain(&format!("beampose: {text}"));
            exit.into()
        }
    }
}

fn with_runtime(command: impl Future<Output = Result<Exit, Ended>>) -> Result<Exit, Ended> {
    tokio::runtime::Builder::new_multi_thread().enable_all().build()?.block_on(command)
}

/// The folder of a session's report: `--out`, else `reports/` and the session's id.
pub fn report_folder(out: Option<&PathBuf>, session: beampose_core::SessionId) -> PathBuf {
    out.cloned().unwrap_or_else(|| PathBuf::from("reports").join(session.to_string()))
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory as _;

    use super::*;

    #[test]
    fn the_command_line_is_sound() {
        Cli::command().debug_assert();
    }
}
