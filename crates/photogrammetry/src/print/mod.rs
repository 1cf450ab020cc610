//! Sheets to print, as SVG to true scale: ring-coded targets, and the dots that cameras are
//! calibrated with.
//!
//! A page is a list of marks in millimetres (`page`), put on paper by `svg`; `targets` and `dots` say
//! what stands where. Nothing here opens a file.

mod dots;
mod page;
mod svg;
mod targets;

pub use dots::dot_page;
pub use page::{Ink, Mark, Page, Paper, Shape};
pub use svg::svg;
pub use targets::{Style, TargetSheet, TargetSheetError, check_code, room, target_page};
