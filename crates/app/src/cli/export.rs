//! `beampose export`.

use std::path::PathBuf;

use super::{Database, Ended, close, find};
use crate::output::{Exit, complain, print};

/// Write a stored session as a folder that other programs read
///
/// Writes `session.yaml`, the cameras' calibrations as ROS `camera_info` YAML, `pattern.yaml` and the
/// pictures as the cameras gave them; `beampose import` reads it again. Numbers keep all their
/// digits. The format has no place for the uncertainties of the calibrations and of the wavelength
/// reading, nor for times and results. SESSION is an id, a unique beginning of one, or `latest`.
#[derive(clap::Args)]
pub struct Export {
    /// Which session
    session: String,
    /// Where to write; made if there is none
    folder: PathBuf,
    /// Write into a folder that is not empty: files of the same names are replaced
    #[arg(long)]
    force: bool,
    /// Print one JSON object: folder, captures, pictures, session
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    database: Database,
}

impl Export {
    pub async fn execute(self) -> Result<Exit, Ended> {
        let store = self.database.open_existing().await?;
        let id = find(&store, &self.session).await?;
        beampose_exchange::prepare(&self.folder, self.force).map_err(Ended::input)?;
        let exported = beampose_exchange::export(&store, id, &self.folder).await;
        close(store).await;
        let exported = exported?;
        for what in &exported.left_out {
            complain(&format!("left out: {what}"));
        }
        let (captures, pictures) = (exported.captures, exported.pictures);
        if self.json {
            let object = serde_json::json!({
                "folder": self.folder.display().to_string(),
                "captures": captures,
                "pictures": pictures,
                "session": id.to_string(),
            });
            print(&object.to_string());
        } else {
            print(&format!(
                "{}: {captures} captures, {pictures} pictures of session {id}",
                self.folder.display()
            ));
        }
        Ok(if exported.left_out.is_empty() { Exit::Success } else { Exit::Failed })
    }
}
