//! Where a projective instrument stands: cameras from points of known place, the module from dots.
//!
//! Resection and ray fit serve as starting values and as estimators of their own; the adjustment
//! (`adjust`) has the last word on uncertainty.

mod angles;
mod ray_fit;
mod resection;

pub use angles::{AngleFit, AngleObservation, angle_gradient, fit_angles, neighbour_observations};
pub use ray_fit::{RayFit, fit_rays};
pub use resection::{Station, resect};
pub(crate) use resection::{homography, triangulate};
