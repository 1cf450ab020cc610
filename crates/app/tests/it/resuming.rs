//! Killed or stopped anywhere, a session goes on and ends as if nothing had been.

use std::collections::BTreeMap;
use std::process::Stdio;
use std::time::{Duration, Instant};

use serde_json::Value;

use crate::instants::UnderWay;
use crate::lab::{Ended, Lab, plan, replaced, rig, signal};

/// The default rig in a world that does not drift: no diode warms, no room does. What is measured
/// at one place is then the same at any time.
fn steady_rig() -> String {
    let text = std::fs::read_to_string(rig()).unwrap();
    let text = replaced(&text, "rise: 1.02 K", "rise: 0 K");
    replaced(&text, "drift_per_hour: 0.2 K", "drift_per_hour: 0 K")
}

/// A folder with a plan and the steady rig.
fn steady_lab(plan: &str) -> Lab {
    lab_of(plan, &steady_rig())
}

/// A folder with a plan and a rig, whose file has the name that all runs here go by.
fn lab_of(plan: &str, rig: &str) -> Lab {
    let lab = Lab::new();
    lab.write("plan.yaml", plan);
    lab.write_rig("steady", rig);
    lab
}

fn run_arguments(scale: &str) -> Vec<&str> {
    vec![
        "run",
        "plan.yaml",
        "--rig",
        "rigs/steady.yaml",
        "--picture-scale",
        scale,
        "--json",
        "--out",
        "report",
    ]
}

/// As many captures with tiny pictures as passes over some stops have, that nobody solves: twelve
/// of them take a fraction of a second.
fn quick_plan_of(passes: u32, to: u32) -> String {
    let text = plan(passes, to, 100);
    let (steps, rest) = text.split_once("\nsolve:").unwrap();
    assert!(rest.contains("analyse"));
    replaced(steps, "experiment: translation", "experiment: acquisition")
}

fn quick_plan() -> String {
    quick_plan_of(3, 300)
}

/// Starts the program and kills it after a while; how long it took if it ended by itself before.
fn killed_or_ended(lab: &Lab, arguments: &[&str], after: Duration) -> Option<Duration> {
    let mut command = lab.command();
    command.args(arguments).stdout(Stdio::null()).stderr(Stdio::null());
    let begin = Instant::now();
    let mut child = command.spawn().unwrap();
    while begin.elapsed() < after {
        if child.try_wait().unwrap().is_some() {
            return Some(begin.elapsed());
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    // SIGKILL: nothing of the program runs after this.
    child.kill().unwrap();
    child.wait().unwrap();
    None
}

/// Starts the program and kills it after a while; true if it had not ended by itself.
fn killed(lab: &Lab, arguments: &[&str], after: Duration) -> bool {
    killed_or_ended(lab, arguments, after).is_none()
}

/// A laboratory whose run was killed when its session was first seen like this. A run that is over
/// before it is seen so is begun again.
fn killed_when(laboratory: impl Fn() -> Lab, is_time: impl Fn(&Value) -> bool) -> Lab {
    for _ in 0..20 {
        let lab = laboratory();
        let mut command = lab.command();
        command.args(run_arguments("0.5")).stdout(Stdio::null()).stderr(Stdio::null());
        let mut run = command.spawn().unwrap();
        while run.try_wait().unwrap().is_none() {
            let listed = lab.beampose(&["sessions", "--json"]);
            if listed.code == 0 && listed.json_lines().iter().any(&is_time) {
                run.kill().unwrap();
                run.wait().unwrap();
                return lab;
            }
        }
    }
    panic!("twenty runs were over before they could be killed");
}

type Acquired = (BTreeMap<String, String>, Vec<String>);

/// Everything acquired: setpoints, readings and hashes of the pictures of each capture; and of
/// steps their labels and outcomes.
fn acquired(lab: &Lab) -> Acquired {
    lab.with_store("beampose.db", async |store| {
        let id = store.find_session("latest").await.unwrap();
        let mut captures = BTreeMap::new();
        for capture in store.captures(id).await.unwrap() {
            let pictures: Vec<_> =
                capture.pictures.iter().map(|p| (p.camera.to_string(), p.blake3.clone())).collect();
            let all = format!("{:?} {:?} {pictures:?}", capture.setpoints, capture.readings);
            captures.insert(capture.id.to_string(), all);
        }
        let steps = store.steps(id).await.unwrap();
        let steps = steps.iter().map(|s| format!("{} {} {:?}", s.number, s.label, s.outcome));
        (captures, steps.collect())
    })
}

/// Goes on until the session is complete; how often it took.
#[track_caller]
fn resume_to_the_end(lab: &Lab) -> Ended {
    lab.beampose(&["resume", "latest", "--json", "--out", "report"]).expect_code(0)
}

fn has_session(lab: &Lab) -> bool {
    let listed = lab.beampose(&["sessions", "--json"]);
    listed.code == 0 && !listed.out.is_empty()
}

/// How often the program is killed; `BEAMPOSE_KILLS` says otherwise.
fn kills() -> u32 {
    std::env::var("BEAMPOSE_KILLS").ok().and_then(|n| n.parse().ok()).unwrap_or(20)
}

/// A laboratory whose run was killed after that share of the time that its session is under way.
fn killed_under_way(under_way: &mut UnderWay, share: f64) -> Lab {
    for _ in 0..50 {
        let lab = steady_lab(&quick_plan());
        let after = under_way.instant(share);
        if let Some(took) = killed_or_ended(&lab, &run_arguments("0.1"), after) {
            under_way.too_late(took);
        } else if !has_session(&lab) {
            under_way.too_soon(after);
        } else if lab.beampose(&["sessions", "latest", "--json"]).json()["outcome"] == "completed" {
            under_way.too_late(after);
        } else {
            under_way.met();
            return lab;
        }
    }
    panic!("fifty kills came before a session began or after it was complete");
}

/// Kills runs at instants spread over the time that their session is under way; each goes on and
/// must end as the whole one did.
fn kill_and_resume(kills: u32, length: Duration, expected: &Acquired) {
    let mut under_way = UnderWay::within(length);
    for kill in 0..kills {
        // Multiples of the golden ratio: any number of them lies evenly.
        let share = (f64::from(kill) * 0.618_033_988_75).fract();
        let lab = killed_under_way(&mut under_way, share);
        let had = acquired(&lab).0.len();
        resume_to_the_end(&lab);
        assert_eq!(acquired(&lab), *expected, "killed when it had {had} captures");
        let sound = lab.beampose(&["sessions", "latest", "--verify"]).expect_code(0).out;
        assert!(sound.starts_with("36 pictures"), "{sound}");
        let gaps = lab.with_store("beampose.db", async |store| {
            let id = store.find_session("latest").await.unwrap();
            store.gaps(id).await.unwrap().len()
        });
        assert_eq!(gaps, 1, "killed when it had {had} captures");
        println!("killed when it had {had} captures");
    }
}

#[test]
fn a_run_killed_at_any_instant_goes_on_and_ends_as_if_nothing_had_been() {
    let whole = steady_lab(&quick_plan());
    let begin = Instant::now();
    whole.beampose(&run_arguments("0.1")).expect_code(0);
    let length = begin.elapsed();
    let expected = acquired(&whole);
    assert_eq!(expected.0.len(), 12);
    // Two at a time: they disturb each other, as the programs of a busy machine do.
    std::thread::scope(|scope| {
        for half in [kills() / 2, kills().div_ceil(2)] {
            let expected = &expected;
            scope.spawn(move || kill_and_resume(half, length, expected));
        }
    });
}

/// Kills a session twenty times, each time a little after it went on; the captures that it had at
/// each kill, or `None` if it was complete before the twentieth.
fn killed_twenty_times(lab: &Lab, first: Duration) -> Option<Vec<usize>> {
    let mut after = first;
    while !has_session(lab) {
        if !killed(lab, &run_arguments("0.1"), after) {
            return None;
        }
        after = after.mul_f64(1.1);
    }
    let mut had = vec![acquired(lab).0.len()];
    while had.len() < 20 {
        if !killed(lab, &["resume", "--json", "--out", "report"], after) {
            return None;
        }
        let (before, now) = (had[had.len() - 1], acquired(lab).0.len());
        // It gets somewhere each time, and not to the end.
        after = after.mul_f64(if now == before { 1.2 } else { 1.0 });
        after = after.mul_f64(if now > before + 2 { 0.8 } else { 1.0 });
        had.push(now);
    }
    Some(had)
}

#[test]
fn a_session_killed_twenty_times_still_ends_alike() {
    let plan = quick_plan_of(6, 900);
    let whole = steady_lab(&plan);
    let begin = Instant::now();
    whole.beampose(&run_arguments("0.1")).expect_code(0);
    let mut first = begin.elapsed() / 12;
    for _ in 0..10 {
        let lab = steady_lab(&plan);
        if let Some(had) = killed_twenty_times(&lab, first) {
            println!("captures at each of the kills: {had:?}");
            resume_to_the_end(&lab);
            assert_eq!(acquired(&lab), acquired(&whole));
            lab.beampose(&["sessions", "latest", "--verify"]).expect_code(0);
            return;
        }
        first = first.mul_f64(0.8);
    }
    panic!("ten sessions were complete before their twentieth kill");
}

/// The poses of the last processing, all digits.
fn poses(lab: &Lab) -> Vec<Value> {
    let report = std::fs::read_to_string(lab.path("report/report.json")).unwrap();
    let report: Value = serde_json::from_str(&report).unwrap();
    let methods = report["methods"].as_object().unwrap();
    methods.values().map(|method| method["positions"].clone()).collect()
}

#[test]
fn poses_and_results_of_a_resumed_session_are_those_of_an_uninterrupted_one() {
    let plan = plan(1, 300, 100);
    let whole = steady_lab(&plan);
    whole.beampose(&run_arguments("0.5")).expect_code(0);
    let half_done = |s: &Value| s["outcome"] == "not closed" && s["captures"].as_u64() >= Some(2);
    let lab = killed_when(|| steady_lab(&plan), half_done);
    let ended = resume_to_the_end(&lab);
    assert!(ended.err.contains("the program died"), "{}", ended.err);
    assert_eq!(ended.json_lines().pop().unwrap()["captures"], 4);
    assert_eq!(acquired(&lab), acquired(&whole));
    assert_eq!(poses(&lab), poses(&whole));
}

/// In a world that drifts the diode is warmed up again after the gap: its wavelength is another one,
/// and the results are as uncertain as they say.
#[test]
fn in_a_drifting_world_the_gap_is_in_the_record_and_the_results_agree_within_their_uncertainty() {
    let plan = plan(1, 300, 100);
    let text = std::fs::read_to_string(rig()).unwrap();
    let whole = lab_of(&plan, &text);
    whole.beampose(&run_arguments("0.5")).expect_code(0);
    let half_done = |s: &Value| s["outcome"] == "not closed" && s["captures"].as_u64() >= Some(2);
    let lab = killed_when(|| lab_of(&plan, &text), half_done);
    resume_to_the_end(&lab);
    let gaps = lab.with_store("beampose.db", async |store| {
        let id = store.find_session("latest").await.unwrap();
        store.gaps(id).await.unwrap()
    });
    assert_eq!(gaps.len(), 1);
    assert!(gaps[0].restored.iter().any(|step| step == "laser on"), "{:?}", gaps[0].restored);
    assert_ne!(acquired(&lab).0, acquired(&whole).0, "nothing drifted: the test shows nothing");
    let (found, expected) = (poses(&lab), poses(&whole));
    assert!(!found.is_empty());
    let number = |stop: &Value, key: &str| stop[key].as_f64().unwrap();
    for (found, expected) in found.iter().zip(&expected) {
        for (a, b) in found.as_array().unwrap().iter().zip(expected.as_array().unwrap()) {
            let apart = number(a, "mean_difference_mm") - number(b, "mean_difference_mm");
            let u = |stop| number(stop, "expanded_uncertainty_mm");
            assert!(apart.abs() <= f64::hypot(u(a), u(b)), "{a} {b}");
        }
    }
}

#[test]
fn an_aborted_session_goes_on_where_it_was() {
    let lab = steady_lab(&plan(1, 300, 100));
    let mut command = lab.command();
    command.args(run_arguments("0.5")).stdout(Stdio::null()).stderr(Stdio::null());
    let mut run = command.spawn().unwrap();
    while !has_session(&lab) {
        std::thread::sleep(Duration::from_millis(20));
    }
    let kill = format!("kill -TERM {}", run.id());
    assert!(std::process::Command::new("sh").args(["-c", &kill]).status().unwrap().success());
    assert_eq!(run.wait().unwrap().code(), Some(3));
    let ended = resume_to_the_end(&lab);
    assert!(ended.err.contains("aborted at"), "{}", ended.err);
    let gaps = lab.with_store("beampose.db", async |store| {
        let id = store.find_session("latest").await.unwrap();
        store.gaps(id).await.unwrap()
    });
    assert_eq!(gaps.len(), 1);
    // The laser was off in between, and `finally` is done again.
    assert!(!gaps[0].redone.is_empty());
    let shown = lab.beampose(&["sessions", "show", "latest", "--json"]).json();
    let interruptions = shown["interruptions"].as_array().unwrap();
    assert_eq!((interruptions.len(), &interruptions[0]["reason"]), (1, &"aborted".into()));
    let redone = interruptions[0]["redone"].as_array().unwrap();
    assert_eq!(redone.len(), gaps[0].redone.len());
    let text = lab.beampose(&["sessions", "show", "latest"]).out;
    let page = std::fs::read_to_string(lab.path("report/report.html")).unwrap();
    assert!(text.contains("(aborted), went on") && page.contains("Interruptions"), "{text}");
    for step in redone {
        let label = step["label"].as_str().unwrap();
        assert!(text.contains(&format!("done again: step {}, {label}", step["number"])), "{text}");
        assert!(page.contains(&format!("step {}, {label} (", step["number"])));
    }
    let (captures, steps) = acquired(&lab);
    assert_eq!(captures.len(), 4);
    assert!(steps.iter().all(|step| step.ends_with("Done")), "{steps:?}");
}

#[test]
fn a_session_that_runs_is_not_resumed_beside_it() {
    let lab = steady_lab(&plan(1, 900, 100));
    let mut command = lab.command();
    command.args(run_arguments("0.5")).stdout(Stdio::null()).stderr(Stdio::null());
    let mut run = command.spawn().unwrap();
    while !has_session(&lab) {
        std::thread::sleep(Duration::from_millis(20));
    }
    // It pauses at the next checkpoint: however slow this test is, the run is still there.
    signal(&run, "INT");
    let refused = lab.beampose(&["resume"]).expect_code(2);
    let holder = format!("is being run by process {}", run.id());
    assert!(refused.err.contains(&holder), "{}", refused.err);
    run.kill().unwrap();
    run.wait().unwrap();
    // The lock went with the process.
    resume_to_the_end(&lab);
    let left = std::fs::read_dir(lab.path(".")).unwrap();
    let locks =
        left.filter(|e| e.as_ref().unwrap().path().extension().is_some_and(|x| x == "lock"));
    assert_eq!(locks.count(), 0);
}

#[test]
fn a_session_killed_while_it_is_solved_is_solved_and_reported() {
    let plan = plan(1, 300, 100);
    let whole = steady_lab(&plan);
    whole.beampose(&run_arguments("0.5")).expect_code(0);
    for _ in 0..20 {
        let lab = killed_when(|| steady_lab(&plan), |s| s["outcome"] == "completed");
        let resumed = lab.beampose(&["resume", "--json", "--out", "report"]);
        if resumed.code == 2 && resumed.err.contains("nothing to resume") {
            // It had solved all before the signal came.
            continue;
        }
        let ended = resumed.expect_code(0);
        assert!(ended.err.contains("all steps are done"), "{}", ended.err);
        assert_eq!(ended.json_lines().pop().unwrap()["captures"], 4);
        assert_eq!(poses(&lab), poses(&whole));
        lab.beampose(&["resume"]).expect_code(2);
        return;
    }
    panic!("twenty runs were solved before they could be killed");
}

#[test]
fn what_cannot_go_on_says_why() {
    let begin = Instant::now();
    let lab = steady_lab(&quick_plan());
    lab.beampose(&run_arguments("0.1")).expect_code(0);
    let complete = lab.beampose(&["resume"]).expect_code(2);
    assert!(complete.err.contains("is complete: nothing to resume"), "{}", complete.err);

    let mut under_way = UnderWay::within(begin.elapsed());
    let lab = killed_under_way(&mut under_way, 0.5);
    let changed = replaced(&quick_plan(), "settle: 2 s", "settle: 3 s");
    lab.write("plan.yaml", &changed);
    let refused = lab.beampose(&["resume"]).expect_code(2);
    let said = refused.err.contains("--accept-changes") || refused.err.contains("cannot go on");
    assert!(said, "{}", refused.err);
    lab.write("plan.yaml", &quick_plan());
    lab.write("rigs/steady.yaml", &format!("# another word\n{}", steady_rig()));
    let refused = lab.beampose(&["resume"]).expect_code(2);
    assert!(refused.err.contains("the rig's text"), "{}", refused.err);
    lab.write("rigs/steady.yaml", &steady_rig());
    let camera = lab.path("rigs/simulated/cam_a.yaml");
    let before = std::fs::read_to_string(&camera).unwrap();
    lab.write("rigs/simulated/cam_a.yaml", &before.replacen("3529.4", "3529.5", 1));
    assert_ne!(std::fs::read_to_string(&camera).unwrap(), before);
    let refused = lab.beampose(&["resume"]).expect_code(2);
    assert!(refused.err.contains("calibrations, pattern or artefact"), "{}", refused.err);
    lab.write("rigs/simulated/cam_a.yaml", &before);
    lab.write("rigs/steady.yaml", &format!("# another word\n{}", steady_rig()));
    lab.beampose(&["resume", "--accept-changes", "--json", "--out", "report"]).expect_code(0);
}
