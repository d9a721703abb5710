//! Measurement of the recognizers: rates, orientation errors against the bound, calibration, the
//! gain of single features, and the remaining failures.
//!
//!     cargo run --release -p spindoe-studies --bin recognizer_limits -- PATTERN.csv OUT_DIR [TRIALS]
//!
//! Prints Markdown and writes plots to `OUT_DIR`. All trials are drawn from [`SEED`], on which no
//! parameter was tuned.

mod calibration;
mod failures;
mod features;
mod rates;

use std::path::PathBuf;

use spindoe::hash::{HashTable, PairRule, RecognizerConfig};
use spindoe::pattern::Pattern;
use spindoe::validate::{Protocol, ProtocolName};

/// Seed of all trials.
const SEED: u64 = 20_261_121;

/// The inputs of every part.
struct Bench {
    table: HashTable,
    out: PathBuf,
    trials: u64,
}

impl Bench {
    fn pattern(&self) -> &Pattern {
        self.table.pattern()
    }
}

/// Protocols beyond the four standard ones.
fn degrees(protocol: Protocol, sigma_deg: f64) -> Protocol {
    protocol.with_sigma_rad(sigma_deg.to_radians())
}

/// All reported protocols, by name.
fn protocols() -> Vec<(&'static str, Protocol)> {
    let [paper, sparse, clutter, image] = ProtocolName::ALL.map(Protocol::standard);
    let missed = Protocol {
        miss_probability: 0.1,
        false_dots: 1,
        ..paper
    };
    vec![
        ("paper, 3 deg", paper),
        ("paper, 5 deg", degrees(paper, 5.0)),
        ("paper, 8 deg", degrees(paper, 8.0)),
        ("sparse", sparse),
        ("clutter", clutter),
        ("3 deg, 10 % missed, 1 false", missed),
        ("image", image),
    ]
}

fn main() -> spindoe::Result<()> {
    let mut arguments = std::env::args().skip(1);
    let (Some(pattern), Some(out)) = (arguments.next(), arguments.next()) else {
        eprintln!("usage: recognizer_limits PATTERN.csv OUT_DIR [TRIALS]");
        std::process::exit(2);
    };
    let trials = arguments.next().map_or(Ok(10_000), |n| n.parse::<u64>());
    let Ok(trials) = trials else {
        eprintln!("TRIALS: expected a whole number");
        std::process::exit(2);
    };
    let pattern = Pattern::read_csv(pattern.as_ref())?;
    let bench = Bench {
        table: HashTable::build(pattern, PairRule::default(), RecognizerConfig::default())?,
        out: out.into(),
        trials,
    };
    spindoe::files::create_writable_dir(&bench.out)?;
    rates::print(&bench)?;
    features::print(&bench)?;
    calibration::print(&bench)?;
    failures::print(&bench)
}
