//! Random numbers: a stream for each part of a scene, and draws from the ranges of the
//! configuration.
//!
//! A frame has one key. Each part of its scene draws from a stream of its own of that key, so that
//! a part that draws more or fewer numbers changes no other: frame `k` of a seed shows the same
//! pose, light, camera, noise and background whatever pattern is on the ball.

use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// A part of a scene that has random numbers of its own.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Stream {
    Pose,
    Camera,
    Ball,
    Pen,
    Dots,
    Light,
    Background,
    Occlusion,
    Sensor,
    Noise,
    Ground,
    Cords,
    Paint,
}

/// The streams of a frame.
#[derive(Debug, Clone, Copy)]
pub(super) struct Streams {
    key: u64,
}

impl Streams {
    /// The streams of a frame whose key is the generator's next number.
    pub fn new<R: Rng + ?Sized>(rng: &mut R) -> Self {
        Self { key: rng.random() }
    }

    /// The generator of a part.
    pub fn of(self, stream: Stream) -> ChaCha8Rng {
        let mut rng = ChaCha8Rng::seed_from_u64(self.key);
        rng.set_stream(stream as u64);
        rng
    }
}

/// Uniform in a range, which may be empty.
pub(super) fn between<R: Rng + ?Sized>([low, high]: [f64; 2], rng: &mut R) -> f64 {
    low + (high - low) * rng.random::<f64>()
}

/// Uniform in the logarithm; the range is positive.
pub(super) fn log_between<R: Rng + ?Sized>([low, high]: [f64; 2], rng: &mut R) -> f64 {
    between([low.ln(), high.ln()], rng).exp()
}

/// Uniform in a range, as the renderer's numbers.
pub(super) fn between_f32<R: Rng + ?Sized>(range: [f64; 2], rng: &mut R) -> f32 {
    between(range, rng) as f32
}
