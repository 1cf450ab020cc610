//! Estimators of the module against the bound of Cramer and Rao: what no unbiased estimator can
//! better, computed here from the geometry alone.
//!
//! A ratio of two root mean squares from n independent draws is uncertain by 1 / sqrt(2 n), which
//! takes thousands of draws to tell three percent. Here the estimator runs beside the best linear
//! one on the same draws: the latter, which knows the truth as its point of linearisation, has
//! exactly the bound as its covariance, and both follow the same noise. Their ratio is then far
//! less uncertain than either, and so is the mean of their difference, the bias.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on stops")]

mod angles;
mod bound;
mod rays;
mod virtual_camera;
