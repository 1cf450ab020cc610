//! `beampose calibrations`: those that are recorded, and where they come from.

use std::path::PathBuf;

use beampose_analysis::report::SourceOrigin;
use beampose_store::{Calibration, CalibrationHead, CalibrationKind, Store};
use comfy_table::Cell;
use serde_json::{Value, json};

use super::sessions::plain_table;
use super::{Database, Ended, close};
use crate::calibration_record::short;
use crate::origins::origin;
use crate::output::{Exit, print};

/// List the recorded calibrations, show one, write its file
///
/// A run of a beam-angle calibration and `beampose calibrate` record what they make, with the sessions
/// and files that it was made from. A calibration is known by the BLAKE3 of its file: a rig or `solve`
/// that is given that file, under whatever name, has used that calibration, and reports say so. It
/// stays when the session that it was made from is deleted. CALIBRATION is the unique beginning of its
/// hash, or `latest`.
#[derive(clap::Args)]
#[command(args_conflicts_with_subcommands = true)]
pub struct Calibrations {
    #[command(subcommand)]
    action: Option<Action>,
    #[command(flatten)]
    list: List,
}

#[derive(clap::Subcommand)]
enum Action {
    List(List),
    Show(Show),
    Export(Export),
}

/// List them, the oldest first
#[derive(Debug, Clone, clap::Args)]
struct List {
    /// Print one JSON object a line
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    database: Database,
}

/// Show one: its parameters, and what it was made from
#[derive(clap::Args)]
struct Show {
    /// Which
    calibration: String,
    /// Print one JSON object, with the file and all that came out
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    database: Database,
}

/// Write its file, byte for byte, as rigs and `solve` take it
#[derive(clap::Args)]
struct Export {
    /// Which
    calibration: String,
    /// The file to write
    file: PathBuf,
    /// Replace the file if it is there
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    database: Database,
}

impl Calibrations {
    pub async fn execute(self) -> Result<Exit, Ended> {
        match self.action {
            None => self.list.execute().await,
            Some(Action::List(list)) => list.execute().await,
            Some(Action::Show(show)) => show.execute().await,
            Some(Action::Export(export)) => export.execute().await,
        }
    }
}

impl List {
    async fn execute(self) -> Result<Exit, Ended> {
        let store = self.database.open_existing().await?;
        let all = store.calibrations().await?;
        close(store).await;
        if self.json {
            all.iter().for_each(|head| print(&object(head).to_string()));
        } else if all.is_empty() {
            print(
                "no calibrations yet: beampose run experiments/plans/beam-angle-calibration.yaml",
            );
        } else {
            print(&table(&all));
        }
        Ok(Exit::Success)
    }
}

impl Show {
    async fn execute(self) -> Result<Exit, Ended> {
        let store = self.database.open_existing().await?;
        let found = find(&store, &self.calibration).await;
        close(store).await;
        let found = found?;
        print(&if self.json { whole(&found)?.to_string() } else { in_words(&found)? });
        Ok(Exit::Success)
    }
}

impl Export {
    async fn execute(self) -> Result<Exit, Ended> {
        let shown = self.file.display().to_string();
        if self.file.exists() && !self.force {
            let help = "\n  help: --force replaces it";
            return Err(Ended::input(format!("{shown} is there already{help}")));
        }
        let store = self.database.open_existing().await?;
        let found = find(&store, &self.calibration).await;
        close(store).await;
        let found = found?;
        std::fs::write(&self.file, &found.content)
            .map_err(|error| Ended::input(format!("{shown} cannot be written: {error}")))?;
        print(&format!("{shown}: {} {}", short(&found.head.blake3), found.head.name));
        Ok(Exit::Success)
    }
}

/// Finds a calibration; one that cannot be found is a fault of the command line.
async fn find(store: &Store, wanted: &str) -> Result<Calibration, Ended> {
    use beampose_store::StoreError::{Ambiguous, NotFound};
    store.calibration(wanted).await.map_err(|error| match error {
        NotFound { .. } | Ambiguous { .. } => Ended::input(error.to_string()),
        other => other.into(),
    })
}

const fn kind(kind: CalibrationKind) -> &'static str {
    match kind {
        CalibrationKind::Pattern => "pattern",
        CalibrationKind::Camera => "camera",
    }
}

fn object(head: &CalibrationHead) -> Value {
    let mut object = json!(origin(head));
    object["kind"] = kind(head.kind).into();
    object
}

fn whole(found: &Calibration) -> Result<Value, serde_json::Error> {
    let mut object = object(&found.head);
    for (key, text) in [
        ("options", &found.options_json),
        ("parameters", &found.parameters_json),
        ("covariance", &found.covariance_json),
        ("result", &found.result_json),
    ] {
        object[key] = serde_json::from_str(text)?;
    }
    object["content"] = found.content.as_str().into();
    Ok(object)
}

fn table(all: &[CalibrationHead]) -> String {
    let mut table = plain_table();
    table.set_header(["calibration", "recorded (UTC)", "kind", "name", "method", "made from"]);
    for head in all {
        let made_from = origin(head).made_from;
        table.add_row([
            Cell::new(short(&head.blake3)),
            Cell::new(head.created.strftime("%Y-%m-%d %H:%M:%S")),
            Cell::new(kind(head.kind)),
            Cell::new(&head.name),
            Cell::new(&head.method),
            Cell::new(
                made_from.first().map(|first| in_short(first, made_from.len())).unwrap_or_default(),
            ),
        ]);
    }
    table.to_string()
}

/// The first thing that a calibration was made from, and how many there are more.
fn in_short(first: &SourceOrigin, count: usize) -> String {
    let more = if count > 1 { format!(" and {} more", count - 1) } else { String::new() };
    match first {
        SourceOrigin::Session { session, state, .. } if state == "stored" => {
            format!("session {session}{more}")
        }
        SourceOrigin::Session { session, state, .. } => {
            format!("session {session} ({state}){more}")
        }
        SourceOrigin::File { name, .. } => format!("{name}{more}"),
    }
}

fn in_words(found: &Calibration) -> Result<String, serde_json::Error> {
    let head = &found.head;
    let mut lines = vec![
        format!("calibration {}", head.blake3),
        format!("  {} {}, by {}", kind(head.kind), head.name, head.method),
        format!("  recorded {} UTC, {}", head.created.strftime("%Y-%m-%d %H:%M:%S"), head.software),
    ];
    let parameters: Vec<Value> = serde_json::from_str(&found.parameters_json)?;
    for parameter in &parameters {
        let name = parameter["name"].as_str().unwrap_or_default();
        let number = |key: &str| parameter[key].as_f64().unwrap_or(f64::NAN);
        lines.push(format!("  {name:<12} {}", with_u(number("value"), number("u"))));
    }
    lines.extend(origin(head).made_from.iter().map(made_from));
    Ok(lines.join("\n"))
}

/// A number to two digits of its uncertainty; very small ones as powers of ten.
fn with_u(value: f64, u: f64) -> String {
    if value != 0.0 && u < 1e-8 {
        return format!("{value:.4e}  u {u:.1e}");
    }
    let places = (1.0 - u.log10().floor()).clamp(0.0, 12.0) as usize;
    format!("{value:.places$}  u {u:.places$}")
}

fn made_from(source: &SourceOrigin) -> String {
    match source {
        SourceOrigin::Session { session, title, processing_utc, state, .. } => {
            let processing = processing_utc.as_ref().map(|at| format!(", processing of {at}"));
            let processing = processing.unwrap_or_default();
            format!("  from session {session} ({title}; {state}{processing})")
        }
        SourceOrigin::File { name, blake3 } => format!("  from {name} {}", short(blake3)),
    }
}
