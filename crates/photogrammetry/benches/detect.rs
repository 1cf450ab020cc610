//! Detection in one 9-megapixel picture in memory, on one thread: dots, targets, both.
//! `cargo bench -p beampose-photogrammetry --bench detect`

#![expect(clippy::expect_used, reason = "a benchmark that cannot be set up stops")]

use beampose_photogrammetry::detect::{
    DotOptions, TargetOptions, find_dots, find_dots_and_targets,
};
use beampose_photogrammetry::{GrayImage, decode};

fn main() {
    divan::main();
}

const PICTURES: [&str; 2] = ["plain", "speckle"];

fn picture(name: &str) -> GrayImage {
    let path = format!("{}/tests/data/dots/{name}.jpg", env!("CARGO_MANIFEST_DIR"));
    decode(&std::fs::read(path).expect("test data")).expect("a whole JPEG file")
}

fn one_thread() -> rayon::ThreadPool {
    rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread")
}

#[divan::bench(args = PICTURES)]
fn dots(bencher: divan::Bencher, name: &str) {
    let image = picture(name);
    let one = one_thread();
    bencher.bench(|| one.install(|| find_dots(&image, &DotOptions::default())));
}

#[divan::bench(args = PICTURES)]
fn dots_and_targets(bencher: divan::Bencher, name: &str) {
    let image = picture(name);
    let one = one_thread();
    let (dots, targets) = (DotOptions::default(), TargetOptions::default());
    bencher.bench(|| one.install(|| find_dots_and_targets(&image, &dots, &targets)));
}
