//! One short run, and everything that a program may read of it.

use std::sync::OnceLock;

use serde_json::Value;

use crate::lab::{Ended, Lab, SCALE, experiments, plan, turned_plan};

/// A session of two passes with three stops, run once for all tests here. They only read it, or
/// add processings with both methods.
fn session() -> &'static (Lab, Ended) {
    static SESSION: OnceLock<(Lab, Ended)> = OnceLock::new();
    SESSION.get_or_init(|| {
        let lab = Lab::new();
        let ended = lab.run(&plan(2, 200, 100), &[]);
        (lab, ended)
    })
}

/// The numbers at `keys` of an object.
#[track_caller]
fn numbers(object: &Value, keys: &[&str]) -> Vec<f64> {
    keys.iter()
        .map(|key| object[key].as_f64().unwrap_or_else(|| panic!("no number {key} in {object}")))
        .collect()
}

/// The newest processing has both methods that take capture by capture. Whether it is the run's,
/// with the session adjustment, or one that another test here added, is the order of the tests.
#[track_caller]
fn assert_solved_by_capture(methods: &serde_json::Map<String, Value>) {
    let by_capture = methods.keys().filter(|method| *method != "session-adjustment");
    assert_eq!(by_capture.collect::<Vec<_>>(), ["inter-beam-angles", "virtual-camera"]);
}

#[test]
fn a_run_solves_its_captures_and_writes_its_report() {
    let (lab, ended) = session();
    assert_eq!((ended.code, ended.err.as_str()), (0, ""), "{}", ended.out);
    let last = ended.json_lines().pop().unwrap();
    assert_eq!(last["session"].as_str().unwrap().len(), 36);
    assert_eq!((&last["outcome"], &last["verdict"]), (&"completed".into(), &"pass".into()));
    assert_eq!(last["captures"], 6);
    let read = |name: &str| std::fs::read_to_string(lab.path("report").join(name)).unwrap();
    let html = read("report.html");
    assert!(html.contains("pass") && html.contains(last["session"].as_str().unwrap()));
    let json: Value = serde_json::from_str(&read("report.json")).unwrap();
    assert_eq!((&json["solved"], &json["verdict"]), (&6.into(), &"pass".into()));
    // A header; then a line for each capture and method, for each stop and method.
    assert_eq!(read("poses.csv").lines().count(), 1 + 6 * 3);
    assert_eq!(read("positions.csv").lines().count(), 1 + 3 * 3);
}

#[test]
fn turned_captures_are_solved_and_stay_out_of_the_passes() {
    let lab = Lab::new();
    let last = lab.run(&turned_plan(), &[]).expect_code(0).json_lines().pop().unwrap();
    assert_eq!((&last["captures"], &last["verdict"]), (&11.into(), &"pass".into()));
    let report = std::fs::read_to_string(lab.path("report/report.json")).unwrap();
    let report: Value = serde_json::from_str(&report).unwrap();
    // All eleven are solved; the three of the pass are what the analysis is about.
    let listed = lab.beampose(&["sessions", "--json"]).expect_code(0).json();
    assert_eq!((&listed["captures"], &listed["solved"]), (&11.into(), &11.into()));
    assert_eq!((&report["captures"], &report["solved"]), (&3.into(), &3.into()));
    let of_session = &report["methods"]["session-adjustment"];
    assert_eq!(of_session["positions"].as_array().unwrap().len(), 3);
    assert_eq!(of_session["differences"].as_array().unwrap().len(), 3);
}

/// All beams of this rig's fan share an error of 0.02 % (1 sigma), nothing else has one of scale.
#[test]
fn turned_captures_tell_an_error_that_all_beams_share() {
    let lab = Lab::new();
    let rig = experiments().join("rigs/simulated-fan-scale.yaml");
    let rig = rig.to_str().unwrap();
    lab.write("plan.yaml", &turned_plan());
    let run = ["run", "plan.yaml", "--rig", rig, "--picture-scale", SCALE, "--out", "report"];
    lab.beampose(&run).expect_code(0);
    let report = std::fs::read_to_string(lab.path("report/report.json")).unwrap();
    let report: Value = serde_json::from_str(&report).unwrap();
    let furthest = |method: &str| {
        let stop = &report["methods"][method]["positions"][2];
        let of = |key: &str| stop[key].as_f64().unwrap();
        (of("mean_difference_mm"), of("expanded_uncertainty_mm"))
    };
    let (alone, u_alone) = furthest("virtual-camera");
    let (together, u_together) = furthest("session-adjustment");
    println!("{alone} ({u_alone}), {together} ({u_together})");
    assert!(alone.abs() < u_alone && together.abs() < u_together);
    assert!(u_together < 0.5 * u_alone);
}

#[test]
fn for_people_a_run_ends_with_a_table_and_where_the_report_is() {
    let lab = Lab::new();
    lab.write("plan.yaml", &plan(1, 100, 100));
    let rig = crate::lab::rig();
    let run = ["run", "plan.yaml", "--rig", &rig, "--picture-scale", "0.5", "--quiet"];
    let ended = lab.beampose(&run).expect_code(0);
    assert!(ended.out.starts_with("session  "), "{}", ended.out);
    assert!(ended.out.contains("verdict  pass") && ended.out.contains("2 of 2 captures solved"));
    let (_, report) = ended.out.trim_end().rsplit_once("report   ").unwrap();
    assert!(report.starts_with("reports/") && lab.path(report).is_file(), "{report}");
}

#[test]
fn the_list_of_sessions_has_the_run() {
    let (lab, ended) = session();
    let listed = lab.beampose(&["sessions", "--json"]).expect_code(0).json();
    assert_eq!(listed["session"], ended.json()["session"]);
    assert_eq!((&listed["captures"], &listed["solved"]), (&6.into(), &6.into()));
    assert_eq!(listed["steps"], listed["steps_stored"]);
    assert_eq!((&listed["outcome"], &listed["simulated"]), (&"completed".into(), &true.into()));
    let shown = lab.beampose(&["sessions"]).expect_code(0).out;
    assert!(shown.contains(listed["session"].as_str().unwrap()), "{shown}");
}

#[test]
fn a_session_shows_its_captures_and_its_journal() {
    let (lab, _) = session();
    let shown = lab.beampose(&["sessions", "latest", "--json"]).expect_code(0).json();
    let captures = shown["captures"].as_array().unwrap();
    assert_eq!(captures.len(), 6);
    assert_eq!(captures[4]["id"], "p004");
    assert_eq!(
        (&captures[4]["setpoints"]["pass"], &captures[4]["setpoints"]["rail_mm"]),
        (&2.0.into(), &100.0.into())
    );
    for capture in captures {
        numbers(&capture["readings"], &["rail_mm", "wavelength_nm", "temperature_degc"]);
        let pictures = capture["pictures"].as_array().unwrap();
        let cameras: Vec<&str> = pictures.iter().filter_map(|p| p["camera"].as_str()).collect();
        assert_eq!(cameras, ["cam_a", "cam_b", "cam_c"]);
    }
    let steps = shown["steps"].as_array().unwrap();
    assert!(steps.iter().all(|s| s["outcome"]["outcome"] == "done"));
    let events = shown["events"].as_array().unwrap();
    assert_eq!(events.last().unwrap()["kind"], "closed");
    let sound = lab.beampose(&["sessions", "latest", "--verify"]).expect_code(0).out;
    assert!(sound.starts_with("18 pictures") && sound.ends_with("all sound\n"), "{sound}");
}

#[test]
fn solve_prints_each_capture_and_method_as_designed() {
    let (lab, ended) = session();
    let solved = lab.beampose(&["solve", "latest", "--json"]).expect_code(0);
    let mut lines = solved.json_lines();
    assert_eq!(lines.pop().unwrap()["session"], ended.json()["session"]);
    assert_eq!(lines.len(), 12);
    for line in &lines {
        let method = line["method"].as_str().unwrap();
        assert!(["virtual-camera", "inter-beam-angles"].contains(&method));
        assert!(line["id"].as_str().unwrap().starts_with('p'));
        assert_eq!(line["status"], "solved");
        let length = |value: &Value| value.as_array().unwrap().len();
        assert_eq!(length(&line["position_mm"]), 3);
        assert_eq!(length(&line["quaternion_wxyz"]), 4);
        assert_eq!(length(&line["rotation_omega_phi_kappa_deg"]), 3);
        assert_eq!(length(&line["covariance"]), 6);
        assert!(line["covariance"].as_array().unwrap().iter().all(|row| length(row) == 6));
        assert!(line["beams_used"].as_u64().unwrap() > 60);
        numbers(line, &["sigma0", "wavelength_nm"]);
        numbers(&line["seconds"], &["decode", "detect", "identify", "adjust"]);
    }
}

#[test]
fn the_report_holds_its_contract() {
    let (lab, _) = session();
    let report = lab.beampose(&["report", "latest", "--json"]).expect_code(0).json();
    assert_eq!(
        (&report["experiment"], &report["verdict"]),
        (&"translation".into(), &"pass".into())
    );
    assert_eq!((&report["captures"], &report["solved"]), (&6.into(), &6.into()));
    let methods = report["methods"].as_object().unwrap();
    assert_solved_by_capture(methods);
    for method in methods.values() {
        numbers(method, &["max_abs_difference_mm", "slope", "offset_mm"]);
        let positions = method["positions"].as_array().unwrap();
        let rail: Vec<f64> = positions.iter().flat_map(|p| numbers(p, &["rail_mm"])).collect();
        assert_eq!(rail, [0.0, 100.0, 200.0]);
        for position in positions {
            let keys = ["mean_difference_mm", "standard_uncertainty_mm", "expanded_uncertainty_mm"];
            let [difference, u, expanded] = numbers(position, &keys)[..] else { panic!() };
            assert!((expanded - 2.0 * u).abs() < 1e-12);
            // The first stop is where distances begin.
            assert!(position["rail_mm"] == 0.0 && difference == 0.0 || u > 0.0, "{position}");
        }
    }
}

#[test]
fn the_score_holds_its_contract() {
    let (lab, ended) = session();
    let score = lab.beampose(&["score", "latest", "--json"]).expect_code(0).json();
    assert_eq!(score["session"], ended.json()["session"]);
    let methods = score["methods"].as_object().unwrap();
    assert_solved_by_capture(methods);
    for method in methods.values() {
        let keys = ["rms_position_error_mm", "rms_rotation_error_deg", "nees_position_mean"];
        assert!(numbers(method, &keys).iter().all(|number| *number > 0.0), "{method}");
        let coverage = numbers(method, &["coverage_95"])[0];
        assert!((0.0..=1.0).contains(&coverage));
    }
}

#[test]
fn a_plan_that_ran_before_takes_what_check_says() {
    let lab = Lab::new();
    let text = plan(1, 200, 100);
    lab.run(&text, &[]).expect_code(0);
    let rig = crate::lab::rig();
    let check =
        |plan: &str| lab.beampose(&["check", plan, "--rig", &rig, "--json"]).expect_code(0).json();
    let number = |value: &serde_json::Value| value.as_f64().unwrap();
    let estimate = check("plan.yaml");
    assert_eq!(estimate["estimated_from_sessions"], 1);
    lab.run(&text, &[]).expect_code(0);
    let took = lab.with_store("beampose.db", async |store| {
        let id = store.find_session("latest").await.unwrap();
        let session = store.session(id).await.unwrap();
        let closed = session.closed.unwrap().monotonic;
        (closed - session.header.opened.monotonic).as_secs_f64()
    });
    let estimated = number(&estimate["estimated_s"]);
    assert!((estimated / took - 1.0).abs() < 0.05, "{estimated} s estimated, {took} s taken");
    let range = &estimate["estimated_range_s"];
    assert!(number(&range[0]) <= took && took <= number(&range[1]), "{range} {took}");
    // Pictures as large as those that were taken: at this scale, far below what the rig says.
    let bytes = lab.with_store("beampose.db", async |store| {
        let id = store.find_session("latest").await.unwrap();
        let captures = store.captures(id).await.unwrap();
        captures.iter().flat_map(|c| &c.pictures).map(|p| p.size_bytes as f64).sum::<f64>()
    });
    let estimated = number(&estimate["estimated_bytes"]);
    assert!((estimated / bytes - 1.0).abs() < 0.05, "{estimated} bytes estimated, {bytes} taken");
    // Another plan on the same rig: its captures are as those were, its waits as it says.
    lab.write("other.yaml", &plan(2, 300, 100));
    let other = check("other.yaml");
    assert_eq!(other["estimated_from_sessions"], 2);
    assert!(number(&other["estimated_s"]) > number(&estimate["estimated_s"]));
    // The report holds the estimate against what it took.
    let page = std::fs::read_to_string(lab.path("report/report.html")).unwrap();
    assert!(page.contains("estimated at its beginning"));
}
