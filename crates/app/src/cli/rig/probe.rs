//! `beampose rig probe`.

use crate::output::{Exit, complain, print};
use crate::wiring::probe::{Candidate, found};

use super::Ended;

/// Find what is attached, ask it who it is, and print a rig file to start from
///
/// Asks on each serial port, and at each address given, with each driver that can; questions only,
/// but a laser that is found is switched off. Instruments with a network interface are found only at
/// the addresses given.
#[derive(clap::Args)]
pub struct Probe {
    /// Also ask here: `tcp:10.0.0.7:55550`, `/dev/ttyUSB3`
    addresses: Vec<String>,
    /// Ask only at the addresses given
    #[arg(long, requires = "addresses")]
    only: bool,
    /// Ask only with these drivers
    #[arg(long, value_name = "NAME")]
    driver: Vec<String>,
}

impl Probe {
    pub async fn execute(self) -> Result<Exit, Ended> {
        let probed = found(&self.addresses, self.only, &self.driver).await.map_err(Ended::input)?;
        let mut names = std::collections::BTreeMap::<&str, usize>::new();
        let mut text =
            String::from("version: 1\ntitle: my laboratory\nclock: real\n\ninstruments:\n");
        let mut any = false;
        for place in &probed {
            let about = place.about.as_deref().unwrap_or("no description");
            match &place.candidates[..] {
                [] => {
                    text.push_str(&format!("  # {} ({about}): nobody answered\n", place.address));
                }
                candidates => {
                    any = true;
                    for it in candidates {
                        text.push_str(&entry(it, &place.address, &mut names));
                    }
                }
            }
        }
        if probed.is_empty() {
            text.push_str("  # no serial port is attached, and no address was given\n");
        }
        print(text.trim_end());
        if !any {
            complain(
                "beampose: no instrument was found\n  help: check cables and power; network instruments need their address: `beampose rig probe tcp:HOST:PORT`",
            );
        }
        Ok(Exit::Success)
    }
}

fn entry(
    it: &Candidate,
    address: &str,
    names: &mut std::collections::BTreeMap<&str, usize>,
) -> String {
    let stem = match it.kind {
        "linear_axis" => "rail",
        "rotary_axis" => "turntable",
        "laser" => "laser",
        "camera" => "camera",
        _ => "sensor",
    };
    let count = names.entry(stem).or_default();
    *count += 1;
    let name = if *count == 1 { stem.to_owned() } else { format!("{stem}_{count}") };
    let body = match it.kind {
        "linear_axis" => {
            "      travel: {from: 0 mm, to: 100 mm}  # to be set\n      speed: 10 mm/s\n      settle: 0.5 s\n"
        }
        "rotary_axis" => {
            "      travel: {from: -10 deg, to: 10 deg}  # to be set\n      speed: 5 deg/s\n      settle: 0.5 s\n"
        }
        "laser" => "      emission_delay: 3 s\n      current: 40 mA  # to be set\n",
        "camera" => "      calibration: camera.yaml\n      pixel_pitch: 1.7 um\n",
        _ => it.reads.map_or("      reads: temperature\n", |_| ""),
    };
    let reads = match (it.kind, it.reads) {
        ("sensor", Some(quantity)) => format!("      reads: {}\n", quantity.name()),
        _ => String::new(),
    };
    let options = if it.options.is_empty() {
        String::new()
    } else {
        format!("      options: {{{}}}  # to be set\n", it.options.join(", "))
    };
    format!(
        "  {name}:  # {}\n    {}:\n      driver: {}\n      address: {address}\n{options}{reads}{body}",
        it.identity, it.kind, it.driver
    )
}
