//! JSON and CSV.

use beampose_analysis::{json, poses_csv, positions_csv};

use crate::synthetic::{Size, around, session};

const SIZE: Size = Size { passes: 2, stops: 2, half: 1, frame: [64, 48], failures: 0 };

/// Fields of one line; quotes are only used here around text without quotes.
fn fields(line: &str) -> Vec<String> {
    let parts = line.split('"').enumerate();
    let text: String =
        parts.map(|(i, p)| if i % 2 == 0 { p.to_owned() } else { p.replace(',', ";") }).collect();
    text.split(',').map(str::to_owned).collect()
}

#[test]
fn every_line_of_the_poses_has_every_column() {
    let mut input = session(&SIZE);
    input.captures[3].solution = Err("cam_a, cam_b: dark".to_owned());
    let text = poses_csv(&input.captures);
    let lines: Vec<_> = text.lines().map(fields).collect();
    assert_eq!(lines.len(), 1 + 2 * 3 + 1);
    assert!(lines.iter().all(|l| l.len() == 1 + 2 + 24 + 21), "{text}");
    assert_eq!(lines[0][..5], ["id", "pass", "rail_mm", "method", "status"]);
    assert_eq!(lines[1][..5], ["p000", "1", "0", "inter-beam-angles", "solved"]);
    assert_eq!(lines[7][4], "cam_a; cam_b: dark");
    let column = |name: &str| lines[0].iter().position(|h| h == name).unwrap();
    assert_eq!(lines[1][column("wavelength_source")], "read");
    let number = |name: &str| lines[1][column(name)].parse::<f64>().unwrap();
    // The stated standard uncertainty of z at the first stop, and its square on the diagonal.
    assert!((number("u_z_mm") - 0.09).abs() < 1e-12 && (number("c33") - 0.0081).abs() < 1e-12);
}

#[test]
fn positions_have_a_line_per_method_and_stop() {
    let input = session(&SIZE);
    let text = positions_csv(input.translation.as_ref().unwrap());
    assert_eq!(text.lines().count(), 1 + 2 * 2);
    assert!(text.lines().nth(1).unwrap().starts_with("inter-beam-angles,0,0,0,"), "{text}");
}

#[test]
fn the_json_says_verdict_and_counts_with_and_without_an_analysis() {
    let value = json(&session(&SIZE)).unwrap();
    for key in
        ["experiment", "verdict", "captures", "solved", "methods", "limits", "scores", "session"]
    {
        assert!(!value[key].is_null(), "{key}");
    }
    let made_from = &value["inputs"][0]["calibration"]["made_from"][0];
    assert_eq!(
        (&made_from["kind"], &made_from["processing_utc"]),
        (&"session".into(), &serde_json::Value::Null)
    );
    assert!(value["inputs"][1]["calibration"].is_null());
    assert_eq!(value["limits"]["max_abs_difference_mm"]["virtual-camera"], 0.5);
    let bare = json(&around(session(&SIZE).captures)).unwrap();
    assert_eq!((&bare["captures"], &bare["solved"]), (&4.into(), &4.into()));
    assert_eq!(bare["methods"]["virtual-camera"]["solved"], 4);
    assert_eq!(bare["verdict"], "inconclusive");
}
