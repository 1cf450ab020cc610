//! Every instrument through its real driver, over TCP and pseudo terminals, before its simulator.

use std::io::{BufRead as _, BufReader};
use std::process::Stdio;

use serde_json::Value;

use crate::lab::{Lab, experiments, plan, replaced, signal};

/// A rig that the program comes with.
fn shipped(name: &str) -> String {
    std::fs::read_to_string(experiments().join(format!("rigs/{name}.yaml"))).unwrap()
}

/// The rig in a world in which nothing changes with time: drivers look now and then whether a stage
/// has arrived, so that a run over wires takes a little longer.
fn still(rig: &str) -> String {
    let text = replaced(&shipped(rig), "rise: 1.02 K", "rise: 0 K");
    replaced(&text, "drift_per_hour: 0.2 K", "drift_per_hour: 0 K")
}

fn report(lab: &Lab) -> Value {
    serde_json::from_str(&std::fs::read_to_string(lab.path("report/report.json")).unwrap()).unwrap()
}

#[test]
fn a_translation_over_wires_has_the_same_bits() {
    let run = |rig: &str| {
        let lab = Lab::new();
        lab.write("plan.yaml", &plan(2, 200, 100));
        lab.write_rig("wires", &still(rig));
        let run = ["run", "plan.yaml", "--rig", "rigs/wires.yaml", "--picture-scale", "0.5"];
        lab.beampose(&[&run[..], &["--quiet", "--out", "report"]].concat()).expect_code(0);
        let read = |name: &str| std::fs::read_to_string(lab.path("report").join(name)).unwrap();
        let pictures = lab.with_store("beampose.db", async |store| {
            let id = store.find_session("latest").await.unwrap();
            assert!(store.verify(id).await.unwrap().problems.is_empty());
            let captures = store.captures(id).await.unwrap().into_iter();
            captures.flat_map(|c| c.pictures).map(|p| p.blake3).collect::<Vec<_>>()
        });
        (pictures, read("poses.csv"), read("positions.csv"))
    };
    let (simulated, wired) = (run("simulated"), run("wire-sim"));
    assert_eq!(simulated.0.len(), 18);
    assert_eq!(simulated, wired);
}

#[test]
fn the_wavelength_drift_over_wires_is_the_same_within_its_uncertainty() {
    let found = |rig: &str| {
        let lab = Lab::new();
        let plan = experiments().join("plans/wavelength-drift.yaml").display().to_string();
        let rig = experiments().join(format!("rigs/{rig}.yaml")).display().to_string();
        lab.beampose(&["run", &plan, "--rig", &rig, "--quiet", "--out", "report"]).expect_code(0);
        report(&lab)
    };
    let (simulated, wired) = (found("simulated"), found("wire-sim"));
    for (part, number, u) in [
        ("steady_drift", "drift_nm_per_hour", "standard_uncertainty_nm_per_hour"),
        ("room", "drift_degc_per_hour", "drift_standard_uncertainty_degc_per_hour"),
        ("recommendation", "warm_up_s", "warm_up_standard_uncertainty_s"),
    ] {
        let of = |report: &Value, key: &str| report[part][key].as_f64().unwrap();
        let difference = of(&wired, number) - of(&simulated, number);
        assert!(difference.abs() < 2.0 * of(&simulated, u), "{part} {number}: {difference}");
    }
}

#[test]
fn the_angles_over_wires_are_the_same_within_their_uncertainty() {
    let found = |rig: &str| {
        let lab = Lab::new();
        let plan = experiments().join("plans/beam-angle-calibration.yaml").display().to_string();
        let rig = experiments().join(format!("rigs/{rig}.yaml")).display().to_string();
        lab.beampose(&["run", &plan, "--rig", &rig, "--quiet", "--out", "report"]).expect_code(0);
        let text = std::fs::read_to_string(lab.path("report/fan_angles.csv")).unwrap();
        let mut lines = text.lines().map(|line| line.split(',').collect::<Vec<_>>());
        let head = lines.next().unwrap();
        let column = |name: &str| head.iter().position(|it| *it == name).unwrap();
        let (angle, u) = (column("angle_deg"), column("u_deg"));
        lines.map(|line| [angle, u].map(|at| line[at].parse::<f64>().unwrap())).collect::<Vec<_>>()
    };
    let (simulated, wired) = (found("simulated-goniometer"), found("wire-sim-goniometer"));
    assert_eq!((simulated.len(), wired.len()), (420, 420));
    for ([of_calls, u], [of_bytes, u_too]) in simulated.into_iter().zip(wired) {
        // The beam's pointing wanders with time, and the two do not take the same time.
        assert!((of_calls - of_bytes).abs() < 3.0 * u.hypot(u_too), "{of_calls} {of_bytes}");
        assert!(u < 0.003 && u_too < 0.003, "{u} {u_too}");
    }
}

#[test]
fn a_rig_is_checked_read_and_driven_by_hand() {
    let lab = Lab::new();
    lab.write_rig("wires", &shipped("wire-sim"));
    let rig = "rigs/wires.yaml";
    let checked = lab.beampose(&["rig", "check", rig, "--json"]).expect_code(0).json_lines();
    assert_eq!(checked.len(), 9);
    for it in &checked {
        assert_eq!((&it["simulated"], &it["error"]), (&true.into(), &Value::Null), "{it}");
    }
    let rail = checked.iter().find(|it| it["instrument"] == "rail").unwrap();
    assert_eq!((&rail["driver"], &rail["reads"]), (&"zaber".into(), &"0 mm".into()));

    let jogged = lab.beampose(&["rig", "jog", rig, "rail", "--to", "123"]).expect_code(0);
    let place: f64 = jogged.out.split_whitespace().nth(1).unwrap().parse().unwrap();
    assert!((place - 123.0).abs() < 0.02, "{}", jogged.out);
    let refused = lab.beampose(&["rig", "jog", rig, "rail", "--to", "1234"]).expect_code(4);
    assert!(refused.err.contains("1234 mm is outside 0 to 1050 mm"), "{}", refused.err);
    let homed = lab.beampose(&["rig", "jog", rig, "turntable", "--home"]).expect_code(0);
    assert!(homed.out.contains("deg"), "{}", homed.out);

    let off = lab.beampose(&["rig", "laser", "off", rig]).expect_code(0);
    assert_eq!(off.out, "laser  off, read back\n");
    lab.beampose(&["rig", "capture", rig, "cam_b", "--out", "by-hand"]).expect_code(0);
    let picture = std::fs::read(lab.path("by-hand/cam_b.jpg")).unwrap();
    assert!(picture.starts_with(&[0xff, 0xd8]) && picture.ends_with(&[0xff, 0xd9]));

    let unknown = lab.beampose(&["rig", "read", rig, "ral"]).expect_code(2);
    assert!(unknown.err.contains("no instrument `ral`; it has cam_a"), "{}", unknown.err);
    let none = lab.beampose(&["rig", "probe", "--only", "tcp:127.0.0.1:1"]).expect_code(0);
    assert!(none.out.contains("# tcp:127.0.0.1:1 (no description): nobody answered"));
    let wrong = lab.beampose(&["rig", "probe", "ttyUSB0"]).expect_code(2);
    assert!(wrong.err.contains("/dev/ttyUSB0"), "{}", wrong.err);
}

#[test]
fn a_driver_says_where_in_the_rig_file_its_address_and_options_are_wrong() {
    let lab = Lab::new();
    let text = replaced(&shipped("wire-sim"), "steps_per_unit: 1000", "steps_per_unt: 1000");
    let text = replaced(
        &text,
        "address: simulator:tcp/ldc501\n      # The",
        "address: simulator:usb/ldc501\n      # The",
    );
    lab.write_rig("wires", &replaced(&text, "driver: bristol", "driver: bristle"));
    let ended = lab.beampose(&["rig", "check", "rigs/wires.yaml"]).expect_code(2);
    for part in ["no driver `bristle` for a `sensor`", "did you mean `bristol`?"] {
        assert!(ended.err.contains(part), "{}", ended.err);
    }
    lab.write_rig("wires", &text);
    let ended = lab.beampose(&["rig", "check", "rigs/wires.yaml"]).expect_code(2);
    for part in [
        "did you mean \"steps_per_unit\"?",
        "\"simulator:usb/ldc501\" is no address",
        "rigs/wires.yaml:",
    ] {
        assert!(ended.err.contains(part), "{}", ended.err);
    }
}

#[test]
fn simulators_answer_other_programs_in_real_time() {
    let lab = Lab::new();
    lab.write_rig("wires", &shipped("wire-sim"));
    let mut command = lab.command();
    command.args(["sim-instruments", "rigs/wires.yaml", "--json"]);
    let mut simulators = command.stdout(Stdio::piped()).spawn().unwrap();
    let lines = BufReader::new(simulators.stdout.take().unwrap()).lines().take(9);
    let all: Vec<Value> = lines.map(|line| serde_json::from_str(&line.unwrap()).unwrap()).collect();
    let address = |name: &str| {
        let it = all.iter().find(|it| it["instrument"] == name).unwrap();
        it["address"].as_str().unwrap().to_owned()
    };
    // Asked as instruments of which nothing is known.
    let probed = lab.beampose(&["rig", "probe", "--only", &address("rail")]).expect_code(0).out;
    assert!(probed.contains("driver: zaber") && probed.contains(&address("rail")), "{probed}");
    // A rig of real instruments, in real time, without a simulated world.
    let mut text = replaced(&shipped("wire-sim"), "clock: virtual", "clock: real");
    for name in ["rail", "thermometer", "turntable", "laser"] {
        let at = text.find(&format!("\n  {name}:\n")).unwrap();
        let (before, after) = text.split_at(at);
        let line = after.lines().find(|line| line.contains("address:")).unwrap().to_owned();
        let told = format!("      address: {}", address(name));
        text = format!("{before}{}", after.replacen(&line, &told, 1));
    }
    let start = text.find("\nsimulation:").unwrap();
    let instruments = text.find("  wavemeter:").unwrap()..text.find("  thermometer:").unwrap();
    text.truncate(start + 1);
    text.replace_range(instruments, "");
    let others = text.find("  diode_thermometer:").unwrap()..text.find("  cam_a:").unwrap();
    text.replace_range(others, "");
    for camera in ["cam_a", "cam_b", "cam_c"] {
        let at = text.find(&format!("\n  {camera}:\n")).unwrap();
        let (before, after) = text.split_at(at);
        text = format!("{before}{}", after.replacen("simulator:tcp", &address(camera), 1));
    }
    lab.write_rig("real", &text);
    let jog = ["rig", "jog", "rigs/real.yaml", "rail", "--to", "20"];
    lab.beampose(&jog).expect_code(0);
    let read = lab.beampose(&["rig", "read", "rigs/real.yaml", "rail"]).expect_code(0).out;
    assert!(read.starts_with("rail  2") || read.starts_with("rail  19.9"), "{read}");
    signal(&simulators, "TERM");
    assert!(simulators.wait().unwrap().success());
}

#[test]
fn the_examples_of_laboratories_are_sound() {
    let plan = experiments().join("plans/translation-test.yaml").display().to_string();
    for rig in ["laboratory-motors", "laboratory-hand-moved"] {
        let lab = Lab::new();
        let rig = experiments().join(format!("rigs/{rig}.yaml")).display().to_string();
        let checked = lab.beampose(&["check", &plan, "--rig", &rig, "--quiet"]).expect_code(0);
        assert!(checked.out.contains("180 pictures"), "{}", checked.out);
    }
}
