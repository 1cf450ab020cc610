//! Bundle problems that others have solved, from their files.

use std::io::Read;
use std::path::Path;

use beampose_photogrammetry::adjust::{
    CameraStation, ImageObservation, InteriorOrientation, InteriorParameter, Problem,
};
use beampose_photogrammetry::camera::Camera;
use beampose_photogrammetry::pose::Station;
use nalgebra::{Matrix2, Rotation3, Vector2, Vector3};

/// A file of `tests/data/bundle`, unpacked if its name ends in `.gz`.
fn numbers(name: &str) -> Vec<f64> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/bundle").join(name);
    let bytes = std::fs::read(&path).unwrap();
    let mut text = String::new();
    if name.ends_with(".gz") {
        flate2::read::GzDecoder::new(bytes.as_slice()).read_to_string(&mut text).unwrap();
    } else {
        text = String::from_utf8(bytes).unwrap();
    }
    text.split_ascii_whitespace().map(|word| word.parse().unwrap()).collect()
}

/// Numbers in the order of a file.
struct Reader(std::vec::IntoIter<f64>);

impl Reader {
    fn next(&mut self) -> f64 {
        self.0.next().unwrap()
    }

    fn count(&mut self) -> usize {
        self.next() as usize
    }

    fn vector(&mut self) -> Vector3<f64> {
        Vector3::from_fn(|_, _| self.next())
    }

    fn observations(&mut self, count: usize) -> Vec<ImageObservation> {
        (0..count)
            .map(|_| ImageObservation {
                camera: self.count(),
                point: self.count(),
                at: Vector2::from_fn(|_, _| self.next()),
                information: Matrix2::identity(),
            })
            .collect()
    }
}

fn pinhole(fx: f64, cx: f64, cy: f64) -> Camera {
    let (k1, k2, p1, p2, k3) = (0.0, 0.0, 0.0, 0.0, 0.0);
    Camera { width: 3456, height: 2592, fx, fy: fx, cx, cy, k1, k2, p1, p2, k3 }
}

/// A station from a rotation vector and translation of `cam_from_world`.
fn station(turn: Vector3<f64>, translation: Vector3<f64>) -> Station {
    let rotation = Rotation3::new(turn).inverse();
    Station { centre: -(rotation * translation), rotation }
}

/// `ba11.txt` or `ba81.txt.gz`: all cameras move, the last of them the virtual one; controls are
/// exactly known. Lengths in metres.
pub fn dots(name: &str) -> Problem {
    let mut file = Reader(numbers(name).into_iter());
    let [cameras, points, controls, observations] = [(); 4].map(|()| file.count());
    let images = file.observations(observations);
    let mut problem = Problem { images, ..Problem::default() };
    for interior in 0..cameras {
        let station = station(file.vector(), file.vector());
        problem.cameras.push(CameraStation { station, interior, is_held: false });
        let camera = pinhole(file.next(), file.next(), file.next());
        problem.interiors.push(InteriorOrientation::fixed(camera));
    }
    problem.points = (0..points + controls).map(|_| file.vector()).collect();
    problem.held_points = (points..points + controls).collect();
    problem
}

/// The format of Bundle Adjustment in the Large: focal length, k1 and k2 of each camera unknown.
/// Its cameras look along -z with y up: y is turned round here.
pub fn in_the_large(name: &str) -> Problem {
    let mut file = Reader(numbers(name).into_iter());
    let [cameras, points, observations] = [(); 3].map(|()| file.count());
    let mut images = file.observations(observations);
    images.iter_mut().for_each(|o| o.at.y = -o.at.y);
    let mut problem = Problem { images, ..Problem::default() };
    let half_turn = Rotation3::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
    for interior in 0..cameras {
        let looking_back = station(file.vector(), file.vector());
        let rotation = looking_back.rotation * half_turn;
        let station = Station { rotation, ..looking_back };
        problem.cameras.push(CameraStation { station, interior, is_held: false });
        let mut camera = pinhole(file.next(), 0.0, 0.0);
        (camera.k1, camera.k2) = (file.next(), file.next());
        use InteriorParameter::{Focal, K1, K2};
        problem.interiors.push(InteriorOrientation::free(camera, &[Focal, K1, K2]));
    }
    problem.points = (0..points).map(|_| file.vector()).collect();
    problem
}
