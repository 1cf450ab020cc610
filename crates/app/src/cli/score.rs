//! `beampose score`: the only reader of the simulation's truth.

use beampose_analysis::{FanScore, MethodScore, ScoredCapture, Truth, score, score_fan};
use beampose_core::SessionId;
use beampose_photogrammetry::Pattern;
use beampose_photogrammetry::solve::Method;
use beampose_store::Store;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::sessions::plain_table;
use super::{Database, Ended, close, find};
use crate::loaded::load;
use crate::other_inputs::pattern;
use crate::output::{Exit, print};

/// Compare a simulated session with its truth
///
/// Position and rotation errors, the normalised estimation error squared (3 where the stated
/// covariance is true), and how often the 95 % ellipsoid holds the truth. SESSION is an id, a
/// unique beginning of one, or `latest`.
#[derive(clap::Args)]
pub struct Score {
    /// Which session
    session: String,
    /// Compare a fan with that of the session instead: a pattern file, as `calibrate pattern` writes it
    #[arg(long, value_name = "FILE")]
    pattern: Option<PathBuf>,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    database: Database,
}

impl Score {
    pub async fn execute(self) -> Result<Exit, Ended> {
        let store = self.database.open_existing().await?;
        let id = find(&store, &self.session).await?;
        if let Some(path) = &self.pattern {
            let compared = compare_fan(&store, id, path).await?;
            close(store).await;
            print(&if self.json { serde_json::to_string(&compared)? } else { in_words(&compared) });
            return Ok(Exit::Success);
        }
        let truths = beampose_store::truth::captures(&store, id).await?;
        if truths.is_empty() {
            let simulated = store.session(id).await?.header.seed.is_some();
            let why = if simulated { "it has no captures" } else { "it is not simulated" };
            return Err(Ended::input(format!("session {id} has no truth to compare with: {why}")));
        }
        let loaded = load(&store, id).await?;
        let mut captures = Vec::new();
        for capture in &loaded.captures {
            let Some(json) = truths.get(&capture.id) else { continue };
            let truth: TruePose = serde_json::from_str(json)?;
            let poses = match &capture.solution {
                Ok(s) => s.results.iter().map(|r| (r.method, r.pose.clone())).collect(),
                Err(reason) => Method::USUAL.map(|m| (m, Err(reason.clone()))).into(),
            };
            let truth =
                Truth { position_mm: truth.position_mm, quaternion_wxyz: truth.quaternion_wxyz };
            captures.push(ScoredCapture { id: capture.id.clone(), truth, poses });
        }
        let scores = score(&captures);
        if self.json {
            let by_name: BTreeMap<&str, &MethodScore> =
                scores.iter().map(|(m, s)| (m.name(), s)).collect();
            print(
                &serde_json::json!({ "session": id.to_string(), "methods": by_name }).to_string(),
            );
        } else {
            print(&table(&scores));
        }
        close(store).await;
        Ok(Exit::Success)
    }
}

/// The part of the true parameters that a fan is compared with.
#[derive(serde::Deserialize)]
struct TrueFan {
    pattern: Pattern,
    pattern_common_error: f64,
}

async fn compare_fan(store: &Store, id: SessionId, path: &Path) -> Result<FanScore, Ended> {
    let found = pattern(path).map_err(Ended::input)?;
    let Some(json) = beampose_store::truth::parameters(store, id).await? else {
        let why = "it is not simulated, or has no captures";
        return Err(Ended::input(format!("session {id} has no truth to compare with: {why}")));
    };
    let truth: TrueFan = serde_json::from_str(&json)?;
    score_fan(&found, &truth.pattern, truth.pattern_common_error).ok_or_else(|| {
        let shown = path.display();
        Ended::input(format!("{shown}: the fan has other beams than that of session {id}"))
    })
}

fn in_words(score: &FanScore) -> String {
    format!(
        "{} angles: rms {:.5} deg, largest {:.5} deg, all together {:+.4} %",
        score.angles,
        score.rms_angle_error_deg,
        score.max_angle_error_deg,
        100.0 * score.mean_relative_error
    )
}

/// The part of the stored truth that is scored.
#[derive(serde::Deserialize)]
struct TruePose {
    position_mm: [f64; 3],
    quaternion_wxyz: [f64; 4],
}

fn table(scores: &BTreeMap<Method, MethodScore>) -> String {
    let mut table = plain_table();
    table.set_header(["method", "rms mm", "rms deg", "NEES (3)", "95 % holds"]);
    let number = |x: Option<f64>, digits: usize| {
        x.map_or_else(|| "none".to_owned(), |x| format!("{x:.digits$}"))
    };
    for (method, s) in scores {
        table.add_row([
            method.name().to_owned(),
            number(s.rms_position_error_mm, 4),
            number(s.rms_rotation_error_deg, 5),
            number(s.nees_position_mean, 2),
            number(s.coverage_95, 3),
        ]);
    }
    table.to_string()
}
