//! Which dot is which beam.
//!
//! In each picture the dots are labelled as a grid (`grid`), anchored at the brighter zero order or
//! by the pattern's extent (`anchor`); the cameras' labels are brought to agree by triangulation
//! (`agree`); the quarter turn, which a square pattern leaves open, is chosen nearest to the prior
//! after the module was fitted in space (`turn`). Nothing here knows a wall's shape.

mod agree;
mod anchor;
mod grid;
mod turn;

pub use grid::{Cell, label_grid};
pub use turn::{Labelled, choose_turn};

use nalgebra::Vector2;

use crate::pattern::{Order, Pattern};
use crate::pose::Station;

/// What one camera saw of the dots.
#[derive(Debug, Clone, PartialEq)]
pub struct View {
    /// Where the camera stands.
    pub station: Station,
    /// Undistorted normalised coordinates (x/z, y/z) of its dots.
    pub directions: Vec<Vector2<f64>>,
    /// Fitted amplitude of each dot.
    pub amplitudes: Vec<f64>,
}

/// The beam of each dot of each view, up to one quarter turn and mirror-free, the same turn for all
/// views; `None` for dots of no beam. `Err` says why nothing could be labelled.
///
/// # Errors
/// A reason in words: too few dots, or views that cannot be brought to agree.
pub fn label_views(views: &[View], pattern: &Pattern) -> Result<Vec<Vec<Option<Order>>>, String> {
    let mut labels: Vec<Vec<Option<Order>>> = views
        .iter()
        .map(|view| {
            let cells = label_grid(&view.directions);
            anchor::anchor(&cells, &view.amplitudes, pattern)
        })
        .collect();
    let count = |l: &Vec<Option<Order>>| l.iter().flatten().count();
    if labels.iter().filter(|l| count(l) >= 9).count() < 2 {
        let counts: Vec<String> = labels.iter().map(|l| count(l).to_string()).collect();
        return Err(format!(
            "fewer than two cameras see a grid of dots (dots in a grid: {})",
            counts.join(", ")
        ));
    }
    agree::agree(views, &mut labels, pattern)?;
    Ok(labels)
}

/// A quarter turn of the labels, clockwise as the module sees it.
#[must_use]
pub fn quarter_turn(order: Order) -> Order {
    Order { m: -order.n, n: order.m }
}
