//! Points that another program found, from CSV.
//!
//! One line a point under a heading that names the columns in any order: `image`, `x_px`, `y_px`,
//! and the place on the sheet as `board_x_mm`, `board_y_mm`, or as `board_x_square`,
//! `board_y_square` in squares of a size that the caller knows. A column `index` is passed over.
//! Pixels count from the centre of the top-left pixel, as OpenCV's do.

use std::collections::BTreeMap;

use nalgebra::Vector2;

use super::{SheetPoint, View};

/// What is wrong in which line; line 1 is the heading.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{line}: {reason}")]
pub struct ObservationsError {
    /// The line.
    pub line: usize,
    /// What is wrong.
    pub reason: String,
}

/// Where the columns are.
struct Heading {
    image: usize,
    board: [usize; 2],
    pixel: [usize; 2],
    /// Millimetres per unit of the board's columns.
    unit: f64,
    count: usize,
}

/// Reads the views, in the order in which their names first come. `square_mm` is the size of a
/// square, for a table in squares.
///
/// # Errors
/// [`ObservationsError`].
pub fn read_observations(text: &str, square_mm: f64) -> Result<Vec<View>, ObservationsError> {
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    let mut lines =
        text.lines().enumerate().map(|(i, l)| (i + 1, l.trim())).filter(|(_, l)| !l.is_empty());
    let fault = |line: usize, reason: String| ObservationsError { line, reason };
    let (at, first) = lines.next().ok_or_else(|| fault(1, "the table is empty".to_owned()))?;
    let heading = heading(first, square_mm).map_err(|reason| fault(at, reason))?;
    let mut views: Vec<View> = Vec::new();
    let mut known: BTreeMap<String, usize> = BTreeMap::new();
    for (at, line) in lines {
        let (name, point) = heading.point(line).map_err(|reason| fault(at, reason))?;
        let index = *known.entry(name.clone()).or_insert_with(|| {
            views.push(View { name, points: Vec::new() });
            views.len() - 1
        });
        if views[index].points.iter().any(|p| p.on_sheet == point.on_sheet) {
            let place = format!("({}, {})", point.on_sheet.x, point.on_sheet.y);
            return Err(fault(
                at,
                format!("the point {place} mm repeats in {}", views[index].name),
            ));
        }
        views[index].points.push(point);
    }
    Ok(views)
}

fn heading(line: &str, square_mm: f64) -> Result<Heading, String> {
    const KNOWN: [&str; 8] = [
        "image",
        "index",
        "board_x_mm",
        "board_y_mm",
        "board_x_square",
        "board_y_square",
        "x_px",
        "y_px",
    ];
    let names: Vec<&str> = line.split(',').map(str::trim).collect();
    if let Some(strange) = names.iter().find(|name| !KNOWN.contains(name)) {
        return Err(format!("unknown column `{strange}`; those known are {}", KNOWN.join(", ")));
    }
    let place = |name: &str| names.iter().position(|n| *n == name);
    let need = |name: &str| place(name).ok_or_else(|| format!("there is no column `{name}`"));
    let (suffix, unit) =
        if place("board_x_mm").is_some() { ("mm", 1.0) } else { ("square", square_mm) };
    Ok(Heading {
        image: need("image")?,
        board: [need(&format!("board_x_{suffix}"))?, need(&format!("board_y_{suffix}"))?],
        pixel: [need("x_px")?, need("y_px")?],
        unit,
        count: names.len(),
    })
}

impl Heading {
    fn point(&self, line: &str) -> Result<(String, SheetPoint), String> {
        let cells: Vec<&str> = line.split(',').map(str::trim).collect();
        if cells.len() != self.count {
            return Err(format!("expected {} values, found {}", self.count, cells.len()));
        }
        let number = |at: usize| match cells[at].parse::<f64>() {
            Ok(value) if value.is_finite() => Ok(value),
            _ => Err(format!("expected a number, found `{}`", cells[at])),
        };
        let pair = |at: [usize; 2]| Ok::<_, String>(Vector2::new(number(at[0])?, number(at[1])?));
        let on_sheet = pair(self.board)? * self.unit;
        let point = SheetPoint { on_sheet, pixel: pair(self.pixel)?, radius_mm: 0.0 };
        Ok((cells[self.image].to_owned(), point))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_may_stand_in_any_order_and_squares_have_a_size() {
        let text = "y_px, x_px, image, board_x_square, board_y_square\n2,1,a.jpg,3,4\n\n5,6,b.jpg,0,1\n7,8,a.jpg,0,0\n";
        let views = read_observations(text, 30.0).unwrap();
        let counts: Vec<_> = views.iter().map(|v| (v.name.as_str(), v.points.len())).collect();
        assert_eq!(counts, [("a.jpg", 2), ("b.jpg", 1)]);
        assert_eq!(views[0].points[0].on_sheet, Vector2::new(90.0, 120.0));
        assert_eq!(views[0].points[0].pixel, Vector2::new(1.0, 2.0));
    }

    #[test]
    fn a_table_that_is_wrong_is_refused_with_its_line() {
        let good = "image,board_x_mm,board_y_mm,x_px,y_px\n";
        let cases = [
            ("", "1: the table is empty"),
            ("image,x_px,y_px\n", "1: there is no column `board_x_square`"),
            ("image,board_x_mm,board_y_mm,x_px\n", "1: there is no column `y_px`"),
            (&format!("{good}a,0,0,1,2\nb,0,0,1\n"), "3: expected 5 values, found 4"),
            (&format!("{good}a,0,0,1,inf\n"), "2: expected a number, found `inf`"),
            (&format!("{good}a,0,0,1,2\n\na,0,0,1,3\n"), "4: the point (0, 0) mm repeats in a"),
        ];
        for (text, expected) in cases {
            assert_eq!(read_observations(text, 1.0).unwrap_err().to_string(), expected);
        }
        let strange = read_observations("image,sharpness\n", 1.0).unwrap_err().to_string();
        assert!(strange.starts_with("1: unknown column `sharpness`"), "{strange}");
    }
}
