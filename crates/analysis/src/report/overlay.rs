//! Pictures with what was found in them: dots, targets, strays; some of them named.

use beampose_photogrammetry::Order;
use beampose_photogrammetry::solve::{CameraSolution, Observation, Subject};
use maud::{Markup, html};

use super::input::{ReportInput, ReportPicture};
use super::picture::{Thumbnail, thumbnail};
use super::plot::{at, legend_entry};
use crate::numbers::count;

/// Width of a letter of a label and height of a line, in picture units.
const LETTER: f64 = 8.6;
const LINE: f64 = 17.0;

/// All pictures of the input: the first at once, the others on request.
pub fn pictures(input: &ReportInput, width: usize) -> Markup {
    let figure = |picture: &ReportPicture| {
        let capture = input.captures.iter().find(|c| c.id == picture.capture);
        let solution = capture.and_then(|c| c.solution.as_ref().ok());
        figure(picture, solution.and_then(|s| s.cameras.get(&picture.camera)), width)
    };
    let Some((first, others)) = input.pictures.split_first() else { return html! {} };
    html! {
        (legend())
        (figure(first))
        @if !others.is_empty() {
            details {
                summary { "Further pictures " span { "(" (others.len()) ")" } }
                @for picture in others { (figure(picture)) }
            }
        }
    }
}

fn figure(picture: &ReportPicture, solution: Option<&CameraSolution>, width: usize) -> Markup {
    let name = format!("capture {}, camera {}", picture.capture, picture.camera);
    let Some(small) = thumbnail(&picture.image, width) else {
        return html! { p.note { (name) ": the picture is empty." } };
    };
    html! {
        figure.picture {
            (drawing(&name, &small, solution))
            figcaption {
                (name) ". " (counts(solution))
                " Reduced from " (picture.image.width) " × " (picture.image.height) " pixels."
            }
        }
    }
}

fn counts(solution: Option<&CameraSolution>) -> String {
    let Some(solution) = solution else {
        return "This camera was not oriented: nothing is marked.".to_owned();
    };
    let used = |f: fn(&Subject) -> bool| {
        solution.observations.iter().filter(|o| o.used && f(&o.subject)).count()
    };
    let rejected = solution.observations.iter().filter(|o| !o.used).count();
    format!(
        "{} and {} used, {} left out, {}.",
        count(used(|s| matches!(s, Subject::Dot(_))), "dot"),
        count(used(|s| matches!(s, Subject::Target(_))), "target"),
        count(rejected, "outlier"),
        count(solution.strays.len(), "stray spot")
    )
}

fn drawing(name: &str, small: &Thumbnail, solution: Option<&CameraSolution>) -> Markup {
    let view = format!("0 0 {} {}", small.width, small.height);
    // The centre of the top-left pixel is (0, 0), its corner is where the drawing begins.
    let place = |p: [f64; 2]| p.map(|v| (v + 0.5) / small.reduction);
    html! {
        svg viewBox=(view) role="img" aria-label=(name) {
            title { (name) }
            image href=(small.uri) x="0" y="0" width=(small.width) height=(small.height) {}
            @if let Some(solution) = solution {
                @for o in &solution.observations { (mark(o, place(o.at))) }
                @for stray in &solution.strays { (cross(place(*stray))) }
                @for label in labels(solution, small) { (label.draw()) }
            }
        }
    }
}

fn mark(observation: &Observation, [x, y]: [f64; 2]) -> Markup {
    let (class, radius) = match (observation.used, observation.subject) {
        (false, _) => ("rejected", 8.0),
        (true, Subject::Dot(_)) => ("dot", 6.0),
        (true, Subject::Target(_)) => ("target", 10.0),
    };
    html! { circle class=(class) cx=(at(x)) cy=(at(y)) r=(at(radius)) {} }
}

fn cross([x, y]: [f64; 2]) -> Markup {
    let (l, r, t, b) = (at(x - 5.0), at(x + 5.0), at(y - 5.0), at(y + 5.0));
    html! { path.stray d=(format!("M{l} {t}L{r} {b}M{l} {b}L{r} {t}")) {} }
}

/// A text beside a mark.
struct Label {
    class: &'static str,
    text: String,
    /// Left and lower edge.
    at: [f64; 2],
}

impl Label {
    fn draw(&self) -> Markup {
        html! { text class=(self.class) x=(at(self.at[0])) y=(at(self.at[1])) { (self.text) } }
    }

    fn width(&self) -> f64 {
        self.text.chars().count() as f64 * LETTER
    }

    fn covers(&self, other: &Self) -> bool {
        self.at[0] < other.at[0] + other.width()
            && other.at[0] < self.at[0] + self.width()
            && (self.at[1] - other.at[1]).abs() < LINE
    }

    fn covers_mark(&self, [x, y]: [f64; 2]) -> bool {
        let near = 5.0;
        (self.at[0] - near..self.at[0] + self.width() + near).contains(&x)
            && (self.at[1] - LINE..self.at[1] + near).contains(&y)
    }

    fn is_within(&self, small: &Thumbnail) -> bool {
        self.at[0] >= 2.0
            && self.at[0] + self.width() <= small.width as f64 - 2.0
            && self.at[1] >= LINE
            && self.at[1] <= small.height as f64 - 4.0
    }
}

/// Labels of the centre, the outermost corners and every target. Each stands where it hides the
/// fewest marks and no other label, or is left out.
fn labels(solution: &CameraSolution, small: &Thumbnail) -> Vec<Label> {
    let named = named_orders(solution);
    let place = |o: &Observation| o.at.map(|v| (v + 0.5) / small.reduction);
    let marks: Vec<[f64; 2]> = solution.observations.iter().map(place).collect();
    let mut placed: Vec<Label> = Vec::new();
    for observation in &solution.observations {
        let (class, text, away) = match observation.subject {
            Subject::Target(code) => ("of-target", format!("#{code}"), 12.0),
            Subject::Dot(order) if named.contains(&order) => {
                ("of-dot", format!("({}, {})", sign(order.m), sign(order.n)), 9.0)
            }
            Subject::Dot(_) => continue,
        };
        let best = candidates(class, &text, place(observation), away)
            .into_iter()
            .filter(|l| l.is_within(small) && !placed.iter().any(|p| p.covers(l)))
            .min_by_key(|l| marks.iter().filter(|m| l.covers_mark(**m)).count());
        placed.extend(best);
    }
    placed
}

/// Places around a mark: right, left, above, below, then the four corners.
fn candidates(class: &'static str, text: &str, [x, y]: [f64; 2], away: f64) -> Vec<Label> {
    let width = text.chars().count() as f64 * LETTER;
    let (left, middle, right) = (-away - width, -width / 2.0, away);
    let (above, level, below) = (-away, 5.0, away + LINE - 4.0);
    [
        (right, level),
        (left, level),
        (middle, above),
        (middle, below),
        (right, above),
        (left, above),
        (right, below),
        (left, below),
    ]
    .into_iter()
    .map(|(dx, dy)| Label { class, text: text.to_owned(), at: [x + dx, y + dy] })
    .collect()
}

fn sign(order: i32) -> String {
    order.to_string().replace('-', "\u{2212}")
}

/// The centre and the four corners of what was seen.
fn named_orders(solution: &CameraSolution) -> Vec<Order> {
    let orders: Vec<Order> = solution
        .observations
        .iter()
        .filter_map(|o| match o.subject {
            Subject::Dot(order) => Some(order),
            Subject::Target(_) => None,
        })
        .collect();
    let toward = |m: i32, n: i32| orders.iter().copied().max_by_key(|o| (m * o.m + n * o.n, o.m));
    let corners =
        [(1, 1), (1, -1), (-1, 1), (-1, -1)].into_iter().filter_map(|(m, n)| toward(m, n));
    corners.chain([Order { m: 0, n: 0 }]).collect()
}

fn legend() -> Markup {
    let ring = |r: f64| html! { circle cx="14" cy="7" r=(at(r)) {} };
    html! {
        ul.legend.on-picture {
            (legend_entry("dot", &ring(4.5), "dot, with the order (m, n) of centre and corners"))
            (legend_entry("target", &ring(5.5), "coded target, with its code"))
            (legend_entry("rejected", &ring(5.0), "left out as an outlier"))
            (legend_entry("stray", &html! { path d="M10 3L18 11M10 11L18 3" {} }, "stray spot"))
        }
    }
}
