//! Pictures of one capture to sightings, on all threads of the pool.
//!
//! Decoding is most of the work and cannot be divided, so all decodes begin first; whoever is free
//! meanwhile looks for dots and targets in what is decoded already. At the end there are fewer
//! pictures than threads: then dots and targets of one picture are looked for side by side. What is
//! found does not depend on who finds it when.

use std::sync::OnceLock;

use crate::detect::{
    DotOptions, DotsFound, Target, TargetOptions, drop_dots_on_targets, find_dots,
    find_dots_and_targets, find_targets,
};
use crate::image::GrayImage;
use crate::solve::Sighting;

/// How far a picture is; for whoever has a clock.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stage {
    /// Its decoding begins.
    Begun,
    /// It is decoded, or could not be.
    Decoded,
    /// Its dots and targets were found (told twice where side by side).
    Detected,
}

/// One picture on its way.
struct Picture<E> {
    image: OnceLock<Result<GrayImage, E>>,
    dots: OnceLock<DotsFound>,
    targets: OnceLock<Vec<Target>>,
}

/// Reads each of `files` by `read` and finds the dots and targets in it; in the order given.
/// `told` hears of the index and stage of each, from any thread.
///
/// # Errors
/// Per picture what `read` says.
pub fn sight_all<F: Sync, E: Send + Sync>(
    files: &[F],
    read: impl Fn(&F) -> Result<GrayImage, E> + Sync,
    told: impl Fn(usize, Stage) + Sync,
) -> Vec<Result<Sighting, E>> {
    let pictures: Vec<Picture<E>> = files.iter().map(|_| Picture::new()).collect();
    let (read, told) = (&read, &told);
    // In the last round of decodes some threads have none.
    let rounds_end = files.len() - files.len() % rayon::current_num_threads();
    rayon::scope_fifo(|scope| {
        for (i, (file, picture)) in files.iter().zip(&pictures).enumerate() {
            scope.spawn_fifo(move |scope| {
                told(i, Stage::Begun);
                let image = picture.image.get_or_init(|| read(file));
                told(i, Stage::Decoded);
                let Ok(image) = image else { return };
                let detected = move || told(i, Stage::Detected);
                if i < rounds_end {
                    scope.spawn_fifo(move |_| picture.find(image, detected));
                } else {
                    scope.spawn_fifo(move |_| picture.find_targets(image, detected));
                    scope.spawn_fifo(move |_| picture.find_dots(image, detected));
                }
            });
        }
    });
    pictures.into_iter().filter_map(Picture::sighting).collect()
}

impl<E> Picture<E> {
    fn new() -> Self {
        Self { image: OnceLock::new(), dots: OnceLock::new(), targets: OnceLock::new() }
    }

    /// Dots and targets in one pass.
    fn find(&self, image: &GrayImage, done: impl Fn()) {
        let (dot_options, target_options) = (DotOptions::default(), TargetOptions::default());
        let (dots, targets) = find_dots_and_targets(image, &dot_options, &target_options);
        self.dots.get_or_init(|| dots);
        self.targets.get_or_init(|| targets);
        done();
    }

    fn find_dots(&self, image: &GrayImage, done: impl Fn()) {
        self.dots.get_or_init(|| find_dots(image, &DotOptions::default()));
        done();
    }

    fn find_targets(&self, image: &GrayImage, done: impl Fn()) {
        self.targets.get_or_init(|| find_targets(image, &TargetOptions::default()));
        done();
    }

    /// What was found; always there once the scope has ended.
    fn sighting(self) -> Option<Result<Sighting, E>> {
        if let Err(error) = self.image.into_inner()? {
            return Some(Err(error));
        }
        let (mut dots, targets) = (self.dots.into_inner()?.dots, self.targets.into_inner()?);
        drop_dots_on_targets(&mut dots, &targets);
        Some(Ok(Sighting { dots, targets }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_come_back_in_order_and_a_bad_one_spoils_no_other() {
        let blank = |width| GrayImage { width, height: 40, data: vec![30; 40 * width] };
        let files = [40, 0, 60];
        let read = |width: &usize| if *width > 0 { Ok(blank(*width)) } else { Err("no picture") };
        let found = sight_all(&files, read, |_, _| ());
        let words: Vec<_> = found.iter().map(|f| f.as_ref().map(|s| s.dots.len())).collect();
        assert_eq!(words, [Ok(0), Err(&"no picture"), Ok(0)]);
    }
}
