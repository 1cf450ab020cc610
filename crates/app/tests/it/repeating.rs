//! The same gives the same; solving again keeps what there was.

use serde_json::Value;

use crate::lab::{Ended, Lab, SCALE, plan, rig, solutions};

/// A run with so many threads for each kind of work, and what came out.
struct Run {
    session: Value,
    poses: Vec<Value>,
    captures: Value,
}

fn run(seed: &str, threads: &str) -> Run {
    let lab = Lab::new();
    lab.write("plan.yaml", &plan(1, 200, 100));
    let rig = rig();
    let beampose = |arguments: &[&str]| {
        let mut command = lab.command();
        command.args(arguments).env("RAYON_NUM_THREADS", threads);
        Ended::of(&command.output().unwrap())
    };
    let usual = ["run", "plan.yaml", "--rig", &rig, "--picture-scale", SCALE, "--json"];
    let ran = beampose(&[&usual[..], &["--seed", seed]].concat());
    let session = ran.json()["session"].clone();
    let mut shown = beampose(&["sessions", "latest", "--json"]).expect_code(0).json();
    let poses = solutions(&beampose(&["solve", "latest", "--json"]).expect_code(0));
    Run { session, poses, captures: shown["captures"].take() }
}

#[test]
fn a_seed_gives_the_same_bits_with_any_number_of_threads() {
    let [one, two] = ["1", "2"].map(|threads| run("7", threads));
    assert_ne!(one.session, two.session);
    assert_eq!(one.poses.len(), 6);
    assert!(one.poses.iter().all(|p| p["status"] == "solved"));
    // Positions, quaternions, covariances and all else but the time it took.
    assert_eq!(one.poses, two.poses);
    // Setpoints, readings, and the pictures' hashes.
    assert_eq!(one.captures, two.captures);
}

#[test]
fn another_seed_gives_another_world() {
    let [one, two] = ["7", "8"].map(|seed| run(seed, "2"));
    for (a, b) in one.poses.iter().zip(&two.poses) {
        assert_ne!(a["position_mm"], b["position_mm"]);
    }
    let hashes = |run: &Run| -> Vec<String> {
        let captures = run.captures.as_array().unwrap().iter();
        let pictures = captures.flat_map(|c| c["pictures"].as_array().unwrap());
        pictures.map(|p| p["blake3"].as_str().unwrap().to_owned()).collect()
    };
    let (one, two) = (hashes(&one), hashes(&two));
    assert_eq!(one.len(), 9);
    assert!(one.iter().all(|hash| !two.contains(hash)));
}

#[test]
fn solving_again_adds_a_processing_and_keeps_the_others() {
    let lab = Lab::new();
    lab.run(&plan(1, 100, 100), &[]).expect_code(0);
    let report = || lab.beampose(&["report", "latest", "--json"]).expect_code(0).json();
    let poses_of_all = || {
        lab.with_store("beampose.db", async |store| {
            let id = store.find_session("latest").await.unwrap();
            let mut all = Vec::new();
            for processing in store.processings(id).await.unwrap() {
                all.push((processing.id, store.poses(processing.id).await.unwrap()));
            }
            all
        })
    };
    let (first_report, first) = (report(), poses_of_all());
    // Capture by capture while it ran, then the whole session together.
    assert_eq!((first.len(), first_report["processing"].as_str()), (2, Some("2")));
    let again = solutions(&lab.beampose(&["solve", "latest", "--json"]).expect_code(0));
    let third = solutions(&lab.beampose(&["solve", "latest", "--json"]).expect_code(0));
    assert_eq!(again, third);
    let all = poses_of_all();
    assert_eq!(all.len(), 4);
    // The run's own are as they were, and the others have the same poses under other numbers.
    assert_eq!(all[..2], first[..]);
    assert!(all[2..].iter().all(|(_, poses)| *poses == first[0].1));
    assert_eq!(report()["processing"], "4");
    let (now, before) = (&report()["methods"], &first_report["methods"]);
    assert_eq!(now["virtual-camera"], before["virtual-camera"]);
    let together = ["solve", "latest", "--method", "session-adjustment", "--json"];
    lab.beampose(&together).expect_code(0);
    assert_eq!(report()["methods"], *before);
}

#[test]
fn one_method_alone_gives_what_it_gives_beside_the_other() {
    let lab = Lab::new();
    lab.run(&plan(1, 100, 100), &[]).expect_code(0);
    let both = solutions(&lab.beampose(&["solve", "latest", "--json"]).expect_code(0));
    for method in ["virtual-camera", "inter-beam-angles"] {
        let alone = ["solve", "latest", "--json", "--method", method];
        let alone = solutions(&lab.beampose(&alone).expect_code(0));
        let of_both: Vec<Value> = both.iter().filter(|p| p["method"] == method).cloned().collect();
        assert_eq!(alone.len(), 2);
        assert_eq!(alone, of_both);
    }
}
