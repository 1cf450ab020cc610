//! Random numbers: one ChaCha stream for each item, so that neither the number of threads nor the
//! order of rendering changes a number.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

/// What a stream's numbers are for. The discriminants are part of every simulated result.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub(crate) enum Purpose {
    Interior = 1,
    Artefact = 2,
    Target = 3,
    Beam = 4,
    Common = 5,
    Wavemeter = 6,
    Rail = 7,
    Turntable = 8,
    Pointing = 9,
    PixelNoise = 16,
    Speckle = 17,
    RailEncoder = 32,
    RotationEncoder = 33,
    RailStop = 34,
    RotationStop = 35,
    Wavelength = 36,
    Temperature = 37,
    DiodeTemperature = 38,
    Fault = 48,
}

/// The streams of one seed.
#[derive(Debug, Clone)]
pub(crate) struct Streams(ChaCha8Rng);

impl Streams {
    pub(crate) fn new(seed: u64) -> Self {
        Self(ChaCha8Rng::seed_from_u64(seed))
    }

    /// The stream of one item: a camera, a reading, a beam.
    pub(crate) fn item(&self, purpose: Purpose, item: u64) -> ChaCha8Rng {
        self.stream(u64::from(purpose as u8) << 56 | item & 0x00ff_ffff_ffff_ffff)
    }

    /// The stream of one dot (or of the pixels, dot 0) in one camera's picture of one capture.
    pub(crate) fn picture(
        &self,
        purpose: Purpose,
        camera: usize,
        capture: u64,
        dot: usize,
    ) -> ChaCha8Rng {
        let (camera, dot) = (camera as u64 & 0xff, dot as u64 & 0xffff);
        self.item(purpose, camera << 48 | (capture & 0xffff_ffff) << 16 | dot)
    }

    fn stream(&self, id: u64) -> ChaCha8Rng {
        let mut rng = self.0.clone();
        rng.set_stream(id);
        rng
    }
}

/// One number of N(0, 1).
pub(crate) fn normal(rng: &mut ChaCha8Rng) -> f64 {
    StandardNormal.sample(rng)
}
