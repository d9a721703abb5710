//! What a camera shows of a pattern, in the few numbers that an objective needs.
//!
//! Rendered frames of random patterns say which dots are found. With `z` the cosine at which a dot is
//! seen, `N` how crowded it is and `t` a standard normal number of its frame, the model is
//!
//! ```text
//! P(found | t) = logistic(b_0 + b_1 z - b_2 N + b_3 t),
//! ```
//!
//! a logistic regression whose constant varies from frame to frame. It is fitted by expectation and
//! maximization over the nodes of a quadrature in `t` (R. D. Bock, M. Aitkin, "Marginal maximum likelihood
//! estimation of item parameters", Psychometrika 46, 1981). [`TooFewDots`] states the same curve by its limit
//! `-b_0 / b_1`, softness `1 / b_1`, spread `b_3 / b_1` and crowding `b_2`.

use nalgebra::{Matrix4, Vector4};

use super::conditions::CameraConditions;
use super::frames::FrameOutcome;
use super::trials::CameraTrials;
use crate::design::constraints::max_separation;
use crate::design::objective::too_few::LEVELS;
use crate::design::objective::{CountFailures, CountedView, TooFewDots};
use crate::error::Result;
use crate::pattern::crowding::crowds;
use crate::pattern::random_pattern;
use crate::stats::logistic;
use crate::synth::Rendering;
use crate::synth::dataset::frame_rng;
use crate::vision::FrameEstimate;
use crate::vision::dots::detector::LIKELY_DOT;

/// Random patterns that are looked at, and frames of each.
const PATTERNS: u64 = 25;
const FRAMES: u64 = 16;
/// Their seed: the same for every design.
const SEED: u64 = 15_500_001;
/// Dots nearer to the limb than this cosine are found in no frame.
const MIN_FACING: f64 = 0.05;
/// Probability that a dot in the middle is found where nothing prevents it.
const MAX_PROBABILITY: f64 = 0.98;
/// Slopes of a logit by z, between which the fit stays.
const SLOPES: [f64; 2] = [2.0, 50.0];
/// Largest loss to a neighbor.
const MAX_CROWDING: f64 = 5.0;
/// Steps of the fit: it gains less than 1e-3 in any number from half of them on.
const STEPS: usize = 200;

/// The assumptions of [`TooFewDots`] for so many dots before a camera, from 400 rendered frames. `done`
/// learns how many more of them are read.
///
/// # Errors
/// [`crate::Error::Argument`] for conditions outside their domain.
pub fn coverage(
    conditions: &CameraConditions,
    dots: usize,
    done: &(dyn Fn(u64) + Sync),
) -> Result<TooFewDots> {
    let trials = CameraTrials::new(*conditions, SEED);
    // As near to each other as on random patterns that can be drawn.
    let nearest = (3.0 * conditions.dot_diameter).min(0.5 * max_separation(dots));
    let (mut frames, mut views) = (Vec::new(), Vec::new());
    for k in 0..PATTERNS {
        let pattern = random_pattern(dots, nearest, &mut frame_rng(SEED, k | 1 << 60))?;
        let crowds = crowds(pattern.dots());
        let own = k * FRAMES..(k + 1) * FRAMES;
        let answers = trials.each_frame(&pattern, own, None, done, |rendering, found| {
            let chances = seen(rendering, found, &crowds);
            let outcome = FrameOutcome::of(found, &rendering.rotation);
            (chances, outcome)
        })?;
        for (chances, outcome) in answers {
            // Without an outline nothing is said of the dots.
            if !chances.is_empty() {
                views.push(CountedView {
                    dots: chances.iter().filter(|chance| chance.is_found).count(),
                    fails: !outcome.is_right(),
                });
            }
            frames.push(chances);
        }
    }
    Ok(TooFewDots {
        failures: CountFailures::fit(&views),
        ..fit(&frames)
    })
}

/// The number of frames that [`coverage`] reads.
pub const COVERAGE_FRAMES: u64 = PATTERNS * FRAMES;

/// A dot that could be found: its z, how crowded it is, and whether it is found.
#[derive(Debug, Clone, Copy)]
struct Chance {
    z: f64,
    crowd: f64,
    is_found: bool,
}

/// The dots of a frame that could be found; none without an outline.
fn seen(rendering: &Rendering, found: &FrameEstimate, crowds: &[f64]) -> Vec<Chance> {
    if found.outline.is_none() {
        return Vec::new();
    }
    let could_be = rendering
        .dots
        .iter()
        .filter(|dot| dot.inside && !dot.occluded && dot.facing > MIN_FACING);
    let chances = could_be.map(|dot| {
        let reach_px = dot.radius_rad * rendering.circle.radius;
        let is_found = found.dots.iter().any(|seen| {
            let off = (seen.pixel.u - dot.pixel.u).hypot(seen.pixel.v - dot.pixel.v);
            seen.probability >= LIKELY_DOT && off < reach_px
        });
        Chance {
            z: dot.facing,
            crowd: crowds[dot.index],
            is_found,
        }
    });
    chances.collect()
}

/// The curve of [`TooFewDots`] that fits these frames.
fn fit(frames: &[Vec<Chance>]) -> TooFewDots {
    // As for the default of the objective, to begin with.
    let mut b = Vector4::new(-2.2, 7.1, -0.5, 1.0);
    for _ in 0..STEPS {
        let (mut slope, mut information) = (Vector4::zeros(), Matrix4::identity());
        for frame in frames {
            for (posterior, level) in posterior(frame, &b).into_iter().zip(LEVELS) {
                for chance in frame {
                    let x = terms(chance, level[0]);
                    let p = logistic(b.dot(&x));
                    slope += posterior * (f64::from(chance.is_found) - p) * x;
                    information += (posterior * p * (1.0 - p)) * x * x.transpose();
                }
            }
        }
        // The identity above makes it invertible.
        b += information.try_inverse().unwrap_or_default() * slope;
        b[1] = b[1].clamp(SLOPES[0], SLOPES[1]);
        b[2] = b[2].clamp(-MAX_CROWDING, 0.0);
    }
    TooFewDots {
        visibility_limit: (-b[0] / b[1]).clamp(-0.5, 0.9),
        softness: 1.0 / b[1],
        limit_spread: (b[3] / b[1]).abs(),
        detection_probability: MAX_PROBABILITY,
        crowding: -b[2],
        ..TooFewDots::default()
    }
}

/// The terms of the regression at a level of the frame's own number.
fn terms(chance: &Chance, level: f64) -> Vector4<f64> {
    Vector4::new(1.0, chance.z, chance.crowd, level)
}

/// The probabilities of the levels, given what is found in a frame.
fn posterior(frame: &[Chance], b: &Vector4<f64>) -> [f64; LEVELS.len()] {
    let logs = LEVELS.map(|[level, weight]| {
        let logs = frame.iter().map(|chance| {
            let logit = b.dot(&terms(chance, level));
            let towards = if chance.is_found { -logit } else { logit };
            // The logarithm of a logistic function that does not overflow.
            -(towards.max(0.0) + (-towards.abs()).exp().ln_1p())
        });
        weight.ln() + logs.sum::<f64>()
    });
    let highest = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let weights = logs.map(|ln| (ln - highest).exp());
    let sum: f64 = weights.iter().sum();
    weights.map(|w| w / sum)
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use rand_distr::StandardNormal;

    use super::*;

    #[test]
    fn the_fit_finds_the_curve_that_dots_were_drawn_from() {
        let truth = TooFewDots {
            visibility_limit: 0.35,
            softness: 0.12,
            limit_spread: 0.2,
            detection_probability: MAX_PROBABILITY,
            crowding: 0.8,
            ..TooFewDots::default()
        };
        let mut rng = ChaCha8Rng::seed_from_u64(7);
        let frames: Vec<Vec<Chance>> = (0..4000)
            .map(|_| {
                let t: f64 = rng.sample(StandardNormal);
                let limit = truth.visibility_limit + truth.limit_spread * t;
                let dot = |_| {
                    let (z, crowd) = (rng.random::<f64>(), rng.random_range(0.0..1.5));
                    let logit = (z - limit) / truth.softness - truth.crowding * crowd;
                    Chance {
                        z,
                        crowd,
                        is_found: rng.random::<f64>() < logistic(logit),
                    }
                };
                (0..10).map(dot).collect()
            })
            .collect();
        let found = fit(&frames);
        assert!((found.visibility_limit - truth.visibility_limit).abs() < 0.02);
        assert!((found.softness - truth.softness).abs() < 0.01, "{found:?}");
        assert!((found.limit_spread - truth.limit_spread).abs() < 0.03);
        assert!((found.crowding - truth.crowding).abs() < 0.15, "{found:?}");
    }

    #[test]
    fn frames_without_dots_leave_the_beginning() {
        let found = fit(&[Vec::new(), Vec::new()]);
        assert!((found.visibility_limit - 0.31).abs() < 0.01);
    }
}
