//! Solving stored sessions again: the same bits, other inputs, many at once, interrupted anywhere.

use std::collections::BTreeMap;
use std::process::Stdio;
use std::time::{Duration, Instant};

use beampose_store::{PoseRow, Processing, SolutionRow};
use serde_json::Value;

use crate::instants::UnderWay;
use crate::lab::{Ended, Lab, plan, replaced, rig, solutions};

/// A folder with so many sessions of four captures, each in another world.
fn lab_with(sessions: u32) -> Lab {
    let lab = Lab::new();
    for seed in 1..=sessions {
        lab.run(&plan(1, 300, 100), &["--seed", &seed.to_string()]).expect_code(0);
    }
    lab
}

/// What a processing holds, without the time it took.
fn rows(lab: &Lab, session: &str, processing: usize) -> (Vec<SolutionRow>, Vec<String>) {
    lab.with_store("beampose.db", async |store| {
        let id = store.find_session(session).await.unwrap();
        let processing = &store.processings(id).await.unwrap()[processing];
        let mut all = Vec::new();
        for capture in store.captures(id).await.unwrap() {
            let mut row = store.solution(processing.id, &capture.id).await.unwrap();
            row.seconds_json.clear();
            all.push(row);
        }
        let results = store.results(processing.id).await.unwrap();
        (all, results.into_iter().map(|result| result.result_json).collect())
    })
}

/// All processings of all sessions, with their poses.
type All = BTreeMap<String, Vec<(Processing, Vec<PoseRow>)>>;

fn processings(lab: &Lab) -> All {
    lab.with_store("beampose.db", async |store| {
        let mut all = All::new();
        for session in store.sessions().await.unwrap() {
            let mut of_session = Vec::new();
            for processing in store.processings(session.id).await.unwrap() {
                let poses = store.poses(processing.id).await.unwrap();
                of_session.push((processing, poses));
            }
            all.insert(session.id.to_string(), of_session);
        }
        all
    })
}

#[test]
fn unchanged_options_give_the_bits_of_the_run_itself() {
    let lab = lab_with(1);
    let methods = ["--method", "inter-beam-angles", "--method", "virtual-camera"];
    let more = ["--method", "session-adjustment", "--json"];
    lab.beampose(&[&["solve", "latest"], &methods[..], &more].concat()).expect_code(0);
    // The run's: capture by capture, then together. Then the same again.
    let live = [rows(&lab, "latest", 0), rows(&lab, "latest", 1)];
    let again = [rows(&lab, "latest", 2), rows(&lab, "latest", 3)];
    for (live, again) in live.iter().zip(&again) {
        assert_eq!(live.0.len(), 4);
        // Poses, covariances, observations with residuals, dots in space, notes.
        assert_eq!(live.0, again.0);
    }
    assert_eq!((live[1].1.len(), &live[1].1), (1, &again[1].1), "the analysis too");
    let shown = lab.beampose(&["sessions", "show", "latest", "--json"]).expect_code(0).json();
    let options: Vec<&Value> =
        shown["processings"].as_array().unwrap().iter().map(|p| &p["options"]["methods"]).collect();
    let alone = serde_json::json!(["inter-beam-angles", "virtual-camera"]);
    let together = serde_json::json!(["inter-beam-angles", "virtual-camera", "session-adjustment"]);
    assert_eq!(options, [&alone, &together, &alone, &together], "each says what it did itself");
}

#[test]
fn every_method_that_is_named_is_solved_beside_the_adjustment() {
    let lab = lab_with(1);
    let named =
        ["solve", "latest", "--json", "--method", "ray-fit", "--method", "session-adjustment"];
    let poses = solutions(&lab.beampose(&named).expect_code(0));
    let methods: Vec<&str> = poses.iter().map(|p| p["method"].as_str().unwrap()).collect();
    assert_eq!(methods, ["ray-fit", "session-adjustment"].repeat(4));
    assert!(poses.iter().all(|pose| pose["status"] == "solved"));
}

#[test]
fn another_calibration_makes_other_poses_and_its_report_knows_it() {
    let lab = lab_with(1);
    lab.beampose(&["export", "latest", "folder"]).expect_code(0);
    let files = std::fs::read_dir(lab.path("folder")).unwrap().map(|entry| entry.unwrap().path());
    let is_calibration = |path: &std::path::PathBuf| {
        let name = path.file_name().unwrap().to_str().unwrap();
        name.contains("cam_a") && name.ends_with(".yaml")
    };
    let cam_a = { files }.find(is_calibration).unwrap();
    let own = format!("cam_a={}", cam_a.display());
    let text = std::fs::read_to_string(&cam_a).unwrap();
    let focal = text.split_once("data: [").unwrap().1.split(',').next().unwrap();
    let longer = focal.trim().parse::<f64>().unwrap() * 1.001;
    lab.write("longer.yaml", &text.replace(focal, &longer.to_string()));

    let before = solutions(&lab.beampose(&["solve", "latest", "--json"]).expect_code(0));
    let solve = |more: &[&str]| lab.beampose(&[&["solve", "latest", "--json"], more].concat());
    let other = solve(&["--with-calibration", "cam_a=longer.yaml"]).expect_code(0);
    let other = solutions(&other);
    assert_eq!(before.len(), other.len());
    for (a, b) in before.iter().zip(&other) {
        assert_ne!(a["position_mm"], b["position_mm"]);
    }
    let report = lab.beampose(&["report", "latest", "--json"]).json();
    assert_eq!(report["processing"], "4");
    // What is told again as it was is no change.
    let same = solutions(&solve(&["--with-calibration", &own]).expect_code(0));
    assert_eq!(same, before);
    let all = processings(&lab);
    let told: Vec<bool> = all.values().next().unwrap()[2..]
        .iter()
        .map(|(p, _)| p.start.measurement_json.is_some())
        .collect();
    assert_eq!(told, [false, true, false]);
    assert_eq!(lab.beampose(&["sessions", "verify"]).code, 0, "each hash is of its own inputs");

    let compared = lab.beampose(&["sessions", "compare", "latest@3", "@4", "--json"]).json();
    assert_eq!(compared["settings_that_differ"], serde_json::json!(["processing", "calibrations"]));
    let poses = &compared["poses"]["virtual-camera"];
    assert_eq!((&poses["compared"], &poses["identical"]), (&4.into(), &0.into()));
    let stop = |of: &Value| of["positions"][3]["mean_difference_mm"].clone();
    let compared_stop = &compared["positions"]["virtual-camera"][3];
    assert_eq!(compared_stop["b_mm"], stop(&report["methods"]["virtual-camera"]));
    assert_ne!(compared_stop["a_mm"], compared_stop["b_mm"]);
    let compared = lab.beampose(&["sessions", "compare", "latest@3", "@5", "--json"]).json();
    assert_eq!(compared["settings_that_differ"], serde_json::json!(["processing"]));
    assert_eq!(compared["poses"]["virtual-camera"]["identical"], 4);
    assert_eq!(compared["positions"]["virtual-camera"].as_array().unwrap().len(), 4);
    assert_eq!(compared["positions"]["virtual-camera"][3]["difference_mm"], 0.0);
}

#[test]
fn other_inputs_that_cannot_be_used_are_named_and_nothing_is_begun() {
    let lab = lab_with(1);
    lab.write("text.yaml", "image_width: many\n");
    for (more, said) in [
        (&["--with-calibration", "cam_a"][..], "expected CAMERA=FILE"),
        (&["--with-calibration", "cam_a=none.yaml"], "none.yaml"),
        (&["--with-calibration", "cam_a=text.yaml"], "text.yaml"),
        (&["--with-pattern", "text.yaml"], "text.yaml"),
        (&["--with-rig", "text.yaml"], "text.yaml"),
        (&["--with-wavelength-u", "0"], "expected nanometres"),
        (&["--tag", "warm"], "they need --all"),
    ] {
        let ended = lab.beampose(&[&["solve", "latest"], more].concat()).expect_code(2);
        assert!(ended.err.contains(said), "{}", ended.err);
    }
    assert_eq!(processings(&lab).values().next().unwrap().len(), 2, "the run's own");
}

#[test]
fn many_sessions_are_solved_by_one_command() {
    let lab = lab_with(3);
    lab.beampose(&["sessions", "tag", "latest", "warm"]).expect_code(0);
    let lines = lab.beampose(&["solve", "--all", "--json"]).expect_code(0).json_lines();
    let sessions: Vec<&Value> = lines.iter().map(|line| &line["session"]).collect();
    let listed = lab.beampose(&["sessions", "--json"]).json_lines();
    let ids: Vec<&Value> = listed.iter().map(|line| &line["session"]).collect();
    let told: Vec<&Value> = sessions.into_iter().filter(|session| !session.is_null()).collect();
    assert_eq!(told, ids, "in their order");
    assert_eq!(lines.len(), 3 * (8 + 1));
    for of_session in processings(&lab).values() {
        let [(_, live), _, (_, again)] = of_session.as_slice() else { panic!("{of_session:?}") };
        assert_eq!(live, again);
    }
    let two = [ids[2].as_str().unwrap(), ids[0].as_str().unwrap(), "latest"];
    let solved = lab.beampose(&["solve", two[0], two[1], two[2]]).expect_code(0);
    let expected = format!(
        "session {}: 8 of 8 poses solved\nsession {}: 8 of 8 poses solved\n",
        two[0], two[1]
    );
    assert_eq!(solved.out, expected, "each once");
    let warm = lab.beampose(&["solve", "--all", "--tag", "warm"]).expect_code(0);
    assert_eq!(warm.out, format!("session {}: 8 of 8 poses solved\n", two[0]));
    let counts: Vec<usize> = processings(&lab).values().map(Vec::len).collect();
    assert_eq!(counts, [4, 3, 5]);
}

const ALL: [&str; 4] = ["solve", "--all", "--method", "session-adjustment"];

/// Begins to solve all, and does something to it after a while; how it ended.
#[cfg(unix)]
fn interrupted(lab: &Lab, after: Duration, signal: &str) -> std::process::Output {
    let mut command = lab.command();
    command.args(ALL).stdout(Stdio::piped()).stderr(Stdio::piped());
    let program = command.spawn().unwrap();
    std::thread::sleep(after);
    let kill = format!("kill -{signal} {} 2>/dev/null", program.id());
    let _over_already = std::process::Command::new("sh").args(["-c", &kill]).status().unwrap();
    program.wait_with_output().unwrap()
}

/// Poses of the processings that are new since the runs, by session.
fn new_poses(all: &All) -> BTreeMap<String, Vec<Vec<PoseRow>>> {
    all.iter()
        .map(|(id, of_session)| {
            assert!(of_session.iter().all(|(p, _)| p.finished.is_some()), "{of_session:?}");
            (id.clone(), of_session[2..].iter().map(|(_, poses)| poses.clone()).collect())
        })
        .collect()
}

#[cfg(unix)]
#[test]
fn killed_anywhere_the_same_command_goes_on_and_ends_as_if_nothing_had_been() {
    let lab = lab_with(3);
    std::fs::copy(lab.path("beampose.db"), lab.path("before.db")).unwrap();
    let begin = Instant::now();
    lab.beampose(&ALL).expect_code(0);
    let mut under_way = UnderWay::within(begin.elapsed());
    let whole = new_poses(&processings(&lab));
    assert!(whole.values().all(|of_session| of_session.len() == 2));
    let results = rows(&lab, whole.keys().next().unwrap(), 3).1;
    assert_eq!(results.len(), 1);
    let (mut continued, mut kept, mut tries) = (0, 0, 0);
    while continued < 6 || kept == 0 {
        tries += 1;
        assert!(tries < 60, "of {tries} kills {continued} met it at work, {kept} poses kept");
        for ending in ["", "-wal", "-shm"] {
            let _none = std::fs::remove_file(lab.path(&format!("beampose.db{ending}")));
        }
        std::fs::copy(lab.path("before.db"), lab.path("beampose.db")).unwrap();
        // Multiples of the golden ratio: any number of them lies evenly.
        let after = under_way.instant((f64::from(tries) * 0.618_034).fract());
        if interrupted(&lab, after, "KILL").status.code().is_some() {
            under_way.too_late(after);
            continue;
        }
        let begun = processings(&lab);
        if begun.values().all(|of_session| of_session.len() == 2) {
            under_way.too_soon(after);
            continue;
        }
        if begun.values().flatten().all(|(processing, _)| processing.finished.is_some()) {
            under_way.too_late(after);
            continue;
        }
        under_way.met();
        let there: usize = begun.values().flat_map(|s| &s[2..]).map(|(_, poses)| poses.len()).sum();
        let ended = lab.beampose(&ALL).expect_code(0);
        assert!(ended.err.contains("3 of these were begun before: going on"), "{}", ended.err);
        let now = processings(&lab);
        assert!(new_poses(&now) == whole, "killed after {after:?}: {now:?}");
        let id = now.keys().next().unwrap();
        assert_eq!(rows(&lab, id, 3).1, results, "killed after {after:?}");
        assert_eq!(lab.beampose(&["sessions", "verify", "--all"]).code, 0);
        continued += 1;
        kept += there;
    }
    println!("{continued} commands were gone on with, {kept} poses were there already");
    // Once it is complete, the same command is a new one.
    lab.beampose(&ALL).expect_code(0);
    assert!(processings(&lab).values().all(|of_session| of_session.len() == 6));
    no_locks(&lab);
}

fn no_locks(lab: &Lab) {
    let left = std::fs::read_dir(lab.path(".")).unwrap();
    let locks =
        left.filter(|e| e.as_ref().unwrap().path().extension().is_some_and(|x| x == "lock"));
    assert_eq!(locks.count(), 0);
}

#[cfg(unix)]
#[test]
fn ctrl_c_finishes_what_is_under_way_and_the_same_command_goes_on() {
    let lab = lab_with(2);
    let begin = Instant::now();
    lab.beampose(&ALL).expect_code(0);
    let mut under_way = UnderWay::within(begin.elapsed());
    let whole = new_poses(&processings(&lab));
    let mut stopped = 0;
    for try_number in 0..30 {
        let after = under_way.instant([0.4, 0.6][stopped]);
        let before: BTreeMap<String, usize> =
            processings(&lab).iter().map(|(id, all)| (id.clone(), all.len())).collect();
        let output = interrupted(&lab, after, "INT");
        let begun = processings(&lab).iter().any(|(id, all)| all.len() > before[id]);
        if output.status.code().is_none_or(|code| code == 0) || !begun {
            // It met the program before it listened or began, or after it was done.
            if begun {
                under_way.too_late(after)
            } else {
                under_way.too_soon(after)
            }
            lab.beampose(&ALL).expect_code(0);
            continue;
        }
        let ended = Ended::of(&output).expect_code(3);
        assert!(ended.err.contains("the same command goes on where it was"), "{}", ended.err);
        no_locks(&lab);
        let again = lab.beampose(&ALL).expect_code(0);
        assert!(
            again.err.contains("of these were begun before"),
            "try {try_number}: {}",
            again.err
        );
        for (id, all) in processings(&lab) {
            assert_eq!(all.len(), before[&id] + 2, "none was begun twice");
            let last: Vec<_> =
                all[all.len() - 2..].iter().map(|(_, poses)| poses.clone()).collect();
            assert_eq!(last, whole[&id]);
        }
        stopped += 1;
        if stopped == 2 {
            break;
        }
    }
    assert_eq!(stopped, 2, "signals that met it at work");
}

#[test]
fn two_commands_at_once_do_not_share_a_processing() {
    let lab = lab_with(2);
    let mut command = lab.command();
    command.args(ALL).stdout(Stdio::null()).stderr(Stdio::piped());
    let first = command.spawn().unwrap();
    while processings(&lab).values().any(|of_session| of_session.len() < 3) {
        std::thread::sleep(Duration::from_millis(5));
    }
    let second = lab.beampose(&ALL).expect_code(0);
    let first = first.wait_with_output().unwrap();
    assert!(first.status.success(), "{}", String::from_utf8_lossy(&first.stderr));
    assert!(!second.err.contains("begun before"), "{}", second.err);
    let all = processings(&lab);
    for of_session in new_poses(&all).values() {
        let [a, a_together, b, b_together] = of_session.as_slice() else { panic!() };
        assert_eq!((a, a_together), (b, b_together));
    }
}

#[test]
fn a_session_that_cannot_be_read_does_not_keep_the_others_from_being_solved() {
    let lab = lab_with(2);
    let bytes = std::fs::read(lab.path("beampose.db")).unwrap();
    let first = lab.beampose(&["sessions", "--json"]).json_lines()[0]["session"].clone();
    // The first session's setup: its key is there once a session.
    let key = b"\"wavelength_u_nm\"";
    let at = bytes.windows(key.len()).position(|window| window == key).unwrap();
    let mut hurt = bytes;
    hurt[at + 1] = b'W';
    std::fs::write(lab.path("beampose.db"), hurt).unwrap();
    let ended = lab.beampose(&["solve", "--all"]).expect_code(4);
    let told = format!("session {}: ", first.as_str().unwrap());
    assert!(
        ended.err.contains("setup cannot be read") && ended.err.contains(&told),
        "{}",
        ended.err
    );
    assert_eq!(ended.out.lines().count(), 1, "{}", ended.out);
}

#[cfg(unix)]
/// Takes one capture, and is then there for an hour of real time: however slow the test is.
const WAITS: &str = "
version: 1
title: Waits
experiment: acquisition
steps:
  - capture: {cameras: all}
  - wait: 1 h
";

#[test]
fn a_session_that_runs_is_left_to_its_run() {
    let lab = lab_with(1);
    let simulated = std::fs::read_to_string(rig()).unwrap();
    lab.write_rig("slow", &replaced(&simulated, "clock: virtual", "clock: real"));
    lab.write("slow.yaml", WAITS);
    let mut command = lab.command();
    command.args(["run", "slow.yaml", "--rig", "rigs/slow.yaml"]);
    command.args(["--picture-scale", crate::lab::SCALE]);
    let mut run = command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    let listed = || lab.beampose(&["sessions", "--json"]).json_lines();
    while listed().len() < 2 || listed().last().unwrap()["captures"].as_u64() < Some(1) {
        std::thread::sleep(Duration::from_millis(20));
    }
    let holder = format!("is being run by process {}", run.id());
    let refused = lab.beampose(&["solve", "latest"]).expect_code(2);
    let all = lab.beampose(&["solve", "--all"]).expect_code(0);
    run.kill().unwrap();
    run.wait().unwrap();
    assert!(refused.err.contains(&holder), "{}", refused.err);
    assert!(all.err.contains("left out: ") && all.err.contains(&holder), "{}", all.err);
    assert_eq!(all.out.lines().count(), 1, "the other one is solved");
    // The lock went with the run.
    lab.beampose(&["solve", "latest"]).expect_code(0);
}
