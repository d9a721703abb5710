//! Advice for a camera: what several patterns give before it, and which change of the camera would
//! help most.
//!
//! Patterns are ranked by the *effective error* of an orientation, the root mean square error of
//! the right answers over `sqrt(right - 2 wrong)`, with `right` and `wrong` as shares of all
//! frames: the error of a spin that is fitted to many frames grows with it, since a frame without
//! an answer gives nothing and a wrong answer takes up, on average, what two right ones give.

use serde::{Deserialize, Serialize};

use super::conditions::CameraConditions;
use super::frames::{FramePrediction, FrameRates, PredictConfig, Predictor};
use super::model::DetectionModel;
use super::spins::SpinPrediction;
use crate::error::{Error, Result};
use crate::pattern::Pattern;
use crate::stencil::{Stencil, StencilConfig};

/// Right answers that a wrong one takes up.
const COST_OF_WRONG: f64 = 2.0;
/// Least share of frames that the effective error divides by.
const MIN_SHARE: f64 = 0.01;

/// The designs that the crate ships, by name.
const SHIPPED: [(&str, &str); 8] = [
    ("dots12", include_str!("../../designs/dots12/pattern.csv")),
    ("dots16", include_str!("../../designs/dots16/pattern.csv")),
    ("dots20", include_str!("../../designs/dots20/pattern.csv")),
    (
        "dots20-paper",
        include_str!("../../designs/dots20-paper/pattern.csv"),
    ),
    ("dots24", include_str!("../../designs/dots24/pattern.csv")),
    ("dots28", include_str!("../../designs/dots28/pattern.csv")),
    ("dots32", include_str!("../../designs/dots32/pattern.csv")),
    ("dots40", include_str!("../../designs/dots40/pattern.csv")),
];

/// A pattern and its name.
#[derive(Debug, Clone, PartialEq)]
pub struct NamedPattern {
    /// The name in the table.
    pub name: String,
    /// The pattern.
    pub pattern: Pattern,
}

/// The designs that the crate ships.
///
/// # Errors
/// [`Error::Internal`] where one cannot be read.
pub fn shipped_designs() -> Result<Vec<NamedPattern>> {
    SHIPPED
        .iter()
        .map(|(name, csv)| {
            let pattern = Pattern::from_csv(name.as_ref(), csv.as_bytes())
                .map_err(|e| Error::Internal(e.to_string()))?;
            Ok(NamedPattern {
                name: (*name).to_owned(),
                pattern,
            })
        })
        .collect()
}

/// How large the dots of a pattern are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum DotSize {
    /// As the conditions state.
    Stated,
    /// As large as the holes of its stencil can be on a ball of this diameter, mm, up to
    /// [`MAX_DOT`].
    LargestHole {
        /// The ball's diameter, mm.
        ball_mm: f64,
    },
}

/// Largest dot that is proposed, ball diameters: the detector was trained up to here.
pub const MAX_DOT: f64 = 0.13;

impl DotSize {
    fn of(self, pattern: &Pattern, conditions: &CameraConditions) -> Result<f64> {
        let Self::LargestHole { ball_mm } = self else {
            return Ok(conditions.dot_diameter);
        };
        let config = StencilConfig {
            ball_diameter_mm: ball_mm,
            ..StencilConfig::default()
        };
        config.validate()?;
        let hole = Stencil::largest_hole_mm(pattern, &config);
        Ok(hole.map_or(conditions.dot_diameter, |mm| (mm / ball_mm).min(MAX_DOT)))
    }
}

/// From how much the advice is made.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AdviceConfig {
    /// Frames and estimator.
    pub predict: PredictConfig,
    /// Sequences a pattern. Default: 100.
    pub sequences: u64,
    /// Frames of a sequence. Default: 10.
    pub sequence_frames: usize,
    /// Default: as stated.
    pub dot_size: DotSize,
}

impl Default for AdviceConfig {
    fn default() -> Self {
        Self {
            predict: PredictConfig::default(),
            sequences: 100,
            sequence_frames: 10,
            dot_size: DotSize::Stated,
        }
    }
}

/// What a pattern gives.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PatternAdvice {
    /// Its name.
    pub name: String,
    /// Number of dots.
    pub dots: usize,
    /// Their diameter over that of the ball.
    pub dot_diameter: f64,
    /// Single frames.
    pub frames: FramePrediction,
    /// See the module, degrees.
    pub effective_error_deg: f64,
    /// Sequences.
    pub spin: SpinPrediction,
}

/// What the best pattern would give after one change.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ChangeAdvice {
    /// The change in words.
    pub change: String,
    /// Single frames.
    pub frames: FramePrediction,
    /// See the module, degrees.
    pub effective_error_deg: f64,
}

/// Advice for a camera.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Advice {
    /// The camera.
    pub conditions: CameraConditions,
    /// The patterns, the best first.
    pub patterns: Vec<PatternAdvice>,
    /// Changes for the best pattern, the most helpful first.
    pub changes: Vec<ChangeAdvice>,
    /// Spins from here on have a slower alias at this frame rate, revolutions per second.
    pub unique_up_to_rps: f64,
}

/// The effective error of these rates, degrees.
pub fn effective_error_deg(rates: &FrameRates) -> f64 {
    let share = rates.right.rate - COST_OF_WRONG * rates.wrong.rate;
    rates.rms_error_deg / share.max(MIN_SHARE).sqrt()
}

/// Advice on these patterns; all are seen in the same scenes. `done` learns how many more of the
/// predictions ([`predictions`]) are made.
///
/// # Errors
/// [`Error::Argument`] for conditions or numbers outside their domain, or no pattern.
pub fn advise(
    model: &DetectionModel,
    patterns: &[NamedPattern],
    conditions: &CameraConditions,
    config: &AdviceConfig,
    done: &dyn Fn(u64),
) -> Result<Advice> {
    let PredictConfig {
        frames,
        seed,
        estimator,
    } = config.predict;
    let mut ranked = Vec::with_capacity(patterns.len());
    for (at, named) in patterns.iter().enumerate() {
        let predictor = Predictor::new(model, &named.pattern, estimator)?;
        let own = CameraConditions {
            dot_diameter: config.dot_size.of(&named.pattern, conditions)?,
            ..*conditions
        };
        let single = predictor.frames(&own, seed, frames)?;
        done(1);
        let spin = predictor.spins(&own, seed, config.sequences, config.sequence_frames)?;
        done(1);
        let advice = PatternAdvice {
            name: named.name.clone(),
            dots: named.pattern.len(),
            dot_diameter: own.dot_diameter,
            effective_error_deg: effective_error_deg(&single.rates),
            frames: single,
            spin,
        };
        ranked.push((at, advice));
    }
    ranked.sort_by(|(_, a), (_, b)| a.effective_error_deg.total_cmp(&b.effective_error_deg));
    let (best, best_conditions) = ranked
        .first()
        .map(|(at, advice)| {
            let own = CameraConditions {
                dot_diameter: advice.dot_diameter,
                ..*conditions
            };
            (&patterns[*at].pattern, own)
        })
        .ok_or_else(|| Error::argument("patterns", "expected at least one"))?;
    let predictor = Predictor::new(model, best, estimator)?;
    let mut changes = Vec::new();
    for (change, changed) in changes_of(&best_conditions) {
        let single = predictor.frames(&changed, seed, frames)?;
        done(1);
        changes.push(ChangeAdvice {
            change,
            effective_error_deg: effective_error_deg(&single.rates),
            frames: single,
        });
    }
    changes.sort_by(|a, b| a.effective_error_deg.total_cmp(&b.effective_error_deg));
    Ok(Advice {
        conditions: *conditions,
        patterns: ranked.into_iter().map(|(_, advice)| advice).collect(),
        changes,
        unique_up_to_rps: 0.5 * conditions.fps,
    })
}

/// Number of predictions that [`advise`] makes for so many patterns.
pub fn predictions(patterns: usize, conditions: &CameraConditions) -> u64 {
    2 * patterns as u64 + changes_of(conditions).len() as u64
}

/// One change at a time, where it stays within the domain.
fn changes_of(conditions: &CameraConditions) -> Vec<(String, CameraConditions)> {
    let now = *conditions;
    let (larger, wider, shorter) = (
        1.5 * now.ball_px,
        1.25 * now.dot_diameter,
        0.5 * now.exposure_s,
    );
    let mut changes = vec![
        (
            format!("ball of {larger:.0} pixels instead of {:.0}", now.ball_px),
            CameraConditions {
                ball_px: larger,
                ..now
            },
        ),
        (
            format!(
                "dots of {:.1} % of the ball's diameter instead of {:.1} %",
                100.0 * wider,
                100.0 * now.dot_diameter
            ),
            CameraConditions {
                dot_diameter: wider,
                ..now
            },
        ),
        (
            format!(
                "exposure of {:.3} ms instead of {:.3}",
                1e3 * shorter,
                1e3 * now.exposure_s
            ),
            CameraConditions {
                exposure_s: shorter,
                ..now
            },
        ),
    ];
    if now.surroundings != super::Surroundings::Dark {
        changes.push((
            "dark surroundings, even light, nothing before the ball".into(),
            CameraConditions {
                surroundings: super::Surroundings::Dark,
                ..now
            },
        ));
    }
    changes.retain(|(_, changed)| changed.check().is_ok());
    changes
}
