//! Measurement of the recognizers: rates, orientation errors against the bound, calibration, the
//! gain of single features, and the remaining failures.
//!
//!     cargo run --release -p spindoe-studies --bin recognizer_limits -- PATTERN.csv OUT_DIR [TRIALS] [PART ...]
//!
//! The parts are rates, features, confidence and failures; all, where none is named. Prints Markdown and writes plots to `OUT_DIR`. All trials are drawn from [`SEED`], on which no
//! parameter was tuned.

mod confidence;
mod failures;
mod features;
mod rates;

use std::path::PathBuf;

use spindoe::ball::Ball;
use spindoe::pattern::Pattern;
use spindoe::recognize::robust::RobustRecognizer;
use spindoe::validate::Trials;
use spindoe::view::{Detection, FalseDots, ProtocolName, ViewModel};

/// Seed of all trials.
const SEED: u64 = 20_261_121;

/// The inputs of every part.
struct Bench {
    ball: Ball,
    out: PathBuf,
    samples: u64,
}

impl Bench {
    fn pattern(&self) -> &Pattern {
        self.ball.pattern()
    }

    /// The trials of these views.
    fn trials(&self, view: ViewModel) -> Trials<'_> {
        Trials::first(self.pattern(), view, SEED, self.samples)
    }

    /// The recognizer that expects these views.
    fn robust(&self, view: ViewModel) -> spindoe::Result<RobustRecognizer> {
        RobustRecognizer::new(self.pattern(), view.into())
    }
}

/// Measures and prints.
type Part = fn(&Bench) -> spindoe::Result<()>;

/// Views with another noise than the protocol's.
fn degrees(name: ProtocolName, sigma_deg: f64) -> ViewModel {
    name.view().with_sigma_rad(sigma_deg.to_radians())
}

/// The protocol's views, of which some may show something else or the mirrored ball.
fn doubting(name: ProtocolName) -> ViewModel {
    let ViewModel {
        foreign_share,
        mirrored_share,
        ..
    } = ViewModel::default();
    ViewModel {
        foreign_share,
        mirrored_share,
        ..name.view()
    }
}

/// All reported views, with the protocol that they are made from.
fn views() -> Vec<(&'static str, ProtocolName, ViewModel)> {
    let [paper, sparse, clutter, image] = ProtocolName::ALL;
    let missed = ViewModel {
        detection: Detection::Each { probability: 0.9 },
        false_dots: FalseDots::Usual(1),
        ..paper.view()
    };
    vec![
        ("paper, 3 deg", paper, paper.view()),
        ("paper, 5 deg", paper, degrees(paper, 5.0)),
        ("paper, 8 deg", paper, degrees(paper, 8.0)),
        ("sparse", sparse, sparse.view()),
        ("clutter", clutter, clutter.view()),
        ("3 deg, 10 % missed, 1 false", paper, missed),
        ("image", image, image.view()),
    ]
}

fn main() -> spindoe::Result<()> {
    let mut arguments = std::env::args().skip(1);
    let (Some(pattern), Some(out)) = (arguments.next(), arguments.next()) else {
        eprintln!("usage: recognizer_limits PATTERN.csv OUT_DIR [TRIALS] [PART ...]");
        std::process::exit(2);
    };
    let samples = arguments.next().map_or(Ok(10_000), |n| n.parse::<u64>());
    let Ok(samples) = samples else {
        eprintln!("TRIALS: expected a whole number");
        std::process::exit(2);
    };
    let pattern = Pattern::read_csv(pattern.as_ref())?;
    let bench = Bench {
        ball: Ball::new(pattern),
        out: out.into(),
        samples,
    };
    spindoe::files::create_writable_dir(&bench.out)?;
    let parts: [(&str, Part); 4] = [
        ("rates", rates::print),
        ("features", features::print),
        ("confidence", confidence::print),
        ("failures", failures::print),
    ];
    let asked: Vec<String> = arguments.collect();
    if let Some(unknown) = asked
        .iter()
        .find(|a| parts.iter().all(|(name, _)| name != a))
    {
        eprintln!("PART: expected rates, features, confidence or failures, found {unknown:?}");
        std::process::exit(2);
    }
    let is_asked = |name: &str| asked.is_empty() || asked.iter().any(|a| a == name);
    parts
        .iter()
        .filter(|(name, _)| is_asked(name))
        .try_for_each(|(_, print)| print(&bench))
}
