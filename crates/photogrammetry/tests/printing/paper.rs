//! Reads the few elements of SVG that a page is made of, and draws them.

use beampose_photogrammetry::GrayImage;
use nalgebra::Vector2;

/// Samples along the side of a pixel.
const STEPS: usize = 4;
/// Steps of a flattened arc.
const ARC: usize = 24;

pub struct Rectangle {
    pub x: f64,
    pub y: f64,
    pub width: f64,
    pub height: f64,
}

enum Form {
    Disc(Vector2<f64>, f64),
    Rectangle(Rectangle),
    Polygon(Vec<Vector2<f64>>),
}

/// A printed page.
pub struct Printed {
    size: [f64; 2],
    forms: Vec<(Form, bool)>,
    texts: Vec<(Vector2<f64>, String)>,
}

impl Printed {
    pub fn parse(text: &str) -> Self {
        let mut page = Self { size: [0.0; 2], forms: Vec::new(), texts: Vec::new() };
        for line in text.lines() {
            let number = |name: &str| attribute(line, name).parse::<f64>().unwrap();
            let is_white = || attribute(line, "fill") == "white";
            let pair = |x: &str, y: &str| Vector2::new(number(x), number(y));
            if line.starts_with("<svg") {
                let size =
                    |name: &str| attribute(line, name).trim_end_matches("mm").parse().unwrap();
                page.size = [size("width"), size("height")];
            } else if line.starts_with("<circle") {
                page.forms.push((Form::Disc(pair("cx", "cy"), number("r")), is_white()));
            } else if line.starts_with("<rect") {
                let (x, y) = (number("x"), number("y"));
                let (width, height) = (number("width"), number("height"));
                let form = Form::Rectangle(Rectangle { x, y, width, height });
                page.forms.push((form, is_white()));
            } else if line.starts_with("<path") {
                page.forms.push((Form::Polygon(polygon(attribute(line, "d"))), is_white()));
            } else if line.starts_with("<text") {
                let said = line.split('>').nth(1).unwrap().split('<').next().unwrap();
                page.texts.push((pair("x", "y"), said.to_owned()));
            } else {
                assert_eq!(line, "</svg>");
            }
        }
        page
    }

    pub fn rectangles(&self) -> impl Iterator<Item = &Rectangle> {
        self.forms.iter().filter_map(|(form, _)| match form {
            Form::Rectangle(r) => Some(r),
            _ => None,
        })
    }

    pub fn text_at(&self, said: &str) -> Vector2<f64> {
        self.texts.iter().find(|t| t.1 == said).unwrap().0
    }

    /// The page at so many pixels a millimetre, the middle of the top left pixel half a pixel in;
    /// ink is not quite black and paper not quite white.
    pub fn picture(&self, scale: f64) -> GrayImage {
        let [width, height] = self.size.map(|s| (s * scale).round() as usize);
        let mut inside = vec![[[true; STEPS]; STEPS]; width * height];
        for (form, is_white) in &self.forms {
            let [low, high] = form.extent();
            let range = |from: f64, to: f64, size: usize| {
                (from * scale - 1.0).max(0.0) as usize..((to * scale + 2.0) as usize).min(size)
            };
            for y in range(low.y, high.y, height) {
                for x in range(low.x, high.x, width) {
                    for (j, row) in inside[y * width + x].iter_mut().enumerate() {
                        for (i, sample) in row.iter_mut().enumerate() {
                            let part = |k: usize| (k as f64 + 0.5) / STEPS as f64;
                            let at = Vector2::new(x as f64 + part(i), y as f64 + part(j)) / scale;
                            if form.holds(&at) {
                                *sample = *is_white;
                            }
                        }
                    }
                }
            }
        }
        let grey = |pixel: &[[bool; STEPS]; STEPS]| {
            let white = pixel.iter().flatten().filter(|s| **s).count() as f64;
            (40.0 + 180.0 * white / (STEPS * STEPS) as f64).round() as u8
        };
        GrayImage { width, height, data: inside.iter().map(grey).collect() }
    }
}

impl Form {
    fn extent(&self) -> [Vector2<f64>; 2] {
        match self {
            Self::Disc(at, r) => [at - Vector2::repeat(*r), at + Vector2::repeat(*r)],
            Self::Rectangle(r) => {
                [Vector2::new(r.x, r.y), Vector2::new(r.x + r.width, r.y + r.height)]
            }
            Self::Polygon(points) => {
                let first = [points[0], points[0]];
                points.iter().fold(first, |[low, high], p| [low.inf(p), high.sup(p)])
            }
        }
    }

    fn holds(&self, at: &Vector2<f64>) -> bool {
        match self {
            Self::Disc(centre, r) => (at - centre).norm() < *r,
            Self::Rectangle(r) => {
                (r.x..r.x + r.width).contains(&at.x) && (r.y..r.y + r.height).contains(&at.y)
            }
            Self::Polygon(points) => {
                let edges = points.iter().zip(points.iter().cycle().skip(1));
                let crosses = |(a, b): &(&Vector2<f64>, &Vector2<f64>)| {
                    (a.y > at.y) != (b.y > at.y)
                        && at.x < a.x + (at.y - a.y) / (b.y - a.y) * (b.x - a.x)
                };
                edges.filter(crosses).count() % 2 == 1
            }
        }
    }
}

fn attribute<'a>(line: &'a str, name: &str) -> &'a str {
    let begin = line.find(&format!(" {name}=\"")).unwrap() + name.len() + 3;
    line[begin..].split('"').next().unwrap()
}

/// A path of `M`, `L`, `A` and `Z`, arcs flattened.
fn polygon(path: &str) -> Vec<Vector2<f64>> {
    let words: Vec<&str> = path.split(' ').collect();
    let number =
        |i: usize| words[i].trim_start_matches(char::is_alphabetic).parse::<f64>().unwrap();
    let mut points = Vec::new();
    let mut i = 0;
    while i < words.len() {
        match words[i].chars().next().unwrap() {
            'M' | 'L' => {
                points.push(Vector2::new(number(i), number(i + 1)));
                i += 2;
            }
            'A' => {
                let to = Vector2::new(number(i + 5), number(i + 6));
                let from = *points.last().unwrap();
                points.extend(arc(from, to, number(i), [words[i + 3] == "1", words[i + 4] == "1"]));
                i += 7;
            }
            _ => {
                assert_eq!(words[i], "Z");
                i += 1;
            }
        }
    }
    points
}

/// The points of a circular arc after its first, as SVG 1.1, appendix F.6 has it.
fn arc(
    from: Vector2<f64>,
    to: Vector2<f64>,
    radius: f64,
    [large, sweep]: [bool; 2],
) -> Vec<Vector2<f64>> {
    let chord = to - from;
    let height = (radius * radius - 0.25 * chord.norm_squared()).max(0.0).sqrt();
    let side = if large == sweep { 1.0 } else { -1.0 };
    let across = Vector2::new(-chord.y, chord.x).normalize();
    let centre = (from + to) * 0.5 - across * (side * height);
    let angle = |p: Vector2<f64>| (p.y - centre.y).atan2(p.x - centre.x);
    let first = angle(from);
    let turn = (angle(to) - first).rem_euclid(std::f64::consts::TAU);
    let turn = if sweep { turn } else { turn - std::f64::consts::TAU };
    (1..=ARC)
        .map(|k| first + turn * k as f64 / ARC as f64)
        .map(|a| centre + Vector2::new(a.cos(), a.sin()) * radius)
        .collect()
}
