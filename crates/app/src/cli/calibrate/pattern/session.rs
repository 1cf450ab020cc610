//! The fan from the photographs of stored sessions.

use beampose_analysis::{
    InputFile, SessionFanReport, nearest_grid, session_fan_html, session_fan_json,
};
use beampose_photogrammetry::Setup;
use beampose_photogrammetry::calibrate::pattern::{
    FanPrior, SessionFan, calibrate_from_session, write_fan_angles,
};
use beampose_store::Calibration;

use super::super::super::{close, find};
use super::super::camera::is_file_name;
use super::told::parameter;
use super::{Ended, Pattern, put};
use crate::calibration_record::{of_photographs, session, told};
use crate::loaded::{load, solved_captures};
use crate::output::{Exit, print};
use crate::pipeline::SOFTWARE;

impl Pattern {
    /// Calibrates from sessions.
    pub(super) async fn of_sessions(&self) -> Result<Exit, Ended> {
        let store = self.database.open_existing().await?;
        let mut together: Option<Setup> = None;
        let (mut all, mut inputs, mut sources) = (Vec::new(), Vec::new(), Vec::new());
        for wanted in &self.session {
            let id = find(&store, wanted).await?;
            let loaded = load(&store, id).await?;
            if together.as_ref().is_some_and(|setup| *setup != loaded.setup) {
                let why = "cameras, artefact and pattern are not those of the session before it";
                return Err(Ended::input(format!("session {id} was measured otherwise: {why}")));
            }
            together = Some(loaded.setup);
            all.extend(loaded.captures);
            let header = &loaded.session.header;
            sources.push(session(header, Some(loaded.processing.start.created)));
            let blake3 = loaded.session.header.plan_hash.clone();
            inputs.push(InputFile { name: id.to_string(), blake3 });
        }
        let Some(setup) = together else { return Err(Ended::input("name a session")) };
        let name = self.name.clone().unwrap_or_else(|| "fan".to_owned());
        if !is_file_name(&name) {
            return Err(Ended::input(format!("`{name}` is no name for files: --name gives one")));
        }
        let prior = self.prior(&setup);
        // A capture that was not solved tells nothing here.
        all.retain(|c| c.solution.is_ok());
        let captures = all.len();
        let found = tokio::task::spawn_blocking(move || {
            let solved = solved_captures(&setup, &all).unwrap_or_default();
            calibrate_from_session(&setup, &solved, prior)
        })
        .await?
        .map_err(|why| Ended::input(format!("the fan cannot be calibrated: {why}")))?;
        let report = SessionFanReport {
            name,
            found: &found,
            prior,
            captures,
            sessions: &inputs,
            software: SOFTWARE.to_owned(),
        };
        let record = of_photographs(&report, sources);
        store.record_calibration(&record).await?;
        close(store).await;
        self.tell_session(&report, &record)
    }

    fn prior(&self, setup: &Setup) -> FanPrior {
        let u = setup.pattern.u;
        let stated = FanPrior { scale: u.common_relative, beam: u.angle_deg.to_radians() };
        let base = if self.nominal { FanPrior::nominal() } else { stated };
        FanPrior {
            scale: self.u_scale_percent.map_or(base.scale, |percent| percent / 100.0),
            beam: self.u_beam_deg.map_or(base.beam, f64::to_radians),
        }
    }

    fn tell_session(&self, report: &SessionFanReport, record: &Calibration) -> Result<Exit, Ended> {
        let (name, found) = (&report.name, report.found);
        let mut json = session_fan_json(report);
        json["calibration"] = record.head.blake3.as_str().into();
        put(&self.out, &format!("{name}.yaml"), &record.content)?;
        put(&self.out, &format!("{name}_angles.csv"), &write_fan_angles(&found.angles))?;
        put(&self.out, &format!("{name}.json"), &serde_json::to_string_pretty(&json)?)?;
        put(&self.out, &format!("{name}.html"), &session_fan_html(report))?;
        if self.json {
            print(&json.to_string());
        } else {
            print(&in_words(name, found, report.prior, report.captures));
            print(&told(record));
            print(&self.out.join(format!("{name}.html")).display().to_string());
        }
        Ok(Exit::Success)
    }
}

fn in_words(name: &str, found: &SessionFan, prior: FanPrior, captures: usize) -> String {
    let most = found.angles.iter().map(|a| a.u).fold(0.0, f64::max).to_degrees();
    let random = found.angles.iter().map(|a| a.u_random).fold(0.0, f64::max).to_degrees();
    let u = found.pattern.u;
    let told = 100.0 * found.scale_told;
    let mut lines = vec![
        format!("{name}: {captures} captures, sigma0 {:.3}", found.sigma0),
        format!(
            "  prior: scale {:.4} %, one beam {:.5} deg",
            100.0 * prior.scale,
            prior.beam.to_degrees()
        ),
        format!(
            "  scale {:+.4} % against the pattern before, u {:.4} %: the pictures tell {told:.0} % of it",
            100.0 * found.scale,
            100.0 * found.scale_u
        ),
        format!("  one beam alone u {:.5} deg", u.angle_deg),
        format!(
            "  {} angles, u up to {most:.5} deg, up to {random:.5} deg without the common scale",
            found.angles.len()
        ),
    ];
    lines.extend(nearest_grid(found).iter().map(|(name, value, u)| parameter(name, *value, *u)));
    lines.join("\n")
}
