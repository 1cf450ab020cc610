//! The budget of one angle: bars and the table of the dissertation (4.1).

use beampose_photogrammetry::calibrate::pattern::{Budget, BudgetSizes, BudgetSource};
use maud::{Markup, html};

use super::super::plot::at;
use crate::numbers::{coarse, fixed};

const WIDTH: f64 = 760.0;
/// Where bars begin: the names stand left of it.
const LEFT: f64 = 190.0;
const ROW: f64 = 26.0;
const BAR: f64 = 14.0;

pub fn budget(budget: &Budget, sizes: &BudgetSizes) -> Markup {
    html! {
        (bars(budget))
        (table(budget, sizes))
        p.note {
            "For an angle of " (fixed(sizes.angle.to_degrees(), 2)) "° and a plane at " (sizes.distance)
            " mm, from the declared standard uncertainties, whatever the measured angles scatter by. At \
             size: the effect of an error of the stated size, as Table 4.1 has it. The height of a dot acts \
             by its square: the root mean square of its effect is √3 times that at size. Drawn: root mean \
             square error of " (budget.draws) " draws through the geometry, each line by itself, and the \
             last with everything off."
        }
    }
}

fn bars(budget: &Budget) -> Markup {
    let rows: Vec<(&str, f64, &str)> = budget
        .sources
        .iter()
        .map(|s| (s.name, s.closed, if s.is_shared { "s1" } else { "s0" }))
        .chain([("combined", budget.closed, "s3")])
        .collect();
    let most = rows.iter().map(|r| r.1).fold(f64::MIN_POSITIVE, f64::max);
    let height = ROW * rows.len() as f64 + 4.0;
    let view = format!("0 0 {} {}", at(WIDTH), at(height));
    html! {
        figure {
            ul.legend {
                (super::super::plot::legend_entry("s0", &key(), "differs from measurement to measurement"))
                (super::super::plot::legend_entry("s1", &key(), "the same for a whole run"))
            }
            div.plot { svg viewBox=(view) role="img" aria-label="contributions to the uncertainty of one angle" {
                @for (i, (name, value, class)) in rows.iter().enumerate() {
                    @let y = ROW * i as f64 + 4.0;
                    @let long = (WIDTH - LEFT - 90.0) * value / most;
                    g.names { text x=(at(LEFT - 10.0)) y=(at(y + BAR - 2.0)) text-anchor="end" { (name) } }
                    g class=(class) { rect x=(at(LEFT)) y=(at(y)) width=(at(long.max(0.6))) height=(at(BAR)) {} }
                    g.ticks { text x=(at(LEFT + long + 8.0)) y=(at(y + BAR - 2.0)) { (fixed(value.to_degrees(), 5)) "°" } }
                }
            } }
            figcaption { "Contributions to the standard uncertainty of one measured angle." }
        }
    }
}

fn key() -> Markup {
    html! { rect x="4" y="2" width="20" height="10" {} }
}

fn table(budget: &Budget, sizes: &BudgetSizes) -> Markup {
    let mm = |size: f64| format!("{} mm", coarse(size));
    let stated = [
        format!("{}°", fixed(sizes.stage_reading.to_degrees(), 5)),
        mm(sizes.offset_across),
        mm(sizes.offset_along),
        mm(sizes.dot_across),
        mm(sizes.dot_height),
        format!("{} %", fixed(100.0 * sizes.wavelength, 4)),
    ];
    let share = |u: f64| format!("{} %", fixed(100.0 * (u / budget.closed).powi(2), 1));
    html! {
        table {
            thead { tr {
                th { "source" } th { "standard uncertainty" } th { "at size" br; "°" } th { "contribution" br; "°" }
                th { "drawn" br; "°" } th { "relative" } th { "of the variance" }
            } }
            tbody {
                @for (source, size) in budget.sources.iter().zip(stated) {
                    (line(source, &size, sizes.angle, &share(source.closed)))
                }
                (sum("random", budget.random, &share(budget.random)))
                (sum("shared", budget.shared, &share(budget.shared)))
                tr {
                    th { strong { "combined" } } td { } td { }
                    td { strong { (fixed(budget.closed.to_degrees(), 5)) } }
                    td { strong { (fixed(budget.drawn.to_degrees(), 5)) } }
                    td { (fixed(100.0 * budget.closed / sizes.angle, 4)) " %" } td { }
                }
            }
        }
    }
}

fn line(source: &BudgetSource, size: &str, angle: f64, share: &str) -> Markup {
    html! {
        tr {
            th { (source.name) } td { (size) }
            td { (fixed(source.at_size.to_degrees(), 6)) }
            td { (fixed(source.closed.to_degrees(), 6)) }
            td { (fixed(source.drawn.to_degrees(), 6)) }
            td { (fixed(100.0 * source.closed / angle, 4)) " %" }
            td { (share) }
        }
    }
}

fn sum(name: &str, u: f64, share: &str) -> Markup {
    html! {
        tr { th { (name) } td { } td { } td { (fixed(u.to_degrees(), 5)) } td { } td { } td { (share) } }
    }
}
