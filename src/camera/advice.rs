//! Advice for a camera: which of several patterns, and which change of the camera would help most.
//!
//! The patterns race (see [`super::race`]), and are measured on frames that the race has not seen; those that
//! stay to the end are also tried on sequences. Then the camera is changed in one property at a time for the
//! best of them. What other patterns and changes are worth is the ratio of their error to the best one's on
//! the same scenes, with its interval: what holds 1 is not decided.

use std::sync::atomic::AtomicBool;

use serde::{Deserialize, Serialize};

use super::conditions::{CameraConditions, Surroundings};
use super::frames::{ErrorRatio, FrameOutcome, FrameRates};
use super::racing::{RaceConfig, RaceResult, Racer, race_patterns};
use super::sequences::SpinRates;
use super::trials::CameraTrials;
use crate::error::Result;
use crate::pattern::{NamedPattern, Pattern};
use crate::stencil::{Stencil, StencilConfig};

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
    /// As the pattern's design says ([`NamedPattern::design`]), else as [`DotSize::LargestHole`].
    Designed {
        /// The ball's diameter where the design says nothing, mm.
        ball_mm: f64,
    },
}

/// Largest dot that is proposed, ball diameters: the detector was trained up to here.
pub const MAX_DOT: f64 = 0.13;

impl DotSize {
    /// The diameter of this pattern's dots, over that of the ball.
    ///
    /// # Errors
    /// [`crate::Error::Argument`] for a diameter of the ball outside its domain.
    pub fn of(self, pattern: &Pattern, conditions: &CameraConditions) -> Result<f64> {
        let ball_mm = match self {
            Self::Stated => return Ok(conditions.dot_diameter),
            Self::LargestHole { ball_mm } | Self::Designed { ball_mm } => ball_mm,
        };
        let config = StencilConfig::for_ball(ball_mm);
        config.validate()?;
        let hole = Stencil::largest_hole_mm(pattern, &config);
        Ok(hole.map_or(conditions.dot_diameter, |mm| (mm / ball_mm).min(MAX_DOT)))
    }

    /// The diameter of the dots of a pattern whose design may be known, over that of the ball.
    ///
    /// # Errors
    /// As [`DotSize::of`].
    pub fn of_named(self, named: &NamedPattern, conditions: &CameraConditions) -> Result<f64> {
        match (self, &named.design) {
            (Self::Designed { .. }, Some(design)) => Ok(design.dot_diameter()),
            (size, _) => size.of(&named.pattern, conditions),
        }
    }
}

/// From how much the advice is made.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AdviceConfig {
    /// Frames of the race and of what is measured after it; a change of the camera is tried on those on which the
    /// best pattern is measured.
    pub race: RaceConfig,
    /// Sequences for a pattern that stays to the end. Default: 24.
    pub sequences: u64,
    /// Frames of a sequence. Default: 10.
    pub sequence_frames: usize,
    /// Default: as stated.
    pub dot_size: DotSize,
    /// Diameter of the ball, mm: larger dots are proposed as far as its stencil leaves room. Default: 40.
    pub ball_mm: f64,
}

impl Default for AdviceConfig {
    fn default() -> Self {
        Self {
            race: RaceConfig::default(),
            sequences: 24,
            sequence_frames: 10,
            dot_size: DotSize::Stated,
            ball_mm: 40.0,
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
    /// Whether it left the race, being clearly worse than the best.
    pub left: bool,
    /// Single frames, which the race has not seen.
    pub frames: FrameRates,
    /// Its error over that of the first pattern on the same scenes; none for the first, and where there are too few right answers.
    pub error_ratio: Option<ErrorRatio>,
    /// Sequences; none for a pattern that left the race.
    pub spin: Option<SpinRates>,
}

/// What the best pattern would give after one change.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ChangeAdvice {
    /// The change in words.
    pub change: String,
    /// Single frames, the scenes of [`PatternAdvice::frames`] of the best pattern.
    pub frames: FrameRates,
    /// The error over that without the change on the same scenes; none where there are too few right answers. The
    /// intervals of all changes hold at once in 95 %.
    pub error_ratio: Option<ErrorRatio>,
}

impl ChangeAdvice {
    /// Whether the change makes the error smaller, beyond what chance does.
    pub fn helps(&self) -> bool {
        self.error_ratio.is_some_and(|ratio| ratio.is_smaller())
    }
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

impl AdviceConfig {
    /// Number of frames that [`advise`] reads for so many patterns, or is spared.
    pub fn frames(&self, patterns: usize, conditions: &CameraConditions) -> u64 {
        let single = self.race.frames() + self.sequences * self.sequence_frames as u64;
        patterns as u64 * single
            + changes_of(conditions, f64::INFINITY).len() as u64 * self.race.max_frames
    }
}

/// Advice on these patterns; all are seen in the same scenes. `done` learns how many more frames
/// ([`AdviceConfig::frames`]) are read or spared.
///
/// # Errors
/// [`crate::Error::Argument`] for conditions or numbers outside their domain, or no pattern.
pub fn advise(
    trials: &CameraTrials,
    patterns: &[NamedPattern],
    config: &AdviceConfig,
    done: &(dyn Fn(u64) + Sync),
) -> Result<Advice> {
    let conditions = &trials.conditions;
    let racers = patterns.iter().map(|named| {
        Ok(Racer {
            pattern: &named.pattern,
            dot_diameter: config.dot_size.of_named(named, conditions)?,
        })
    });
    let racers = racers.collect::<Result<Vec<_>>>()?;
    let never = AtomicBool::new(false);
    let results = race_patterns(trials, &racers, &config.race, &never, done)?;
    // A race without racers is an error: there is a first.
    let best = &results[0];
    let ranked = results.iter().map(|result| {
        let racer = &racers[result.entry];
        let is_other = result.entry != best.entry;
        // The fewer frames of one that left are the first of the best one's.
        let ratio = || ErrorRatio::of(best.first(&result.outcomes), &result.outcomes, 1);
        Ok(PatternAdvice {
            name: patterns[result.entry].name.clone(),
            dots: racer.pattern.len(),
            dot_diameter: racer.dot_diameter,
            left: result.left,
            frames: FrameRates::of(&result.outcomes, trials.seed),
            error_ratio: is_other.then(ratio).flatten(),
            spin: spin_of(trials, racer, result, config, done)?,
        })
    });
    let ranked = ranked.collect::<Result<Vec<_>>>()?;
    let changes = changes(trials, &racers[best.entry], &best.outcomes, config, done)?;
    Ok(Advice {
        conditions: *conditions,
        patterns: ranked,
        changes,
        unique_up_to_rps: 0.5 * conditions.fps,
    })
}

fn spin_of(
    trials: &CameraTrials,
    racer: &Racer<'_>,
    result: &RaceResult,
    config: &AdviceConfig,
    done: &(dyn Fn(u64) + Sync),
) -> Result<Option<SpinRates>> {
    let AdviceConfig {
        sequences,
        sequence_frames,
        ..
    } = *config;
    if result.left {
        done(sequences * sequence_frames as u64);
        return Ok(None);
    }
    let own = trials.with_dot_diameter(racer.dot_diameter);
    let spins = own.spins(racer.pattern, sequences, sequence_frames, done)?;
    Ok(Some(spins))
}

/// What each change of the camera gives of a pattern with these outcomes without it, the smallest effective error first.
fn changes(
    trials: &CameraTrials,
    racer: &Racer<'_>,
    unchanged: &[FrameOutcome],
    config: &AdviceConfig,
    done: &(dyn Fn(u64) + Sync),
) -> Result<Vec<ChangeAdvice>> {
    let ball_mm = config.ball_mm;
    let largest = DotSize::LargestHole { ball_mm }.of(racer.pattern, &trials.conditions)?;
    let own = trials.with_dot_diameter(racer.dot_diameter).conditions;
    let all = changes_of(&own, largest);
    let count = all.len();
    let changed = all.into_iter().map(|(change, conditions)| {
        let changed = CameraTrials {
            conditions,
            ..*trials
        };
        let outcomes = changed.frames(racer.pattern, config.race.fresh(false), done)?;
        Ok(ChangeAdvice {
            change,
            frames: FrameRates::of(&outcomes, trials.seed),
            error_ratio: ErrorRatio::of(unchanged, &outcomes, count),
        })
    });
    let mut changes = changed.collect::<Result<Vec<_>>>()?;
    changes.sort_by(|a, b| {
        let [a, b] = [a, b].map(|c| c.frames.effective_error_deg);
        a.total_cmp(&b)
    });
    Ok(changes)
}

/// One change at a time, where it stays within the domain and dots within the largest.
fn changes_of(conditions: &CameraConditions, largest_dot: f64) -> Vec<(String, CameraConditions)> {
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
    if now.surroundings != Surroundings::Dark {
        changes.push((
            "dark surroundings, even light, nothing before the ball".into(),
            CameraConditions {
                surroundings: Surroundings::Dark,
                ..now
            },
        ));
    }
    changes.retain(|(_, changed)| {
        let is_possible = changed.dot_diameter <= largest_dot.max(now.dot_diameter);
        is_possible && changed.check().is_ok()
    });
    changes
}
