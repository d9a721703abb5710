//! Validation with a recognizer chosen by its name, for the command and the reports.

use std::ops::Range;

use super::{Protocol, TrialResult, Validation, require_samples, run_trials_in, summarize};
use crate::error::Result;
use crate::hash::HashTable;
use crate::recognize::robust::RobustRecognizer;
use crate::recognize::{PaperRecognizer, RecognizerName};

/// A validation and its recognizer.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct NamedValidation {
    /// The recognizer.
    pub recognizer: RecognizerName,
    /// The result.
    #[serde(flatten)]
    pub validation: Validation,
}

/// Runs all trials with the recognizer of that name, made from `table`, and returns the results in
/// their order. The paper's recognizer takes its parameters from the table; the robust one gets the
/// protocol's rates ([`Protocol::recognizer_config`]).
///
/// # Errors
/// As [`super::run_trials`], and [`crate::Error::Argument`] for recognizer parameters outside their
/// domains.
pub fn run_named(
    table: &HashTable,
    recognizer: RecognizerName,
    protocol: &Protocol,
    seed: u64,
    samples: u64,
) -> Result<Vec<TrialResult>> {
    require_samples(samples)?;
    run_named_in(table, recognizer, protocol, seed, 0..samples, &|_| {})
}

/// As [`run_named`], for some of the trials only: ranges that follow each other give what one call
/// over all of them gives. `done` learns from any thread how many more trials are done.
///
/// # Errors
/// As [`run_named`].
pub fn run_named_in(
    table: &HashTable,
    recognizer: RecognizerName,
    protocol: &Protocol,
    seed: u64,
    trials: Range<u64>,
    done: &(dyn Fn(u64) + Sync),
) -> Result<Vec<TrialResult>> {
    let pattern = table.pattern();
    match recognizer {
        RecognizerName::Paper => {
            let paper = PaperRecognizer::from_table(table)?;
            run_trials_in(pattern, &paper, protocol, seed, trials, done)
        }
        RecognizerName::Robust => {
            let robust = RobustRecognizer::new(pattern, protocol.recognizer_config())?;
            run_trials_in(pattern, &robust, protocol, seed, trials, done)
        }
    }
}

/// Validates the recognizer of that name on `samples` trials; see [`run_named`].
///
/// # Errors
/// As [`run_named`].
pub fn validate_named(
    table: &HashTable,
    recognizer: RecognizerName,
    protocol: &Protocol,
    seed: u64,
    samples: u64,
) -> Result<NamedValidation> {
    validate_named_observed(table, recognizer, protocol, seed, samples, &|_| {})
}

/// As [`validate_named`]; `done` learns from any thread how many more trials are done.
///
/// # Errors
/// As [`run_named`].
pub fn validate_named_observed(
    table: &HashTable,
    recognizer: RecognizerName,
    protocol: &Protocol,
    seed: u64,
    samples: u64,
    done: &(dyn Fn(u64) + Sync),
) -> Result<NamedValidation> {
    let results = run_named_in(table, recognizer, protocol, seed, 0..samples, done)?;
    Ok(NamedValidation {
        recognizer,
        validation: summarize(&results, protocol, seed),
    })
}
