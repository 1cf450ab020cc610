//! A page as SVG: one unit is a millimetre, and the file says so.

use std::fmt::Write as _;

use nalgebra::Vector2;

use super::page::{Ink, Mark, Page, Shape, TEXT};

/// The page. Coordinates have a resolution of a tenth of a micrometre.
#[must_use]
pub fn svg(page: &Page) -> String {
    let (width, height) = (page.width, page.height);
    let mut text = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}mm\" height=\"{height}mm\" \
         viewBox=\"0 0 {width} {height}\" font-family=\"sans-serif\" font-size=\"{TEXT}\">\n\
         <rect x=\"0\" y=\"0\" width=\"{width}\" height=\"{height}\" fill=\"white\"/>\n"
    );
    for mark in &page.marks {
        let _ = writeln!(text, "{}", element(mark));
    }
    text.push_str("</svg>\n");
    text
}

fn element(mark: &Mark) -> String {
    let fill = match mark.ink {
        Ink::Black => "black",
        Ink::White => "white",
    };
    let (x, y) = (short(mark.at.x), short(mark.at.y));
    match &mark.shape {
        Shape::Disc { radius } => {
            format!("<circle cx=\"{x}\" cy=\"{y}\" r=\"{}\" fill=\"{fill}\"/>", short(*radius))
        }
        Shape::Rectangle { width, height } => {
            let (w, h) = (short(*width), short(*height));
            format!("<rect x=\"{x}\" y=\"{y}\" width=\"{w}\" height=\"{h}\" fill=\"{fill}\"/>")
        }
        Shape::Sector { inner, outer, from, to } => {
            format!(
                "<path d=\"{}\" fill=\"{fill}\"/>",
                sector(&mark.at, [*inner, *outer], [*from, *to])
            )
        }
        Shape::Text(said) => {
            format!("<text x=\"{x}\" y=\"{y}\" fill=\"{fill}\">{}</text>", escaped(said))
        }
    }
}

/// Out along the first edge, clockwise on the outer circle, in, and back on the inner one.
fn sector(centre: &Vector2<f64>, [inner, outer]: [f64; 2], [from, to]: [f64; 2]) -> String {
    let at = |radius: f64, angle: f64| {
        let p = centre + Vector2::new(angle.cos(), angle.sin()) * radius;
        format!("{} {}", short(p.x), short(p.y))
    };
    let large = u8::from(to - from > std::f64::consts::PI);
    format!(
        "M{} A{r} {r} 0 {large} 1 {} L{} A{q} {q} 0 {large} 0 {} Z",
        at(outer, from),
        at(outer, to),
        at(inner, to),
        at(inner, from),
        r = short(outer),
        q = short(inner)
    )
}

fn short(value: f64) -> String {
    let text = format!("{value:.4}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".to_owned() } else { text.to_owned() }
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short_and_text_is_escaped() {
        assert_eq!((short(6.0), short(-0.00001), short(1.23456)).0, "6");
        assert_eq!((short(-0.00001), short(1.23456)), ("0".to_owned(), "1.2346".to_owned()));
        assert_eq!(escaped("a < b & c"), "a &lt; b &amp; c");
    }
}
