//! The exchange folder: out of a session, into one, and what is refused.

use std::path::Path;

use serde_json::Value;

use crate::lab::{Ended, Lab, plan, replaced, solutions};

/// What follows a picture's first bytes: import decodes nothing.
const PICTURE: &[u8] = b"\0picture";

const CAMERA: &str = "\
image_width: 100
image_height: 80
camera_name: cam_a
distortion_model: plumb_bob
camera_matrix: {rows: 3, cols: 3, data: [90.0, 0, 50.5, 0, 90.0, 40.25, 0, 0, 1]}
distortion_coefficients: {rows: 1, cols: 5, data: [-0.08, 0.03, 0.0002, -0.0001, 0]}
";

const PATTERN: &str = "\
version: 1
columns: 3
rows: 3
reference_wavelength_nm: 658.0
model:
  radial_grid: {pitch_mm: 52.22, k1_per_mm2: 3.5e-8, distance_mm: 1000}
u: {angle_deg: 0.0013, common_relative: 0.0003}
";

/// As DESIGN writes it, with two cameras.
const SESSION: &str = "\
version: 1
title: rail test, cameras triggered by another program
cameras:
  cam_a: {calibration: cam_a.yaml}
  cam_b: {calibration: cam_b.yaml}
pattern: pattern.yaml
artefact:
  targets:
    - {code: 45, xyz_mm: [0, 0, 0], u_mm: 0.02, radius_mm: 6}
    - {code: 51, xyz_mm: [600, 0, 0], u_mm: 0.02, radius_mm: 6}
    - {code: 53, xyz_mm: [0, 400.125, 0], u_mm: 0.02, radius_mm: 6}
  scale_relative_u: 0.0004
tie_targets: {radius_mm: 6}
module_prior: {rotation_omega_phi_kappa_deg: [0, 0, 0], within_deg: 45}
captures:
  - id: p000
    setpoints: {rail_mm: 0, pass: 1}
    readings: {wavelength_nm: 658.02, temperature_degc: 24.1}
    images: {cam_a: p000_a.jpg, cam_b: p000_b.png}
  - id: p001
    setpoints:
    images: {cam_a: p001_a.jpg}
";

/// Writes a folder with this `session.yaml`.
fn folder(lab: &Lab, name: &str, session: &str) {
    let put = |file: &str, text: &str| lab.write(&format!("{name}/{file}"), text);
    put("session.yaml", session);
    put("cam_a.yaml", CAMERA);
    put("cam_b.yaml", CAMERA);
    put("pattern.yaml", PATTERN);
    for (file, magic) in [
        ("p000_a.jpg", &b"\xff\xd8\xff"[..]),
        ("p000_b.png", b"\x89PNG"),
        ("p001_a.jpg", b"\xff\xd8"),
    ] {
        let bytes = [magic, file.as_bytes(), PICTURE].concat();
        std::fs::write(lab.path(&format!("{name}/{file}")), bytes).unwrap();
    }
}

/// The files of a folder by name.
fn files(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let mut files: Vec<_> = std::fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap())
        .map(|e| (e.file_name().into_string().unwrap(), std::fs::read(e.path()).unwrap()))
        .collect();
    files.sort();
    files
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect()
}

/// Fails unless two poses agree within the uncertainty that one of them states. They are not the
/// same: the format does not say what the wavelength reading and the calibrations are worth.
#[track_caller]
fn assert_close(one: &Value, other: &Value) {
    assert_eq!((&one["id"], &one["method"]), (&other["id"], &other["method"]));
    assert_eq!(one["status"], "solved", "{one}");
    assert_eq!(other["status"], "solved", "{other}");
    let (p, q) = (numbers(&one["position_mm"]), numbers(&other["position_mm"]));
    for axis in 0..3 {
        let u = one["covariance"][axis][axis].as_f64().unwrap().sqrt();
        assert!((p[axis] - q[axis]).abs() < u, "{one}\n{other}");
    }
}

#[test]
fn a_session_comes_back_from_its_folder_and_is_solved_as_before() {
    let lab = Lab::new();
    let run = lab.run(&plan(2, 100, 100), &[]);
    assert!(run.code <= 1, "{run:?}");
    let known = solutions(&lab.beampose(&["solve", "latest", "--json"]).expect_code(0));
    let out = lab.beampose(&["export", "latest", "out", "--json"]).expect_code(0).json();
    assert_eq!((&out["captures"], &out["pictures"]), (&4.into(), &12.into()));

    let copy = ["--db", "copy.db"];
    let import = ["import", "out", "--json"];
    let come = lab.beampose(&[&import[..], &copy].concat()).expect_code(0).json();
    let id = come["session"].as_str().unwrap();
    assert_eq!(come["pictures"], 12);
    let solve = ["solve", id, "--json"];
    let solved = || solutions(&lab.beampose(&[&solve[..], &copy].concat()).expect_code(0));
    let again = solved();
    assert_eq!(known.len(), again.len());
    known.iter().zip(&again).for_each(|(one, other)| assert_close(one, other));
    assert_eq!(again, solved(), "the same bits each time");

    let export = ["export", "latest", "again"];
    lab.beampose(&[&export[..], &copy].concat()).expect_code(0);
    assert_eq!(files(&lab.path("out")), files(&lab.path("again")));
    // There is no plan to judge by, and no simulation.
    let report = lab.beampose(&[&["report", "latest", "--json"], &copy[..]].concat());
    assert_eq!(report.expect_code(0).json()["verdict"], "inconclusive");
    let score = lab.beampose(&[&["score", "latest"], &copy[..]].concat()).expect_code(2);
    assert!(score.err.contains("it is not simulated"), "{}", score.err);
}

#[test]
fn what_another_program_wrote_is_kept_as_it_is() {
    let lab = Lab::new();
    folder(&lab, "in", SESSION);
    let come = lab.beampose(&["import", "in", "--json"]).expect_code(0).json();
    assert_eq!((&come["captures"], &come["pictures"]), (&2.into(), &3.into()));
    let shown = lab.beampose(&["sessions", "latest", "--json"]).expect_code(0).json();
    assert_eq!(shown["session"], come["session"]);
    assert_eq!(shown["title"], "rail test, cameras triggered by another program");
    assert_eq!(
        (&shown["experiment"], &shown["outcome"]),
        (&"acquisition".into(), &"completed".into())
    );
    assert_eq!(shown["steps"][0]["kind"], "import");
    let first = &shown["captures"][0];
    assert_eq!(first["setpoints"], serde_json::json!({ "rail_mm": 0.0, "pass": 1.0 }));
    assert_eq!(
        first["readings"],
        serde_json::json!({ "wavelength_nm": 658.02, "temperature_degc": 24.1 })
    );
    lab.beampose(&["export", "latest", "out"]).expect_code(0);
    insta::with_settings!({ omit_expression => true, prepend_module_to_snapshot => false }, {
        let text = std::fs::read_to_string(lab.path("out/session.yaml")).unwrap();
        insta::assert_snapshot!("exported_session", text);
    });
    let bytes = |name: &str| std::fs::read(lab.path(name)).unwrap();
    for (given, written) in [
        ("in/p000_a.jpg", "out/p000_cam_a.jpg"),
        ("in/p000_b.png", "out/p000_cam_b.png"),
        ("in/p001_a.jpg", "out/p001_cam_a.jpg"),
    ] {
        assert_eq!(bytes(given), bytes(written), "{written}");
    }
}

#[test]
fn calibrations_from_elsewhere_are_worth_what_was_published() {
    let lab = Lab::new();
    folder(&lab, "in", SESSION);
    lab.write("in/cam_a.yaml", &CAMERA.replace("90.0", "3529.4"));
    lab.beampose(&["import", "in"]).expect_code(0);
    let setup: Value = lab.with_store("beampose.db", async |store| {
        let id = store.find_session("latest").await.unwrap();
        let header = store.session(id).await.unwrap().header;
        serde_json::from_str(&header.measurement_json).unwrap()
    });
    assert_eq!(setup["wavelength_u_nm"], 0.1);
    for (camera, scale) in [("cam_a", 1.0), ("cam_b", 90.0 / 3529.4)] {
        let sigma = &setup["cameras"][camera]["sigma"];
        let near = |x: &Value, of: f64| (x.as_f64().unwrap() / (of * scale) - 1.0).abs() < 0.02;
        assert!(near(&sigma["focal_px"], 0.94), "{sigma}");
        assert!(near(&sigma["principal_point_px"][0], 0.82), "{sigma}");
        assert!(near(&sigma["principal_point_px"][1], 0.35), "{sigma}");
    }
}

#[test]
fn a_table_of_beams_comes_from_its_own_file_and_goes_out_inline() {
    let lab = Lab::new();
    folder(&lab, "in", &replaced(SESSION, "pattern.yaml", "fan/pattern.yaml"));
    let grid = "radial_grid: {pitch_mm: 52.22, k1_per_mm2: 3.5e-8, distance_mm: 1000}";
    lab.write("in/fan/pattern.yaml", &replaced(PATTERN, grid, "table: {file: beams.csv}"));
    let orders = || (-1..=1).flat_map(|n| (-1..=1).map(move |m| (m, n)));
    let lines: Vec<String> = orders()
        .map(|(m, n)| format!("{m},{n},{},{},3", f64::from(m) * 0.1, f64::from(n)))
        .collect();
    lab.write("in/fan/beams.csv", &format!("m,n,x,y,z\n{}\n", lines.join("\n")));
    lab.beampose(&["import", "in"]).expect_code(0);
    lab.beampose(&["export", "latest", "out"]).expect_code(0);
    lab.beampose(&["import", "out"]).expect_code(0);
    lab.beampose(&["export", "latest", "again"]).expect_code(0);
    assert_eq!(files(&lab.path("out")), files(&lab.path("again")));
    let written = std::fs::read_to_string(lab.path("out/pattern.yaml")).unwrap();
    let beams = orders().map(|(m, n)| [f64::from(m) * 0.1 / 3.0, f64::from(n) / 3.0]);
    for [x, y] in beams {
        assert!(written.contains(&format!("- [{x:e}, {y:e}]")), "{x} {y}:\n{written}");
    }
}

#[test]
fn a_picture_that_is_none_is_kept_with_a_warning() {
    let lab = Lab::new();
    folder(&lab, "in", SESSION);
    lab.write("in/p001_a.jpg", "raw");
    let come = lab.beampose(&["import", "in"]).expect_code(0);
    assert_eq!(come.err, "in/p001_a.jpg: warning: neither JPEG nor PNG; it cannot be solved\n");
    for line in solutions(&lab.beampose(&["solve", "latest", "--json"]).expect_code(0)) {
        assert_ne!(line["status"], "solved");
    }
    lab.beampose(&["export", "latest", "out"]).expect_code(0);
    assert_eq!(std::fs::read(lab.path("out/p001_cam_a.bin")).unwrap(), b"raw");
}

#[test]
fn export_replaces_nothing_unless_it_is_told_to() {
    let lab = Lab::new();
    folder(&lab, "in", SESSION);
    lab.beampose(&["import", "in"]).expect_code(0);
    let before = files(&lab.path("in"));
    let refused = lab.beampose(&["export", "latest", "in"]).expect_code(2);
    assert!(refused.err.starts_with("beampose: in is not empty\n"), "{}", refused.err);
    assert_eq!(files(&lab.path("in")), before);
    lab.beampose(&["export", "latest", "in", "--force"]).expect_code(0);
    assert!(files(&lab.path("in")).len() > before.len());
    lab.beampose(&["import", "in"]).expect_code(0);
    let file = lab.beampose(&["export", "latest", "in/session.yaml"]).expect_code(2);
    assert_eq!(file.err, "beampose: in/session.yaml is a file, not a folder\n");
    lab.beampose(&["export", "ffff", "out"]).expect_code(2);
    assert!(!lab.path("out").exists());
}

/// One broken folder: its change of `session.yaml`, what else is done to it, and what is said.
fn told(lab: &Lab, name: &str, from: &str, to: &str, more: impl FnOnce(&Path)) -> String {
    folder(lab, name, &replaced(SESSION, from, to));
    more(&lab.path(name));
    said(name, &lab.beampose(&["import", name]))
}

fn said(name: &str, ended: &Ended) -> String {
    assert!(ended.out.is_empty(), "{name}: {ended:?}");
    format!("$ beampose import {name}\n{}exit code {}\n", ended.err, ended.code)
}

#[test]
fn a_broken_folder_gets_all_its_faults_and_makes_no_session() {
    let lab = Lab::new();
    let remove =
        |file: &'static str| move |path: &Path| std::fs::remove_file(path.join(file)).unwrap();
    let nothing = |_: &Path| {};
    lab.write("secret.jpg", "secret");
    let cases = [
        said("missing", &lab.beampose(&["import", "missing"])),
        said("secret.jpg", &lab.beampose(&["import", "secret.jpg"])),
        told(&lab, "empty", "1", "1", remove("session.yaml")),
        told(&lab, "newer", "version: 1\n", "version: 2\nnew: 1\n", nothing),
        told(&lab, "unknown_key", "setpoints: {", "setpoint: {", nothing),
        told(&lab, "key_missing", "    images: {cam_a: p001_a.jpg}\n", "", nothing),
        told(&lab, "not_a_number", "658.02", "658,02 nm", nothing),
        told(&lab, "not_finite", "658.02", ".nan", nothing),
        told(&lab, "not_yaml", "pattern: ", "pattern: [", nothing),
        told(&lab, "not_there", "1", "1", |path| {
            for file in ["cam_a.yaml", "pattern.yaml", "p000_b.png", "p001_a.jpg"] {
                remove(file)(path);
            }
        }),
        told(&lab, "outside", "{cam_a: p001_a.jpg}", "{cam_a: ../secret.jpg}", nothing),
        told(&lab, "absolute", "{cam_a: p001_a.jpg}", "{cam_a: /secret.jpg}", nothing),
        told(&lab, "folder", "p001_a.jpg", "pictures", |path| {
            std::fs::create_dir(path.join("pictures")).unwrap();
        }),
        told(&lab, "large", "1", "1", |path| {
            let file = std::fs::File::create(path.join("p001_a.jpg")).unwrap();
            file.set_len(200_000_001).unwrap();
        }),
        told(&lab, "unknown_camera", "{cam_a: p001_a.jpg}", "{cam_c: p001_a.jpg}", nothing),
        told(&lab, "twice", "id: p001", "id: p000", nothing),
        told(&lab, "codes", "code: 51", "code: 90", nothing),
        told(&lab, "same_codes", "code: 51", "code: 45", nothing),
        told(
            &lab,
            "exact_target",
            "    - {code: 53, xyz_mm: [0, 400.125, 0], u_mm: 0.02",
            "    - {code: 53, xyz_mm: [0, 400.125, 0], u_mm: 0",
            nothing,
        ),
        told(&lab, "few_targets", "    - {code: 53", "    # {code: 53", nothing),
        told(&lab, "calibration", "1", "1", |path| {
            std::fs::write(path.join("cam_b.yaml"), CAMERA.replace("plumb_bob", "fisheye"))
                .unwrap();
        }),
        told(&lab, "table", "1", "1", |path| {
            let grid = "radial_grid: {pitch_mm: 52.22, k1_per_mm2: 3.5e-8, distance_mm: 1000}";
            let table = PATTERN.replace(grid, "table: {file: ../secret.csv}");
            std::fs::write(path.join("pattern.yaml"), table).unwrap();
        }),
    ];
    let all = cases.join("\n");
    insta::with_settings!({ omit_expression => true, prepend_module_to_snapshot => false }, {
        insta::assert_snapshot!("bad_folders", all);
    });
    assert!(!lab.path("beampose.db").exists(), "nothing is made of a broken folder");
}

#[cfg(unix)]
#[test]
fn a_link_is_followed_within_the_folder_and_not_out_of_it() {
    let lab = Lab::new();
    let link = |to: &str, at: &str| std::os::unix::fs::symlink(to, lab.path(at)).unwrap();
    folder(&lab, "in", &replaced(SESSION, "p001_a.jpg", "link.jpg"));
    link("p001_a.jpg", "in/link.jpg");
    lab.beampose(&["import", "in"]).expect_code(0);
    lab.write("secret.jpg", "secret");
    std::fs::remove_file(lab.path("in/link.jpg")).unwrap();
    link("../secret.jpg", "in/link.jpg");
    let refused = lab.beampose(&["import", "in"]).expect_code(2);
    let expected = "picture `link.jpg`: a link that leads outside the folder is refused";
    assert!(refused.err.contains(expected), "{}", refused.err);
}
