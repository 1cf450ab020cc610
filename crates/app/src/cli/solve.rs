//! `beampose solve`: reprocessing.

use std::sync::Arc;

use beampose_core::SessionId;
use beampose_photogrammetry::Setup;
use beampose_photogrammetry::rotation::{from_wxyz, omega_phi_kappa};
use beampose_photogrammetry::solve::{Method, MethodResult};
use beampose_store::Store;

use super::{Database, Ended, close, find};
use crate::output::{Exit, print};
use crate::pipeline::{Pipeline, Solved, adjust_session};
use crate::progress::Progress;

/// Solve a stored session again, as a new processing beside the old ones
///
/// SESSION is an id, a unique beginning of one, or `latest`.
#[derive(clap::Args)]
pub struct Solve {
    /// Which session
    session: String,
    /// How the module is found: virtual-camera, inter-beam-angles (without it both), or
    /// session-adjustment, all captures of the session in one adjustment
    #[arg(long = "method", value_name = "METHOD", value_parser = super::method)]
    methods: Vec<Method>,
    /// Print one JSON object for each capture and method
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    database: Database,
}

impl Solve {
    pub async fn execute(self) -> Result<Exit, Ended> {
        let store = self.database.open_existing().await?;
        let id = find(&store, &self.session).await?;
        let methods =
            if self.methods.is_empty() { Method::USUAL.to_vec() } else { self.methods.clone() };
        let together = methods.contains(&Method::SessionAdjustment);
        // The adjustment of the session starts from the captures' own.
        let first = if together { &Method::USUAL[..] } else { &methods };
        let mut solved = solve_session(&store, id, first, !self.json).await?;
        if together {
            solved = adjust_session(&store, id).await?;
        }
        for one in &mut solved {
            one.solution.results.retain(|r| methods.contains(&r.method));
        }
        let mut unsolved = 0;
        for one in &solved {
            for result in &one.solution.results {
                unsolved += usize::from(result.pose.is_err());
                if self.json {
                    print(&line(one, result).to_string());
                } else if let Err(reason) = &result.pose {
                    print(&format!("{} {}: {reason}", one.capture, result.method.name()));
                }
            }
        }
        if self.json {
            print(&serde_json::json!({ "session": id.to_string() }).to_string());
        } else {
            let results: usize = solved.iter().map(|s| s.solution.results.len()).sum();
            print(&format!("session {id}: {} of {results} poses solved", results - unsolved));
        }
        close(store).await;
        Ok(Exit::Success)
    }
}

/// Solves all captures of a stored session as a new processing.
///
/// # Errors
/// When the session cannot be read, or the store fails.
pub async fn solve_session(
    store: &Arc<Store>,
    id: SessionId,
    methods: &[Method],
    shown: bool,
) -> anyhow::Result<Vec<Solved>> {
    let session = store.session(id).await?;
    let setup: Setup = serde_json::from_str(&session.header.measurement_json)?;
    let captures = store.captures(id).await?;
    let progress = Progress::solving(captures.len() as u64, shown);
    let pipeline = Pipeline::begin(store.clone(), id, Arc::new(setup), methods).await?;
    let mut solved = Vec::new();
    for capture in &captures {
        let one = pipeline.solve(capture).await?;
        progress.solved(&one);
        solved.push(one);
    }
    pipeline.finish().await?;
    progress.finish();
    Ok(solved)
}

/// One capture and method as DESIGN fixes it.
fn line(one: &Solved, result: &MethodResult) -> serde_json::Value {
    let seconds = serde_json::json!(one.seconds);
    let common = serde_json::json!({
        "id": one.capture.as_str(),
        "method": result.method.name(),
        "beams_used": result.beams_used,
        "sigma0": result.sigma0,
        "wavelength_nm": result.wavelength_nm,
        "ambiguous": result.ambiguous,
        "seconds": seconds,
        "notes": one.solution.notes,
    });
    let mut object = common.as_object().cloned().unwrap_or_default();
    match &result.pose {
        Ok(pose) => {
            let angles = omega_phi_kappa(&from_wxyz(pose.quaternion_wxyz)).map(f64::to_degrees);
            object.insert("status".to_owned(), "solved".into());
            object.insert("position_mm".to_owned(), serde_json::json!(pose.position_mm));
            object.insert("quaternion_wxyz".to_owned(), serde_json::json!(pose.quaternion_wxyz));
            object.insert("rotation_omega_phi_kappa_deg".to_owned(), serde_json::json!(angles));
            object.insert("covariance".to_owned(), serde_json::json!(pose.covariance));
        }
        Err(reason) => {
            object.insert("status".to_owned(), reason.clone().into());
        }
    }
    serde_json::Value::Object(object)
}
