//! A laboratory as sightings: what cameras would report of a known scene, with declared noise.

use std::collections::BTreeMap;

use beampose_photogrammetry::detect::{Dot, DotQuality, ImagePoint, Target};
use beampose_photogrammetry::pose::Station;
use beampose_photogrammetry::rotation::from_omega_phi_kappa;
use beampose_photogrammetry::solve::{Sighting, circle_image_offset};
use beampose_photogrammetry::{
    Artefact, ArtefactTarget, CalibratedCamera, Camera, InteriorSigma, Order, Pattern,
    PatternModel, PatternUncertainty, Setup, TieTargets,
};
use nalgebra::{
    Matrix2, Matrix3, Matrix6, Quaternion, Rotation3, UnitQuaternion, Vector2, Vector3, Vector6,
};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

/// Noise of a dot's centre per axis, pixels: speckle of contrast 0.35.
const DOT_SIGMA: f64 = 0.13;
/// Noise of a target's centre per axis, pixels.
const TARGET_SIGMA: f64 = 0.015;

/// Where the module truly is.
pub struct Truth {
    pub position: Vector3<f64>,
    pub rotation: UnitQuaternion<f64>,
}

impl Truth {
    /// Normalised squared errors of a pose: of all six unknowns, and of the position. Of the four
    /// quarter turns of the module, which a square pattern leaves open, the nearest counts.
    pub fn normalised(&self, pose: &beampose_core::Pose) -> (f64, f64) {
        let [w, x, y, z] = pose.quaternion_wxyz;
        let found = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z));
        let quarter = |k: u32| {
            let turn = std::f64::consts::FRAC_PI_2 * f64::from(k);
            self.rotation * UnitQuaternion::from_axis_angle(&Vector3::z_axis(), turn)
        };
        let error = |k| (found * quarter(k).inverse()).scaled_axis();
        let rotation = (0..4).map(error).min_by(|a, b| a.norm().total_cmp(&b.norm())).unwrap();
        let position = Vector3::from(pose.position_mm) - self.position;
        let mut both = Vector6::zeros();
        both.fixed_rows_mut::<3>(0).copy_from(&position);
        both.fixed_rows_mut::<3>(3).copy_from(&rotation);
        let covariance = Matrix6::from_fn(|r, c| pose.covariance[r][c]);
        let of_position = covariance.fixed_view::<3, 3>(0, 0).into_owned();
        (
            both.dot(&covariance.cholesky().unwrap().solve(&both)),
            position.dot(&of_position.cholesky().unwrap().solve(&position)),
        )
    }
}

/// Where the module stands and what it shines on.
#[derive(Debug, Clone, Copy)]
pub struct Shot {
    /// Omega, phi, kappa of the module, degrees.
    pub turned_deg: [f64; 3],
    /// Where its axis meets the wall z = 0, and how far away that is, mm.
    pub aim: [f64; 3],
    pub distance: f64,
    /// A second wall that leaves the first along x = `.0` mm, to the left, bent by `.1` degrees
    /// towards the cameras (negative: away from them).
    pub corner: Option<(f64, f64)>,
}

impl Shot {
    /// The rail of the default rig: `rail` mm back from 0.9 m.
    pub fn on_rail(rail: f64) -> Self {
        let aim = [-420.0, 200.0, 0.0];
        Self { turned_deg: [4.0, 9.0, 1.5], aim, distance: 900.0 + rail, corner: None }
    }

    fn module(&self) -> (Vector3<f64>, UnitQuaternion<f64>) {
        let rotation = from_omega_phi_kappa(self.turned_deg.map(f64::to_radians));
        (Vector3::from(self.aim) - rotation * Vector3::z() * self.distance, rotation)
    }

    fn dot(&self, position: &Vector3<f64>, direction: &Vector3<f64>) -> Vector3<f64> {
        let onto_first = position - direction * (position.z / direction.z);
        let Some((edge, bend_deg)) = self.corner else { return onto_first };
        if onto_first.x >= edge && direction.z < 0.0 {
            return onto_first;
        }
        let bend = bend_deg.to_radians();
        let normal = Vector3::new(bend.sin(), 0.0, bend.cos());
        let from_edge = Vector3::new(edge, 0.0, 0.0) - position;
        position + direction * (from_edge.dot(&normal) / direction.dot(&normal))
    }
}

/// Names and places of cameras.
pub type Cameras<'a> = &'a [(&'a str, [f64; 3])];

/// Three cameras as on the default rig.
pub const THREE: [(&str, [f64; 3]); 3] = [
    ("cam_a", [-1500.0, 700.0, 1900.0]),
    ("cam_b", [900.0, 600.0, 1900.0]),
    ("cam_c", [-300.0, -650.0, 2100.0]),
];

/// A scene with its true values beside what the solver is told.
pub struct Laboratory {
    pub setup: Setup,
    noise: f64,
    cameras: BTreeMap<String, (Station, Camera)>,
    targets: Vec<(u16, Vector3<f64>, f64)>,
    beams: Vec<(Order, Vector2<f64>)>,
    scale: f64,
    wavelength_bias: f64,
}

fn normal(rng: &mut ChaCha8Rng) -> f64 {
    StandardNormal.sample(rng)
}

/// A station that looks at a point, with its rows level.
pub fn look_at(centre: [f64; 3], target: [f64; 3]) -> Station {
    let centre = Vector3::from(centre);
    let z = (Vector3::from(target) - centre).normalize();
    let x = z.cross(&Vector3::y()).normalize();
    let frame = Matrix3::from_columns(&[x, z.cross(&x), z]);
    Station { centre, rotation: Rotation3::from_matrix_unchecked(frame) }
}

/// The fan of the dissertation, with its calibration's uncertainty.
pub fn pattern() -> Pattern {
    Pattern {
        columns: 11,
        rows: 11,
        reference_wavelength_nm: 658.0,
        model: PatternModel::RadialGrid {
            pitch_mm: 52.22,
            k1_per_mm2: 3.5e-8,
            distance_mm: 1000.0,
        },
        u: PatternUncertainty { angle_deg: 0.0013, common_relative: 1e-4 },
        zero_order_relative_intensity: Some(3.0),
    }
}

fn setup(cameras: Cameras<'_>) -> Setup {
    let model = Camera {
        width: 3456,
        height: 2592,
        fx: 3529.41,
        fy: 3529.41,
        cx: 1727.5,
        cy: 1295.5,
        k1: -0.08,
        k2: 0.03,
        p1: 2e-4,
        p2: -1e-4,
        k3: 0.0,
    };
    let sigma = InteriorSigma { focal_px: 0.94, principal_point_px: [0.82, 0.35] };
    let camera = CalibratedCamera { model, sigma };
    let places = [
        (45, [100.0, 0.0, 0.0]),
        (51, [360.0, 0.0, 12.0]),
        (53, [230.0, 130.0, 0.0]),
        (75, [100.0, 200.0, 12.0]),
        (77, [360.0, 200.0, 0.0]),
        (83, [230.0, 300.0, 12.0]),
        (85, [100.0, 400.0, 0.0]),
        (89, [360.0, 400.0, 0.0]),
    ];
    let target = |(code, xyz_mm)| ArtefactTarget { code, xyz_mm, u_mm: 0.01, radius_mm: 6.0 };
    Setup {
        cameras: cameras.iter().map(|(name, _)| ((*name).to_owned(), camera)).collect(),
        pattern: pattern(),
        artefact: Artefact { targets: places.map(target).into(), scale_relative_u: 5e-5 },
        tie_targets: Some(TieTargets { radius_mm: 6.0 }),
        module_prior: None,
        wavelength_u_nm: 0.02,
        wavelength_by_temperature: None,
    }
}

impl Laboratory {
    /// All as declared, without noise.
    pub fn exact() -> Self {
        Self::new(0, 0.0, &THREE, setup(&THREE))
    }

    /// Every declared error drawn.
    pub fn drawn(seed: u64) -> Self {
        Self::new(seed, 1.0, &THREE, setup(&THREE))
    }

    /// Every declared error drawn, with cameras of one's own.
    pub fn drawn_with(seed: u64, cameras: Cameras<'_>) -> Self {
        Self::new(seed, 1.0, cameras, setup(cameras))
    }

    /// The same where only the fan has errors: 0.0013 degrees for each beam, 0.02 % for all.
    pub fn with_errors_of_the_fan(seed: u64) -> Self {
        let mut setup = setup(&THREE);
        setup.pattern.u.common_relative = 2e-4;
        setup.wavelength_u_nm = 0.0;
        setup.artefact.scale_relative_u = 0.0;
        setup.artefact.targets.iter_mut().for_each(|t| t.u_mm = 0.0);
        for camera in setup.cameras.values_mut() {
            camera.sigma = InteriorSigma { focal_px: 0.0, principal_point_px: [0.0; 2] };
        }
        Self::new(seed, 1.0, &THREE, setup)
    }

    /// Every declared error drawn, of a fan that is known so well: degrees of each beam, relative of all.
    pub fn with_fan_known(seed: u64, u: PatternUncertainty) -> Self {
        let mut setup = setup(&THREE);
        setup.pattern.u = u;
        Self::new(seed, 1.0, &THREE, setup)
    }

    fn new(seed: u64, noise: f64, views: Cameras<'_>, setup: Setup) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut draw = |sigma: f64| noise * sigma * normal(&mut rng);
        let cameras = views
            .iter()
            .map(|&(name, centre)| {
                let calibrated = setup.cameras[name];
                let s = calibrated.sigma;
                let focal = draw(s.focal_px);
                let camera = Camera {
                    fx: calibrated.model.fx + focal,
                    fy: calibrated.model.fy + focal,
                    cx: calibrated.model.cx + draw(s.principal_point_px[0]),
                    cy: calibrated.model.cy + draw(s.principal_point_px[1]),
                    ..calibrated.model
                };
                (name.to_owned(), (look_at(centre, [-330.0, 200.0, 0.0]), camera))
            })
            .collect();
        let artefact_scale = 1.0 + draw(setup.artefact.scale_relative_u);
        let mut targets: Vec<_> = setup
            .artefact
            .targets
            .iter()
            .map(|t| {
                let error = Vector3::from_fn(|_, _| draw(t.u_mm));
                (t.code, Vector3::from(t.xyz_mm) * artefact_scale + error, t.radius_mm)
            })
            .collect();
        let ties = [
            (99, -1000.0, 0.0),
            (101, -1000.0, 400.0),
            (105, -700.0, 760.0),
            (107, -100.0, 760.0),
            (113, -700.0, -360.0),
            (117, -100.0, -360.0),
        ];
        targets.extend(ties.map(|(code, x, y)| (code, Vector3::new(x, y, 0.0), 6.0)));
        let sigma = setup.pattern.u.angle_deg.to_radians();
        let beams = setup
            .pattern
            .orders()
            .map(|order| {
                let d = setup.pattern.direction(order, 0.0).unwrap();
                let across = d.cross(&Vector3::y()).normalize();
                let down = d.cross(&across);
                let moved = (d + across * draw(sigma) + down * draw(sigma)).normalize();
                (order, moved.xy())
            })
            .collect();
        let scale = draw(setup.pattern.u.common_relative);
        let wavelength_bias = draw(setup.wavelength_u_nm);
        Self { setup, noise, cameras, targets, beams, scale, wavelength_bias }
    }

    /// Moves a camera, mm, and turns it about its own axes, radians.
    pub fn knock(&mut self, camera: &str, shift: [f64; 3], turn: [f64; 3]) {
        let (station, _) = self.cameras.get_mut(camera).unwrap();
        station.centre += Vector3::from(shift);
        station.rotation *= Rotation3::new(Vector3::from(turn));
    }

    /// What the wavelength meter reads.
    pub fn read_nm(&self) -> f64 {
        658.0 + self.wavelength_bias
    }

    /// The true directions of the beams at the reference wavelength, row by row.
    pub fn true_directions(&self) -> Vec<Vector3<f64>> {
        let direction = |(_, cosines): &(Order, Vector2<f64>)| {
            let c = cosines * (1.0 + self.scale);
            Vector3::new(c.x, c.y, (1.0 - c.norm_squared()).sqrt())
        };
        self.beams.iter().map(direction).collect()
    }

    /// One capture with the module `rail` mm along its way back from the wall.
    pub fn capture(&self, seed: u64, rail: f64) -> (BTreeMap<String, Sighting>, Truth) {
        self.shot(seed, &Shot::on_rail(rail))
    }

    /// The same with the module turned about the vertical, degrees.
    pub fn capture_turned(
        &self,
        seed: u64,
        rail: f64,
        turn_deg: f64,
    ) -> (BTreeMap<String, Sighting>, Truth) {
        let shot = Shot::on_rail(rail);
        let (position, rotation) = shot.module();
        let turn = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), turn_deg.to_radians());
        self.seen(seed, &shot, position, turn * rotation)
    }

    /// One capture of the module anywhere.
    pub fn shot(&self, seed: u64, shot: &Shot) -> (BTreeMap<String, Sighting>, Truth) {
        let (position, rotation) = shot.module();
        self.seen(seed, shot, position, rotation)
    }

    fn seen(
        &self,
        seed: u64,
        shot: &Shot,
        position: Vector3<f64>,
        rotation: UnitQuaternion<f64>,
    ) -> (BTreeMap<String, Sighting>, Truth) {
        let mut rng = ChaCha8Rng::seed_from_u64(seed ^ 0x9e37_79b9);
        let dots: Vec<(Order, Vector3<f64>)> = self
            .beams
            .iter()
            .map(|(order, cosines)| {
                let c = cosines * (1.0 + self.scale);
                let d = rotation * Vector3::new(c.x, c.y, (1.0 - c.norm_squared()).sqrt());
                (*order, shot.dot(&position, &d))
            })
            .collect();
        let sightings = self
            .cameras
            .iter()
            .map(|(name, (station, camera))| {
                (name.clone(), self.sighting(&mut rng, station, camera, &dots))
            })
            .collect();
        (sightings, Truth { position, rotation })
    }

    fn sighting(
        &self,
        rng: &mut ChaCha8Rng,
        station: &Station,
        camera: &Camera,
        dots: &[(Order, Vector3<f64>)],
    ) -> Sighting {
        let mut point = |at: Vector2<f64>, sigma: f64| ImagePoint {
            at: at + Vector2::new(normal(rng), normal(rng)) * (sigma * self.noise),
            covariance: Matrix2::identity() * (sigma * sigma),
        };
        let inside = |at: &Vector2<f64>| {
            at.min() > 0.0 && at.x < camera.width as f64 && at.y < camera.height as f64
        };
        let dots = dots
            .iter()
            .filter_map(|(order, place)| {
                let at = camera.project(&station.station_point(place)).filter(inside)?;
                let amplitude = if (order.m, order.n) == (0, 0) { 300.0 } else { 110.0 };
                Some(Dot { point: point(at, DOT_SIGMA), amplitude, ..some_dot() })
            })
            .collect();
        let targets = self
            .targets
            .iter()
            .map(|(code, place, radius)| {
                let at = camera.project(&station.station_point(place)).unwrap();
                let offset = circle_image_offset(camera, station, place, &Vector3::z(), *radius);
                Target {
                    code: *code,
                    point: point(at + offset.unwrap(), TARGET_SIGMA),
                    ..some_target()
                }
            })
            .collect();
        Sighting { dots, targets }
    }
}

fn some_point() -> ImagePoint {
    ImagePoint { at: Vector2::zeros(), covariance: Matrix2::identity() }
}

fn some_dot() -> Dot {
    Dot {
        point: some_point(),
        amplitude: 0.0,
        background: 30.0,
        sigma: [3.0, 3.0],
        quality: DotQuality::default(),
    }
}

fn some_target() -> Target {
    Target { code: 0, point: some_point(), semi_axes: [10.0, 10.0], angle: 0.0 }
}
