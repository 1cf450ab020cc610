//! The bound, the best linear estimator, and the scenes of Table 6.1 and of figures 4.3 and 4.10.

use beampose_photogrammetry::pose::Fan;
use beampose_photogrammetry::{Order, Pattern, PatternUncertainty};
use nalgebra::{Matrix3, Matrix6, SMatrix, Vector3, Vector6};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use rayon::iter::{IntoParallelIterator as _, ParallelIterator as _};

/// Coordinates of a dot are uncertain by this, mm (Table 6.1).
pub const DOT_SIGMA: f64 = 0.1;

/// A module in the origin that looks along z, and its dots on a plane.
pub struct Scene {
    pub pattern: Pattern,
    pub orders: Vec<Order>,
    pub directions: Vec<Vector3<f64>>,
    pub dots: Vec<Vector3<f64>>,
}

impl Scene {
    /// `size` beams a side, equal angles over `view_deg`, a plane 2 m away tilted about y.
    pub fn new(size: u32, view_deg: f64, tilt_deg: f64) -> Self {
        let u = PatternUncertainty { angle_deg: 0.0, common_relative: 0.0 };
        let step = view_deg.to_radians() / f64::from(size - 1);
        let pattern = Pattern::equal_angle(size, step, u);
        let beams = pattern.beams(0.0);
        let directions: Vec<Vector3<f64>> = beams.iter().map(|b| b.direction).collect();
        let normal = Vector3::new(tilt_deg.to_radians().sin(), 0.0, tilt_deg.to_radians().cos());
        let onto = |d: &Vector3<f64>| d * (2000.0 * normal.z / d.dot(&normal));
        let dots = directions.iter().map(onto).collect();
        Self { pattern, orders: beams.iter().map(|b| b.order).collect(), directions, dots }
    }

    pub fn fan(&self) -> Fan<'_> {
        Fan { pattern: &self.pattern, scale: 0.0, scale_sigma: 0.0 }
    }
}

/// The least covariance of a pose, and how the best linear estimator follows each dot.
pub struct Bound {
    /// Position in mm, rotation in rad about the world axes.
    pub covariance: Matrix6<f64>,
    gains: Vec<SMatrix<f64, 6, 3>>,
}

impl Bound {
    /// A dot is `centre + R direction depth` plus noise; pose and depths are unknown. The depth is
    /// eliminated from each dot's information.
    pub fn of(dots: &[Vector3<f64>], covariances: &[Matrix3<f64>]) -> Self {
        let parts: Vec<_> = dots
            .iter()
            .zip(covariances)
            .map(|(arm, covariance)| {
                let weight = covariance.try_inverse().unwrap();
                let along = weight * arm;
                let across = weight - along * along.transpose() / arm.dot(&along);
                let mut by_pose = SMatrix::<f64, 3, 6>::zeros();
                by_pose.fixed_columns_mut::<3>(0).copy_from(&Matrix3::identity());
                by_pose.fixed_columns_mut::<3>(3).copy_from(&-arm.cross_matrix());
                (by_pose, across)
            })
            .collect();
        let information: Matrix6<f64> = parts.iter().map(|(d, p)| d.transpose() * p * d).sum();
        let covariance = information.cholesky().unwrap().inverse();
        let gains = parts.iter().map(|(d, p)| covariance * d.transpose() * p).collect();
        Self { covariance, gains }
    }

    /// For dots whose coordinates are all uncertain by [`DOT_SIGMA`].
    pub fn uniform(dots: &[Vector3<f64>]) -> Self {
        Self::of(dots, &vec![Matrix3::identity() * DOT_SIGMA.powi(2); dots.len()])
    }

    /// The error of the best linear estimator under this noise of the dots.
    pub fn best(&self, noise: &[Vector3<f64>]) -> Vector6<f64> {
        self.gains.iter().zip(noise).map(|(gain, noise)| gain * noise).sum()
    }
}

pub fn normal(rng: &mut ChaCha8Rng) -> f64 {
    StandardNormal.sample(rng)
}

/// A generator for draw `k`, the same for any number of threads.
pub fn generator(seed: u64, draw: u64) -> ChaCha8Rng {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(draw);
    rng
}

/// Position errors of an estimator beside those of the best linear one.
pub struct Paired {
    found: Vec<Vector3<f64>>,
    best: Vec<Vector3<f64>>,
    bound: Matrix3<f64>,
}

impl Paired {
    /// `draw(k)` gives both errors of draw `k`.
    pub fn draw(
        draws: u64,
        bound: &Bound,
        draw: impl Fn(u64) -> (Vector3<f64>, Vector6<f64>) + Sync + Send,
    ) -> Self {
        let pairs: Vec<_> = (0..draws).into_par_iter().map(draw).collect();
        let (found, best): (Vec<_>, Vec<_>) = pairs.into_iter().unzip();
        let best = best.iter().map(|e| e.fixed_rows::<3>(0).into_owned()).collect();
        Self { found, best, bound: bound.covariance.fixed_view::<3, 3>(0, 0).into_owned() }
    }

    /// Root mean square of the error over that of the best linear estimator, which is the bound,
    /// in the metric of the bound: one for an efficient estimator.
    pub fn ratio(&self) -> f64 {
        let metric = self.bound.try_inverse().unwrap();
        let sum = |errors: &[Vector3<f64>]| -> f64 {
            errors.iter().map(|e| (e.transpose() * metric * e).x).sum()
        };
        (sum(&self.found) / sum(&self.best)).sqrt()
    }

    /// As [`Self::ratio`], but of the scatter about the mean: what is left of the error when the
    /// bias is taken off.
    pub fn scatter_ratio(&self) -> f64 {
        let centred = |errors: &[Vector3<f64>]| {
            let mean = errors.iter().sum::<Vector3<f64>>() / errors.len() as f64;
            errors.iter().map(|e| e - mean).collect()
        };
        let (found, best) = (centred(&self.found), centred(&self.best));
        Self { found, best, bound: self.bound }.ratio()
    }

    /// Mean of the difference from the unbiased best linear estimator, in standard deviations of
    /// the bound, axis by axis.
    pub fn bias(&self) -> Vector3<f64> {
        let n = self.found.len() as f64;
        let mean: Vector3<f64> =
            self.found.iter().zip(&self.best).map(|(f, b)| f - b).sum::<Vector3<f64>>() / n;
        mean.component_div(&self.bound.diagonal().map(f64::sqrt))
    }
}
