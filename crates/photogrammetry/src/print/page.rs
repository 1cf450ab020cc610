//! A page: its size and what is printed on it, in millimetres from its top left corner.

use nalgebra::Vector2;

use crate::scene::{RING_BITS, ring_sectors};

/// Room that no printer prints on, and some.
pub(super) const MARGIN: f64 = 12.0;
/// Height of the strip at the bottom that holds the ruler.
pub(super) const FOOT: f64 = 14.0;
/// Length of the ruler.
const RULER: f64 = 100.0;
/// Height of small print.
pub(super) const TEXT: f64 = 2.6;
/// Quiet zone around a target, in radii of its centre disc: the ring ends at 3.
pub(super) const QUIET: f64 = 3.6;

/// Paper, upright.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Paper {
    /// 210 mm x 297 mm.
    A4,
    /// 297 mm x 420 mm.
    A3,
}

impl Paper {
    /// Width and height, millimetres.
    #[must_use]
    pub const fn size_mm(self) -> [f64; 2] {
        match self {
            Self::A4 => [210.0, 297.0],
            Self::A3 => [297.0, 420.0],
        }
    }

    /// Its name.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::A4 => "A4",
            Self::A3 => "A3",
        }
    }
}

/// Black or white.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ink {
    /// Printed.
    Black,
    /// Left free on black.
    White,
}

impl Ink {
    pub(super) const fn other(self) -> Self {
        match self {
            Self::Black => Self::White,
            Self::White => Self::Black,
        }
    }
}

/// A form, around the place of its mark.
#[derive(Debug, Clone, PartialEq)]
pub enum Shape {
    /// A filled circle.
    Disc {
        /// Millimetres.
        radius: f64,
    },
    /// A part of a ring: clockwise from `from` to `to`, radians from x towards y (down).
    Sector {
        /// Inner radius, millimetres.
        inner: f64,
        /// Outer radius.
        outer: f64,
        /// Where it begins.
        from: f64,
        /// Where it ends, less than a turn on.
        to: f64,
    },
    /// A rectangle from its top left corner.
    Rectangle {
        /// Width, millimetres.
        width: f64,
        /// Height.
        height: f64,
    },
    /// Text that begins here, on its base line.
    Text(String),
}

/// A form at its place.
#[derive(Debug, Clone, PartialEq)]
pub struct Mark {
    /// Millimetres from the top left corner of the page.
    pub at: Vector2<f64>,
    /// What is drawn.
    pub shape: Shape,
    /// With what.
    pub ink: Ink,
}

/// A page, later marks on top of earlier ones.
#[derive(Debug, Clone, PartialEq)]
pub struct Page {
    /// Width, millimetres.
    pub width: f64,
    /// Height.
    pub height: f64,
    /// What is on it.
    pub marks: Vec<Mark>,
}

impl Page {
    /// An empty page with a title and a ruler to check the print with.
    pub(super) fn titled([width, height]: [f64; 2], title: String) -> Self {
        let mut page = Self { width, height, marks: Vec::new() };
        page.put(Vector2::new(MARGIN, MARGIN - 4.0), Ink::Black, Shape::Text(title));
        page.ruler();
        page
    }

    pub(super) fn put(&mut self, at: Vector2<f64>, ink: Ink, shape: Shape) {
        self.marks.push(Mark { at, shape, ink });
    }

    /// A ruler of 100 mm with a tick every 10 mm: a print that was fitted to the page shows there.
    fn ruler(&mut self) {
        let base = Vector2::new(MARGIN, self.height - MARGIN + 4.0);
        let line = Shape::Rectangle { width: RULER, height: 0.2 };
        self.put(base, Ink::Black, line);
        for tick in 0..=10 {
            let length = if tick % 5 == 0 { 4.0 } else { 2.5 };
            let at = base + Vector2::new(10.0 * f64::from(tick) - 0.1, -length);
            self.put(at, Ink::Black, Shape::Rectangle { width: 0.2, height: length });
        }
        let said = format!("{RULER} mm: measure it; print at 100 %, not fitted to the page");
        self.put(base + Vector2::new(RULER + 4.0, 0.0), Ink::Black, Shape::Text(said));
    }

    /// A ring-coded target; on paper of the colour of the disc it brings its own ground.
    pub(super) fn target(&mut self, at: Vector2<f64>, code: u16, radius: f64, ink: Ink) {
        if ink == Ink::White {
            let side = 2.0 * QUIET * radius;
            let corner = at - Vector2::repeat(0.5 * side);
            let ground = Shape::Rectangle { width: side, height: side };
            self.put(corner, ink.other(), ground);
        }
        self.put(at, ink, Shape::Disc { radius });
        for (from, to) in runs(code) {
            self.put(at, ink, Shape::Sector { inner: 2.0 * radius, outer: 3.0 * radius, from, to });
        }
    }
}

/// The runs of ones around the ring as angles: neighbours in one piece, so that no hairline parts
/// them.
fn runs(code: u16) -> Vec<(f64, f64)> {
    let sectors = ring_sectors(code);
    let n = sectors.len();
    let angle = |i: usize| std::f64::consts::TAU * i as f64 / f64::from(RING_BITS);
    let begins = |i: &usize| sectors[*i] && !sectors[(i + n - 1) % n];
    let length = |i: usize| (0..n).take_while(|k| sectors[(i + k) % n]).count();
    (0..n).filter(begins).map(|i| (angle(i), angle(i + length(i)))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_of_ones_are_one_piece_each() {
        let sixth = std::f64::consts::TAU / 6.0;
        // 45 is 000000101101: one sector, two, one; read from the first, most significant.
        let pieces = runs(45);
        assert_eq!(pieces.len(), 3);
        assert!((pieces[1].1 - pieces[1].0 - sixth).abs() < 1e-12, "{pieces:?}");
        // A run over the end of the ring is one piece too.
        assert_eq!(runs(0b1000_0000_0001).len(), 1);
    }
}
