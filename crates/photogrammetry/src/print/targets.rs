//! A page of ring-coded targets.

use nalgebra::Vector2;

use super::page::{FOOT, Ink, MARGIN, Page, Paper, QUIET, Shape, TEXT};
use crate::detect::{is_usable_code, usable_codes};
use crate::scene::{RING_BITS, canonical_code};

/// Between the quiet zones of neighbours, millimetres: room to cut.
const GAP: f64 = 2.0;
/// Smallest radius of a centre disc, millimetres: below it a printer's dots show in the ring.
const LEAST_RADIUS: f64 = 0.5;

/// The colours of a target.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Style {
    /// Disc and code black.
    DarkOnLight,
    /// Disc and code white, on a black square.
    LightOnDark,
}

/// What is wanted.
#[derive(Debug, Clone, PartialEq)]
pub struct TargetSheet {
    /// The codes, in reading order.
    pub codes: Vec<u16>,
    /// Radius of the centre disc, millimetres; the ring reaches to three times that.
    pub radius_mm: f64,
    /// Colours.
    pub style: Style,
    /// The paper.
    pub paper: Paper,
    /// Width and height of the page, millimetres: the paper's, upright or turned.
    pub size_mm: [f64; 2],
    /// Targets across; without it as many as there is room for.
    pub columns: Option<usize>,
    /// Targets down.
    pub rows: Option<usize>,
}

/// Why a sheet cannot be made.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TargetSheetError {
    /// A number that is no code.
    #[error("code {code} is out of range: codes are below {}; the nearest that serves is {nearest}", 1 << RING_BITS)]
    OutOfRange {
        /// The number.
        code: u32,
        /// The nearest that serves.
        nearest: u16,
    },
    /// A code that is another one turned.
    #[error("code {code} is code {canonical} turned: write {canonical}")]
    Turned {
        /// As asked for.
        code: u16,
        /// Its smallest rotation.
        canonical: u16,
    },
    /// A code that can be mistaken.
    #[error("code {code} can be mistaken for something else; the nearest that serves is {nearest}")]
    Unusable {
        /// As asked for.
        code: u16,
        /// The nearest that serves.
        nearest: u16,
    },
    /// The same twice.
    #[error("code {0} is there twice: two targets of one code cannot be told apart")]
    Twice(u16),
    /// No codes.
    #[error("no codes are asked for")]
    Nothing,
    /// A radius that cannot be printed.
    #[error("a radius of {0} mm cannot be printed: it must be {LEAST_RADIUS} mm or more")]
    Radius(f64),
    /// No room.
    #[error(
        "{asked} targets do not fit: with a centre radius of {radius_mm} mm there is room for {across} x {down} = {} on {paper}",
        across * down
    )]
    TooMany {
        /// How many are asked for.
        asked: usize,
        /// Columns that fit.
        across: usize,
        /// Rows that fit.
        down: usize,
        /// The radius.
        radius_mm: f64,
        /// The paper's name.
        paper: &'static str,
    },
    /// Rows or columns that do not fit.
    #[error("{asked} {what} do not fit: {paper} has room for {room}")]
    Grid {
        /// How many are asked for.
        asked: usize,
        /// `rows` or `columns`.
        what: &'static str,
        /// How many fit.
        room: usize,
        /// The paper's name.
        paper: &'static str,
    },
}

/// Checks a number that is to be a code.
///
/// # Errors
/// Why it is none that serves, with the nearest that does.
pub fn check_code(code: u32) -> Result<u16, TargetSheetError> {
    let near = |code: u32| {
        let usable = usable_codes().into_iter();
        usable.min_by_key(|c| u32::from(*c).abs_diff(code)).unwrap_or_default()
    };
    let small = u16::try_from(code).ok().filter(|c| u32::from(*c) < 1 << RING_BITS);
    let Some(small) = small else {
        return Err(TargetSheetError::OutOfRange { code, nearest: near(code) });
    };
    if is_usable_code(small) {
        return Ok(small);
    }
    let canonical = canonical_code(small);
    Err(if canonical != small && is_usable_code(canonical) {
        TargetSheetError::Turned { code: small, canonical }
    } else {
        TargetSheetError::Unusable { code: small, nearest: near(code) }
    })
}

/// The page.
///
/// # Errors
/// [`TargetSheetError`].
pub fn target_page(sheet: &TargetSheet) -> Result<Page, TargetSheetError> {
    check(sheet)?;
    let [columns, rows] = grid(sheet)?;
    let n = sheet.codes.len();
    let title = format!(
        "beampose · {n} ring-coded targets of 12 bits · centre radius {} mm",
        sheet.radius_mm
    );
    let mut page = Page::titled(sheet.size_mm, title);
    let inside = inside(sheet);
    let step = Vector2::new(inside.x / columns as f64, inside.y / rows as f64);
    let ink = if sheet.style == Style::DarkOnLight { Ink::Black } else { Ink::White };
    for (i, code) in sheet.codes.iter().enumerate() {
        let cell = Vector2::new((i % columns) as f64 + 0.5, (i / columns) as f64 + 0.5);
        let middle = Vector2::repeat(MARGIN) + cell.component_mul(&step);
        let at = middle - Vector2::new(0.0, 0.5 * label_height());
        page.target(at, *code, sheet.radius_mm, ink);
        let below = QUIET * sheet.radius_mm + 0.9 * label_height();
        let label = Vector2::new(-QUIET * sheet.radius_mm, below);
        page.put(at + label, Ink::Black, Shape::Text(code.to_string()));
    }
    Ok(page)
}

fn label_height() -> f64 {
    1.2 * TEXT
}

fn check(sheet: &TargetSheet) -> Result<(), TargetSheetError> {
    if sheet.codes.is_empty() {
        return Err(TargetSheetError::Nothing);
    }
    if !(sheet.radius_mm.is_finite() && sheet.radius_mm >= LEAST_RADIUS) {
        return Err(TargetSheetError::Radius(sheet.radius_mm));
    }
    for (i, code) in sheet.codes.iter().enumerate() {
        check_code(u32::from(*code))?;
        if sheet.codes[..i].contains(code) {
            return Err(TargetSheetError::Twice(*code));
        }
    }
    Ok(())
}

/// The room within the margins and above the ruler.
fn inside(sheet: &TargetSheet) -> Vector2<f64> {
    let [width, height] = sheet.size_mm;
    Vector2::new(width - 2.0 * MARGIN, height - 2.0 * MARGIN - FOOT)
}

/// Columns and rows.
fn grid(sheet: &TargetSheet) -> Result<[usize; 2], TargetSheetError> {
    let side = 2.0 * QUIET * sheet.radius_mm + GAP;
    let inside = inside(sheet);
    let fit = |room: f64, size: f64| (room / size).max(0.0) as usize;
    let (across, down) = (fit(inside.x, side), fit(inside.y, side + label_height()));
    let paper = sheet.paper.name();
    for (asked, room, what) in [(sheet.columns, across, "columns"), (sheet.rows, down, "rows")] {
        if let Some(asked) = asked.filter(|asked| *asked > room || *asked == 0) {
            return Err(TargetSheetError::Grid { asked, what, room, paper });
        }
    }
    let (columns, rows) = (sheet.columns.unwrap_or(across), sheet.rows.unwrap_or(down));
    if sheet.codes.len() > columns * rows {
        let (asked, radius_mm) = (sheet.codes.len(), sheet.radius_mm);
        return Err(TargetSheetError::TooMany {
            asked,
            across: columns,
            down: rows,
            radius_mm,
            paper,
        });
    }
    Ok([columns, rows])
}

/// How many targets fit on a sheet as it is described, its codes aside.
///
/// # Errors
/// Rows or columns that do not fit.
pub fn room(sheet: &TargetSheet) -> Result<usize, TargetSheetError> {
    if !(sheet.radius_mm.is_finite() && sheet.radius_mm >= LEAST_RADIUS) {
        return Err(TargetSheetError::Radius(sheet.radius_mm));
    }
    let empty = TargetSheet { codes: Vec::new(), ..sheet.clone() };
    grid(&empty).map(|[columns, rows]| columns * rows)
}
