//! Where a projective instrument stands: cameras from points of known place, the module from dots.
//!
//! The module: `locate` with an `Estimator`, from dots with their covariance (`DotField`) and the
//! fan that made them (`Fan`). Unit-weight fits (`fit_angles`, `fit_rays`) are starting values and
//! what the dissertation did; the adjustment (`adjust`) has the last word on a capture.
//!
//! To add an estimator: a variant of `Estimator`, an arm in `locate`.

mod angles;
mod field;
mod generalised;
mod locate;
mod propagate;
mod ray_fit;
mod resection;
mod simplex;
mod weighted_rays;

pub use angles::{AngleFit, AngleObservation, angle_gradient, fit_angles, neighbour_observations};
pub use field::{DotField, Fan};
pub use locate::{Estimator, LocateError, Located, locate};
pub use ray_fit::{RayFit, fit_rays, refine_rays};
pub use resection::{Station, resect};
pub(crate) use resection::{homography, triangulate};
pub use simplex::SimplexOptions;
pub use weighted_rays::{WeightedRayFit, fit_weighted_rays};
