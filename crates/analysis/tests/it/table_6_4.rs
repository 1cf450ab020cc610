//! Table 6.4's arithmetic from Table 6.3's numbers.
//!
//! Both tables are rounded to 0.01 mm, so a printed result is right when it lies in the interval
//! that the rounding of its inputs allows. Two printed U are not: errata, named below.

use std::collections::BTreeMap;

use beampose_analysis::{
    DistanceRule, Limits, StatedScale, TranslationInput, TravelCapture, translation,
};
use beampose_core::CaptureId;
use beampose_core::units::Millimetre;
use beampose_photogrammetry::solve::Method;

use crate::translation::pose;

/// Travel, Table 6.3's u_c, Table 6.4's u_c and U.
const ROWS: [(f64, f64, f64, f64); 8] = [
    (0.0, 0.55, 0.55, 1.10),
    (100.0, 0.56, 0.79, 1.48),
    (300.0, 0.57, 0.81, 1.62),
    (400.0, 0.58, 0.82, 1.64),
    (500.0, 0.60, 0.84, 1.68),
    (700.0, 0.61, 0.87, 1.74),
    (800.0, 0.62, 0.89, 1.78),
    (900.0, 0.63, 0.92, 1.88),
];

/// Where the print's U is not twice its own u_c: 1.58 and 1.84.
const ERRATA: [f64; 2] = [100.0, 900.0];

/// Standard uncertainty of every distance, with all u_c of Table 6.3 moved by `shift`.
fn combined(shift: f64) -> Vec<f64> {
    let capture = |(travel, u, _, _): (f64, f64, f64, f64)| TravelCapture {
        id: CaptureId(format!("{travel}")),
        pass: 1,
        setpoint: Millimetre(travel),
        readback: Millimetre(travel),
        // The table's u_c is of all three coordinates: any division among them is the same.
        poses: BTreeMap::from([(Method::InterBeamAngles, Ok(pose(travel, [u + shift, 0.0, 0.0])))]),
    };
    let result = translation(&TranslationInput {
        captures: ROWS.map(capture).to_vec(),
        scale_relative_u: 0.0004,
        stated_scale: StatedScale::Separate,
        rule: DistanceRule::AllCoordinates,
        limits: Limits::default(),
    });
    let positions = &result.methods[&Method::InterBeamAngles].positions;
    positions.iter().map(|p| p.standard_uncertainty_mm).collect()
}

#[test]
fn the_printed_uncertainties_follow_within_the_rounding_of_their_inputs() {
    let (low, high) = (combined(-0.005), combined(0.005));
    for (i, (travel, _, printed_u, printed_expanded)) in ROWS.into_iter().enumerate() {
        let within = low[i] - 0.005 <= printed_u && printed_u <= high[i] + 0.005;
        assert!(within, "{travel} mm: {printed_u} not in {} .. {}", low[i], high[i]);
        let agrees =
            2.0 * low[i] - 0.01 <= printed_expanded && printed_expanded <= 2.0 * high[i] + 0.01;
        assert_eq!(agrees, !ERRATA.contains(&travel), "{travel} mm: U = {printed_expanded}");
    }
}
