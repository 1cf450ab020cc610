//! The configuration's sense: what the world's arithmetic cannot do without.

use crate::error::WorldError;

use super::{RailConfig, StageConfig, WorldConfig};

type Checked = Result<(), WorldError>;

fn require(
    holds: bool,
    what: &str,
    found: impl std::fmt::Debug,
    expected: &'static str,
) -> Checked {
    if holds {
        return Ok(());
    }
    Err(WorldError::Value { what: what.to_owned(), found: format!("{found:?}"), expected })
}

fn positive(what: &str, value: f64) -> Checked {
    require(value.is_finite() && value > 0.0, what, value, "a number above 0")
}

fn not_negative(what: &str, value: f64) -> Checked {
    require(value.is_finite() && value >= 0.0, what, value, "a number not below 0")
}

fn direction(what: &str, value: [f64; 3]) -> Checked {
    let length = value.iter().map(|x| x * x).sum::<f64>().sqrt();
    require(length.is_finite() && length > 0.0, what, value, "a vector of some length")
}

impl WorldConfig {
    /// The first number that makes no sense, if there is one.
    pub(crate) fn check(&self) -> Checked {
        let scale = self.picture_scale;
        require(scale > 0.0 && scale <= 1.0, "picture_scale", scale, "above 0 and up to 1")?;
        positive("beam.diameter_mm", self.beam.diameter_mm)?;
        not_negative("beam.divergence_mrad", self.beam.divergence_mrad)?;
        if let Some(pointing) = &self.beam.pointing {
            not_negative("beam.pointing.wander_deg", pointing.wander_deg)?;
            positive("beam.pointing.period_s", pointing.period_s)?;
        }
        positive("beam.peak_distance_mm", self.beam.peak_distance_mm)?;
        positive("diode.wavelength_nm", self.diode.wavelength_nm)?;
        positive("diode.time_constant_s", self.diode.time_constant_s)?;
        not_negative("diode.emission_delay_s", self.diode.emission_delay_s)?;
        not_negative("diode_thermometer.noise_degc", self.diode_thermometer.noise_degc)?;
        for (i, hop) in self.diode.mode_hops.iter().enumerate() {
            let what = format!("diode.mode_hops[{i}].by_nm");
            require(hop.by_nm.is_finite(), &what, hop.by_nm, "a number")?;
        }
        if let Some(rail) = &self.rail {
            check_rail(rail)?;
        }
        if let Some(rotation) = &self.rotation {
            check_stage("rotation", &rotation.stage)?;
            direction("rotation.axis_direction", rotation.axis_direction)?;
        }
        self.check_scene()?;
        self.check_cameras()?;
        self.check_picture()
    }

    fn check_scene(&self) -> Checked {
        for (i, wall) in self.walls.iter().enumerate() {
            direction(&format!("walls[{i}].normal"), wall.normal)?;
        }
        for (i, mirror) in self.mirrors.iter().enumerate() {
            direction(&format!("mirrors[{i}].normal"), mirror.normal)?;
            for half in mirror.half_size_mm {
                positive(&format!("mirrors[{i}].half_size_mm"), half)?;
            }
        }
        for (i, target) in self.targets.iter().enumerate() {
            direction(&format!("targets[{i}].normal"), target.normal)?;
            positive(&format!("targets[{i}].radius_mm"), target.radius_mm)?;
            let (code, what) = (target.code, format!("targets[{i}].code"));
            require((1..4095).contains(&code), &what, code, "a 12-bit code from 1 to 4094")?;
        }
        Ok(())
    }

    fn check_cameras(&self) -> Checked {
        for (name, camera) in &self.cameras {
            let model = &camera.calibration.model;
            positive(&format!("cameras.{name}.calibration.model.fx"), model.fx)?;
            positive(&format!("cameras.{name}.calibration.model.fy"), model.fy)?;
            let size = [model.width, model.height];
            let what = format!("cameras.{name}.calibration.model size");
            let fits = size.iter().all(|&n| n as f64 * self.picture_scale >= 8.0 && n < 65536);
            require(fits, &what, size, "8 to 65535 pixels a side, once scaled")?;
            let [a, b] = [camera.look_at_mm, camera.position_mm];
            let view = std::array::from_fn(|i| a[i] - b[i]);
            direction(&format!("cameras.{name}.look_at_mm - position_mm"), view)?;
            not_negative(&format!("cameras.{name}.trigger_delay_s"), camera.trigger_delay_s)?;
            not_negative(&format!("cameras.{name}.exposure_s"), camera.exposure_s)?;
            not_negative(&format!("cameras.{name}.readout_s"), camera.readout_s)?;
        }
        Ok(())
    }

    fn check_picture(&self) -> Checked {
        let picture = &self.picture;
        not_negative("picture.psf_sigma_px", picture.psf_sigma_px)?;
        not_negative("picture.photon_noise_grey", picture.photon_noise_grey)?;
        not_negative("picture.read_noise_grey", picture.read_noise_grey)?;
        not_negative("picture.speckle.grain_px", picture.speckle.grain_px)?;
        let contrast = picture.speckle.contrast;
        require((0.0..=1.0).contains(&contrast), "picture.speckle.contrast", contrast, "0 to 1")?;
        let quality = picture.jpeg_quality;
        require((1..=100).contains(&quality), "picture.jpeg_quality", quality, "1 to 100")
    }
}

fn check_rail(rail: &RailConfig) -> Checked {
    check_stage("rail", &rail.stage)?;
    direction("rail.direction", rail.direction)?;
    positive("rail.period_mm", rail.period_mm)
}

fn check_stage(name: &str, stage: &StageConfig) -> Checked {
    let [low, high] = stage.limits;
    require(low <= high, &format!("{name}.stage.limits"), stage.limits, "lower, upper")?;
    positive(&format!("{name}.stage.speed_per_s"), stage.speed_per_s)?;
    not_negative(&format!("{name}.stage.settle_s"), stage.settle_s)?;
    not_negative(&format!("{name}.stage.resolution"), stage.resolution)
}
