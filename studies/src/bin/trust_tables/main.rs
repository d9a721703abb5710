//! How far answers can be trusted: the tables of docs/measurements/trust.md.
//!
//!     cargo run --release -p spindoe-studies --bin trust_tables -- TABLE [TRIALS] [SEED]
//!
//! `TABLE` is `conditions`: identification by files told nothing, against those told everything.

mod conditions;

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
        _ => return Err("expected a table: conditions".into()),
    }
    Ok(())
}
