//! The report page: well-formed, self-contained, complete, and calm about sessions that went wrong.

use beampose_analysis::html;
use beampose_analysis::report::{Interruption, RedoneStep};
use beampose_photogrammetry::GrayImage;
use beampose_photogrammetry::solve::Method;

use crate::synthetic::{Size, analysed, around, session, stamp};

fn small() -> Size {
    Size { passes: 2, stops: 4, half: 1, frame: [320, 240], failures: 0 }
}

/// Elements without an end tag.
const VOID: [&str; 4] = ["meta", "br", "link", "img"];

/// Every tag is closed in order, nothing is loaded from elsewhere, nothing is not a number.
#[track_caller]
pub fn check(page: &str) {
    let mut open: Vec<&str> = Vec::new();
    for part in page.split('<').skip(1) {
        let (tag, _) = part.split_once('>').unwrap_or_else(|| panic!("no end of <{part}"));
        let name = tag.split([' ', '\n']).next().unwrap_or_default();
        if let Some(closed) = name.strip_prefix('/') {
            assert_eq!(open.pop(), Some(closed), "wrong end tag after {open:?}");
        } else if !name.starts_with('!') && !VOID.contains(&name) {
            open.push(name);
        }
    }
    assert!(open.is_empty(), "not closed: {open:?}");
    for never in ["NaN", "inf ", "http://", "https://", "<script", "src=", "@import", "url("] {
        assert!(!page.contains(never), "{never:?} in the page");
    }
}

/// One tag a line, the style sheet and the pictures' bytes left out.
fn readable(page: &str) -> String {
    let (head, rest) = page.split_once("<style>").unwrap();
    let (_, rest) = rest.split_once("</style>").unwrap();
    let mut out = String::from(head);
    for (i, part) in rest.split("base64,").enumerate() {
        out.push_str(if i == 0 { part } else { part.split_once('"').map_or("", |p| p.1) });
    }
    out.replace("><", ">\n<")
}

#[test]
fn a_small_session_gives_this_page() {
    let page = html(&session(&small()));
    check(&page);
    insta::assert_snapshot!(readable(&page));
}

#[test]
fn the_same_input_gives_the_same_page() {
    assert_eq!(html(&session(&small())), html(&session(&small())));
}

#[test]
fn a_full_session_shows_failures_and_is_a_size_that_can_be_mailed() {
    let size = Size { passes: 6, stops: 10, half: 5, frame: [1728, 1296], failures: 2 };
    let page = html(&session(&size));
    check(&page);
    assert!(page.contains("12 of 121 dots seen by two cameras or more"));
    assert!(page.contains("58 solved by inter-beam angles"));
    assert!(page.len() < 3_000_000, "{} bytes", page.len());
}

#[test]
fn an_empty_session_says_so() {
    for translation in [None, Some(analysed(&[]))] {
        let mut input = around(vec![]);
        input.translation = translation;
        let page = html(&input);
        check(&page);
        assert!(page.contains("none were taken") && page.contains("Inconclusive"));
    }
}

#[test]
fn one_capture_has_poses_and_no_distance() {
    let input = session(&Size { passes: 1, stops: 1, ..small() });
    let page = html(&input);
    check(&page);
    assert!(page.contains("There is no measured distance"));
    assert!(page.contains("1 of 1 captures"));
}

#[test]
fn when_every_capture_failed_the_reasons_are_shown() {
    let mut input = session(&small());
    for (i, capture) in input.captures.iter_mut().enumerate() {
        if i % 2 == 0 {
            capture.solution = Err("cam_b: damaged JPEG file: it ends <early>".to_owned());
        } else if let Ok(solution) = &mut capture.solution {
            for result in &mut solution.results {
                result.pose = Err("2 of 9 beams named; 6 are needed".to_owned());
            }
        }
    }
    let result = analysed(&input.captures);
    (input.verdict, input.reasons) = (result.verdict, result.reasons.clone());
    input.translation = Some(result);
    let page = html(&input);
    check(&page);
    assert!(page.contains("it ends &lt;early&gt;") && page.contains("2 of 9 beams named"));
    assert!(page.contains("0 of 8 captures solved"));
    assert!(page.contains("nothing is marked"), "the picture of a failed capture is shown bare");
}

#[test]
fn numbers_that_are_none_and_empty_pictures_do_not_reach_the_page() {
    let mut input = session(&small());
    input.pictures[0].image = GrayImage { width: 0, height: 0, data: vec![] };
    if let Ok(solution) = &mut input.captures[1].solution {
        solution.results[0].sigma0 = f64::NAN;
        if let Ok(pose) = &mut solution.results[0].pose {
            pose.covariance = [[f64::NAN; 6]; 6];
        }
        solution.cameras.values_mut().for_each(|c| c.observations[0].residual = [f64::NAN; 2]);
    }
    input.translation = Some(analysed(&input.captures));
    input.environment[0].readings[0].value = f64::NAN;
    check(&html(&input));
}

#[test]
fn a_session_of_another_experiment_has_no_distances() {
    let mut input = session(&small());
    (input.experiment, input.translation) = ("stability".to_owned(), None);
    input.methods = vec![Method::VirtualCamera];
    let page = html(&input);
    check(&page);
    assert!(!page.contains("Travelled distance"));
}

#[test]
fn each_interruption_is_told_with_what_was_done_again() {
    let mut input = around(vec![]);
    assert!(!html(&input).contains("Interruptions"));
    let step = RedoneStep {
        number: 17,
        label: "capture p004 <all>".to_owned(),
        before: "failed: cam_b: no answer".to_owned(),
    };
    let gap = |restored: &[&str], redone: Vec<RedoneStep>| Interruption {
        stopped: stamp(100.0),
        resumed: stamp(100.0 + 5400.0),
        reason: "the program died".to_owned(),
        restored: restored.iter().map(|&text| text.to_owned()).collect(),
        redone,
    };
    input.interruptions =
        vec![gap(&["move rail to 300 mm", "switch laser on"], vec![step]), gap(&[], vec![])];
    let page = html(&input);
    check(&page);
    let text = readable(&page);
    for said in [
        "Interruptions",
        "the program died",
        "90 min later",
        "move rail to 300 mm; switch laser on",
        "step 17, capture p004 &lt;all&gt; (failed: cam_b: no answer)",
        "nothing",
        "no step",
    ] {
        assert!(text.contains(said), "{said}");
    }
    let json = beampose_analysis::json(&input).unwrap();
    assert_eq!(json["interruptions"][0]["duration_s"], 5400.0);
    assert_eq!(json["interruptions"][0]["redone"][0]["number"], 17);
}
