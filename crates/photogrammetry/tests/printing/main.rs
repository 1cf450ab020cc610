//! What is printed reads back: the SVG is parsed, drawn as a picture and searched as any other.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on stops")]

mod paper;

use beampose_photogrammetry::calibrate::{ControlMark, Sheet, find_sheet};
use beampose_photogrammetry::detect::{TargetOptions, find_targets, usable_codes};
use beampose_photogrammetry::print::{
    Paper, Style, TargetSheet, check_code, dot_page, room, svg, target_page,
};
use nalgebra::Vector2;

use paper::Printed;

fn sheet(style: Style) -> TargetSheet {
    TargetSheet {
        codes: Vec::new(),
        radius_mm: 4.0,
        style,
        paper: Paper::A4,
        size_mm: Paper::A4.size_mm(),
        columns: None,
        rows: None,
    }
}

/// Pixels for a millimetre: a centre disc has a radius of 8.
const SCALE: f64 = 2.0;

#[test]
fn every_code_of_a_printed_page_is_read_back_in_its_place() {
    let usable = usable_codes();
    for style in [Style::DarkOnLight, Style::LightOnDark] {
        let empty = sheet(style);
        let count = room(&empty).unwrap();
        assert!(count > 30, "{count}");
        for codes in usable.chunks(count) {
            let wanted = TargetSheet { codes: codes.to_vec(), ..empty.clone() };
            let printed = Printed::parse(&svg(&target_page(&wanted).unwrap()));
            let found = find_targets(&printed.picture(SCALE), &TargetOptions::default());
            let mut read: Vec<u16> = found.iter().map(|t| t.code).collect();
            read.sort_unstable();
            assert_eq!(read, codes, "{style:?}");
            for target in &found {
                // Its number stands below it, at the left end of the quiet zone.
                let label = printed.text_at(&target.code.to_string());
                let centre = (target.point.at + Vector2::repeat(0.5)) / SCALE;
                let offset = label - centre;
                assert!((offset.x + 14.4).abs() < 0.05, "{offset}");
                assert!((14.4..18.0).contains(&offset.y), "{offset}");
                // A disc of 4 mm is 8 px, to the few hundredths that a sampled edge gives.
                assert!((target.semi_axes[0] / SCALE - 4.0).abs() < 0.05);
            }
        }
    }
}

#[test]
fn the_page_has_the_size_of_the_paper_and_a_ruler_of_100_mm() {
    let wanted = TargetSheet { codes: vec![45], ..sheet(Style::DarkOnLight) };
    let text = svg(&target_page(&wanted).unwrap());
    assert!(text.contains("width=\"210mm\" height=\"297mm\" viewBox=\"0 0 210 297\""), "{text}");
    let printed = Printed::parse(&text);
    let ticks = printed.rectangles().filter(|r| r.width < 0.3);
    let x: Vec<f64> = ticks.map(|r| r.x).collect();
    assert_eq!(x.len(), 11);
    assert!((x[10] - x[0] - 100.0).abs() < 1e-9);
}

#[test]
fn what_cannot_be_printed_is_told_with_what_can() {
    let told = |wanted: &TargetSheet| target_page(wanted).unwrap_err().to_string();
    let base = TargetSheet { radius_mm: 10.0, ..sheet(Style::DarkOnLight) };
    let many = TargetSheet { codes: usable_codes()[..20].to_vec(), ..base.clone() };
    assert_eq!(
        told(&many),
        "20 targets do not fit: with a centre radius of 10 mm there is room for 2 x 3 = 6 on A4"
    );
    let wide = TargetSheet { codes: vec![45], columns: Some(3), ..base.clone() };
    assert_eq!(told(&wide), "3 columns do not fit: A4 has room for 2");
    let twice = TargetSheet { codes: vec![45, 45], ..base.clone() };
    assert_eq!(
        told(&twice),
        "code 45 is there twice: two targets of one code cannot be told apart"
    );
    assert_eq!(told(&base), "no codes are asked for");
    let tiny = TargetSheet { codes: vec![45], radius_mm: 0.1, ..base };
    assert_eq!(told(&tiny), "a radius of 0.1 mm cannot be printed: it must be 0.5 mm or more");
}

#[test]
fn a_number_that_is_no_code_gets_the_nearest_that_is() {
    let told = |code| check_code(code).unwrap_err().to_string();
    let last = *usable_codes().last().unwrap();
    assert_eq!(
        told(5000),
        format!(
            "code 5000 is out of range: codes are below 4096; the nearest that serves is {last}"
        )
    );
    assert_eq!(told(90), "code 90 is code 45 turned: write 45");
    assert_eq!(
        told(1),
        format!(
            "code 1 can be mistaken for something else; the nearest that serves is {}",
            usable_codes()[0]
        )
    );
    assert_eq!(check_code(45), Ok(45));
}

#[test]
fn a_printed_dot_sheet_is_found_with_its_marks() {
    let mark = |code, x_mm, y_mm| ControlMark { code, x_mm, y_mm, radius_mm: 2.0 };
    let sheet = Sheet {
        rows: 8,
        columns: 10,
        pitch_mm: 15.0,
        dot_diameter_mm: 6.0,
        control_marks: vec![mark(45, 30.0, 30.0), mark(75, 90.0, 45.0)],
    };
    let text = svg(&dot_page(&sheet));
    // 135 mm x 105 mm and the borders go on A4, turned or not; upright comes first.
    assert!(text.contains("width=\"210mm\" height=\"297mm\""));
    let picture = Printed::parse(&text).picture(4.0);
    let view = find_sheet("printed", &picture, &sheet).unwrap();
    assert_eq!(view.points.len(), 80);
    let first = view.points.iter().find(|p| p.on_sheet == Vector2::zeros()).unwrap().pixel;
    for point in &view.points {
        let expected = first + point.on_sheet * 4.0;
        // Samples of a quarter pixel leave a few hundredths.
        assert!((point.pixel - expected).norm() < 0.1, "{:?}", point.on_sheet);
    }
}
