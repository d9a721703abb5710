//! What the nets are trained on: samples of synthetic frames with their targets, and the frames that
//! calibrate and score a net.
//!
//! Every frame is drawn from its own generator, seeded by the training's seed and the frame's
//! number, with its own random pattern: a net must detect dots, not learn a pattern. A frame
//! gives several samples, each rotated or mirrored at random (a mirrored pattern is a pattern too). A part of the
//! frames shows something else than a dotted ball.
//!
//! Four sets of frames, drawn with four seeds ([`FrameSet`]), are disjoint: one trains, one selects
//! the best weights, one calibrates them, and one gives the reported score.
//!
//! Guaranteed: what is drawn is a function of the net, the seed and the frame's number, on any number of threads.
//! The optimizer is no part of this crate: `python/train` has it.

use std::ops::Range;

use rand::{Rng, RngExt};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::dataset::frame_rng;
use super::{Rendering, Scene, SynthConfig, SynthKind};
use crate::concurrency;
use crate::design::random_pattern;
use crate::error::Result;
use crate::vision::dots::patch::{MIDDLE, Patch, RADIUS, SIZE};
use crate::vision::net::graph::Head;
use crate::vision::net::network::{Activations, Network};
use crate::vision::net::weights::{ConvolutionNumbers, OutputCalibration};
use crate::vision::optics::camera::Pixel;

pub mod dots;
pub mod outlines;
pub mod score;

pub use outlines::OutlineScore;
pub use score::DotScore;

/// Targets of a cell of a net for dots: 1 in a dot's own cell; `(1 - y)^4` of the heat `y` elsewhere, 0 where
/// nobody can decide; columns and rows to the nearest dot, in the patch's pixels; their weight.
pub const DOT_TARGETS: [&str; 5] = ["own", "elsewhere", "column", "row", "near"];
/// Targets of a cell of the net for outlines: the signed distance from the outline, in
/// [`UNIT`](crate::vision::outline::net::UNIT), and its weight.
pub const OUTLINE_TARGETS: [&str; 2] = ["distance", "weight"];
/// Share of the frames that show something else than a dotted ball: there a net must find nothing.
const DISTRACTOR_SHARE: f64 = 0.12;
/// Probability from which on a dot counts as found in scores.
const FOUND: f64 = 0.5;

/// What is shown where there is nothing to find.
const DISTRACTORS: [SynthKind; 8] = [
    SynthKind::Dotless,
    SynthKind::LogoOnly,
    SynthKind::SeamsOnly,
    SynthKind::Fruit,
    SynthKind::Lamp,
    SynthKind::Wheel,
    SynthKind::Speckled,
    SynthKind::Noise,
];

/// Draws a frame with its own random pattern.
///
/// # Errors
/// [`Error::Argument`](crate::Error::Argument) where the configuration is out of its domain.
fn random_frame(config: &SynthConfig, rng: &mut ChaCha8Rng) -> Result<Rendering> {
    let dots = rng.random_range(12..=30);
    let most = 1.3 / f64::from(dots).sqrt();
    let pattern = random_pattern(dots as usize, rng.random_range(0.5..1.0) * most, rng)?;
    Scene::random(&pattern, config, rng)?.render()
}

/// One of the eight symmetries of a square.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Symmetry {
    transpose: bool,
    flip_columns: bool,
    flip_rows: bool,
}

impl Symmetry {
    /// Any of the eight.
    pub fn random<R: Rng + ?Sized>(rng: &mut R) -> Self {
        Self {
            transpose: rng.random(),
            flip_columns: rng.random(),
            flip_rows: rng.random(),
        }
    }

    /// A patch's values in their new places.
    pub fn apply(self, values: &[f32]) -> Vec<f32> {
        let mut placed = vec![0.0; SIZE * SIZE];
        for row in 0..SIZE {
            for column in 0..SIZE {
                let to = self.place(Pixel {
                    u: column as f64,
                    v: row as f64,
                });
                placed[to.v as usize * SIZE + to.u as usize] = values[row * SIZE + column];
            }
        }
        placed
    }

    /// The new position of the value at (column, row).
    pub fn place(self, at: Pixel) -> Pixel {
        let flip = |x: f64, yes: bool| if yes { 2.0 * MIDDLE - x } else { x };
        let (u, v) = if self.transpose {
            (at.v, at.u)
        } else {
            (at.u, at.v)
        };
        Pixel {
            u: flip(u, self.flip_columns),
            v: flip(v, self.flip_rows),
        }
    }
}

/// The purpose of a set of frames. Each purpose has a seed, so no set shares a frame with another.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FrameSet {
    /// The net trains on them.
    Train,
    /// They select the best weights.
    Validation,
    /// Probabilities and covariances are calibrated on them.
    Calibration,
    /// The reported score comes from them, and nothing else uses them.
    Test,
}

impl FrameSet {
    /// All sets.
    pub const ALL: [Self; 4] = [Self::Train, Self::Validation, Self::Calibration, Self::Test];

    /// The seed of the set's frames in a training with this seed.
    pub fn seed(self, training: u64) -> u64 {
        training
            ^ match self {
                Self::Train => 0,
                Self::Validation => 0x7661_6c69_6461_7465,
                Self::Calibration => 0x6361_6c69_6272_6174,
                Self::Test => 0x7265_706f_7274_6564,
            }
    }

    /// The set's name.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Train => "train",
            Self::Validation => "validation",
            Self::Calibration => "calibration",
            Self::Test => "test",
        }
    }
}

impl std::str::FromStr for FrameSet {
    type Err = crate::error::Error;

    fn from_str(name: &str) -> Result<Self> {
        crate::error::by_name(&Self::ALL, Self::as_str, "set", name)
    }
}

/// Samples that a net draws from a frame of the training.
pub fn samples_per_frame(head: Head) -> usize {
    match head {
        Head::Dots | Head::DotsLarge => 2,
        Head::Outline => 4,
    }
}

/// The distribution of a net's frames.
fn distribution(head: Head) -> SynthConfig {
    // Larger balls are downscaled to the patch anyway.
    let dots = SynthConfig {
        size_px: [40, 120],
        ..SynthConfig::default()
    };
    match head {
        Head::Dots | Head::DotsLarge => dots,
        // More of the ball's surroundings.
        Head::Outline => SynthConfig {
            ball_px: Some([32.0, 110.0]),
            fill: [0.35, 1.0],
            off_center: 0.4,
            ..dots
        },
    }
}

/// A frame of a net's distribution.
fn training_frame(config: &SynthConfig, rng: &mut ChaCha8Rng) -> Result<Rendering> {
    if !rng.random_bool(DISTRACTOR_SHARE) {
        return random_frame(config, rng);
    }
    let kind = DISTRACTORS[rng.random_range(0..DISTRACTORS.len())];
    // Where there is no ball, the net for outlines learns that nothing can be known.
    let other = SynthConfig {
        kind,
        ..config.clone()
    };
    random_frame(&other, rng)
}

/// Samples to train on, one after the other.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct TrainingBatch {
    /// Samples.
    pub len: usize,
    /// Gray values as the nets see them: (n, side, side).
    pub patches: Vec<f32>,
    /// (n, [`DOT_TARGETS`] or [`OUTLINE_TARGETS`], cells, cells).
    pub targets: Vec<f32>,
}

/// The samples of a range of training frames, [`samples_per_frame`] of each.
///
/// # Errors
/// [`Error::Argument`](crate::Error::Argument) where a scene cannot be drawn.
pub fn batch(head: Head, seed: u64, frames: Range<u64>) -> Result<TrainingBatch> {
    let config = distribution(head);
    let draw = |frame: u64| -> Result<TrainingBatch> {
        let mut rng = frame_rng(FrameSet::Train.seed(seed), frame);
        let rendering = training_frame(&config, &mut rng)?;
        let mut batch = TrainingBatch::default();
        for _ in 0..samples_per_frame(head) {
            let (patch, targets) = match head {
                Head::Dots | Head::DotsLarge => {
                    let sample = dots::sample(&rendering, &mut rng);
                    let symmetry = Symmetry::random(&mut rng);
                    let targets = dots::targets(&sample.dots, symmetry);
                    (symmetry.apply(sample.patch.values()), targets)
                }
                Head::Outline => {
                    let sample = outlines::sample(&rendering, &mut rng);
                    let symmetry = Symmetry::random(&mut rng);
                    let targets = outlines::targets(&sample.circle, symmetry);
                    (symmetry.apply(sample.patch.values()), targets)
                }
            };
            batch.len += 1;
            batch.patches.extend(patch);
            batch.targets.extend(targets);
        }
        Ok(batch)
    };
    let mut all = TrainingBatch::default();
    for batch in concurrency::map_range(frames, draw) {
        let batch = batch?;
        all.len += batch.len;
        all.patches.extend(batch.patches);
        all.targets.extend(batch.targets);
    }
    Ok(all)
}

/// Frames whose samples stand for the synthetic world.
const WORLD_FRAMES: u64 = 16;

/// SHA-256 of the first samples of a training, hexadecimal: another one means that what is drawn has changed.
///
/// # Errors
/// As [`batch`].
pub fn world_sha256(head: Head, seed: u64) -> Result<String> {
    let first = batch(head, seed, 0..WORLD_FRAMES)?;
    let values = first.patches.iter().chain(&first.targets);
    // To an eighth of a gray value or so: processors may round differently.
    let bytes: Vec<u8> = values
        .flat_map(|x| ((x * 8.0).round() as i16).to_le_bytes())
        .collect();
    Ok(crate::files::sha256_hex(&bytes))
}

/// Samples that a net does not train on, one a frame.
#[derive(Debug, Clone, PartialEq)]
pub enum HeldOutSamples {
    /// Of a net for dots.
    Dots(Head, Vec<dots::DotSample>),
    /// Of the net for outlines.
    Outline(Vec<outlines::OutlineSample>),
}

/// How good a net is, on frames that it was not trained on.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Score {
    /// A net for dots, at a probability of one half.
    Dots(DotScore),
    /// A net for outlines.
    Outline(OutlineScore),
}

impl HeldOutSamples {
    /// Draws the first frames of a set.
    ///
    /// # Errors
    /// [`Error::Argument`](crate::Error::Argument) where a scene cannot be drawn.
    pub fn draw(head: Head, seed: u64, set: FrameSet, frames: u64) -> Result<Self> {
        let seed = set.seed(seed);
        Ok(match head {
            Head::Dots | Head::DotsLarge => {
                Self::Dots(head, each(head, seed, frames, dots::sample)?)
            }
            Head::Outline => Self::Outline(each(head, seed, frames, outlines::sample)?),
        })
    }

    /// The samples' patches, in their order.
    pub fn patches(&self) -> Vec<&Patch> {
        match self {
            Self::Dots(_, samples) => samples.iter().map(|s| &s.patch).collect(),
            Self::Outline(samples) => samples.iter().map(|s| &s.patch).collect(),
        }
    }

    /// The cells that a net gives for each sample, as the estimator runs it.
    ///
    /// # Errors
    /// [`Error::Argument`](crate::Error::Argument) where the layers are not those of the net.
    pub fn cells(&self, layers: &[ConvolutionNumbers]) -> Result<Vec<Vec<f32>>> {
        cells_of(self.head(), layers, self.patches().into_par_iter())
    }

    /// What the samples are for.
    pub fn head(&self) -> Head {
        match self {
            Self::Dots(head, _) => *head,
            Self::Outline(_) => Head::Outline,
        }
    }

    /// Fits a net's calibration to the samples.
    ///
    /// # Errors
    /// [`Error::Argument`](crate::Error::Argument) where the layers are not those of the net.
    pub fn calibrate(&self, layers: &[ConvolutionNumbers]) -> Result<OutputCalibration> {
        Ok(match self {
            Self::Dots(head, samples) => {
                let raw = OutputCalibration::default();
                score::calibrate(&match_all(*head, layers, samples, &raw)?)
            }
            Self::Outline(samples) => OutputCalibration {
                covariance_factor: outlines::covariance_factor(&outline_errors(layers, samples)?),
                ..OutputCalibration::default()
            },
        })
    }

    /// The score of a net on the samples.
    ///
    /// # Errors
    /// [`Error::Argument`](crate::Error::Argument) where the layers are not those of the net.
    pub fn score(
        &self,
        layers: &[ConvolutionNumbers],
        calibration: &OutputCalibration,
    ) -> Result<Score> {
        Ok(match self {
            Self::Dots(head, samples) => {
                let matched = match_all(*head, layers, samples, calibration)?;
                Score::Dots(score::score(&matched, samples, FOUND))
            }
            Self::Outline(samples) => {
                Score::Outline(outlines::score(&outline_errors(layers, samples)?))
            }
        })
    }
}

/// One sample of each frame.
fn each<S: Send>(
    head: Head,
    seed: u64,
    frames: u64,
    sample: impl Fn(&Rendering, &mut ChaCha8Rng) -> S + Sync,
) -> Result<Vec<S>> {
    let config = distribution(head);
    let one = |frame: u64| {
        let mut rng = frame_rng(seed, frame);
        let rendering = training_frame(&config, &mut rng)?;
        Ok(sample(&rendering, &mut rng))
    };
    concurrency::map_range(0..frames, one).into_iter().collect()
}

impl Score {
    /// What selects the best weights: larger is better.
    pub fn quality(&self) -> f64 {
        match self {
            Self::Dots(score) => score.f1(),
            Self::Outline(score) => -score.mean_error,
        }
    }
}

impl std::fmt::Display for Score {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Dots(s) => write!(
                f,
                "of {} dots on {} frames {:.2} % found, {:.3} false per frame, median error {:.2} % of the radius",
                s.dots,
                s.frames,
                100.0 * s.recall(),
                s.false_peaks as f64 / s.frames as f64,
                100.0 * s.median_error / RADIUS,
            ),
            Self::Outline(s) => write!(
                f,
                "of {} outlines {} within 1 %, {} within 2 % and {} within 5 % of the radius, median error {:.2} %, mean {:.2} %",
                s.frames,
                s.within[0],
                s.within[1],
                s.within[2],
                100.0 * s.median_error,
                100.0 * s.mean_error,
            ),
        }
    }
}

/// Runs a net on patches, as the estimator runs it.
fn cells_of<'a>(
    head: Head,
    layers: &[ConvolutionNumbers],
    patches: impl IndexedParallelIterator<Item = &'a Patch>,
) -> Result<Vec<Vec<f32>>> {
    let network = Network::new(head, layers)?;
    let run = |activations: &mut Activations, patch| network.forward(patch, activations).to_vec();
    Ok(patches.map_init(|| Activations::new(head), run).collect())
}

/// The errors of the circles that a net gives on samples.
fn outline_errors(
    layers: &[ConvolutionNumbers],
    samples: &[outlines::OutlineSample],
) -> Result<Vec<outlines::OutlineError>> {
    let cells = cells_of(Head::Outline, layers, samples.par_iter().map(|s| &s.patch))?;
    let pairs = std::iter::zip(&cells, samples);
    Ok(pairs.map(|(c, s)| outlines::error(c, s)).collect())
}

/// The peaks of a net on samples, matched with their dots.
fn match_all(
    head: Head,
    layers: &[ConvolutionNumbers],
    samples: &[dots::DotSample],
    calibration: &OutputCalibration,
) -> Result<Vec<score::MatchedPeak>> {
    let cells = cells_of(head, layers, samples.par_iter().map(|s| &s.patch))?;
    let mut matched = Vec::new();
    for (cells, sample) in std::iter::zip(&cells, samples) {
        score::match_peaks(cells, sample, calibration, &mut matched);
    }
    Ok(matched)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sets_share_no_frame() {
        let mut patches: Vec<Patch> = Vec::new();
        for set in FrameSet::ALL {
            let drawn = HeldOutSamples::draw(Head::Dots, 0, set, 3).expect("frames");
            let HeldOutSamples::Dots(_, samples) = drawn else {
                panic!("samples of another net");
            };
            patches.extend(samples.into_iter().map(|s| s.patch));
        }
        for (i, a) in patches.iter().enumerate() {
            assert!(patches[..i].iter().all(|b| a != b), "{i}");
        }
    }

    #[test]
    fn a_frame_gives_the_same_samples_in_any_batch() {
        for head in Head::ALL {
            let all = batch(head, 5, 0..4).expect("frames");
            let last = batch(head, 5, 3..4).expect("frames");
            assert_eq!(all.len, 4 * last.len, "{head:?}");
            assert!(all.patches.ends_with(&last.patches), "{head:?}");
            assert!(all.targets.ends_with(&last.targets), "{head:?}");
        }
    }

    #[test]
    fn dots_beyond_the_edge_of_the_image_are_not_asked_for() {
        let mut outside = 0;
        for seed in 0..400 {
            let mut rng = frame_rng(seed, 0);
            let frame = random_frame(&distribution(Head::Dots), &mut rng).expect("a frame");
            let asked = dots::sample(&frame, &mut rng).dots;
            let (width, height) = (frame.image.width() as f64, frame.image.height() as f64);
            for (dot, asked) in frame.dots.iter().zip(asked) {
                let inside = (-0.5..width - 0.5).contains(&dot.pixel.u)
                    && (-0.5..height - 0.5).contains(&dot.pixel.v);
                assert!(inside || !asked.certain);
                assert_eq!(asked.certain, dot.is_visible());
                outside += usize::from(!inside && !dot.occluded && dot.facing > 0.3);
            }
        }
        assert!(outside > 0, "no such dot: the test shows nothing");
    }
}
