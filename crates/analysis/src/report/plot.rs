//! Plots as SVG: axes, ticks, series, a legend in HTML. Colours and strokes are CSS classes, so
//! that a plot follows the page into the dark and onto paper.

use maud::{Markup, html};

use super::axis::Axis;

/// What a series is drawn with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Shape {
    /// A filled circle.
    Circle,
    /// A filled square.
    Square,
    /// A ring.
    Ring,
}

/// How a series is drawn.
#[derive(Debug, Clone)]
pub enum Mark {
    /// Symbols at (x, y).
    Symbols(Shape, f64, Vec<(f64, f64)>),
    /// Error bars: (x, y, half length).
    Bars(Vec<(f64, f64, f64)>),
    /// A polyline.
    Line(Vec<(f64, f64)>),
    /// A level across the plot, with a text at its right end.
    Level(f64, String),
    /// A line from bottom to top, with a text at its upper end.
    Upright(f64, String),
    /// A filled rectangle: from and to in x, from and to in y.
    Area([f64; 2], [f64; 2]),
}

/// A series with its CSS class and its sideways shift in drawing units.
#[derive(Debug, Clone)]
pub struct Layer {
    /// CSS classes.
    pub class: String,
    /// Shift to the right, so that series at the same x do not cover each other.
    pub shift: f64,
    /// How it is drawn.
    pub mark: Mark,
}

/// A plot.
#[derive(Debug, Clone)]
pub struct Plot {
    /// What it shows, for people who do not see it.
    pub title: String,
    /// Horizontal axis.
    pub x: Axis,
    /// Vertical axis.
    pub y: Axis,
    /// Height in drawing units; the width is [`WIDTH`].
    pub height: f64,
    /// Series, first drawn first.
    pub layers: Vec<Layer>,
}

/// Width of every plot in drawing units.
pub const WIDTH: f64 = 760.0;
const LEFT: f64 = 62.0;
const TOP: f64 = 26.0;
const BOTTOM: f64 = 42.0;

/// A coordinate as SVG wants it: a tenth of a drawing unit is below what anybody sees.
pub fn at(value: f64) -> String {
    let text = format!("{value:.1}");
    if text == "-0.0" { "0.0".to_owned() } else { text }
}

impl Plot {
    /// Right end of the axes: texts of levels stand beyond it, where no data are.
    fn right(&self) -> f64 {
        let named = |l: &Layer| matches!(&l.mark, Mark::Level(_, text) if !text.is_empty());
        WIDTH - if self.layers.iter().any(named) { 72.0 } else { 16.0 }
    }

    fn x_at(&self, x: f64) -> f64 {
        self.x.place(x, LEFT, self.right())
    }

    fn y_at(&self, y: f64) -> f64 {
        self.y.place(y, self.height - BOTTOM, TOP)
    }

    /// The drawing.
    pub fn draw(&self) -> Markup {
        let view = format!("0 0 {} {}", at(WIDTH), at(self.height));
        html! {
            div.plot { svg viewBox=(view) role="img" aria-label=(self.title) {
                title { (self.title) }
                (self.grid())
                @for layer in &self.layers { (self.layer(layer)) }
                (self.labels())
            } }
        }
    }

    fn grid(&self) -> Markup {
        let base = self.height - BOTTOM;
        html! {
            g.grid {
                @for (value, _) in self.y.ticks() {
                    line x1=(at(LEFT)) x2=(at(self.right())) y1=(at(self.y_at(value))) y2=(at(self.y_at(value))) {}
                }
            }
            g.axis {
                line x1=(at(LEFT)) x2=(at(self.right())) y1=(at(base)) y2=(at(base)) {}
                @for (value, _) in self.x.ticks() {
                    line x1=(at(self.x_at(value))) x2=(at(self.x_at(value))) y1=(at(base)) y2=(at(base + 5.0)) {}
                }
            }
        }
    }

    fn labels(&self) -> Markup {
        let base = self.height - BOTTOM;
        let middle = f64::midpoint(LEFT, self.right());
        html! {
            g.ticks {
                @for (value, text) in self.y.ticks() {
                    text x=(at(LEFT - 8.0)) y=(at(self.y_at(value) + 4.0)) text-anchor="end" { (text) }
                }
                @for (value, text) in self.x.ticks() {
                    text x=(at(self.x_at(value))) y=(at(base + 18.0)) text-anchor="middle" { (text) }
                }
            }
            g.names {
                text x="4" y="13" { (self.y.label) }
                text x=(at(middle)) y=(at(self.height - 6.0)) text-anchor="middle" { (self.x.label) }
            }
        }
    }

    fn layer(&self, layer: &Layer) -> Markup {
        let x = |v: f64| self.x_at(v) + layer.shift;
        html! {
            g class=(layer.class) {
                @match &layer.mark {
                    Mark::Symbols(shape, size, points) => {
                        @for (px, py) in points.iter().filter(is_finite) {
                            (symbol(*shape, *size, x(*px), self.y_at(*py)))
                        }
                    }
                    Mark::Bars(bars) => {
                        @for (bx, by, half) in bars.iter().filter(|b| is_finite(&&(b.0, b.1 + b.2))) { (self.bar(x(*bx), *by, *half)) }
                    }
                    Mark::Line(points) => {
                        @let line = points.iter().filter(is_finite).map(|p| (x(p.0), self.y_at(p.1)));
                        polyline points=(path(line)) {}
                    }
                    Mark::Level(value, text) => {
                        @if self.y.shows(*value) { (self.level(*value, text)) }
                    }
                    Mark::Upright(value, text) => {
                        @if self.x.shows(*value) { (self.upright(x(*value), text)) }
                    }
                    Mark::Area(along, up) => { (self.area(*along, *up)) }
                }
            }
        }
    }

    fn bar(&self, x: f64, y: f64, half: f64) -> Markup {
        let (low, high) = (self.y_at(y - half), self.y_at(y + half));
        let d = format!(
            "M{x0} {high}H{x1}M{x} {high}V{low}M{x0} {low}H{x1}",
            x0 = at(x - 3.5),
            x1 = at(x + 3.5),
            x = at(x),
            high = at(high),
            low = at(low)
        );
        html! { path d=(d) {} }
    }

    fn upright(&self, x: f64, text: &str) -> Markup {
        // Where there is no room to the right, the text stands to the left.
        let (anchor, beside) = if x > 0.7 * self.right() { ("end", -5.0) } else { ("start", 5.0) };
        html! {
            line x1=(at(x)) x2=(at(x)) y1=(at(self.height - BOTTOM)) y2=(at(TOP)) {}
            @if !text.is_empty() {
                text x=(at(x + beside)) y=(at(TOP + 10.0)) text-anchor=(anchor) { (text) }
            }
        }
    }

    fn area(&self, along: [f64; 2], up: [f64; 2]) -> Markup {
        let [left, right] = along.map(|v| self.x_at(self.x.clamp(v)));
        let [low, high] = up.map(|v| self.y_at(self.y.clamp(v)));
        let (width, height) = (right - left, low - high);
        html! {
            @if width > 0.0 && height > 0.0 {
                rect x=(at(left)) y=(at(high)) width=(at(width)) height=(at(height)) {}
            }
        }
    }

    fn level(&self, value: f64, text: &str) -> Markup {
        let y = self.y_at(value);
        html! {
            line x1=(at(LEFT)) x2=(at(self.right())) y1=(at(y)) y2=(at(y)) {}
            @if !text.is_empty() {
                text x=(at(self.right() + 6.0)) y=(at(y + 4.0)) { (text) }
            }
        }
    }
}

/// One symbol of about `size` drawing units across.
pub fn symbol(shape: Shape, size: f64, x: f64, y: f64) -> Markup {
    let half = size / 2.0;
    html! {
        @match shape {
            Shape::Circle => circle cx=(at(x)) cy=(at(y)) r=(at(half)) {},
            Shape::Ring => circle.ring cx=(at(x)) cy=(at(y)) r=(at(half)) {},
            Shape::Square => rect x=(at(x - half)) y=(at(y - half)) width=(at(size)) height=(at(size)) {},
        }
    }
}

/// What is not a number is not drawn.
fn is_finite(point: &&(f64, f64)) -> bool {
    point.0.is_finite() && point.1.is_finite()
}

fn path(points: impl Iterator<Item = (f64, f64)>) -> String {
    points.map(|(x, y)| format!("{},{}", at(x), at(y))).collect::<Vec<_>>().join(" ")
}

/// One entry of a legend: a small drawing and its meaning.
pub fn legend_entry(class: &str, drawing: &Markup, meaning: &str) -> Markup {
    html! {
        li {
            svg.key viewBox="0 0 28 14" aria-hidden="true" { g class=(class) { (drawing) } }
            (meaning)
        }
    }
}
