//! How far answers can be trusted: the tables of docs/measurements/trust.md.
//!
//!     cargo run --release -p spindoe-studies --bin trust_tables -- TABLE [TRIALS] [SEED]
//!
//! `TABLE` is one of
//! - `conditions`: identification by files that are told nothing, against those told the protocol,
//! - `spins`: spins reported of random orientations,
//! - `confidence`: the map of an estimate's confidence, fitted and compared with the truth,
//! - `kinds`: single images that do not show the ball; further words choose kinds,
//! - `tables`: verdicts over clips on the right, a wrong and a mirrored table.

mod conditions;
mod kinds;
mod logistic;
mod spins;
mod tables;

use std::error::Error;

/// Seed of all trials, on which no parameter was tuned.
const SEED: u64 = 14_140_001;

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let table = arguments.next().unwrap_or_default();
    let trials: Option<u64> = arguments.next().map(|a| a.parse()).transpose()?;
    let seed: u64 = arguments.next().map_or(Ok(SEED), |a| a.parse())?;
    match table.as_str() {
        "conditions" => conditions::print(trials.unwrap_or(10_000), seed)?,
        "spins" => spins::print(trials.unwrap_or(10_000), seed)?,
        "confidence" => kinds::confidence(trials.unwrap_or(12_000), seed)?,
        "kinds" => kinds::print(
            trials.unwrap_or(3_000),
            seed,
            &arguments.collect::<Vec<_>>(),
        )?,
        "tables" => tables::print(trials.unwrap_or(1_000), seed)?,
        _ => return Err("expected a table: conditions, confidence, kinds, spins or tables".into()),
    }
    Ok(())
}
