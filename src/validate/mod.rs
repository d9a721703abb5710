//! Monte Carlo validation: how often a recognizer is correct on views made by a stated protocol.
//!
//! A trial rotates the pattern uniformly on SO(3), keeps the dots above the visibility limit, moves
//! each by noise, drops some, adds false ones, and shuffles the list. Two successes are counted,
//! each with its Wilson 95 % interval: *identity* (every real dot has its own index and every false
//! dot none) and *orientation* (error under 20 degrees, the failure threshold of the SpinDOE
//! paper). Both are rates of the views that could be judged: those with fewer real dots than the protocol or the
//! recognizer needs are skipped, whatever the number of their false dots. The rate that comes first is of all views
//! ([`Validation::answered`]): a view that shows too few dots is a failure of the pattern.
//!
//! [`Trials`] is the one place where trials are run: of a [`ViewModel`], by any [`Recognizer`]. The
//! sums are taken in the order of the trials: the result is the same on any number of threads.

mod sensitivity;

pub use crate::stats::{Proportion, median};
use crate::view::{Protocol, ProtocolName, Trial, TrialGenerator, ViewModel};
pub use sensitivity::{
    SensitivityConfig, SensitivityPoint, SweptParameter, sensitivity, sensitivity_csv,
};

use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering};

use crate::ball::Ball;
use crate::concurrency::{self, Stopwatch};
use crate::error::{Error, Result, require};
use crate::geometry::rotation_angle;
use crate::pattern::Pattern;
use crate::recognize::{NamedRecognizer, Recognizer, RecognizerName};

pub use crate::recognize::ORIENTATION_FAILURE_RAD;

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
    /// Orientation error under 20 degrees, of all views: one that shows too few dots counts as a failure.
    pub answered: Proportion,
    /// Trials whose view had too few real dots to be an identification.
    pub skipped: u64,
    /// Every dot correctly identified, every false dot unassigned, of the views that were not skipped.
    pub identity: Proportion,
    /// Orientation error under 20 degrees, of the views that were not skipped.
    pub orientation: Proportion,
    /// Mean orientation error of the orientation successes, degrees; not a number (null in JSON) without any.
    #[serde(deserialize_with = "crate::stats::or_nan")]
    pub mean_error_deg: f64,
    /// Median orientation error of the orientation successes, degrees; not a number (null in JSON) without any.
    #[serde(deserialize_with = "crate::stats::or_nan")]
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
    /// Share of the views that show too few dots.
    pub fn skipped_share(&self) -> f64 {
        self.skipped as f64 / self.samples.max(1) as f64
    }

    /// The same values without the time, so that the same seed gives the same bytes.
    #[must_use]
    pub fn untimed(mut self) -> Self {
        self.us_per_identification = None;
        self.median_us_per_identification = None;
        self
    }
}

/// Checks a number of trials before any of them is run.
///
/// # Errors
/// [`crate::Error::Argument`] for none and for more than [`MAX_TRIALS`].
pub fn check_samples(samples: u64) -> Result<()> {
    require(samples > 0, "samples", "at least 1 trial", samples)?;
    let expected = format!("at most {MAX_TRIALS} trials");
    require(samples <= MAX_TRIALS, "samples", &expected, samples)
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
        dots_confidence: f64,
        /// The recognizer's own probability that the rotation is correct.
        confidence: f64,
        /// Time of the identification, nanoseconds.
        nanoseconds: u64,
    },
}

/// Trials of a view model: which, of which ball.
#[derive(Debug, Clone)]
pub struct Trials<'p> {
    /// The pattern that the views show.
    pub pattern: &'p Pattern,
    /// What is seen of it.
    pub view: ViewModel,
    /// Seed of the trials.
    pub seed: u64,
    /// Their numbers: ranges that follow each other give what one run over all of them gives.
    pub range: Range<u64>,
    /// What ends the run before, with an error.
    pub stop: Option<&'p AtomicBool>,
}

impl<'p> Trials<'p> {
    /// The first `samples` trials of a seed.
    pub fn first(pattern: &'p Pattern, view: ViewModel, seed: u64, samples: u64) -> Self {
        Self {
            pattern,
            view,
            seed,
            range: 0..samples,
            stop: None,
        }
    }

    /// Runs the recognizer on every trial; the results are in the trials' order. `observer` learns
    /// from any thread how many more trials are done.
    ///
    /// # Errors
    /// [`crate::Error::Argument`] for no trials, too many, or a view model outside its domain; [`crate::Error::Stopped`].
    pub fn run<R: Recognizer>(
        &self,
        recognizer: &R,
        observer: &(dyn Fn(u64) + Sync),
    ) -> Result<Vec<TrialResult>> {
        let Range { start, end } = self.range;
        self.view.check()?;
        check_samples(if start < end { end } else { 0 })?;
        let chunks = start / CHUNK..end.div_ceil(CHUNK);
        let is_stopped = || self.stop.is_some_and(|stop| stop.load(Ordering::Relaxed));
        let results = concurrency::map_range(chunks, |chunk| {
            if is_stopped() {
                return Vec::new();
            }
            let mut generator = self.generator();
            let mut trial = Trial::default();
            let mut workspace = recognizer.workspace();
            let (from, to) = ((chunk * CHUNK).max(start), ((chunk + 1) * CHUNK).min(end));
            let results: Vec<_> = (from..to)
                .take_while(|_| !is_stopped())
                .map(|index| {
                    generator.generate(index, &mut trial);
                    self.judge(&trial, recognizer, &mut workspace)
                })
                .collect();
            observer(to - from);
            results
        });
        if is_stopped() {
            return Err(Error::Stopped);
        }
        Ok(results.into_iter().flatten().collect())
    }

    /// Draws the trials one by one.
    pub fn generator(&self) -> TrialGenerator<'p> {
        TrialGenerator::new(self.pattern.dots(), self.view, self.seed)
    }

    /// Runs the recognizer on one view and compares its answer with the truth.
    pub fn judge<R: Recognizer>(
        &self,
        trial: &Trial,
        recognizer: &R,
        workspace: &mut R::Workspace,
    ) -> TrialResult {
        // False dots do not make a usable view of one that shows too few real dots.
        if trial.real_dots() < self.view.min_dots.max(recognizer.min_dots()) {
            return TrialResult::Skipped;
        }
        let start = Stopwatch::start();
        let outcome = recognizer.explain(&trial.dots, None, workspace);
        let nanoseconds = start.elapsed().as_nanos() as u64;
        match outcome.map(|explanations| explanations.best()) {
            Ok(answer) => TrialResult::Judged {
                identity: answer.assignment == trial.truth,
                error_rad: rotation_angle(&answer.rotation, &trial.rotation),
                dots_confidence: answer.dots_confidence,
                confidence: answer.confidence,
                nanoseconds,
            },
            Err(_) => TrialResult::Judged {
                identity: false,
                error_rad: f64::INFINITY,
                dots_confidence: 0.0,
                confidence: 0.0,
                nanoseconds,
            },
        }
    }
}

/// A validation and its recognizer.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct NamedValidation {
    /// The recognizer.
    pub recognizer: RecognizerName,
    /// The result.
    #[serde(flatten)]
    pub validation: Validation,
}

/// What is validated, on which trials.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ValidationConfig {
    /// The recognizer.
    pub recognizer: RecognizerName,
    /// The protocol.
    pub protocol: Protocol,
    /// Seed of the trials.
    pub seed: u64,
    /// Number of trials.
    pub samples: u64,
}

impl Default for ValidationConfig {
    /// 10 000 trials of `paper`, seed 0, with the robust recognizer.
    fn default() -> Self {
        Self {
            recognizer: RecognizerName::Robust,
            protocol: Protocol::standard(ProtocolName::Paper),
            seed: 0,
            samples: 10_000,
        }
    }
}

impl ValidationConfig {
    /// The trials of a pattern.
    pub fn trials<'p>(&self, pattern: &'p Pattern) -> Trials<'p> {
        Trials::first(pattern, *self.protocol.view(), self.seed, self.samples)
    }

    /// The results of all trials with a ball; see [`Trials::run`]. The recognizer knows the
    /// view model, but not which dots are false or missed.
    ///
    /// # Errors
    /// As [`Trials::run`] and [`NamedRecognizer::new`].
    pub fn results(
        &self,
        ball: &Ball,
        observer: &(dyn Fn(u64) + Sync),
    ) -> Result<Vec<TrialResult>> {
        self.trials(ball.pattern())
            .run(&self.recognizer_for(ball)?, observer)
    }

    fn recognizer_for(&self, ball: &Ball) -> Result<NamedRecognizer> {
        NamedRecognizer::new(self.recognizer, ball, self.protocol.view())
    }

    /// As [`ValidationConfig::run`], which setting `stop` ends.
    ///
    /// # Errors
    /// [`crate::Error::Stopped`]; as [`ValidationConfig::results`].
    pub(crate) fn run_until(
        &self,
        ball: &Ball,
        stop: Option<&AtomicBool>,
    ) -> Result<NamedValidation> {
        self.run_by(&self.recognizer_for(ball)?, ball, stop)
    }

    /// The same with a recognizer that is at hand.
    ///
    /// # Errors
    /// As [`Trials::run`].
    pub(crate) fn run_by(
        &self,
        recognizer: &NamedRecognizer,
        ball: &Ball,
        stop: Option<&AtomicBool>,
    ) -> Result<NamedValidation> {
        let trials = Trials {
            stop,
            ..self.trials(ball.pattern())
        };
        Ok(self.summary(ball, &trials.run(recognizer, &|_| {})?))
    }

    /// Validates a ball: counts the successes of [`ValidationConfig::results`].
    ///
    /// # Errors
    /// As [`ValidationConfig::results`].
    pub fn run(&self, ball: &Ball, observer: &(dyn Fn(u64) + Sync)) -> Result<NamedValidation> {
        let results = self.results(ball, observer)?;
        Ok(self.summary(ball, &results))
    }

    /// Counts the successes of results of these trials.
    pub fn summary(&self, ball: &Ball, results: &[TrialResult]) -> NamedValidation {
        let trials = self.trials(ball.pattern());
        NamedValidation {
            recognizer: self.recognizer,
            validation: Validation::of(results, self.protocol.name(), &trials),
        }
    }
}

impl Validation {
    /// Counts the successes of trials, which a protocol names.
    pub fn of(results: &[TrialResult], protocol: ProtocolName, trials: &Trials<'_>) -> Self {
        let (mut identity, mut judged) = (0u64, 0u64);
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
                judged += 1;
                times.push(nanoseconds as f64 / 1000.0);
                identity += u64::from(is_correct);
                if error_rad < ORIENTATION_FAILURE_RAD {
                    errors.push(error_rad.to_degrees());
                }
            }
        }
        let orientation = errors.len() as u64;
        let mean_error_deg = errors.iter().sum::<f64>() / orientation as f64;
        let median_error_deg = match errors.is_empty() {
            true => f64::NAN,
            false => median(&mut errors),
        };
        Self {
            protocol,
            samples: results.len() as u64,
            sigma_deg: trials.view.noise.sigma_rad().to_degrees(),
            seed: trials.seed,
            answered: Proportion::new(orientation, results.len() as u64),
            skipped: results.len() as u64 - judged,
            identity: Proportion::new(identity, judged),
            orientation: Proportion::new(orientation, judged),
            mean_error_deg,
            median_error_deg,
            us_per_identification: Some(times.iter().sum::<f64>() / judged.max(1) as f64),
            median_us_per_identification: Some(median(&mut times)),
        }
    }
}
