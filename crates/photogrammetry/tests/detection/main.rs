//! Detection on whole pictures that were made elsewhere.

#![expect(clippy::unwrap_used, clippy::expect_used, reason = "a test that cannot go on fails")]

use beampose_photogrammetry::decode;
use beampose_photogrammetry::detect::{Dot, DotOptions, TargetOptions, find_dots, find_targets};
use nalgebra::Vector2;

const DATA: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/dots");

fn truth() -> Vec<Vector2<f64>> {
    let text = std::fs::read_to_string(format!("{DATA}/truth.txt")).unwrap();
    let number = |word: &str| word.parse::<f64>().unwrap();
    text.lines()
        .map(|line| {
            let (x, y) = line.split_once(' ').unwrap();
            Vector2::new(number(x), number(y.trim()))
        })
        .collect()
}

/// Dots of a picture beside their true places: all found, nothing else.
fn found(name: &str) -> Vec<(Dot, Vector2<f64>)> {
    let image = decode(&std::fs::read(format!("{DATA}/{name}.jpg")).unwrap()).unwrap();
    assert!(find_targets(&image, &TargetOptions::default()).is_empty());
    let dots = find_dots(&image, &DotOptions::default()).dots;
    let truth = truth();
    assert_eq!((dots.len(), truth.len()), (121, 121));
    let near = |at: &Vector2<f64>| {
        *dots.iter().find(|dot| (dot.point.at - at).norm() < 2.0).expect("a dot at its place")
    };
    truth.into_iter().map(|at| (near(&at), at)).collect()
}

fn rms(pairs: &[(Dot, Vector2<f64>)]) -> f64 {
    let squares: f64 = pairs.iter().map(|(dot, at)| (dot.point.at - at).norm_squared()).sum();
    (squares / (2.0 * pairs.len() as f64)).sqrt()
}

/// Mean squared standardised error; 2 is expected, with a standard deviation of 2 / sqrt(121).
fn standardised(pairs: &[(Dot, Vector2<f64>)]) -> f64 {
    let square = |(dot, at): &(Dot, Vector2<f64>)| {
        let error = dot.point.at - at;
        (error.transpose() * dot.point.covariance.try_inverse().unwrap() * error)[0]
    };
    pairs.iter().map(square).sum::<f64>() / pairs.len() as f64
}

#[test]
fn clean_dots_are_centred_at_the_cramer_rao_bound() {
    let pairs = found("plain");
    // The bound is 0.0213 px; 242 errors tell it to 5 %, one of which is allowed above.
    assert!(rms(&pairs) < 0.0225, "{}", rms(&pairs));
    assert!((standardised(&pairs) - 2.0).abs() < 0.55, "{}", standardised(&pairs));
}

#[test]
fn speckled_dots_are_centred_with_the_weights_of_their_own_picture() {
    let pairs = found("speckle");
    // The fit that is told contrast and grain reaches 0.129 px; 242 errors tell it to 5 %.
    assert!(rms(&pairs) < 0.135, "{}", rms(&pairs));
    assert!((standardised(&pairs) - 2.0).abs() < 0.55, "{}", standardised(&pairs));
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    let image = decode(&std::fs::read(format!("{DATA}/speckle.jpg")).unwrap()).unwrap();
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| find_dots(&image, &DotOptions::default()))
    };
    let one = on(1);
    assert_eq!(one, on(2));
    assert_eq!(one, on(5));
}
