//! Milliseconds per full-size picture on one thread: `cargo bench -p beampose-virtual-lab`.

use beampose_core::Emission;
use beampose_virtual_lab::{ModuleState, World, WorldConfig};

fn main() {
    divan::main();
}

/// The laboratory at full size, its static layers rendered.
fn laboratory() -> Option<(World, ModuleState)> {
    let world = World::new(WorldConfig::laboratory(), 1).ok()?;
    let module = world.module_state(300.0, 0.0, 658.0, Emission::On);
    world.render("cam_a", &module, 0).ok()?;
    Some((world, module))
}

#[divan::bench(sample_count = 20)]
fn picture_of_nine_megapixels(bencher: divan::Bencher) {
    let Some((world, module)) = laboratory() else { return };
    bencher.bench_local(|| world.render("cam_a", &module, 1));
}

#[divan::bench(sample_count = 20)]
fn picture_of_nine_megapixels_as_jpeg(bencher: divan::Bencher) {
    let Some((world, module)) = laboratory() else { return };
    bencher.bench_local(|| world.render_jpeg("cam_a", &module, 1));
}

#[divan::bench(sample_count = 3)]
fn first_picture_with_background_and_targets(bencher: divan::Bencher) {
    bencher.bench_local(laboratory);
}
