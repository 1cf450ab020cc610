//! Codes of small and blurred targets, whose sectors run into one another: the whole print is
//! fitted to the pixels ([`super::pattern`]) with a grey level for each sector of its own. What the
//! blur has mixed is so taken apart, and each sector has an uncertainty.
//!
//! A code is read only if every sector comes out plainly dark or light, many of its standard
//! uncertainties from the middle; what is left over must be small. Otherwise it is refused: where
//! blur and noise leave a sector a seventh of the contrast of doubt, the margin between codes is gone.

use nalgebra::{Matrix2, Rotation2, SMatrix, SVector, Vector2};

use super::candidates::sample;
use super::decode;
use super::ellipse::Ellipse;
use super::pattern::{Columns, DISC, GREYS, Patch, SECTORS, SHAPE, UNKNOWNS, View};
use super::{Target, TargetOptions, is_usable_code};
use crate::detect::{ImagePoint, lanes};
use crate::image::GrayImage;
use crate::scene::canonical_code;

type Normal = SMatrix<f64, UNKNOWNS, UNKNOWNS>;
type Vector = SVector<f64, UNKNOWNS>;

/// Largest small semi-axis, pixels: sectors of larger discs are read one by one.
const LARGEST: f64 = 6.0;
/// Smallest part of the contrast by which two sectors' worth of a ring must be lighter than two
/// others, in the picture and once the start has taken them apart: 0.38 and 0.73 were the least of 900
/// prints that were read, 0.2 and 0.4 are common among speckled dots.
const LEAST_CHANGE: f64 = 0.33;
const LEAST_APART: f64 = 0.6;
/// A small disc looks smaller than it is, the smaller axis by no more than this.
const LARGEST_GROWTH: f64 = 1.2;
/// Where changes are looked for, in radii of what the disc looks like: across the ring, so that grains
/// of speckle cancel.
const RING_RADII: [f64; 3] = [2.5, 2.8, 3.1];
/// Directions in which they are looked for, and how many of them are two sectors.
const DIRECTIONS: usize = 2 * SECTORS;
const TWO_SECTORS: usize = 4;
/// Start value of the blur, pixels.
const BLUR: f64 = 1.2;
/// Turns within a sector from which the fit starts.
const TURNS: usize = 3;
/// Blur makes a small disc look smaller than it is by about this.
const SHRUNK: f64 = 1.12;
/// Largest distance of the centres of disc and ring, in radii.
const MOST_OFFSET: f64 = 0.1;
/// Largest ratio of the semi-axes: a tilt of 63 degrees.
const MOST_RATIO: f64 = 2.2;
/// Largest sum of the squared standardised departures of all sectors, one in ten thousand, and what
/// a print and its fit leave in each.
const MOST_CHI_SQUARE: f64 = 39.1;
const UNEVEN: f64 = 0.03;
/// Steps before a fit is given up.
const MAX_STEPS: usize = 20;
/// Steps after which most of the misfit must be gone.
const FIRST_STEPS: usize = 3;
/// How far a sector may then be from disc or ground, as a part of the contrast.
const FIRST_DEPARTURE: f64 = 0.5;
/// Changes around the ring of a code that serves.
const LEAST_CHANGES: usize = 4;
/// A step that changes the sum of squares by less than this part is the last.
const CONVERGED: f64 = 1e-4;
/// Largest rms residual of a start and of the end, as a part of the contrast.
const START_MISFIT: f64 = 0.22;
const MOST_MISFIT: f64 = 0.12;
/// Largest rms residual in units of the noise, and as a part of the contrast: prints and lenses are
/// not quite those of the model.
const MOST_NOISE: f64 = 1.3;
const MOST_UNLIKE: f64 = 0.02;
/// Largest correlation of neighbouring residuals: six times what chance makes of 900 pixels.
const MOST_CORRELATION: f64 = 0.2;
/// Largest standard uncertainty of a sector, as a part of the contrast: with the margin of 0.3 a
/// wrong bit is five of them away.
const MOST_DOUBT: f64 = 0.14;

/// Whether a disc is small and no thinner than a target's, and something changes around it: cheap, and
/// false of laser dots.
pub(super) fn may_be_target(image: &GrayImage, ellipse: &Ellipse, options: &TargetOptions) -> bool {
    let [large, small] = ellipse.semi_axes();
    let least = options.min_semi_axis / LARGEST_GROWTH;
    let is_disc = (least..LARGEST).contains(&small) && large < LARGEST_GROWTH * MOST_RATIO * small;
    is_disc && changes_around(image, ellipse, options) == Some(true)
}

/// Whether the grey levels around a disc differ from one another; `None` outside the picture.
fn changes_around(image: &GrayImage, ellipse: &Ellipse, options: &TargetOptions) -> Option<bool> {
    let map = ellipse.map();
    let disc = sample(image, ellipse.centre.x, ellipse.centre.y)?;
    let mut around = [0.0; DIRECTIONS];
    for (sum, direction) in
        around.iter_mut().zip(decode::UNIT.iter().step_by(decode::PER_SECTOR / 2))
    {
        for radius in RING_RADII {
            let at = ellipse.centre + map * Vector2::from(*direction) * radius;
            *sum += sample(image, at.x, at.y)? / RING_RADII.len() as f64;
        }
    }
    around.sort_unstable_by(f64::total_cmp);
    let [low, high] = [around[0], around[DIRECTIONS - 1]];
    let contrast = (disc - low).abs().max((disc - high).abs());
    let change = around[DIRECTIONS - TWO_SECTORS] - around[TWO_SECTORS - 1];
    Some(contrast >= options.min_contrast && change > LEAST_CHANGE * contrast)
}

/// The target of a disc, if its code is beyond doubt; `noise` is that of the background, grey levels.
pub(super) fn read(
    image: &GrayImage,
    ellipse: &Ellipse,
    noise: f64,
    options: &TargetOptions,
) -> Option<Target> {
    let fit = Fit::start(image, ellipse)?.refined()?;
    fit.is_whole(noise).then(|| fit.target(options))?
}

/// Sums of the normal equations.
struct Sums {
    normal: Normal,
    right: Vector,
    squares: f64,
}

impl Sums {
    fn new(columns: &Columns, left: &[f32]) -> Self {
        let all = columns.all();
        let mut normal = Normal::zeros();
        for i in 0..UNKNOWNS {
            for j in 0..=i {
                let sum = f64::from(lanes::dot(&all[i], &all[j]));
                (normal[(i, j)], normal[(j, i)]) = (sum, sum);
            }
        }
        let right = Vector::from_fn(|i, _| f64::from(lanes::dot(left, &all[i])));
        Self { normal, right, squares: f64::from(lanes::dot(left, left)) }
    }
}

/// A print fitted to pixels.
struct Fit {
    patch: Patch,
    view: View,
    greys: [f64; GREYS],
    squares: f64,
}

impl Fit {
    /// The best of several turns, with the greys that fit them.
    fn start(image: &GrayImage, ellipse: &Ellipse) -> Option<Self> {
        let views = (0..TURNS).map(|i| {
            let turn = i as f64 * std::f64::consts::TAU / (TURNS * SECTORS) as f64;
            let map = ellipse.map() * Rotation2::new(turn).matrix() * SHRUNK;
            View { centre: ellipse.centre, ring: ellipse.centre, map, blur: BLUR }
        });
        let mut best: Option<Self> = None;
        for view in views {
            let Some(fit) = Self::with_greys(Patch::around(image, &view)?, view) else { continue };
            if best.as_ref().is_none_or(|best| fit.squares < best.squares) {
                best = Some(fit);
            }
        }
        best.filter(|fit| fit.misfit() < START_MISFIT && fit.tells_sectors_apart())
    }

    /// The greys that fit a view best.
    fn with_greys(patch: Patch, view: View) -> Option<Self> {
        let columns = patch.columns(&view, None);
        let by = columns.greys();
        let normal = SMatrix::<f64, GREYS, GREYS>::from_fn(|i, j| {
            f64::from(lanes::dot(&by[i.max(j)], &by[i.min(j)]))
        });
        let right =
            SVector::<f64, GREYS>::from_fn(|i, _| f64::from(lanes::dot(patch.greys(), &by[i])));
        let greys: [f64; GREYS] = normal.cholesky()?.solve(&right).into();
        let left = patch.left(&columns, &greys);
        let squares = f64::from(lanes::dot(&left, &left));
        Some(Self { patch, view, greys, squares })
    }

    /// Rms residual as a part of the contrast.
    fn misfit(&self) -> f64 {
        (self.squares / self.patch.count).sqrt() / self.greys[DISC].abs()
    }

    /// The fit of all unknowns (Levenberg and Marquardt); `None` where it finds no rest.
    fn refined(mut self) -> Option<Self> {
        let mut damping: f64 = 1e-3;
        let mut sums = self.sums();
        for count in 0..MAX_STEPS {
            if count >= FIRST_STEPS && !self.is_promising() {
                return None;
            }
            let mut damped = sums.normal;
            (0..UNKNOWNS).for_each(|i| damped[(i, i)] *= 1.0 + damping);
            let step = damped.cholesky()?.solve(&sums.right);
            let (view, greys) = self.moved(&step)?;
            let columns = self.patch.columns(&view, Some(&greys));
            let after = Sums::new(&columns, &self.patch.left(&columns, &greys));
            if after.squares < sums.squares {
                let is_last = after.squares > (1.0 - CONVERGED) * sums.squares;
                (self.view, self.greys, self.squares) = (view, greys, after.squares);
                sums = after;
                damping = (damping * 0.1).max(1e-7);
                if is_last {
                    return Some(self);
                }
            } else {
                damping *= 10.0;
                if damping > 1e3 {
                    return Some(self);
                }
            }
        }
        None
    }

    /// Each sector's part of the disc's contrast: 0 is ground.
    fn parts(&self) -> [f64; SECTORS] {
        std::array::from_fn(|i| self.greys[DISC + 1 + i] / self.greys[DISC])
    }

    /// Whether at least two sectors are far from two others, as in every code that serves.
    fn tells_sectors_apart(&self) -> bool {
        let mut parts = self.parts();
        parts.sort_unstable_by(f64::total_cmp);
        parts[SECTORS - 2] - parts[1] > LEAST_APART
    }

    /// Whether this may yet become a print: most of the misfit is gone, every sector is on its way to
    /// disc or ground, and there are changes around the ring.
    fn is_promising(&self) -> bool {
        let parts = self.parts();
        let is_near =
            |part: &f64| (part - f64::from(u8::from(*part > 0.5))).abs() < FIRST_DEPARTURE;
        let changes =
            (0..SECTORS).filter(|&i| (parts[i] > 0.5) != (parts[(i + 1) % SECTORS] > 0.5)).count();
        self.misfit() < MOST_MISFIT && changes >= LEAST_CHANGES && parts.iter().all(is_near)
    }

    fn sums(&self) -> Sums {
        let columns = self.patch.columns(&self.view, Some(&self.greys));
        Sums::new(&columns, &self.patch.left(&columns, &self.greys))
    }

    fn moved(&self, step: &Vector) -> Option<(View, [f64; GREYS])> {
        let view = self.view.moved(step.fixed_rows::<SHAPE>(0).as_slice());
        let greys = std::array::from_fn(|i| self.greys[i] + step[SHAPE + i]);
        let growth = view.map.determinant() / self.view.map.determinant();
        ((0.3..6.0).contains(&view.blur) && (0.4..2.5).contains(&growth)).then_some((view, greys))
    }

    /// Whether the fit leaves noise alone: no more of it than there is, and no pattern.
    fn is_whole(&self, noise: f64) -> bool {
        let columns = self.patch.columns(&self.view, Some(&self.greys));
        let left = self.patch.left(&columns, &self.greys);
        let rms = (self.squares / self.patch.count).sqrt();
        let most = (MOST_NOISE * noise).hypot(MOST_UNLIKE * self.greys[DISC]);
        rms < most && self.patch.correlation(&left) < MOST_CORRELATION
    }

    fn target(&self, options: &TargetOptions) -> Option<Target> {
        let sums = self.sums();
        let variance = sums.squares / (self.patch.count - UNKNOWNS as f64);
        let covariance = sums.normal.try_inverse()? * variance;
        let code = self.code(&covariance, options.code_margin)?;
        let shape = (self.view.map * self.view.map.transpose()).try_inverse()?;
        let ellipse = Ellipse::valid(self.view.centre, shape)?;
        let (semi_axes, angle) = (ellipse.semi_axes(), ellipse.angle());
        let is_target = super::is_wanted(&ellipse, self.greys[DISC].abs(), options)
            && is_usable_code(code)
            && self.misfit() < MOST_MISFIT
            && semi_axes[0] < MOST_RATIO * semi_axes[1]
            && ellipse.radius(&self.view.ring) < MOST_OFFSET;
        let covariance: Matrix2<f64> = covariance.fixed_view::<2, 2>(0, 0).into();
        let point = ImagePoint { at: ellipse.centre, covariance };
        is_target.then_some(Target { code, point, semi_axes, angle })
    }

    /// The canonical code, if each sector is like disc or ground.
    fn code(&self, covariance: &Normal, margin: f64) -> Option<u16> {
        let disc = self.greys[DISC];
        let (mut bits, mut chi_square) = (0u16, 0.0);
        for sector in 1..=SECTORS {
            let part = self.greys[DISC + sector] / disc;
            let bit = part > 0.5;
            let index = SHAPE + DISC + sector;
            let doubt = covariance[(index, index)].sqrt() / disc.abs();
            let departure = (part - f64::from(u8::from(bit))).abs();
            if !(departure < margin && doubt < MOST_DOUBT) {
                return None;
            }
            chi_square += departure * departure / (doubt * doubt + UNEVEN * UNEVEN);
            bits = bits << 1 | u16::from(bit);
        }
        (chi_square < MOST_CHI_SQUARE).then(|| canonical_code(bits))
    }
}
