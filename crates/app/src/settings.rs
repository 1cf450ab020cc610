//! What the command line may change of a rig.

use beampose_plan::Rig;

/// Changes to a simulated rig.
#[derive(
    Debug, Clone, Copy, Default, PartialEq, clap::Args, serde::Serialize, serde::Deserialize,
)]
#[serde(deny_unknown_fields)]
pub struct Overrides {
    /// Another seed for a simulated rig: another world, other noise
    #[arg(long, value_name = "N")]
    pub seed: Option<u64>,
    /// Smaller pictures from simulated cameras: 0.5 halves width and height
    #[arg(long, value_name = "FACTOR", value_parser = picture_scale)]
    pub picture_scale: Option<f64>,
}

fn picture_scale(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(scale) if (0.1..=1.0).contains(&scale) => Ok(scale),
        _ => Err("expected a number from 0.1 to 1".to_owned()),
    }
}

impl Overrides {
    /// The rig with the changes made.
    ///
    /// # Errors
    /// When the rig has no simulation to change.
    pub fn apply(&self, mut rig: Rig) -> Result<Rig, String> {
        if let Some(simulation) = &mut rig.simulation {
            simulation.seed = self.seed.unwrap_or(simulation.seed);
            simulation.picture.scale = self.picture_scale.unwrap_or(simulation.picture.scale);
        } else if self.seed.is_some() || self.picture_scale.is_some() {
            return Err(format!(
                "{}: --seed and --picture-scale are for simulated rigs; this one has no `simulation`",
                rig.source.name()
            ));
        }
        Ok(rig)
    }
}
