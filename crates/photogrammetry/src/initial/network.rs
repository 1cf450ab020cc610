//! A whole network from nothing.

use std::collections::BTreeMap;

use nalgebra::{Matrix3, Rotation3, Vector2, Vector3};

use super::relative::relative_orientations;
use crate::adjust::Problem;
use crate::pose::{Station, resect, triangulate};

/// Why there are no start values.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum InitialError {
    /// No camera sees four known points, and no two cameras share enough points.
    #[error("no camera sees four known points, and no two cameras see five points in common")]
    NothingToStartFrom,
    /// Cameras that could not be connected to the rest.
    #[error("cameras {0:?} see too few points that the others see")]
    Unconnected(Vec<usize>),
}

/// Fewer points than this do not fix a camera beyond doubt.
const FEWEST_TO_RESECT: usize = 4;

/// Sets the stations of all cameras and the places of all points that two cameras see; what is
/// there before is not looked at, except points that are held or controlled. Modules are left alone.
///
/// With known points, the result is in their frame; with fewer than three, in that of one camera,
/// its distance to the next as unit, or in the unit of the first scale bar.
///
/// # Errors
/// [`InitialError`]; the problem is then as it was.
pub fn initial_values(problem: &mut Problem) -> Result<(), InitialError> {
    let views = views(problem);
    let known = known_points(problem);
    let resected = Network::resected(&views, &known);
    let networks = if resected.stations.is_empty() { paired(&views) } else { vec![resected] };
    let best = networks
        .into_iter()
        .map(|mut network| {
            network.grow(&views, &known);
            network
        })
        .min_by(|a, b| a.misfit(&views).total_cmp(&b.misfit(&views)))
        .ok_or(InitialError::NothingToStartFrom)?;
    let missing: Vec<usize> = (0..views.len()).filter(|c| !best.stations.contains_key(c)).collect();
    if !missing.is_empty() {
        return Err(InitialError::Unconnected(missing));
    }
    best.into_frame(problem, &known).write(problem);
    Ok(())
}

/// Per camera the directions in which it sees points.
type Views = Vec<BTreeMap<usize, Vector2<f64>>>;

fn views(problem: &Problem) -> Views {
    let mut views = vec![BTreeMap::new(); problem.cameras.len()];
    for o in &problem.images {
        if let Some(direction) = problem.interior(o.camera).normalise(&o.at) {
            views[o.camera].insert(o.point, direction);
        }
    }
    views
}

fn known_points(problem: &Problem) -> BTreeMap<usize, Vector3<f64>> {
    let held = problem.held_points.iter().map(|p| (*p, problem.points[*p]));
    held.chain(problem.controls.iter().map(|c| (c.point, c.at))).collect()
}

/// Cameras and points that have a place.
#[derive(Debug, Clone, Default)]
struct Network {
    stations: BTreeMap<usize, Station>,
    points: BTreeMap<usize, Vector3<f64>>,
}

impl Network {
    /// All cameras that see enough known points.
    fn resected(views: &Views, known: &BTreeMap<usize, Vector3<f64>>) -> Self {
        let mut network = Self { points: known.clone(), ..Self::default() };
        network.resect_more(views);
        network
    }

    /// Places points and cameras in turns until nothing is added.
    fn grow(&mut self, views: &Views, known: &BTreeMap<usize, Vector3<f64>>) {
        loop {
            let before = (self.stations.len(), self.points.len());
            self.triangulate_more(views, known);
            self.resect_more(views);
            if (self.stations.len(), self.points.len()) == before {
                break;
            }
        }
        self.triangulate_more(views, known);
    }

    fn resect_more(&mut self, views: &Views) {
        for (camera, view) in views.iter().enumerate() {
            if self.stations.contains_key(&camera) {
                continue;
            }
            let seen = view.iter().filter_map(|(p, d)| Some((*self.points.get(p)?, *d)));
            let (points, directions): (Vec<_>, Vec<_>) = seen.unzip();
            if points.len() >= FEWEST_TO_RESECT
                && let Some(station) = resect(&points, &directions)
            {
                self.stations.insert(camera, station);
            }
        }
    }

    /// Places every point that two placed cameras see, again where it was before: more cameras see
    /// it better. Known points stay where the network stands on them.
    fn triangulate_more(&mut self, views: &Views, known: &BTreeMap<usize, Vector3<f64>>) {
        let stands_on_known = known.keys().any(|p| self.points.contains_key(p));
        let mut rays: BTreeMap<usize, Vec<(&Station, Vector2<f64>)>> = BTreeMap::new();
        for (camera, station) in &self.stations {
            for (point, direction) in &views[*camera] {
                rays.entry(*point).or_default().push((station, *direction));
            }
        }
        for (point, rays) in rays {
            if stands_on_known && known.contains_key(&point) {
                continue;
            }
            if let Some(place) = triangulate(&rays)
                && rays.iter().all(|(station, _)| station.station_point(&place).z > 0.0)
            {
                self.points.insert(point, place);
            }
        }
    }

    /// How badly the network fits: cameras that have no place count most, then residuals.
    fn misfit(&self, views: &Views) -> f64 {
        let (mut sum, mut count) = (0.0, 0.0_f64);
        for (camera, station) in &self.stations {
            for (point, direction) in &views[*camera] {
                if let Some(place) = self.points.get(point) {
                    let p = station.station_point(place);
                    sum += (Vector2::new(p.x / p.z, p.y / p.z) - direction).norm_squared();
                    count += 1.0;
                }
            }
        }
        let missing = (views.len() - self.stations.len()) as f64;
        missing + (sum / count.max(1.0)).sqrt()
    }

    /// The network moved, turned and scaled onto known points, if it does not stand on them yet, or
    /// scaled to the first scale bar.
    fn into_frame(mut self, problem: &Problem, known: &BTreeMap<usize, Vector3<f64>>) -> Self {
        let pairs: Vec<(Vector3<f64>, Vector3<f64>)> =
            known.iter().filter_map(|(p, at)| Some((*self.points.get(p)?, *at))).collect();
        let similarity = if pairs.len() >= 3 {
            Similarity::between(&pairs)
        } else {
            problem.scale_bars.iter().find_map(|bar| {
                let [a, b] = bar.ends.map(|end| self.points.get(&end));
                let scale = bar.length / (a? - b?).norm();
                Some(Similarity { scale, rotation: Rotation3::identity(), shift: Vector3::zeros() })
            })
        };
        if let Some(to) = similarity {
            self.points.values_mut().for_each(|p| *p = to.of(p));
            for station in self.stations.values_mut() {
                station.centre = to.of(&station.centre);
                station.rotation = to.rotation * station.rotation;
            }
        }
        self
    }

    fn write(&self, problem: &mut Problem) {
        for (camera, station) in &self.stations {
            problem.cameras[*camera].station = *station;
        }
        for (point, place) in &self.points {
            if !problem.held_points.contains(point) {
                problem.points[*point] = *place;
            }
        }
    }
}

/// Networks of the two cameras that share the most points, one for each way in which these can
/// stand to one another.
fn paired(views: &Views) -> Vec<Network> {
    let pairs = (0..views.len()).flat_map(|a| (a + 1..views.len()).map(move |b| (a, b)));
    let shared = |(a, b): &(usize, usize)| -> usize {
        views[*a].keys().filter(|p| views[*b].contains_key(p)).count()
    };
    let Some((a, b)) = pairs.max_by_key(|pair| (shared(pair), std::cmp::Reverse(*pair))) else {
        return Vec::new();
    };
    let both = views[a].iter().filter_map(|(p, d)| Some((*d, *views[b].get(p)?)));
    let (first, second): (Vec<_>, Vec<_>) = both.unzip();
    let origin = Station { centre: Vector3::zeros(), rotation: Rotation3::identity() };
    relative_orientations(&first, &second)
        .into_iter()
        .map(|found| Network {
            stations: BTreeMap::from([(a, origin), (b, found.second)]),
            points: BTreeMap::new(),
        })
        .collect()
}

/// A movement with growth.
struct Similarity {
    scale: f64,
    rotation: Rotation3<f64>,
    shift: Vector3<f64>,
}

impl Similarity {
    /// The one that takes the first points of the pairs closest to the second (Umeyama 1991).
    fn between(pairs: &[(Vector3<f64>, Vector3<f64>)]) -> Option<Self> {
        let n = pairs.len() as f64;
        let from = pairs.iter().map(|p| p.0).sum::<Vector3<f64>>() / n;
        let to = pairs.iter().map(|p| p.1).sum::<Vector3<f64>>() / n;
        let scatter: Matrix3<f64> =
            pairs.iter().map(|(a, b)| (b - to) * (a - from).transpose()).sum();
        let svd = scatter.svd(true, true);
        let (u, v_t) = (svd.u?, svd.v_t?);
        let sign = (u * v_t).determinant().signum();
        let keep = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, sign));
        let rotation = Rotation3::from_matrix_unchecked(u * keep * v_t);
        let spread: f64 = pairs.iter().map(|(a, _)| (a - from).norm_squared()).sum();
        let along: f64 = pairs.iter().map(|(a, b)| (b - to).dot(&(rotation * (a - from)))).sum();
        let scale = along / spread;
        (scale > 0.0).then(|| Self { scale, rotation, shift: to - rotation * from * scale })
    }

    fn of(&self, point: &Vector3<f64>) -> Vector3<f64> {
        self.rotation * point * self.scale + self.shift
    }
}
