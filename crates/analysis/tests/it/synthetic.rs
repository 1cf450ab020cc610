//! A session made up for reports: plausible poses, residuals, pictures and readings from a seed.
//!
//! Not a simulation: nothing here is measured from the pictures.

use std::collections::BTreeMap;
use std::time::Duration;

use beampose_analysis::report::{
    CalibrationOrigin, InputOrigin, Provenance, ReportCapture, ReportPicture, SourceOrigin, Trace,
};
use beampose_analysis::{
    DistanceRule, Limits, ReportInput, ScoredCapture, StatedScale, TranslationInput, TravelCapture,
    Truth, Verdict, score, translation,
};
use beampose_core::units::Millimetre;
use beampose_core::{
    CaptureId, Identity, Pose, Quantity, Reading, SessionId, SessionOutcome, Stamp,
};
use beampose_photogrammetry::rotation::{from_omega_phi_kappa, wxyz};
use beampose_photogrammetry::solve::{
    CameraSolution, CaptureSolution, Method, MethodResult, Observation, StageSeconds, Subject,
};
use beampose_photogrammetry::{GrayImage, Order, Wavelength, WavelengthSource};
use nalgebra::{Rotation3, UnitQuaternion, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

/// How large a session is made.
pub struct Size {
    /// Passes along the rail.
    pub passes: u32,
    /// Stops in a pass, 100 mm apart.
    pub stops: u32,
    /// Beams on each side of the centre.
    pub half: i32,
    /// Width and height of the pictures.
    pub frame: [usize; 2],
    /// How many captures fail.
    pub failures: usize,
}

const CAMERAS: [(&str, [f64; 3]); 3] = [
    ("cam_a", [-750.0, 260.0, 1500.0]),
    ("cam_b", [30.0, -420.0, 1650.0]),
    ("cam_c", [780.0, 310.0, 1450.0]),
];

const TARGETS: [(u16, [f64; 2]); 8] = [
    (45, [-330.0, -250.0]),
    (77, [0.0, -270.0]),
    (83, [320.0, -250.0]),
    (101, [-340.0, 260.0]),
    (119, [10.0, 275.0]),
    (187, [335.0, 255.0]),
    (211, [-345.0, 0.0]),
    (235, [342.0, 8.0]),
];

struct Noise(ChaCha8Rng);

impl Noise {
    fn normal(&mut self, sigma: f64) -> f64 {
        let z: f64 = StandardNormal.sample(&mut self.0);
        z * sigma
    }
}

pub fn stamp(seconds: f64) -> Stamp {
    let monotonic = Duration::from_secs_f64(seconds);
    let start: jiff::Timestamp = "2026-11-20T08:30:00Z".parse().unwrap();
    Stamp {
        monotonic,
        utc: start.checked_add(jiff::SignedDuration::try_from(monotonic).unwrap()).unwrap(),
    }
}

/// Where a point of the wall appears in a camera that looks at the wall's middle.
fn project(camera: [f64; 3], frame: [usize; 2], point: [f64; 2]) -> [f64; 2] {
    let eye = Vector3::from(camera);
    let z = (Vector3::zeros() - eye).normalize();
    let x = z.cross(&Vector3::y()).normalize();
    let y = z.cross(&x);
    let ray = Vector3::new(point[0], point[1], 0.0) - eye;
    let f = 1.05 * frame[0] as f64 * 1.6;
    let scale = f / ray.dot(&z) / 1.0;
    [frame[0] as f64 / 2.0 + scale * ray.dot(&x), frame[1] as f64 / 2.0 + scale * ray.dot(&y)]
}

fn observation(subject: Subject, at: [f64; 2], noise: &mut Noise) -> Observation {
    let mut residual = [0, 1].map(|_| noise.normal(0.06));
    let used = noise.normal(1.0).abs() < 3.0;
    if !used {
        residual = residual.map(|r| r + 0.5);
    }
    Observation { subject, at, covariance: [[0.0036, 0.0], [0.0, 0.0036]], residual, used }
}

fn cameras(size: &Size, distance: f64, noise: &mut Noise) -> BTreeMap<String, CameraSolution> {
    let one = |(name, position_mm): (&str, [f64; 3])| {
        let mut observations = Vec::new();
        for n in -size.half..=size.half {
            for m in -size.half..=size.half {
                let point = [f64::from(m) * 0.05222 * distance, f64::from(-n) * 0.05222 * distance];
                let at = project(position_mm, size.frame, point);
                let inside = (0..2).all(|i| at[i] > 4.0 && at[i] < size.frame[i] as f64 - 5.0);
                if inside {
                    observations.push(observation(Subject::Dot(Order { m, n }), at, noise));
                }
            }
        }
        for (code, point) in TARGETS {
            let at = project(position_mm, size.frame, point);
            observations.push(observation(Subject::Target(code), at, noise));
        }
        let strays = vec![project(position_mm, size.frame, [-140.0, 203.0])];
        let solution = CameraSolution {
            position_mm,
            quaternion_wxyz: [1.0, 0.0, 0.0, 0.0],
            observations,
            strays,
        };
        (name.to_owned(), solution)
    };
    CAMERAS.map(one).into_iter().collect()
}

fn result(method: Method, truth: &Truth, u_mm: [f64; 3], noise: &mut Noise) -> MethodResult {
    let u_rad = [2e-4, 2e-4, 1e-4];
    let mut covariance = [[0.0; 6]; 6];
    for i in 0..3 {
        covariance[i][i] = u_mm[i] * u_mm[i];
        covariance[3 + i][3 + i] = u_rad[i] * u_rad[i];
    }
    let turn = Vector3::from(u_rad.map(|u| noise.normal(u)));
    let truth_q = from_omega_phi_kappa([0.01, -0.02, 0.005]);
    let pose = Pose {
        position_mm: [0, 1, 2].map(|i| truth.position_mm[i] + noise.normal(u_mm[i])),
        quaternion_wxyz: wxyz(
            &(UnitQuaternion::from_rotation_matrix(&Rotation3::new(turn)) * truth_q),
        ),
        covariance,
    };
    let (beams_used, sigma0) = (119, 1.0 + noise.normal(0.05));
    let wavelength_nm = 658.02 + noise.normal(0.003);
    let known = Wavelength {
        source: WavelengthSource::Read,
        nm: wavelength_nm,
        own_u_nm: 0.0,
        common_u_nm: 0.01,
        age_s: None,
    };
    let (pose, wavelength) = (Ok(pose), Some(known));
    MethodResult { method, pose, beams_used, sigma0, wavelength_nm, wavelength, ambiguous: false }
}

fn capture(size: &Size, pass: u32, stop: u32, noise: &mut Noise) -> (ReportCapture, Truth) {
    let index = (pass - 1) * size.stops + stop;
    let rail = f64::from(stop) * 100.0;
    let truth = Truth {
        position_mm: [3.0, -2.0, 900.0 + rail],
        quaternion_wxyz: wxyz(&from_omega_phi_kappa([0.01, -0.02, 0.005])),
    };
    let grow = 1.0 + rail / 900.0;
    let failed = (index as usize) % 17 == 13 && (index as usize) / 17 < size.failures;
    let mut angles = result(Method::InterBeamAngles, &truth, [0.38, 0.38, 0.09 * grow], noise);
    let virtual_camera = result(Method::VirtualCamera, &truth, [0.21, 0.21, 0.055 * grow], noise);
    if let Ok(pose) = &mut angles.pose {
        pose.position_mm[2] -= 0.0003 * rail;
    }
    if failed {
        angles.pose = Err("12 of 121 dots seen by two cameras or more; 16 are needed".to_owned());
    }
    let notes = if failed { vec!["cam_b: 3 targets only, left out".to_owned()] } else { vec![] };
    let solution = CaptureSolution {
        cameras: cameras(size, 900.0, noise),
        dots: vec![],
        results: vec![angles, virtual_camera],
        notes,
    };
    let wavelength = 658.02 + 0.004 * (f64::from(index) / 9.0).sin();
    let capture = ReportCapture {
        id: CaptureId(format!("p{index:03}")),
        at: Some(stamp(20.0 + 12.0 * f64::from(index))),
        setpoints: BTreeMap::from([
            ("pass".to_owned(), f64::from(pass)),
            ("rail_mm".to_owned(), rail),
        ]),
        readings: BTreeMap::from([
            ("rail_mm".to_owned(), rail),
            ("wavelength_nm".to_owned(), wavelength),
        ]),
        wavelength: None,
        solution: Ok(solution),
        seconds: StageSeconds { decode: 0.11, detect: 0.42, identify: 0.05, adjust: 0.18 },
    };
    (capture, truth)
}

fn poses(capture: &ReportCapture) -> BTreeMap<Method, Result<Pose, String>> {
    match &capture.solution {
        Ok(solution) => solution.results.iter().map(|r| (r.method, r.pose.clone())).collect(),
        Err(reason) => Method::USUAL.map(|m| (m, Err(reason.clone()))).into(),
    }
}

/// The analysis of captures, as the app wires it.
pub fn analysed(captures: &[ReportCapture]) -> beampose_analysis::TranslationResult {
    let travel = |c: &ReportCapture| TravelCapture {
        id: c.id.clone(),
        pass: c.setpoints["pass"] as u32,
        setpoint: Millimetre(c.setpoints["rail_mm"]),
        readback: Millimetre(c.readings["rail_mm"]),
        poses: poses(c),
    };
    translation(&TranslationInput {
        captures: captures.iter().map(travel).collect(),
        scale_relative_u: 0.0001,
        stated_scale: StatedScale::Separate,
        rule: DistanceRule::AlongTravel,
        limits: Limits {
            max_abs_difference: Method::USUAL.map(|m| (m, Millimetre(0.5))).into(),
            min_solved_fraction: Some(0.95),
            ..Limits::default()
        },
    })
}

fn trace(instrument: &str, quantity: Quantity, values: impl Iterator<Item = f64>) -> Trace {
    let read = |(i, value): (usize, f64)| Reading {
        quantity,
        value,
        standard_uncertainty: None,
        at: stamp(18.0 + 12.0 * i as f64),
    };
    Trace {
        instrument: instrument.into(),
        quantity,
        readings: values.enumerate().map(read).collect(),
    }
}

/// The report's input for a session of the given size.
pub fn session(size: &Size) -> ReportInput {
    let mut noise = Noise(ChaCha8Rng::seed_from_u64(11));
    let stops = (1..=size.passes).flat_map(|pass| (0..size.stops).map(move |stop| (pass, stop)));
    let (captures, truths): (Vec<_>, Vec<_>) =
        stops.map(|(pass, stop)| capture(size, pass, stop, &mut noise)).unzip();
    let scored: Vec<ScoredCapture> = captures
        .iter()
        .zip(truths)
        .map(|(c, truth)| ScoredCapture { id: c.id.clone(), truth, poses: poses(c) })
        .collect();
    let n = captures.len();
    let result = analysed(&captures);
    let mut input = around(captures);
    input.verdict = result.verdict;
    input.reasons = result.reasons.clone();
    input.translation = Some(result);
    input.scores = score(&scored);
    input.pictures = input.captures.first().map_or_else(Vec::new, |c| pictures(size, c));
    input.frames_px = CAMERAS.map(|(name, _)| (name.to_owned(), size.frame)).into();
    let wavelength = (0..n).map(|i| 658.02 + 0.004 * (i as f64 / 9.0).sin());
    let temperature = (0..n).map(|i| 21.3 + 0.4 * (1.0 - (-(i as f64) / 30.0).exp()));
    input.environment = vec![
        trace("wavemeter", Quantity::Wavelength, wavelength),
        trace("thermometer", Quantity::Temperature, temperature),
    ];
    input
}

/// A report around captures, without analysis, pictures and readings.
pub fn around(captures: Vec<ReportCapture>) -> ReportInput {
    let identity = |model: &str| Identity {
        model: model.to_owned(),
        serial: Some("1042".to_owned()),
        simulated: true,
    };
    let text = |pairs: [(&str, &str); 2]| pairs.map(|(k, v)| (k.to_owned(), v.to_owned())).into();
    ReportInput {
        title: "Translation along the rail, 11 × 11 pattern".to_owned(),
        experiment: "translation".to_owned(),
        verdict: Verdict::Inconclusive,
        reasons: vec!["no captures".to_owned()],
        methods: Method::USUAL.to_vec(),
        captures,
        translation: None,
        side_by_side: vec![],
        drift: None,
        angles: None,
        scores: BTreeMap::new(),
        pictures: vec![],
        frames_px: BTreeMap::new(),
        environment: vec![],
        provenance: Provenance {
            session: SessionId("0193458a-7c00-7000-8000-000000000001".parse().unwrap()),
            outcome: SessionOutcome::Completed,
            opened: stamp(0.0),
            closed: Some(stamp(760.0)),
            processing: "0193458a-9d11-7000-8000-00000000000a".to_owned(),
            acquired_with: "beampose 0.1.0".to_owned(),
            processed_with: "beampose 0.1.0".to_owned(),
            options: text([("methods", "inter-beam-angles, virtual-camera"), ("outlier limit", "4 sigma")]),
            hashes: text([("inputs", "b3:7d2f41c09a6e55e1"), ("plan", "b3:0f8e2a77c41b9d36")]),
            inputs: inputs(),
            seed: Some(11),
            instruments: BTreeMap::from([
                ("cam_a".into(), identity("simulated camera")),
                ("rail".into(), identity("simulated rail")),
            ]),
            plan_text: "version: 1\ntitle: Translation along the rail, 11 × 11 pattern\nsteps:\n  - sweep: {rail: {from: 0 mm, to: 900 mm}} # <a & b>\n".to_owned(),
            rig_text: String::new(),
        },
        interruptions: vec![],
        notes: vec!["the laser warmed up for 10 min before the first capture".to_owned()],
    }
}

/// A fan calibrated in a session that is gone, and a camera of which nothing is known.
fn inputs() -> Vec<InputOrigin> {
    let session = SourceOrigin::Session {
        session: "0193458a-0000-7000-8000-000000000001".to_owned(),
        title: "beam angles <monday>".to_owned(),
        plan_blake3: "00ff".repeat(16),
        processing_utc: None,
        state: "deleted 2026-11-20T08:30:00Z".to_owned(),
    };
    let csv = SourceOrigin::File { name: "measured.csv".to_owned(), blake3: "0f1e".repeat(16) };
    let fan = CalibrationOrigin {
        blake3: "7d2f".repeat(16),
        name: "fan".to_owned(),
        method: "rotation stage".to_owned(),
        created_utc: "2026-11-19T08:30:00Z".to_owned(),
        software: "beampose 0.1.0".to_owned(),
        made_from: vec![session, csv],
    };
    let input = |camera: Option<&str>, file: &str, calibration: Option<CalibrationOrigin>| {
        let blake3 = if camera.is_none() { "7d2f" } else { "41c0" }.repeat(16);
        InputOrigin {
            camera: camera.map(str::to_owned),
            file: file.to_owned(),
            blake3,
            calibration,
        }
    };
    vec![input(None, "fan.yaml", Some(fan)), input(Some("cam_a"), "cam_a.yaml", None)]
}

fn pictures(size: &Size, capture: &ReportCapture) -> Vec<ReportPicture> {
    let Ok(solution) = &capture.solution else { return vec![] };
    let one = |(name, camera): (&String, &CameraSolution)| ReportPicture {
        capture: capture.id.clone(),
        camera: name.clone(),
        image: picture(size.frame, camera),
    };
    solution.cameras.iter().map(one).collect()
}

/// A grey wall, brighter in the middle, with spots and ringed discs.
fn picture(frame: [usize; 2], camera: &CameraSolution) -> GrayImage {
    let [width, height] = frame;
    let shade = |x: usize, y: usize| {
        let (dx, dy) = (x as f64 / width as f64 - 0.5, y as f64 / height as f64 - 0.5);
        let grain = ((x * 7919 + y * 104_729) % 13) as f64 - 6.0;
        (92.0 - 70.0 * (dx * dx + dy * dy) + grain).clamp(0.0, 255.0)
    };
    let mut grey: Vec<f64> =
        (0..height).flat_map(|y| (0..width).map(move |x| shade(x, y))).collect();
    let radius = width as f64 / 150.0;
    for o in &camera.observations {
        let reach = (3.2 * radius).ceil() as i64;
        for dy in -reach..=reach {
            for dx in -reach..=reach {
                let (x, y) = (o.at[0].round() as i64 + dx, o.at[1].round() as i64 + dy);
                let inside = x >= 0 && y >= 0 && x < width as i64 && y < height as i64;
                if !inside {
                    continue;
                }
                let r = ((dx * dx + dy * dy) as f64).sqrt() / radius;
                let value = &mut grey[y as usize * width + x as usize];
                match o.subject {
                    Subject::Dot(_) => *value += 170.0 * (-8.0 * r * r).exp(),
                    Subject::Target(code) => {
                        let sector = ((dy as f64).atan2(dx as f64) / std::f64::consts::FRAC_PI_6
                            + 6.0) as u16;
                        let dark =
                            r < 1.0 || (2.0..3.0).contains(&r) && code >> (sector % 12) & 1 == 1;
                        if dark {
                            *value = 18.0;
                        }
                    }
                }
            }
        }
    }
    GrayImage { width, height, data: grey.into_iter().map(|v| v.clamp(0.0, 255.0) as u8).collect() }
}
