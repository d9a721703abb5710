//! Measurement of the recognizers: rates, orientation errors against the bound, confidences, the
//! noise learned, the gain of single features, and the remaining failures.
//!
//!     cargo run --release -p spindoe-studies -- recognizer --help
//!
//! Prints Markdown and writes plots. All trials are drawn from [`SEED`], on which no
//! parameter was tuned.

mod confidence;
mod failures;
mod features;
mod noise;
mod rates;

use std::path::PathBuf;

use spindoe::ball::Ball;
use spindoe::pattern::Pattern;
use spindoe::recognize::robust::RobustRecognizer;
use spindoe::validate::Trials;
use spindoe::view::{Detection, FalseDots, ProtocolName, ViewModel};
use spindoe_studies::Outcome;
use spindoe_studies::frames::DOTS20;

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

/// The parts of the measurement by their names.
const PARTS: [(&str, Part); 5] = [
    ("rates", rates::print),
    ("features", features::print),
    ("confidence", confidence::print),
    ("noise", noise::print),
    ("failures", failures::print),
];

#[derive(clap::Args)]
pub struct Args {
    /// Pattern of the ball.
    #[arg(long, default_value = DOTS20)]
    pattern: PathBuf,
    /// Folder of the plots.
    #[arg(long, default_value = "docs/recognizer")]
    out: PathBuf,
    /// Trials of a row.
    #[arg(long, default_value_t = 10_000)]
    trials: u64,
    /// Parts of the measurement; all of them where none is named.
    #[arg(value_parser = PARTS.map(|(name, _)| name))]
    parts: Vec<String>,
}

impl Args {
    pub fn run(&self) -> Outcome {
        let bench = Bench {
            ball: Ball::new(Pattern::read_csv(&self.pattern)?),
            out: self.out.clone(),
            samples: self.trials,
        };
        spindoe::files::create_writable_dir(&bench.out)?;
        let is_asked = |name: &str| self.parts.is_empty() || self.parts.iter().any(|a| a == name);
        let (trials, path) = (self.trials, self.pattern.display());
        println!("{trials} trials a row, seed {SEED}, {path}");
        for (_, print) in PARTS.iter().filter(|(name, _)| is_asked(name)) {
            println!();
            print(&bench)?;
        }
        Ok(())
    }
}
