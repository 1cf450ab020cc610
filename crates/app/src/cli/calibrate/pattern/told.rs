//! What a calibration says in the terminal.

use beampose_analysis::FanReport;

use super::super::digits;

pub fn in_words(report: &FanReport, measurements: usize) -> String {
    let (found, options) = (report.found, report.options);
    let nm = options.reference_wavelength_nm;
    let mut lines = vec![format!(
        "{}: {measurements} angles of {} pairs, at {nm} nm",
        report.name,
        found.means.len()
    )];
    if let Some(spread) = found.spread {
        let sigma = spread.sigma.to_degrees();
        lines.push(format!("  standard deviation of one angle {sigma:.5} deg"));
    }
    for candidate in &found.candidates {
        let name = candidate.model.name();
        lines.push(match &candidate.fit {
            Ok(fit) => format!(
                "  {name:<12} chi2 {:>8.2} / {:<3} AICc {:>8.2}{}",
                fit.chi2,
                fit.redundancy(),
                fit.aicc(),
                if fit.model == found.fit.model { "  taken" } else { "" }
            ),
            Err(why) => format!("  {name:<12} {why}"),
        });
    }
    let fit = &found.fit;
    let read = fit.model.read(&fit.parameters, options.grid_distance, nm);
    for (i, p) in read.iter().enumerate() {
        let u = fit.covariance[(i, i)].max(0.0).sqrt() * p.slope.abs();
        lines.push(parameter(p.name, p.value, u));
    }
    let u = &found.pattern.u;
    let most = found.angles.iter().map(|a| a.u).fold(0.0, f64::max).to_degrees();
    lines.push(format!(
        "  one beam alone {:.5} deg, all together {:.4} %; {} angles, u up to {most:.5} deg",
        u.angle_deg,
        100.0 * u.common_relative,
        found.angles.len()
    ));
    let budget = report.budget;
    lines.push(format!(
        "  budget of one angle {:.5} deg (random {:.5}, shared {:.5}); drawn {:.5}",
        budget.closed.to_degrees(),
        budget.random.to_degrees(),
        budget.shared.to_degrees(),
        budget.drawn.to_degrees()
    ));
    lines.join("\n")
}

/// A parameter with its standard uncertainty, two digits of it; a radial term is far below what decimals
/// show.
pub fn parameter(name: &str, value: f64, u: f64) -> String {
    let text = if value != 0.0 && u < 1e-8 {
        format!("{value:.4e}  u {u:.1e}")
    } else {
        format!("{}  u {}", digits(value, 6), digits(u, 2))
    };
    format!("  {name:<22} {text}")
}
