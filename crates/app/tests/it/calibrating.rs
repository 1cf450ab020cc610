//! `calibrate` and `targets`: pictures and points in, calibrations, pages and sheets out.

use beampose_photogrammetry::calibrate::read_sheet;
use beampose_photogrammetry::camera::read_camera_info;
use beampose_photogrammetry::{Camera, GrayImage};
use serde_json::Value;

use crate::draw::{Lens, twelve_stations};
use crate::lab::{Lab, replaced};

const CORNERS: &str = include_str!("../../../photogrammetry/tests/data/opencv-chess-corners.csv");

const SHEET: &str = "version: 1\nrows: 8\ncolumns: 9\npitch_mm: 25\ndot_diameter_mm: 12\n";

const CAMERA: Camera = Camera {
    width: 320,
    height: 240,
    fx: 300.0,
    fy: 301.0,
    cx: 161.0,
    cy: 118.0,
    k1: -0.1,
    k2: 0.0,
    p1: 0.0,
    p2: 0.0,
    k3: 0.0,
};

fn png(image: &GrayImage) -> Vec<u8> {
    let mut bytes = Vec::new();
    let size = |n: usize| u32::try_from(n).unwrap();
    let mut encoder = png::Encoder::new(&mut bytes, size(image.width), size(image.height));
    encoder.set_color(png::ColorType::Grayscale);
    let mut writer = encoder.write_header().unwrap();
    writer.write_image_data(&image.data).unwrap();
    writer.finish().unwrap();
    bytes
}

/// A folder with four pictures of the sheet, one of nothing, and one that is no picture.
fn photograph(lab: &Lab, folder: &str) {
    lab.write(&format!("{folder}/sheet.yaml"), SHEET);
    let (sheet, lens) = (read_sheet(SHEET).unwrap(), Lens::new(CAMERA));
    let put = |name: &str, bytes: &[u8]| {
        std::fs::write(lab.path(&format!("{folder}/{name}")), bytes).unwrap();
    };
    for (i, station) in twelve_stations(&sheet, 330.0).iter().enumerate().step_by(3) {
        let picture = lens.photograph(&sheet, &[], station, 1.5, i as u64);
        put(&format!("p{i:02}.png"), &png(&picture));
    }
    let (width, height) = (CAMERA.width, CAMERA.height);
    put("q_dark.png", &png(&GrayImage { width, height, data: vec![20; width * height] }));
    put("r_text.jpg", b"not a picture");
}

fn parameter<'a>(json: &'a Value, name: &str) -> &'a Value {
    let all = json["parameters"].as_array().unwrap();
    all.iter().find(|p| p["name"] == name).unwrap()
}

#[test]
fn a_file_of_points_gives_opencvs_camera_and_its_files() {
    let lab = Lab::new();
    lab.write("left.csv", CORNERS);
    let typed = ["calibrate", "camera", "left.csv", "--size", "640x480", "--out", "out", "--json"];
    let json = lab.beampose(&typed).expect_code(0).json();
    // As OpenCV 5 prints them, to all digits that are printed.
    assert!((json["rms_px"].as_f64().unwrap() - 0.408_694_8).abs() < 1e-7);
    for (name, value, sigma) in
        [("fx", 536.0735, 0.928), ("cy", 235.5369, 1.0706), ("k3", 0.252_312, 0.197_52)]
    {
        let found = parameter(&json, name);
        let (here, stated) =
            (found["value"].as_f64().unwrap(), found["standard_deviation"].as_f64().unwrap());
        assert!((here - value).abs() < 1e-4 && (stated / sigma - 1.0).abs() < 1e-4, "{found}");
    }
    assert_eq!(
        (json["pictures"].as_array().unwrap().len(), &json["points"]),
        (13, &Value::from(702))
    );
    let text = std::fs::read_to_string(lab.path("out/left.yaml")).unwrap();
    assert_eq!(read_camera_info(&text).unwrap().fx, json["camera"]["fx"].as_f64().unwrap());
    let page = std::fs::read_to_string(lab.path("out/left.html")).unwrap();
    for part in ["Correlations", "Coverage", "Residuals in the picture", "left13.jpg", "0.409"] {
        assert!(page.contains(part), "{part}");
    }
    for never in ["NaN", "<script", "http://", "src="] {
        assert!(!page.contains(never), "{never}");
    }
}

#[test]
fn a_folder_of_pictures_gives_its_camera_and_says_what_it_left_out() {
    let lab = Lab::new();
    photograph(&lab, "morning");
    let typed = ["calibrate", "camera", "morning", "--estimate", "fx,fy,cx,cy,k1", "--json"];
    let ended = lab.beampose(&typed).expect_code(0);
    let json = ended.json();
    let left_out = json["left_out"].as_array().unwrap();
    let names: Vec<&str> = left_out.iter().map(|l| l["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["q_dark.png", "r_text.jpg"]);
    assert!(ended.err.contains("r_text.jpg is left out: not a JPEG or PNG file"), "{}", ended.err);
    for (name, truth) in [("fx", 300.0), ("fy", 301.0), ("cx", 161.0), ("cy", 118.0), ("k1", -0.1)]
    {
        let found = parameter(&json, name);
        let off = found["value"].as_f64().unwrap() - truth;
        // Four sigma: one of fifteen thousand would be farther off.
        assert!(off.abs() < 4.0 * found["standard_deviation"].as_f64().unwrap(), "{found}");
    }
    assert_eq!(json["inputs"].as_array().unwrap().len(), 7);
    let file = std::fs::read(lab.path("calibrations/morning.yaml")).unwrap();
    let recorded = lab.beampose(&["calibrations", "show", "latest", "--json"]).expect_code(0);
    let recorded = recorded.json();
    assert_eq!(recorded["blake3"], blake3::hash(&file).to_hex().to_string());
    assert_eq!((&recorded["kind"], &recorded["name"]), (&"camera".into(), &"morning".into()));
    assert_eq!(recorded["parameters"][0]["u"], json["parameters"][0]["standard_deviation"]);
    assert_eq!(recorded["made_from"].as_array().unwrap().len(), 7);
}

#[test]
fn several_calibrations_are_compared_and_so_are_their_files() {
    let lab = Lab::new();
    lab.write("one.csv", CORNERS);
    lab.write("two.csv", CORNERS);
    // The camera's picture moved by 20 pixels: as if the lens were shifted.
    let mut moved = String::new();
    for (i, line) in CORNERS.lines().enumerate() {
        let (rest, y) = line.rsplit_once(',').unwrap();
        let y = if i == 0 { y.to_owned() } else { (y.parse::<f64>().unwrap() + 20.0).to_string() };
        moved.push_str(&format!("{rest},{y}\n"));
    }
    lab.write("three.csv", &moved);
    let typed =
        ["calibrate", "camera", "one.csv", "two.csv", "three.csv", "--size", "640x500", "--json"];
    let lines = lab.beampose(&typed).expect_code(0).json_lines();
    assert_eq!(lines.len(), 4);
    let stability = &lines[3];
    let cy = parameter(stability, "cy");
    let significant: Vec<bool> =
        cy["changes"].as_array().unwrap().iter().map(|c| c["is_significant"] == true).collect();
    assert_eq!(significant, [false, true], "{cy}");
    assert!((cy["changes"][1]["difference"].as_f64().unwrap() - 20.0).abs() < 1e-3, "{cy}");
    assert!(parameter(stability, "fx")["is_unstable"] == false);
    assert!(lab.path("calibrations/stability.html").exists());

    let files = ["one", "two", "three"].map(|n| format!("calibrations/{n}.yaml"));
    let typed = ["calibrate", "compare", &files[0], &files[1], &files[2]];
    let again = lab.beampose(&[&typed[..], &["--json"]].concat()).expect_code(0).json();
    assert_eq!(again["calibrations"], stability["calibrations"]);
    let probability = |json: &Value| parameter(json, "cy")["changes"][1]["probability"].as_f64();
    assert_eq!(probability(&again), probability(stability));
    let told = lab.beampose(&typed).expect_code(0).out;
    assert!(told.contains("changes from one calibration to the next"), "{told}");
}

/// Ten horizontal and ten vertical angles of the dissertation's fan, three times each, to the digits
/// of a stage, read at a wavelength that drifts.
fn measured_angles() -> String {
    use beampose_photogrammetry::Order;
    use beampose_photogrammetry::calibrate::pattern::{FanModel, StageAxis, StageGeometry};
    let direction = |order, nm: f64| {
        FanModel::RadialGrid.direction(&[0.05222, 0.035], order, nm / 658.0 - 1.0).unwrap()
    };
    let stage = StageGeometry::aligned(5000.0);
    let mut text =
        "from_m,from_n,to_m,to_n,axis,repeat,angle_deg,wavelength_nm # stage\n".to_owned();
    for (axis, dm) in [(StageAxis::Horizontal, 1), (StageAxis::Vertical, 0)] {
        for k in -5..5 {
            let (from, to) = (
                Order { m: k * dm, n: k * (1 - dm) },
                Order { m: (k + 1) * dm, n: (k + 1) * (1 - dm) },
            );
            for repeat in 1..=3 {
                let nm = 658.0 + 0.01 * f64::from(k + repeat);
                let turn = stage.turn(&direction(from, nm), &direction(to, nm), axis).unwrap();
                let angle = turn.to_degrees() + 0.001 * f64::from(repeat - 2);
                text.push_str(&format!(
                    "{},{},{},{},{},{repeat},{angle:.6},{nm:.3}\n",
                    from.m,
                    from.n,
                    to.m,
                    to.n,
                    axis.name()
                ));
            }
        }
    }
    text
}

#[test]
fn measured_angles_give_a_pattern_that_reads_back_and_its_files() {
    let lab = Lab::new();
    lab.write("stage.csv", &measured_angles());
    let typed = ["calibrate", "pattern", "stage.csv", "--out", "out", "--json"];
    let json = lab.beampose(&typed).expect_code(0).json();
    assert_eq!((&json["model"], &json["measurements"]), (&"radial-grid".into(), &60.into()));
    let fit = &json["fit"];
    for (name, value) in [("pitch_mm", 52.22), ("k1_per_mm2", 3.5e-8)] {
        let found = parameter(fit, name);
        let off = found["value"].as_f64().unwrap() - value;
        // The angles are exact but for their sixth decimal.
        assert!(off.abs() < 0.01 * found["u"].as_f64().unwrap(), "{found}");
    }
    assert!((json["standard_deviation_of_one_deg"].as_f64().unwrap() - 0.001).abs() < 1e-5);
    assert_eq!(json["angles"].as_array().unwrap().len(), 420);
    let text = std::fs::read_to_string(lab.path("out/stage.yaml")).unwrap();
    let pattern = beampose_photogrammetry::pattern::read_pattern(&text).unwrap();
    assert_eq!(pattern.u.common_relative, json["u"]["common_relative"].as_f64().unwrap());
    // It is recorded, with the file that it was made from.
    let recorded = lab.beampose(&["calibrations", "--json"]).expect_code(0).json();
    assert_eq!(recorded["blake3"], blake3::hash(text.as_bytes()).to_hex().to_string());
    assert_eq!((&recorded["name"], &recorded["kind"]), (&"stage".into(), &"pattern".into()));
    let csv = blake3::hash(measured_angles().as_bytes()).to_hex().to_string();
    let from = serde_json::json!([{ "kind": "file", "name": "stage.csv", "blake3": csv }]);
    assert_eq!(recorded["made_from"], from);
    let angles = std::fs::read_to_string(lab.path("out/stage_angles.csv")).unwrap();
    assert_eq!(angles.lines().count(), 421);
    let page = std::fs::read_to_string(lab.path("out/stage.html")).unwrap();
    for part in ["Angles against order", "Residuals of each model", "Budget of one angle", "52.220"]
    {
        assert!(page.contains(part), "{part}");
    }
    for never in ["NaN", "<script", "http://", "src="] {
        assert!(!page.contains(never), "{never}");
    }
    let again = [&typed[..], &["--model", "grating", "--name", "by_periods"]].concat();
    lab.beampose(&again).expect_code(0);
    let text = std::fs::read_to_string(lab.path("out/by_periods.yaml")).unwrap();
    let table = beampose_photogrammetry::pattern::read_pattern(&text).unwrap();
    assert!(matches!(table.model, beampose_photogrammetry::PatternModel::Table { .. }));
}

#[test]
fn a_sheet_of_targets_goes_to_a_file_or_to_standard_output() {
    let lab = Lab::new();
    let printed = lab.beampose(&["targets", "--codes", "45,75", "--radius-mm", "8"]).expect_code(0);
    assert!(printed.out.contains(">45</text>") && printed.out.contains(">75</text>"));
    let typed =
        ["targets", "--page", "a3", "--landscape", "--style", "light-on-dark", "--out", "t.svg"];
    assert_eq!(lab.beampose(&typed).expect_code(0).out, "t.svg\n");
    let text = std::fs::read_to_string(lab.path("t.svg")).unwrap();
    assert!(text.contains("width=\"420mm\" height=\"297mm\""));
    lab.write("sheet.yaml", SHEET);
    let sheet = lab.beampose(&["calibrate", "sheet", "sheet.yaml"]).expect_code(0).out;
    assert_eq!(sheet.matches("<circle").count(), 72);
}

#[test]
fn what_cannot_be_calibrated_or_printed_is_told_in_one_message() {
    let lab = Lab::new();
    lab.write("left.csv", CORNERS);
    lab.write("cut.csv", &replaced(CORNERS, "left13.jpg,53,8,5,", "left13.jpg,53,8,"));
    lab.write("empty/sheet.yaml", SHEET);
    lab.write("bare/picture.txt", "");
    lab.write("wrong/sheet.yaml", &replaced(SHEET, "rows: 8", "rows: 1"));
    lab.write("stage.csv", &replaced(&measured_angles(), "0,0,1,0,horizontal,2,", "0,0,1,0,up,2,"));
    lab.write("outside.csv", &measured_angles());
    let cases: [(&str, &str); 21] = [
        ("calibrate camera nowhere", "nowhere: no such file"),
        ("calibrate camera bare", "bare/sheet.yaml: no such file"),
        ("calibrate camera empty", "empty: there is no JPEG or PNG picture in it"),
        ("calibrate camera wrong", "wrong/sheet.yaml: rows is 1, expected 3 to 200"),
        ("calibrate camera left.csv", "help: --size 640x480"),
        ("calibrate camera left.csv --size 640x300", "is outside of 640 x 300 pixels"),
        ("calibrate camera cut.csv --size 640x480", "cut.csv:649: expected 6 values, found 5"),
        ("calibrate camera left.csv left.csv --size 640x480", "two sources are called left"),
        ("calibrate camera left.csv --estimate fx,k4", "`k4` is no parameter"),
        ("calibrate camera left.csv --size 640x480 --name ../x", "`../x` is no name for files"),
        ("calibrate compare left.csv left.csv", "left.csv: "),
        ("calibrate pattern", "the following required arguments were not provided"),
        ("calibrate pattern none.csv", "none.csv: no such file"),
        (
            "calibrate pattern stage.csv",
            "stage.csv:18: column `axis`: expected horizontal or vertical",
        ),
        ("calibrate pattern outside.csv --size 9x9", "outside.csv: the fan has no beam (-5, 0)"),
        ("calibrate pattern outside.csv --u-offset-mm 1", "expected 2 numbers with commas between"),
        ("targets --codes 44", "code 44 is code 11 turned: write 11"),
        ("targets --codes 1", "can be mistaken for something else; the nearest that serves is 5"),
        ("targets --codes 5000", "code 5000 is out of range: codes are below 4096"),
        ("targets --codes 45-99 --radius-mm 12", "targets do not fit"),
        ("targets --codes 1-4", "no code of 1-4 serves"),
    ];
    for (typed, expected) in cases {
        let arguments: Vec<&str> = typed.split_whitespace().collect();
        let ended = lab.beampose(&arguments).expect_code(2);
        assert!(ended.err.contains(expected), "{typed}: {}", ended.err);
        assert_eq!(ended.out, "", "{typed}");
    }
    assert!(!lab.path("calibrations").exists(), "nothing is written of a broken input");
    assert!(!lab.path("beampose.db").exists(), "nor recorded");
}
