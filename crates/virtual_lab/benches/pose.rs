//! From three full-size JPEG files to the pose by both methods, with the three decodes alone beside
//! it as the floor. `cargo bench -p beampose-virtual-lab --bench pose`

#![expect(clippy::expect_used, reason = "a benchmark that cannot be set up stops")]

use std::collections::BTreeMap;

use beampose_core::Emission;
use beampose_photogrammetry::detect::{
    DotOptions, TargetOptions, drop_dots_on_targets, find_dots_and_targets,
};
use beampose_photogrammetry::sight::sight_all;
use beampose_photogrammetry::solve::{Method, Sighting, solve_capture};
use beampose_photogrammetry::{Artefact, ArtefactTarget, GrayImage, Setup, TieTargets, decode};
use beampose_virtual_lab::config::TargetRole;
use beampose_virtual_lab::{World, WorldConfig};
use rayon::iter::{IntoParallelRefIterator as _, ParallelIterator as _};

fn main() {
    divan::main();
}

/// One capture of the laboratory: what the solver is told, and three JPEG files.
fn capture() -> (Setup, Vec<(String, Vec<u8>)>) {
    let config = WorldConfig::laboratory();
    let targets = config.targets.iter().filter_map(|t| match t.role {
        TargetRole::Artefact { u_mm } => {
            Some(ArtefactTarget { code: t.code, xyz_mm: t.xyz_mm, u_mm, radius_mm: t.radius_mm })
        }
        TargetRole::Tie => None,
    });
    let artefact =
        Artefact { targets: targets.collect(), scale_relative_u: config.artefact_scale_relative_u };
    let (pattern, wavelength_u_nm) = (config.pattern.clone(), config.wavemeter.bias_u_nm);
    let world = World::new(config, 7).expect("the laboratory is sound");
    let module = world.module_state(300.0, 0.0, 658.0, Emission::On);
    let cameras = world.calibrations();
    let files = cameras
        .keys()
        .map(|name| (name.clone(), world.render_jpeg(name, &module, 0).expect("a known camera")))
        .collect();
    let tie_targets = Some(TieTargets { radius_mm: 6.0 });
    let setup = Setup {
        cameras,
        pattern,
        artefact,
        tie_targets,
        module_prior: None,
        wavelength_u_nm,
        wavelength_by_temperature: None,
    };
    (setup, files)
}

fn sight(image: &GrayImage) -> Sighting {
    let (found, targets) =
        find_dots_and_targets(image, &DotOptions::default(), &TargetOptions::default());
    let mut dots = found.dots;
    drop_dots_on_targets(&mut dots, &targets);
    Sighting { dots, targets }
}

fn sightings(files: &[(String, Vec<u8>)]) -> BTreeMap<String, Sighting> {
    let found = sight_all(files, |(_, bytes)| decode(bytes), |_, _| ());
    let names = files.iter().map(|(name, _)| name.clone());
    names.zip(found).map(|(name, seen)| (name, seen.expect("a whole JPEG file"))).collect()
}

#[divan::bench]
fn three_decodes_alone(bencher: divan::Bencher) {
    let (_, files) = capture();
    bencher.bench(|| files.par_iter().map(|(_, b)| decode(b).map(|i| i.width)).count());
}

#[divan::bench]
fn detect_one_picture_in_memory_on_one_thread(bencher: divan::Bencher) {
    let (_, files) = capture();
    let image = decode(&files[0].1).expect("a whole JPEG file");
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
    bencher.bench(|| one.install(|| sight(&image)));
}

#[divan::bench]
fn three_files_to_pose(bencher: divan::Bencher) {
    let (setup, files) = capture();
    let read = setup.wavelength(Some(658.0));
    bencher.bench(|| {
        let solution = solve_capture(&setup, &sightings(&files), &read, &Method::USUAL, &mut || ());
        assert!(solution.results.iter().all(|r| r.pose.is_ok()));
        solution
    });
}

#[divan::bench]
fn solve_from_sightings(bencher: divan::Bencher) {
    let (setup, files) = capture();
    let sightings = sightings(&files);
    let read = setup.wavelength(Some(658.0));
    bencher.bench(|| solve_capture(&setup, &sightings, &read, &Method::USUAL, &mut || ()));
}
