//! The page of a calibration sheet.

use nalgebra::Vector2;

use super::page::{FOOT, Ink, MARGIN, Page, Paper, QUIET, Shape};
use crate::calibrate::Sheet;

/// The page of a sheet of dots: on the smallest paper that holds it, upright or turned, else on a
/// page of its own size, for a plotter.
#[must_use]
pub fn dot_page(sheet: &Sheet) -> Page {
    let last = sheet.dot(sheet.columns - 1, sheet.rows - 1);
    let border = sheet
        .control_marks
        .iter()
        .map(|m| QUIET * m.radius_mm)
        .fold(sheet.dot_diameter_mm, f64::max);
    let needed = last + Vector2::new(2.0 * (border + MARGIN), 2.0 * (border + MARGIN) + FOOT);
    let size = size(&needed);
    let title = format!(
        "beampose · {} rows and {} columns of dots · pitch {} mm · diameter {} mm",
        sheet.rows, sheet.columns, sheet.pitch_mm, sheet.dot_diameter_mm
    );
    let mut page = Page::titled(size, title);
    let room = Vector2::new(size[0], size[1] - FOOT);
    let first = (room - last) * 0.5;
    for row in 0..sheet.rows {
        for column in (0..sheet.columns).filter(|c| sheet.mark_at(*c, row).is_none()) {
            let disc = Shape::Disc { radius: sheet.dot_radius_mm() };
            page.put(first + sheet.dot(column, row), Ink::Black, disc);
        }
    }
    for mark in &sheet.control_marks {
        page.target(first + mark.place(), mark.code, mark.radius_mm, Ink::Black);
    }
    page
}

fn size(needed: &Vector2<f64>) -> [f64; 2] {
    let turned = |[width, height]: [f64; 2]| [[width, height], [height, width]];
    let papers = [Paper::A4, Paper::A3].into_iter().flat_map(|p| turned(p.size_mm()));
    let mut fitting = papers.filter(|[w, h]| needed.x <= *w && needed.y <= *h);
    fitting.next().unwrap_or([needed.x.ceil(), needed.y.ceil()])
}
