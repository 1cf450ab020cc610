//! The log: to standard error as far as asked for, and of each session to a file.

use std::fs::File;
use std::io::Write;
use std::path::Path;
use std::sync::{Mutex, MutexGuard, PoisonError};

use tracing_subscriber::filter::EnvFilter;
use tracing_subscriber::fmt::MakeWriter;
use tracing_subscriber::layer::SubscriberExt as _;
use tracing_subscriber::util::SubscriberInitExt as _;
use tracing_subscriber::{Layer as _, Registry};

/// How a line looks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Format {
    /// For people
    Text,
    /// One JSON object a line, for programs
    Json,
}

/// The file of the session that runs, once there is one.
static FILE: Mutex<Option<File>> = Mutex::new(None);

/// Begins the log: warnings to standard error (`-v` more, `RUST_LOG` has the last word), and
/// everything from "info" on to the session's file.
pub fn begin(verbose: u8, format: Format) {
    let default = match verbose {
        0 => "warn",
        1 => "info",
        _ => "debug",
    };
    let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new(default));
    // What is stored is the record; a database library's own news are of no use to a laboratory.
    let kept = EnvFilter::new("info,sqlx=warn,beampose_engine=debug");
    let layer = || tracing_subscriber::fmt::layer::<Registry>();
    let (shown, filed) = match format {
        Format::Text => (
            layer().with_writer(std::io::stderr).boxed(),
            layer().with_writer(Session).with_ansi(false).boxed(),
        ),
        Format::Json => (
            layer().json().with_writer(std::io::stderr).boxed(),
            layer().json().with_writer(Session).boxed(),
        ),
    };
    let layers = vec![shown.with_filter(filter).boxed(), filed.with_filter(kept).boxed()];
    tracing_subscriber::registry().with(layers).init();
}

/// From here on what happens goes to `run.log` in a session's folder too, behind what is there.
///
/// # Errors
/// When the file cannot be written.
pub fn to_session(folder: &Path) -> std::io::Result<()> {
    let path = folder.join("run.log");
    *file() = Some(File::options().create(true).append(true).open(path)?);
    Ok(())
}

fn file() -> MutexGuard<'static, Option<File>> {
    FILE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Writes to the session's file, if there is one. A disk that is full costs lines of the log, and
/// nothing else.
struct Session;

impl Write for Session {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        if let Some(file) = file().as_mut() {
            let _the_run_goes_on = file.write_all(bytes);
        }
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

impl MakeWriter<'_> for Session {
    type Writer = Self;

    fn make_writer(&self) -> Self {
        Self
    }
}
