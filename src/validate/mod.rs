//! Monte Carlo validation: how often a recognizer is correct on views made by a stated protocol.
//!
//! A trial rotates the pattern uniformly on SO(3), keeps the dots above the visibility limit, moves
//! each by noise, drops some, adds false ones, and shuffles the list. Two successes are counted,
//! each with its Wilson 95 % interval: *identity* (every real dot has its own index and every false
//! dot none) and *orientation* (error under 20 degrees, the failure threshold of the SpinDOE
//! paper). Views with fewer real dots than the protocol or the recognizer needs are counted
//! separately, whatever the number of their false dots.
//!
//! Trial `i` of seed `s` draws from stream `i` of a ChaCha8 generator seeded with `s`, and the sums
//! are taken in the order of the trials: the result is the same on any number of threads.

mod by_name;
mod protocol;
mod sensitivity;
mod trial;

pub use crate::stats::{Proportion, median};
pub use by_name::{
    NamedValidation, run_named, run_named_in, validate_named, validate_named_observed,
};
pub use protocol::{Noise, Protocol, ProtocolName};
pub use sensitivity::{
    SensitivityConfig, SensitivityPoint, SweptParameter, sensitivity, sensitivity_csv,
};
pub use trial::{Trial, TrialGenerator, observed_frames};

use std::ops::Range;

use crate::concurrency::{self, Stopwatch};
use crate::error::{Result, require};
use crate::geometry::rotation_angle;
use crate::pattern::Pattern;
use crate::recognize::{Identification, Recognizer};

/// Orientation errors of this value or more are failures, radians (20 degrees, SpinDOE Sec. IV).
pub const ORIENTATION_FAILURE_RAD: f64 = 20.0 * std::f64::consts::PI / 180.0;

/// Maximum number of trials of one run: their results are held, some 40 bytes each.
pub const MAX_TRIALS: u64 = 100_000_000;

/// Trials handled by one task; small enough to balance, large enough to reuse a workspace.
const CHUNK: u64 = 64;

/// Result of a validation.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Validation {
    /// The protocol's name.
    pub protocol: ProtocolName,
    /// Number of trials requested.
    pub samples: u64,
    /// Noise in degrees (`paper`, `sparse`, `clutter`), or its equivalent at the ball's center
    /// (`image`).
    pub sigma_deg: f64,
    /// The seed of the trials.
    pub seed: u64,
    /// Trials whose view had too few real dots to be an identification.
    pub skipped: u64,
    /// Every dot correctly identified, every false dot unassigned.
    pub identity: Proportion,
    /// Orientation error under 20 degrees.
    pub orientation: Proportion,
    /// Mean orientation error of the orientation successes, degrees.
    pub mean_error_deg: f64,
    /// Median orientation error of the orientation successes, degrees.
    pub median_error_deg: f64,
    /// Mean time of one identification on one thread, microseconds. The only value here that
    /// differs between runs; shipped results leave it out, see [`Validation::untimed`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub us_per_identification: Option<f64>,
    /// Median time of one identification on one thread, microseconds; no more repeatable than the
    /// mean.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub median_us_per_identification: Option<f64>,
}

impl Validation {
    /// The same values without the time, so that the same seed gives the same bytes.
    #[must_use]
    pub fn untimed(mut self) -> Self {
        self.us_per_identification = None;
        self.median_us_per_identification = None;
        self
    }
}

/// One trial's result.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum TrialResult {
    /// Too few dots to identify anything.
    Skipped,
    /// The recognizer was run.
    Judged {
        /// Every dot has its correct index, or none if false.
        identity: bool,
        /// Orientation error, radians; infinite where the recognizer rejected the view.
        error_rad: f64,
        /// The recognizer's own probability of being correct; 0 where it rejected the view.
        confidence: f64,
        /// The recognizer's own probability that the rotation is correct.
        pose_confidence: f64,
        /// Time of the identification, nanoseconds.
        nanoseconds: u64,
    },
}

/// Runs every trial and returns the results in their order.
///
/// # Errors
/// [`crate::Error::Argument`] for zero trials, too many, or a protocol outside its domain.
pub fn run_trials<R: Recognizer>(
    pattern: &Pattern,
    recognizer: &R,
    protocol: &Protocol,
    seed: u64,
    samples: u64,
) -> Result<Vec<TrialResult>> {
    run_trials_observed(pattern, recognizer, protocol, seed, samples, &|_| {})
}

/// As [`run_trials`]; `done` learns from any thread how many more trials are done.
///
/// # Errors
/// As [`run_trials`].
pub fn run_trials_observed<R: Recognizer>(
    pattern: &Pattern,
    recognizer: &R,
    protocol: &Protocol,
    seed: u64,
    samples: u64,
    done: &(dyn Fn(u64) + Sync),
) -> Result<Vec<TrialResult>> {
    require_samples(samples)?;
    run_trials_in(pattern, recognizer, protocol, seed, 0..samples, done)
}

/// Checks the number of trials.
fn require_samples(samples: u64) -> Result<()> {
    require(samples > 0, "samples", "at least 1 trial", samples)?;
    let expected = format!("at most {MAX_TRIALS} trials");
    require(samples <= MAX_TRIALS, "samples", &expected, samples)
}

/// As [`run_trials_observed`], for some of the trials only: ranges that follow each other give what
/// one call over all of them gives.
///
/// # Errors
/// [`crate::Error::Argument`] for a protocol outside its domain, or trials beyond the largest number.
pub fn run_trials_in<R: Recognizer>(
    pattern: &Pattern,
    recognizer: &R,
    protocol: &Protocol,
    seed: u64,
    trials: Range<u64>,
    done: &(dyn Fn(u64) + Sync),
) -> Result<Vec<TrialResult>> {
    protocol.check()?;
    require_samples(trials.end)?;
    let chunks = trials.start / CHUNK..trials.end.div_ceil(CHUNK);
    let results = concurrency::map_range(chunks, |chunk| {
        let mut generator = TrialGenerator::new(pattern, *protocol, seed);
        let mut trial = Trial::default();
        let mut workspace = recognizer.workspace();
        let mut answer = Identification::default();
        let from = (chunk * CHUNK).max(trials.start);
        let to = ((chunk + 1) * CHUNK).min(trials.end);
        let results: Vec<_> = (from..to)
            .map(|index| {
                generator.generate(index, &mut trial);
                judge(&trial, recognizer, protocol, &mut workspace, &mut answer)
            })
            .collect();
        done(to - from);
        results
    });
    Ok(results.into_iter().flatten().collect())
}

/// Runs the recognizer on one view and compares its answer with the truth. The answer is left in
/// `answer`, unless the view was skipped or rejected.
pub fn judge<R: Recognizer>(
    trial: &Trial,
    recognizer: &R,
    protocol: &Protocol,
    workspace: &mut R::Workspace,
    answer: &mut Identification,
) -> TrialResult {
    // False dots do not make a usable view of one that shows too few real dots.
    if trial.real_dots() < protocol.min_dots.max(recognizer.min_dots()) {
        return TrialResult::Skipped;
    }
    let start = Stopwatch::start();
    let outcome = recognizer.identify_into(&trial.dots, workspace, answer);
    let nanoseconds = start.elapsed().as_nanos() as u64;
    match outcome {
        Ok(()) => TrialResult::Judged {
            identity: answer.assignment == trial.truth,
            error_rad: rotation_angle(&answer.rotation, &trial.rotation),
            confidence: answer.confidence,
            pose_confidence: answer.pose_confidence,
            nanoseconds,
        },
        Err(_) => TrialResult::Judged {
            identity: false,
            error_rad: f64::INFINITY,
            confidence: 0.0,
            pose_confidence: 0.0,
            nanoseconds,
        },
    }
}

/// Validates a recognizer on `samples` trials of a protocol.
///
/// # Errors
/// As [`run_trials`].
pub fn validate<R: Recognizer>(
    pattern: &Pattern,
    recognizer: &R,
    protocol: &Protocol,
    seed: u64,
    samples: u64,
) -> Result<Validation> {
    let results = run_trials(pattern, recognizer, protocol, seed, samples)?;
    Ok(summarize(&results, protocol, seed))
}

/// Counts successes over a set of trials.
pub fn summarize(results: &[TrialResult], protocol: &Protocol, seed: u64) -> Validation {
    let (mut identity, mut trials) = (0u64, 0u64);
    let mut times = Vec::with_capacity(results.len());
    let mut errors = Vec::with_capacity(results.len());
    for result in results {
        if let TrialResult::Judged {
            identity: is_correct,
            error_rad,
            nanoseconds,
            ..
        } = *result
        {
            trials += 1;
            times.push(nanoseconds as f64 / 1000.0);
            identity += u64::from(is_correct);
            if error_rad < ORIENTATION_FAILURE_RAD {
                errors.push(error_rad.to_degrees());
            }
        }
    }
    let orientation = errors.len() as u64;
    Validation {
        protocol: protocol.name,
        samples: results.len() as u64,
        sigma_deg: protocol.sigma_rad().to_degrees(),
        seed,
        skipped: results.len() as u64 - trials,
        identity: Proportion::new(identity, trials),
        orientation: Proportion::new(orientation, trials),
        mean_error_deg: errors.iter().sum::<f64>() / orientation.max(1) as f64,
        median_error_deg: median(&mut errors),
        us_per_identification: Some(times.iter().sum::<f64>() / trials.max(1) as f64),
        median_us_per_identification: Some(median(&mut times)),
    }
}
