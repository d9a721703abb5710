//! What the synthetic world renders, as one digest: numbers that follow from it say by which world they were derived.

use super::dataset::independent_frame;
use super::{SynthConfig, SynthKind};
use crate::concurrency;
use crate::error::Result;
use crate::geometry::spiral_directions;
use crate::pattern::Pattern;

/// Frames of each kind in each of the two conditions.
const FRAMES: usize = 4;
/// Their seed, and the dots of their pattern.
const SEED: u64 = 0x776f_726c;
const DOTS: usize = 20;
/// Columns and rows of each frame whose pixels count.
const SAMPLES: usize = 8;
/// Gray values that the digest distinguishes, of a brightness of one: processors may round differently.
const LEVELS: f32 = 16.0;

/// SHA-256 of what is rendered, hexadecimal: pixels and truth of a few frames of every kind, in good and in all conditions.
/// Another one means that the world has changed, and not what is written about it.
///
/// # Errors
/// [`crate::Error::Argument`] where a scene cannot be drawn.
pub fn world_sha256() -> Result<String> {
    let pattern = Pattern::new(spiral_directions(DOTS).collect())?;
    let conditions = [SynthConfig::good(), SynthConfig::default()];
    let mut sets = Vec::new();
    for config in conditions {
        sets.extend(SynthKind::ALL.map(|kind| SynthConfig {
            kind,
            ..config.clone()
        }));
    }
    let frames = 0..(sets.len() * FRAMES) as u64;
    let drawn = concurrency::map_range(frames, |k| -> Result<Vec<u8>> {
        let k = k as usize;
        let frame = independent_frame(&pattern, &sets[k / FRAMES], SEED, k % FRAMES)?;
        let gray = frame.image.to_gray();
        let (width, height) = (gray.width(), gray.height());
        let mut bytes = Vec::new();
        for size in [width, height, frame.truth.dots.len()] {
            bytes.extend((size as u32).to_le_bytes());
        }
        for at in 0..SAMPLES * SAMPLES {
            let place = |k: usize, side: usize| (2 * k + 1) * side / (2 * SAMPLES);
            let (u, v) = (place(at % SAMPLES, width), place(at / SAMPLES, height));
            let value = gray.values()[v * width + u];
            bytes.push((value * LEVELS).round() as u8);
        }
        let visible = frame.truth.dots.iter().filter(|dot| dot.visible);
        bytes.push(visible.count() as u8);
        Ok(bytes)
    });
    let drawn: Vec<Vec<u8>> = drawn.into_iter().collect::<Result<_>>()?;
    Ok(crate::files::sha256_hex(&drawn.concat()))
}
