//! Stored sessions in the long run: found, labelled, compared, verified, moved, deleted.

use std::sync::Arc;

use serde_json::{Value, json};

use crate::lab::{Lab, plan, solutions};

/// Two sessions of two captures.
fn two() -> (Lab, [String; 2]) {
    let lab = Lab::new();
    for seed in ["1", "2"] {
        lab.run(&plan(1, 100, 100), &["--seed", seed]).expect_code(0);
    }
    let listed = lab.beampose(&["sessions", "--json"]).expect_code(0).json_lines();
    let id = |i: usize| listed[i]["session"].as_str().unwrap().to_owned();
    let ids = [id(0), id(1)];
    (lab, ids)
}

fn listed(lab: &Lab, filter: &[&str]) -> Vec<String> {
    let ended = lab.beampose(&[&["sessions", "--json"], filter].concat()).expect_code(0);
    let lines = ended.json_lines();
    lines.iter().map(|line| line["session"].as_str().unwrap().to_owned()).collect()
}

#[test]
fn sessions_are_found_by_what_is_known_of_them() {
    let (lab, ids) = two();
    let [first, second] = [&ids[..1], &ids[1..]];
    let tagged = lab.beampose(&["sessions", "tag", &ids[0], "warm", "baseline"]).expect_code(0);
    assert_eq!(tagged.out, format!("session {}: baseline warm\n", ids[0]));
    let today = jiff::Timestamp::now().strftime("%Y-%m-%d").to_string();
    for (filter, expected) in [
        (&[][..], &ids[..]),
        (&["--tag", "warm"], first),
        (&["--tag", "warm", "--tag", "baseline"], first),
        (&["--tag", "warm", "--tag", "cold"], &[]),
        (&["--limit", "1"], second),
        (&["--limit", "0"], &[]),
        (&["--experiment", "translation"], &ids),
        (&["--experiment", "rotation"], &[]),
        (&["--rig", "before a WALL"], &ids),
        (&["--rig", "simulated.yaml"], &ids),
        (&["--rig", "bench"], &[]),
        (&["--until", "2020-01-01"], &[]),
        (&["--since", "2020-01-01"], &ids),
        (&["--since", "2020-01-01", "--until", "2999-12-31"], &ids),
        (&["--since", &today], &ids),
        (&["--verdict", "none"], &[]),
        (&["--verdict", "aborted"], &[]),
    ] {
        // At midnight between run and list `today` is the day after: try it as the day before too.
        assert_eq!(listed(&lab, filter), expected, "{filter:?}");
    }
    let verdict = lab.beampose(&["report", &ids[0], "--json"]).json()["verdict"].clone();
    assert!(listed(&lab, &["--verdict", verdict.as_str().unwrap()]).contains(&ids[0]));
    let text = lab.beampose(&["sessions", "--tag", "none"]).expect_code(0).out;
    assert_eq!(text, "no such session\n");
    assert!(lab.beampose(&["sessions"]).expect_code(0).out.contains("baseline warm"));

    lab.beampose(&["sessions", "untag", &ids[0], "warm"]).expect_code(0);
    assert_eq!(listed(&lab, &["--tag", "warm"]), Vec::<String>::new());
    for (typed, said) in [
        (&["untag", "latest", "warm"][..], "has no tag \"warm\"; it has none"),
        (&["tag", "latest", "two words"], "a tag is one word"),
        (&["--since", "yesterday"], "expected a day as 2026-11-20"),
        (&["latest", "--tag", "warm"], "no filter applies"),
        (&["note", "latest", " "], "it is empty"),
    ] {
        let ended = lab.beampose(&[&["sessions"], typed].concat()).expect_code(2);
        assert!(ended.err.contains(said), "{}", ended.err);
    }
}

#[test]
fn notes_and_tags_are_shown_with_the_session() {
    let (lab, ids) = two();
    lab.beampose(&["sessions", "note", &ids[0], "lamp was on"]).expect_code(0);
    lab.beampose(&["sessions", "tag", &ids[0], "warm"]).expect_code(0);
    let shown = lab.beampose(&["sessions", "show", &ids[0], "--json"]).expect_code(0).json();
    assert_eq!(shown["tags"], json!(["warm"]));
    assert_eq!(shown["notes"][0]["text"], "lamp was on");
    // The older form is the same.
    assert_eq!(lab.beampose(&["sessions", &ids[0], "--json"]).json(), shown);
    let text = lab.beampose(&["sessions", "show", &ids[0]]).expect_code(0).out;
    assert!(text.contains("tags warm") && text.contains(": lamp was on"), "{text}");
    assert_eq!(shown["interruptions"], json!([]));
}

#[test]
fn two_sessions_are_compared() {
    let (lab, ids) = two();
    let compared = lab.beampose(&["sessions", "compare", &ids[0], &ids[1], "--json"]);
    let compared = compared.expect_code(0).json();
    let differ: Vec<&str> = compared["settings_that_differ"]
        .as_array()
        .unwrap()
        .iter()
        .map(|name| name.as_str().unwrap())
        .collect();
    assert!(differ.contains(&"session") && differ.contains(&"seed"), "{differ:?}");
    assert!(!differ.contains(&"plan (steps)") && !differ.contains(&"options"), "{differ:?}");
    let poses = &compared["poses"]["virtual-camera"];
    assert_eq!((&poses["compared"], &poses["identical"]), (&2.into(), &0.into()));
    let [stop_a, stop_b] = [0, 1].map(|i| {
        let report = lab.beampose(&["report", &ids[i], "--json"]).json();
        report["methods"]["virtual-camera"]["positions"][1].clone()
    });
    let number = |value: &Value, key: &str| value[key].as_f64().unwrap();
    let stop = &compared["positions"]["virtual-camera"][1];
    let key = "mean_difference_mm";
    assert_eq!(number(stop, "difference_mm"), number(&stop_b, key) - number(&stop_a, key));
    let key = "expanded_uncertainty_mm";
    let expected = number(&stop_a, key).hypot(number(&stop_b, key));
    assert_eq!(number(stop, key), expected);

    let text = lab.beampose(&["sessions", "compare", &ids[0], &ids[1]]).expect_code(0).out;
    assert!(text.contains("B - A mm") && text.contains("seed"), "{text}");
    for (typed, said) in [
        ([format!("{}@9", ids[0]), "@1".to_owned()], "has no processing 9; it has 1, 2"),
        ([format!("{}@1", ids[0]), "@x".to_owned()], "has no processing x"),
        (["ffff".to_owned(), "@1".to_owned()], "there is no session \"ffff\""),
    ] {
        let ended = lab.beampose(&["sessions", "compare", &typed[0], &typed[1]]).expect_code(2);
        assert!(ended.err.contains(said), "{}", ended.err);
    }
}

/// Changes a byte in the middle of a picture, as a failing disk does.
fn hurt_a_picture(lab: &Lab) {
    let picture = lab.with_store("beampose.db", async |store| {
        let id = store.find_session("latest").await.unwrap();
        let capture = store.captures(id).await.unwrap().remove(0);
        let picture = store.picture(id, &capture.id, &capture.pictures[0].camera).await.unwrap();
        Arc::into_inner(store).unwrap().close().await;
        picture
    });
    let mut bytes = std::fs::read(lab.path("beampose.db")).unwrap();
    // It lies in pages: a stretch that none of them divides is found as it is.
    let found = picture[picture.len() / 2..].windows(64).step_by(64).find_map(|stretch| {
        let mut places = bytes.windows(64).enumerate().filter(|(_, window)| *window == stretch);
        places.next().map(|(at, _)| at)
    });
    bytes[found.unwrap() + 32] ^= 0x55;
    std::fs::write(lab.path("beampose.db"), bytes).unwrap();
}

#[test]
fn a_corrupt_picture_is_named_and_the_others_are_still_solved() {
    let (lab, ids) = two();
    let sound = lab.beampose(&["sessions", "verify", "--all"]).expect_code(0).out;
    assert!(sound.ends_with("the database is sound\n"), "{sound}");
    let one = lab.beampose(&["sessions", "verify", &ids[0], "--json"]).expect_code(0).json();
    assert_eq!((&one["pictures"], &one["problems"]), (&6.into(), &json!([])));
    assert_eq!(one["steps"], lab.beampose(&["sessions", "--json"]).json_lines()[0]["steps"]);

    hurt_a_picture(&lab);
    let all = lab.beampose(&["sessions", "verify", "--all", "--json"]).expect_code(4).json_lines();
    let problems: Vec<&Value> =
        all.iter().flat_map(|line| line["problems"].as_array().unwrap()).collect();
    assert_eq!(problems.len(), 1, "{problems:?}");
    let problem = problems[0].as_str().unwrap();
    assert!(problem.starts_with("the picture of cam_"), "{problem}");
    assert!(problem.contains(" is damaged: its BLAKE3 is "), "{problem}");
    let hurt = if problem.contains(&ids[0]) { &ids[0] } else { &ids[1] };
    let told = lab.beampose(&["sessions", hurt, "--verify"]).expect_code(4).out;
    assert!(told.contains(problem), "{told}");

    // Two cameras are left for that capture, and say so.
    let poses = solutions(&lab.beampose(&["solve", hurt, "--json"]).expect_code(0));
    assert_eq!(poses.len(), 4);
    assert!(poses.iter().all(|pose| pose["status"] == "solved"), "{poses:?}");
    let notes = poses.iter().filter(|pose| pose["notes"].to_string().contains("is damaged"));
    assert_eq!(notes.count(), 2, "one capture by two methods");
}

#[test]
fn a_session_moves_to_another_database_as_one_file() {
    let (lab, ids) = two();
    lab.beampose(&["sessions", "tag", &ids[0], "warm"]).expect_code(0);
    let written = lab.beampose(&["sessions", "export", &ids[0], "warm.bps"]).expect_code(0);
    assert_eq!(written.out, format!("warm.bps: session {}, 6 pictures\n", ids[0]));
    let read = lab.beampose(&["sessions", "import", "warm.bps", "--db", "other.db", "--json"]);
    assert_eq!(read.expect_code(0).json()["session"], ids[0].as_str());
    let other = |typed: &[&str]| lab.beampose(&[typed, &["--db", "other.db"]].concat());
    other(&["sessions", "verify", "latest"]).expect_code(0);
    assert!(other(&["sessions"]).out.contains("warm"));

    // Captured here, solved there: the same bits, and the same report.
    let here = solutions(&lab.beampose(&["solve", &ids[0], "--json"]).expect_code(0));
    assert_eq!(solutions(&other(&["solve", &ids[0], "--json"]).expect_code(0)), here);
    let scores =
        [lab.beampose(&["score", &ids[0], "--json"]), other(&["score", &ids[0], "--json"])];
    assert_eq!(scores[0].out, scores[1].out, "the simulation's truth went along");
    assert_eq!(lab.beampose(&["solve", "latest", "--db", "warm.bps"]).code, 0, "it is a database");

    for (typed, said) in [
        (&["import", "warm.bps"][..], "is stored already, and stays as it is"),
        (&["import", "none.bps"], "there is no file none.bps"),
        (&["import", "plan.yaml"], "plan.yaml is not a beampose database"),
        (&["import", "report"], "it is a folder"),
        (&["export", "latest", "warm.bps"], "warm.bps is there already"),
        (&["export", "latest", "beampose.db", "--force"], "beampose.db is there already"),
    ] {
        let ended = lab.beampose(&[&["sessions"], typed].concat()).expect_code(2);
        assert!(ended.err.contains(said), "{}", ended.err);
    }
    lab.beampose(&["sessions", "export", "latest", "warm.bps", "--force"]).expect_code(0);
    let resumed = other(&["resume", &ids[0]]).expect_code(2);
    assert!(resumed.err.contains("was imported, not run"), "{}", resumed.err);
}

#[test]
fn a_session_is_deleted_only_when_somebody_says_so() {
    let (lab, ids) = two();
    // Standard input is no terminal here.
    let asked = lab.beampose(&["sessions", "delete", &ids[0]]).expect_code(2);
    assert!(
        asked.err.contains("nothing is deleted") && asked.err.contains("--yes"),
        "{}",
        asked.err
    );
    assert_eq!(listed(&lab, &[]), ids);
    let deleted = lab.beampose(&["sessions", "delete", &ids[0], "--yes", "--json"]);
    let deleted = deleted.expect_code(0).json();
    assert_eq!(deleted["pictures"], 6);
    assert_eq!(listed(&lab, &[]), ids[1..]);
    let vacuumed = lab.beampose(&["sessions", "vacuum", "--json"]).expect_code(0).json();
    let bytes = |key: &str| vacuumed[key].as_u64().unwrap();
    let gone = deleted["bytes"].as_u64().unwrap();
    assert!(gone > 100_000 && bytes("before_bytes") - bytes("after_bytes") > gone, "{vacuumed}");
    lab.beampose(&["sessions", "verify", "--all"]).expect_code(0);
    assert_eq!(lab.beampose(&["report", &ids[1], "--json"]).code, 0);
    lab.beampose(&["sessions", "delete", &ids[0], "--yes"]).expect_code(2);
}
