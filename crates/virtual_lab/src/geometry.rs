//! Planes and cameras in space.

use beampose_photogrammetry::Camera;
use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector2, Vector3};

use crate::config::CameraConfig;

/// A unit vector across `normal` that points up in the world (along -Z on a floor or ceiling).
fn up_across(normal: &Vector3<f64>) -> Vector3<f64> {
    let up = if normal.y.abs() > 0.999 { -Vector3::z() } else { Vector3::y() };
    (up - normal * normal.dot(&up)).normalize()
}

/// Axes on a plane seen from the front: right, up, out of it.
pub(crate) fn plane_axes(normal: &Vector3<f64>) -> Matrix3<f64> {
    let out = normal.normalize();
    let up = up_across(&out);
    Matrix3::from_columns(&[up.cross(&out), up, out])
}

/// A camera where it truly stands, with its true interior orientation.
#[derive(Debug, Clone)]
pub(crate) struct View {
    pub(crate) camera: Camera,
    pub(crate) position: Vector3<f64>,
    pub(crate) world_from_camera: UnitQuaternion<f64>,
}

impl View {
    pub(crate) fn new(camera: Camera, config: &CameraConfig) -> Self {
        let position = Vector3::from(config.position_mm);
        let forward = (Vector3::from(config.look_at_mm) - position).normalize();
        let up = up_across(&forward);
        let right = forward.cross(&up);
        let upright = Matrix3::from_columns(&[right, -up, forward]);
        let roll = Rotation3::from_axis_angle(&Vector3::z_axis(), config.roll_deg.to_radians());
        let turned = Rotation3::from_matrix_unchecked(upright) * roll;
        let world_from_camera = UnitQuaternion::from_rotation_matrix(&turned);
        Self { camera, position, world_from_camera }
    }

    /// The image of a world point, pixels; `None` where it has none.
    pub(crate) fn project(&self, point: &Vector3<f64>) -> Option<Vector2<f64>> {
        self.camera
            .project(&self.world_from_camera.inverse_transform_vector(&(point - self.position)))
    }
}

/// A camera whose pictures are `scale` times as large: pixel centres keep their meaning.
pub(crate) fn scaled(camera: &Camera, scale: f64) -> Camera {
    Camera {
        width: (camera.width as f64 * scale).round() as usize,
        height: (camera.height as f64 * scale).round() as usize,
        fx: camera.fx * scale,
        fy: camera.fy * scale,
        cx: (camera.cx + 0.5) * scale - 0.5,
        cy: (camera.cy + 0.5) * scale - 0.5,
        ..*camera
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_upright_camera_sees_right_to_the_right_and_up_to_the_top() {
        let config = crate::WorldConfig::laboratory();
        let view = View::new(config.cameras["cam_b"].calibration.model, &config.cameras["cam_b"]);
        let centre = view.project(&Vector3::zeros()).unwrap();
        assert!(view.project(&Vector3::new(100.0, 0.0, 0.0)).unwrap().x > centre.x + 50.0);
        assert!(view.project(&Vector3::new(0.0, 100.0, 0.0)).unwrap().y < centre.y - 50.0);
        assert!((centre - Vector2::new(1731.0, 1291.0)).norm() < 1e-6);
    }
}
