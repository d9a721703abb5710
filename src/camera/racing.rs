//! Which of several patterns is best for a camera, without as many frames for those that are clearly
//! worse.
//!
//! All patterns are tried on the same frames, in rounds that double the number of frames. After each
//! round a pattern leaves that is clearly worse than the leader, the one of the smallest
//! [`FrameRates::effective_error_deg`]: where the paired difference of `ln E^2` lies so far above zero
//! that chance alone would not do so in 5 of 100 races, over all comparisons that a race makes together. (O. Maron,
//! A. W. Moore, "Hoeffding races", NIPS 1993, with paired normal intervals instead of Hoeffding's.)
//!
//! The variance of a difference is the sum of the squared differences of both patterns' changes of
//! `ln E^2` over the frames, so that what is hard for both patterns cancels. Where the first order says
//! nothing, the 95 % interval of the difference of the shares of right answers decides.

use std::ops::Range;

use super::frames::{FrameOutcome, FrameRates, ln_squared_error, paired};
use super::trials::CameraTrials;
use crate::error::{Result, require};
use crate::pattern::Pattern;
use crate::stats::normal_cdf;

/// Probability that the best leaves, over all comparisons of a race.
const ERROR: f64 = 0.05;

/// How long a race is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RaceConfig {
    /// Frames of the first round. Default: 128.
    pub first_frames: u64,
    /// Frames of a pattern that stays to the end. Default: 1024.
    pub max_frames: u64,
}

impl RaceConfig {
    /// A race of at most so many frames a pattern.
    pub fn of_frames(max_frames: u64) -> Self {
        let first_frames = Self::default().first_frames.min(max_frames);
        Self {
            first_frames,
            max_frames,
        }
    }
}

impl Default for RaceConfig {
    fn default() -> Self {
        Self {
            first_frames: 128,
            max_frames: 1024,
        }
    }
}

/// How a pattern did in a race.
#[derive(Debug, Clone, PartialEq)]
pub struct RaceResult {
    /// Its place in the input.
    pub entry: usize,
    /// Its outcomes, those of the frames from 0 on: their number says how long it stayed.
    pub outcomes: Vec<FrameOutcome>,
    /// Whether it left before the end, being clearly worse.
    pub left: bool,
}

impl RaceResult {
    /// Smaller is better.
    fn loss(&self) -> f64 {
        let rates = FrameRates::of(&self.outcomes, 0);
        if rates.right.successes == 0 {
            return f64::INFINITY;
        }
        rates.effective_error_deg
    }
}

/// Races `entries` patterns; the best first, then those that stayed to the end, then those that left,
/// the last to leave first. `try_frames` gives an entry's outcomes of a range of frames, in their
/// order; frame `k` must be the same scene for every entry.
///
/// # Errors
/// [`crate::Error::Argument`] for a number of frames or entries outside its domain; those of
/// `try_frames`.
pub fn race(
    entries: usize,
    config: &RaceConfig,
    mut try_frames: impl FnMut(usize, Range<u64>) -> Result<Vec<FrameOutcome>>,
) -> Result<Vec<RaceResult>> {
    require(entries > 0, "patterns", "at least 1", entries)?;
    let RaceConfig {
        first_frames,
        max_frames,
    } = *config;
    require(max_frames > 0, "frames", "at least 1", max_frames)?;
    require(
        first_frames > 0 && first_frames <= max_frames,
        "first_frames",
        &format!("1 to {max_frames}"),
        first_frames,
    )?;
    let mut racing: Vec<RaceResult> = (0..entries)
        .map(|entry| RaceResult {
            entry,
            outcomes: Vec::new(),
            left: false,
        })
        .collect();
    let mut gone: Vec<RaceResult> = Vec::new();
    let rounds = (max_frames.div_ceil(first_frames))
        .next_power_of_two()
        .ilog2();
    let comparisons = (entries - 1) as f64 * f64::from(rounds);
    let error = ERROR / comparisons.max(1.0);
    let (mut done, mut next) = (0, first_frames);
    loop {
        for standing in &mut racing {
            standing
                .outcomes
                .extend(try_frames(standing.entry, done..next)?);
        }
        racing.sort_by(|a, b| a.loss().total_cmp(&b.loss()));
        done = next;
        if done == max_frames {
            break;
        }
        next = done.saturating_mul(2).min(max_frames);
        let (stay, mut leave): (Vec<_>, Vec<_>) = {
            let leader = racing[0].outcomes.clone();
            racing
                .into_iter()
                .partition(|s| !is_clearly_worse(&s.outcomes, &leader, error))
        };
        for standing in &mut leave {
            standing.left = true;
        }
        leave.append(&mut gone);
        gone = leave;
        racing = stay;
    }
    racing.append(&mut gone);
    Ok(racing)
}

/// A pattern in a race.
#[derive(Debug, Clone, Copy)]
pub struct Racer<'a> {
    /// The pattern.
    pub pattern: &'a Pattern,
    /// The diameter of its dots, over that of the ball.
    pub dot_diameter: f64,
}

/// Races patterns on the frames of a camera, each with its own dots. `done` learns how many more
/// frames are read or, at the end, were spared: `racers.len() * max_frames` in all.
///
/// # Errors
/// As [`race`] and [`CameraTrials::frames`].
pub fn race_patterns(
    trials: &CameraTrials,
    racers: &[Racer<'_>],
    config: &RaceConfig,
    done: &(dyn Fn(u64) + Sync),
) -> Result<Vec<RaceResult>> {
    let standings = race(racers.len(), config, |entry, frames| {
        let racer = &racers[entry];
        let own = trials.with_dot_diameter(racer.dot_diameter);
        own.frames(racer.pattern, frames, done)
    })?;
    let spared = |s: &RaceResult| config.max_frames - s.outcomes.len() as u64;
    done(standings.iter().map(spared).sum());
    Ok(standings)
}

/// Whether these outcomes are worse than the leader's, by more than chance does with the probability
/// `error`.
fn is_clearly_worse(outcomes: &[FrameOutcome], leader: &[FrameOutcome], error: f64) -> bool {
    let (Some((own, own_changes)), Some((best, best_changes))) =
        (ln_squared_error(outcomes), ln_squared_error(leader))
    else {
        return paired(leader, outcomes).high < 0.0;
    };
    let changes = own_changes.iter().zip(&best_changes);
    let variance: f64 = changes.map(|(a, b)| (a - b) * (a - b)).sum();
    // Not NaN: outcomes that do not differ have no variance.
    own > best && normal_cdf((best - own) / variance.sqrt()) < error
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    /// Frames that are right with a known rate, with the same error each: `E^2` is `e^2 / rate`. The
    /// uniform number of a frame is the same for all entries, as its scene is.
    fn toy(seed: u64, rates: &[f64], config: &RaceConfig) -> Vec<RaceResult> {
        race(rates.len(), config, |entry, frames| {
            Ok(frames
                .map(|k| {
                    let mut rng = ChaCha8Rng::seed_from_u64(seed);
                    rng.set_stream(k);
                    let (shared, own) = (rng.random::<f64>(), {
                        rng.set_stream(k | (entry as u64 + 1) << 32);
                        rng.random::<f64>()
                    });
                    // Half of the frames are as hard for every entry.
                    let hardness = if k % 2 == 0 { shared } else { own };
                    if hardness < rates[entry] {
                        FrameOutcome::Answered { error_rad: 0.02 }
                    } else {
                        FrameOutcome::Unanswered
                    }
                })
                .collect())
        })
        .expect("a valid race")
    }

    #[test]
    fn the_best_of_known_rates_stays_to_the_end() {
        let rates = [0.70, 0.80, 0.90, 0.85, 0.95, 0.60, 0.90, 0.50];
        let races = 400;
        let (mut lost, mut tried) = (0, 0);
        for seed in 0..races {
            let standings = toy(seed, &rates, &RaceConfig::default());
            let best = standings.iter().find(|s| s.entry == 4);
            lost += u64::from(best.is_none_or(|s| s.left));
            tried += standings.iter().map(|s| s.outcomes.len()).sum::<usize>();
        }
        let full = races as usize * rates.len() * RaceConfig::default().max_frames as usize;
        println!("lost {lost} of {races}; tried {tried} of {full}");
        // Many races would lose the best in 5 of 100, were there another as good.
        assert!(lost <= races / 40, "{lost} of {races}");
        assert!(2 * tried < full, "{tried} of {full}");
    }

    #[test]
    fn those_that_leave_had_fewer_frames_and_stand_last() {
        let config = RaceConfig::default();
        let standings = toy(1, &[0.3, 0.95, 0.6], &config);
        assert_eq!(standings[0].entry, 1);
        assert_eq!(standings[0].outcomes.len() as u64, config.max_frames);
        for worse in &standings[1..] {
            assert!(worse.left && (worse.outcomes.len() as u64) < config.max_frames);
        }
        // Nothing distinguishes an entry from itself.
        assert!(!is_clearly_worse(
            &standings[0].outcomes,
            &standings[0].outcomes,
            0.05
        ));
    }

    #[test]
    fn a_pattern_that_is_never_right_leaves_and_never_leads() {
        let standings = toy(2, &[0.0, 0.9], &RaceConfig::default());
        assert_eq!((standings[0].entry, standings[1].left), (1, true));
    }

    #[test]
    fn a_race_without_entries_or_frames_is_refused() {
        let none = |_, _| Ok(Vec::new());
        assert!(race(0, &RaceConfig::default(), none).is_err());
        let config = RaceConfig {
            first_frames: 0,
            ..RaceConfig::default()
        };
        assert!(race(1, &config, none).is_err());
    }
}
