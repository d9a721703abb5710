//! Validation with a recogniser chosen by its name: what the command and the reports need.

use super::{Protocol, TrialResult, Validation, run_trials, summarize};
use crate::error::Result;
use crate::hash::HashTable;
use crate::recognise::robust::RobustRecogniser;
use crate::recognise::{PaperRecogniser, RecogniserName};

/// A validation, and whose.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct NamedValidation {
    /// The recogniser.
    pub recognizer: RecogniserName,
    /// What was found.
    #[serde(flatten)]
    pub validation: Validation,
}

/// Runs all trials with the recogniser of that name, made from `table`, and returns the results in
/// their order. The paper's recogniser takes its parameters from the table; the robust one is told the
/// protocol's rates ([`Protocol::recogniser_config`]).
///
/// # Errors
/// As [`run_trials`], and [`crate::Error::Argument`] for recogniser parameters outside their domains.
pub fn run_named(
    table: &HashTable,
    recogniser: RecogniserName,
    protocol: &Protocol,
    seed: u64,
    samples: u64,
) -> Result<Vec<TrialResult>> {
    let pattern = table.pattern();
    match recogniser {
        RecogniserName::Paper => {
            let paper = PaperRecogniser::from_table(table)?;
            run_trials(pattern, &paper, protocol, seed, samples)
        }
        RecogniserName::Robust => {
            let robust = RobustRecogniser::new(pattern, protocol.recogniser_config())?;
            run_trials(pattern, &robust, protocol, seed, samples)
        }
    }
}

/// Validates the recogniser of that name on `samples` trials; see [`run_named`].
///
/// # Errors
/// As [`run_named`].
pub fn validate_named(
    table: &HashTable,
    recogniser: RecogniserName,
    protocol: &Protocol,
    seed: u64,
    samples: u64,
) -> Result<NamedValidation> {
    let results = run_named(table, recogniser, protocol, seed, samples)?;
    Ok(NamedValidation {
        recognizer: recogniser,
        validation: summarize(&results, protocol, seed),
    })
}
