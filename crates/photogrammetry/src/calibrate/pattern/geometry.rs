//! How far a stage turns until a second beam stands where the first stood, and the closed forms of
//! section 4.2.1.
//!
//! The stage turns about a vertical axis through C; a plane stands at the distance CD in front of it,
//! and the reference place lies opposite the axis. Seen from above, x right and y towards the plane.
//! A beam through M with the azimuth `a` passes the axis at the distance `w = x cos a - y sin a`,
//! which no turn changes, so that it meets the reference place where
//! `CD sin(a + turn) - x_t cos(a + turn) = -w`: a closed form with nothing left out. Where the grating
//! stands along the axis (z) does not enter.

use nalgebra::{Rotation3, Vector3};

use super::StageAxis;

/// The module on the stage in front of the plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StageGeometry {
    /// From the axis of the stage to the plane (CD), mm.
    pub distance: f64,
    /// Where the grating stands off the axis at the middle of the range: to the right, towards the
    /// plane (along the middle beam), up; mm.
    pub offset: [f64; 3],
    /// Tilt of the module against the plane in which the stage turns: up, and rolled about the middle
    /// beam; radians.
    pub tilt: [f64; 2],
}

impl StageGeometry {
    /// An aligned module at a distance, mm.
    #[must_use]
    pub const fn aligned(distance: f64) -> Self {
        Self { distance, offset: [0.0; 3], tilt: [0.0; 2] }
    }

    /// How far the stage turns between two beams (directions in the module's frame), radians,
    /// positive where `to` lies further right (or down, for the vertical axis). `None` where the dot
    /// cannot come to the reference place.
    #[must_use]
    pub fn turn(&self, from: &Vector3<f64>, to: &Vector3<f64>, axis: StageAxis) -> Option<f64> {
        self.turn_missing(from, to, axis, 0.0)
    }

    /// As [`Self::turn`] with the second dot `missed` mm right of the first.
    #[must_use]
    pub fn turn_missing(
        &self,
        from: &Vector3<f64>,
        to: &Vector3<f64>,
        axis: StageAxis,
        missed: f64,
    ) -> Option<f64> {
        Some(self.setting(from, axis, 0.0)? - self.setting(to, axis, missed)?)
    }

    /// The stage's setting at which the beam stands `target` mm right of the reference place.
    fn setting(&self, beam: &Vector3<f64>, axis: StageAxis, target: f64) -> Option<f64> {
        let azimuth = self.azimuth(beam, axis);
        let [x, y, _] = self.offset;
        let reach = self.distance.hypot(target);
        let sine = (x * azimuth.cos() - y * azimuth.sin()) / reach;
        let turn = target.atan2(self.distance) - sine.asin() - azimuth;
        (self.distance > 0.0 && turn.is_finite()).then_some(turn)
    }

    /// Azimuth about the axis of the stage, positive to the right.
    fn azimuth(&self, beam: &Vector3<f64>, axis: StageAxis) -> f64 {
        // Right, towards the plane, up.
        let on_stage = match axis {
            StageAxis::Horizontal => Vector3::new(beam.x, beam.z, -beam.y),
            StageAxis::Vertical => Vector3::new(beam.y, beam.z, beam.x),
        };
        let [up, rolled] = self.tilt;
        let turned = Rotation3::from_axis_angle(&Vector3::x_axis(), up)
            * (Rotation3::from_axis_angle(&Vector3::y_axis(), rolled) * on_stage);
        turned.x.atan2(turned.y)
    }
}

/// Eq. 4.5: what a misalignment across the beam adds to an angle, radians. `MD` and `b` of the print
/// are the distance, and how far the module moves towards the plane as the stage turns.
#[must_use]
pub fn cross_misalignment(angle: f64, offset: f64, distance: f64) -> f64 {
    (offset * (1.0 - angle.cos())).atan2(distance - offset * angle.sin())
}

/// Eq. 4.9: what a misalignment along the beam adds to an angle, radians.
#[must_use]
pub fn along_misalignment(angle: f64, offset: f64, distance: f64) -> f64 {
    (distance / (distance - offset) * angle.tan()).atan() - angle
}

/// Eq. 4.10: what a dot that is off along the direction of the turn adds to an angle, radians.
#[must_use]
pub fn dot_across(missed: f64, distance: f64) -> f64 {
    missed.atan2(distance)
}

/// What a second dot above the first adds: `cos angle = cos height cos turn`, so second order.
#[must_use]
pub fn dot_height(angle: f64, height: f64, distance: f64) -> f64 {
    let ratio = angle.cos() / height.atan2(distance).cos();
    if ratio < 1.0 { angle - ratio.acos() } else { angle }
}

/// Eq. 4.12 for the first order: what a relative change of the wavelength adds, radians.
#[must_use]
pub fn wavelength_change(angle: f64, relative: f64) -> f64 {
    (angle.sin() * (1.0 + relative)).asin() - angle
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(degrees: f64) -> Vector3<f64> {
        let (sine, cosine) = degrees.to_radians().sin_cos();
        Vector3::new(sine, 0.0, cosine)
    }

    /// The dot on the plane after a turn, by rotating the module and cutting with the plane.
    fn dot(g: &StageGeometry, beam: &Vector3<f64>, setting: f64) -> f64 {
        let turn = |x: f64, y: f64| {
            (x * setting.cos() + y * setting.sin(), y * setting.cos() - x * setting.sin())
        };
        let (px, py) = turn(g.offset[0], g.offset[1]);
        let (dx, dy) = turn(beam.x, beam.z);
        px + dx * (g.distance - py) / dy
    }

    #[test]
    fn after_the_turn_the_second_dot_stands_where_the_first_stood() {
        let g = StageGeometry { offset: [3.0, -7.0, 2.0], ..StageGeometry::aligned(5000.0) };
        for (from, to, missed) in [(0.0, 2.9, 0.0), (-14.0, -11.2, 0.3), (8.0, -3.0, -1.0)] {
            let first = g.setting(&at(from), StageAxis::Horizontal, 0.0).unwrap();
            assert!(dot(&g, &at(from), first).abs() < 1e-9);
            let turn = g.turn_missing(&at(from), &at(to), StageAxis::Horizontal, missed).unwrap();
            assert!((dot(&g, &at(to), first - turn) - missed).abs() < 1e-9, "{from} {to}");
        }
    }

    #[test]
    fn an_aligned_module_turns_by_the_angle_between_the_beams() {
        let g = StageGeometry::aligned(5000.0);
        let turn = g.turn(&at(-2.0), &at(0.9), StageAxis::Horizontal).unwrap();
        assert!((turn - 2.9f64.to_radians()).abs() < 1e-15);
        let (down, up) = (Vector3::new(0.0, 0.1, 1.0), Vector3::new(0.0, -0.1, 1.0));
        let turn = g.turn(&up, &down, StageAxis::Vertical).unwrap();
        assert!((turn - 2.0 * 0.1f64.atan()).abs() < 1e-15);
    }

    #[test]
    fn the_closed_forms_are_those_of_the_geometry() {
        let angle = 2.9f64.to_radians();
        let error = |offset: [f64; 3]| {
            let g = StageGeometry { offset, ..StageGeometry::aligned(5000.0) };
            angle - g.turn(&at(0.0), &at(2.9), StageAxis::Horizontal).unwrap()
        };
        // Eq. 4.9 takes DF for D'F', which is good to 1 - cos 2.9 degrees.
        let along = along_misalignment(angle, 1.0, 5000.0);
        assert!((error([0.0, 1.0, 0.0]) / along - 1.0).abs() < 2e-3, "{along}");
        // Eq. 4.5 measures from the first beam's dot, not from the axis' foot.
        let across = cross_misalignment(angle, 1.0, 5000.0);
        assert!((error([1.0, 0.0, 0.0]) / across - 1.0).abs() < 1e-3, "{across}");
    }

    #[test]
    fn the_printed_contributions_of_table_4_1_follow() {
        let angle = 2.9f64.to_radians();
        let check = |found: f64, print: f64| {
            assert!((found.to_degrees() - print).abs() < 5.1e-6, "{} {print}", found.to_degrees());
        };
        check(along_misalignment(angle, 1.0, 5000.0), 0.00058);
        // The print says 0.00100: an erratum.
        check(dot_across(0.1, 5000.0), 0.00115);
        check(dot_height(angle, 1.0, 5000.0), 0.00002);
        check(wavelength_change(angle, 0.4 / 658.0), 0.00176);
        // The print says 0.00003, twice what its eq. 4.5 gives; nothing in the sum.
        check(cross_misalignment(angle, 1.0, 5000.0), 0.000015);
    }
}
