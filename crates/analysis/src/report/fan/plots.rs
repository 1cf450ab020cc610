//! Angles against order as in Fig. 4.20, and what each model leaves.

use beampose_photogrammetry::calibrate::pattern::{FanCalibration, FanFit, MeanAngle, StageAxis};
use beampose_photogrammetry::pattern::angle_between;
use maud::{Markup, html};

use super::super::axis::{Axis, Ends};
use super::super::plot::{Layer, Mark, Plot, Shape, legend_entry, symbol};

/// How far the two axes' symbols stand apart at one order, in drawing units.
const APART: f64 = 5.0;

/// Look and place of an axis.
fn look(axis: StageAxis) -> (&'static str, Shape, f64) {
    match axis {
        StageAxis::Horizontal => ("s0", Shape::Circle, -APART),
        StageAxis::Vertical => ("s1", Shape::Square, APART),
    }
}

const AXES: [StageAxis; 2] = [StageAxis::Horizontal, StageAxis::Vertical];

/// The middle of a pair along its axis, in orders.
fn middle(mean: &MeanAngle) -> f64 {
    let (a, b) = match mean.axis {
        StageAxis::Horizontal => (mean.from.m, mean.to.m),
        StageAxis::Vertical => (mean.from.n, mean.to.n),
    };
    f64::midpoint(f64::from(a), f64::from(b))
}

fn layer(class: &str, shift: f64, mark: Mark) -> Layer {
    Layer { class: class.to_owned(), shift, mark }
}

/// Measured angles with the standard deviation of one measurement, and the model's.
pub fn against_order(found: &FanCalibration) -> Markup {
    let mut layers = Vec::new();
    let (mut places, mut values) = (Vec::new(), Vec::new());
    for axis in AXES {
        let (class, shape, shift) = look(axis);
        let mut bars = Vec::new();
        let mut line = Vec::new();
        for (mean, angle) in found.means.iter().zip(&found.corrected) {
            if mean.axis == axis {
                let spread = mean.scatter.unwrap_or(mean.u).to_degrees();
                bars.push((middle(mean), angle.to_degrees(), spread));
                line.extend(computed(&found.fit, mean).map(|a| (middle(mean), a.to_degrees())));
            }
        }
        line.sort_by(|a, b| a.0.total_cmp(&b.0));
        places.extend(bars.iter().map(|b| b.0));
        values.extend(bars.iter().flat_map(|b| [b.1 - b.2, b.1 + b.2]));
        values.extend(line.iter().map(|p| p.1));
        let points = bars.iter().map(|b| (b.0, b.1)).collect();
        layers.push(layer(&format!("{class} fit"), shift, Mark::Line(line)));
        layers.push(layer(&format!("{class} bars"), shift, Mark::Bars(bars)));
        layers.push(layer(class, shift, Mark::Symbols(shape, 7.0, points)));
    }
    let plot = Plot {
        title: "Measured angles against order".to_owned(),
        x: Axis::over("middle of the pair, in orders from the centre", places, 11.0, Ends::Padded),
        y: Axis::over("angle / °", values, 7.0, Ends::AtTicks),
        height: 340.0,
        layers,
    };
    html! {
        figure {
            (legend())
            (plot.draw())
            figcaption {
                "As Fig. 4.20 of the dissertation: the angle between neighbouring beams, corrected to the \
                 reference wavelength and for the known geometry; bars are the standard deviation of one \
                 measurement. Dashed: the model taken."
            }
        }
    }
}

fn computed(fit: &FanFit, mean: &MeanAngle) -> Option<f64> {
    let at = |order| fit.model.direction(&fit.parameters, order, 0.0);
    Some(angle_between(&at(mean.from)?, &at(mean.to)?))
}

/// What each model leaves, with the standard uncertainty of a mean.
pub fn residuals(found: &FanCalibration) -> Markup {
    let fits = found.candidates.iter().filter_map(|c| Some((c.model, c.fit.as_ref().ok()?)));
    let fits: Vec<_> = fits.collect();
    // One scale for all models, so that they can be compared by eye.
    let reach = fits.iter().flat_map(|(_, fit)| {
        fit.residuals.iter().zip(&found.means).flat_map(|(r, m)| [r - m.u, r + m.u])
    });
    let reach: Vec<f64> = reach.map(f64::to_degrees).collect();
    html! {
        figure {
            (legend())
            @for (model, fit) in &fits {
                h3 { (super::title(*model)) }
                (of_model(found, fit, &reach))
            }
            figcaption {
                "Measured minus computed mean angles; bars are the standard uncertainty of a mean, without \
                 what all angles share."
            }
        }
    }
}

fn of_model(found: &FanCalibration, fit: &FanFit, reach: &[f64]) -> Markup {
    let mut layers = vec![layer("zero", 0.0, Mark::Level(0.0, String::new()))];
    let mut places = Vec::new();
    for axis in AXES {
        let (class, shape, shift) = look(axis);
        let of_axis = found.means.iter().zip(&fit.residuals).filter(|(m, _)| m.axis == axis);
        let bars: Vec<_> =
            of_axis.map(|(m, r)| (middle(m), r.to_degrees(), m.u.to_degrees())).collect();
        places.extend(bars.iter().map(|b| b.0));
        let points = bars.iter().map(|b| (b.0, b.1)).collect();
        layers.push(layer(&format!("{class} bars"), shift, Mark::Bars(bars)));
        layers.push(layer(class, shift, Mark::Symbols(shape, 7.0, points)));
    }
    let plot = Plot {
        title: format!("Residuals of the model {}", fit.model.name()),
        x: Axis::over("middle of the pair, in orders from the centre", places, 11.0, Ends::Padded),
        y: Axis::over("residual / °", reach.iter().copied(), 5.0, Ends::AtTicks),
        height: 220.0,
        layers,
    };
    plot.draw()
}

fn legend() -> Markup {
    html! {
        ul.legend { @for axis in AXES {
            @let (class, shape, _) = look(axis);
            (legend_entry(class, &symbol(shape, 8.0, 14.0, 7.0), axis.name()))
        } }
    }
}
