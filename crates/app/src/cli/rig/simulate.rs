//! `beampose sim-instruments`.

use std::path::Path;

use super::{Ended, Which};
use crate::output::{Exit, print};
use crate::wiring;

/// Start the simulators of a rig as instruments of their own, for this and other software
///
/// Each instrument of the rig whose address is `simulator:tcp` or `simulator:pty` answers at an
/// address of its own, in real time, all in one simulated world, until Ctrl-C. Prints the addresses,
/// one JSON object a line with --json: put them into a rig file in place of `simulator:...`.
#[derive(clap::Args)]
pub struct SimInstruments {
    #[command(flatten)]
    which: Which,
    /// Print one JSON object for each instrument
    #[arg(long)]
    json: bool,
}

impl SimInstruments {
    pub async fn execute(self) -> Result<Exit, Ended> {
        let rig = crate::input::rig(&self.which.rig, &crate::settings::Overrides::default())
            .map_err(Ended::input)?;
        let folder = self.which.rig.parent().unwrap_or(Path::new(""));
        let running = wiring::simulators(&rig, folder).map_err(Ended::input)?;
        if running.addresses().is_empty() {
            return Err(Ended::input(format!(
                "{}: no instrument has the address `simulator:tcp` or `simulator:pty`",
                self.which.rig.display()
            )));
        }
        for (name, driver, address) in running.addresses() {
            if self.json {
                let object =
                    serde_json::json!({"instrument": name, "driver": driver, "address": address});
                print(&object.to_string());
            } else {
                print(&format!("{name}  {driver}  {address}"));
            }
        }
        let mut term = tokio::signal::unix::signal(tokio::signal::unix::SignalKind::terminate())?;
        tokio::select! {
            _ = tokio::signal::ctrl_c() => {}
            _ = term.recv() => {}
        }
        drop(running);
        Ok(Exit::Success)
    }
}
