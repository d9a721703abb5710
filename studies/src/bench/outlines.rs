//! How near to the truth is the outline, and how much do failures of the outline cost?
//!
//! Each frame is estimated as a user would, and again with the true outline. The first table gives the share of
//! outlines within 1, 2 and 5 % of the radius (the larger of the center's and the radius' error), over all frames and
//! over those of which at least 60 % of the rim shows; the second what both give.
//!
//!     cargo run --release -p spindoe-studies -- outlines --help

use std::path::PathBuf;

use spindoe::camera::FrameOutcome;
use spindoe::pattern::Pattern;
use spindoe::synth::SynthConfig;
use spindoe::synth::dataset::{FrameTruth, SynthFrame};
use spindoe::vision::net::Weights;
use spindoe::vision::{
    BallCircle, Budget, CnnDetector, DetectorName, DotDetector, Estimator, EstimatorConfig,
    FrameEstimate, OutlinePrior, Prior,
};
use spindoe_studies::frames::{DOTS20, FrameSet, all_conditions, each, good_conditions, outcome};
use spindoe_studies::score::{RATES, rates, share};
use spindoe_studies::table::Table;
use spindoe_studies::{Outcome, row};

/// Outline errors that are counted, parts of the radius.
const WITHIN: [f64; 3] = [0.01, 0.02, 0.05];
/// Share of the rim that must show for the second group.
const MIN_RIM: f64 = 0.6;

/// A frame's result.
struct Seen {
    rim: f64,
    /// Of the outline that the pose was found on, part of the radius; infinite where there is none.
    outline_error: f64,
    /// With the outline that is found, and with the true one.
    outcomes: [FrameOutcome; 2],
}

fn off(circle: Option<BallCircle>, truth: &FrameTruth) -> f64 {
    circle.map_or(f64::INFINITY, |c| {
        let center = (c.center.u - truth.center.u).hypot(c.center.v - truth.center.v);
        center.max((c.radius - truth.radius_px).abs()) / truth.radius_px
    })
}

fn measure(estimator: &Estimator, frame: &SynthFrame, [found]: [FrameEstimate; 1]) -> Seen {
    let truth = &frame.truth;
    let circle = BallCircle::new(truth.center, truth.radius_px);
    let prior = Prior {
        outline: Some(OutlinePrior::given(circle)),
        ..Prior::default()
    };
    let (mut ws, mut given) = (estimator.workspace(), FrameEstimate::default());
    estimator.estimate(
        &frame.image,
        &prior,
        &Budget::default(),
        &mut ws,
        &mut given,
    );
    Seen {
        rim: truth.rim_visible,
        outline_error: off(found.outline.map(|o| o.circle), truth),
        outcomes: [&found, &given].map(|f| outcome(f, truth)),
    }
}

#[derive(clap::Args)]
pub struct Args {
    /// Frames of a line.
    #[arg(long, default_value_t = 500)]
    frames: usize,
    /// Seed of the frames.
    #[arg(long, default_value_t = 61)]
    seed: u64,
    /// Weights of the detector instead of the built-in ones.
    #[arg(long)]
    weights: Option<PathBuf>,
}

impl Args {
    pub fn run(&self) -> Outcome {
        let (count, seed) = (self.frames, self.seed);
        let detector = match &self.weights {
            Some(path) => {
                let weights = Weights::read(path)?;
                DotDetector::Cnn(CnnDetector::new(&weights)?)
            }
            None => DetectorName::Cnn.build()?,
        };
        let pattern = Pattern::read_csv(DOTS20.as_ref())?;
        let estimator = [Estimator::new(
            &pattern,
            EstimatorConfig::default(),
            detector,
        )?];
        let sixty = FrameSet {
            name: "all conditions, 60 px",
            config: SynthConfig {
                ball_px: Some([60.0; 2]),
                ..SynthConfig::default()
            },
        };
        let mut sets = Vec::new();
        for set in [all_conditions(), sixty, good_conditions()] {
            let seen = each(&estimator, &set.config, seed, count, |frame, found| {
                measure(&estimator[0], frame, found)
            })?;
            sets.push((set.name, seen));
        }
        println!("{count} frames a line, seed {seed}");
        let within = WITHIN.map(|w| format!("outline within {} %", 100.0 * w));
        let headings = ["frames".to_owned(), "number".to_owned()];
        let table = Table::new(headings.into_iter().chain(within));
        for (name, seen) in &sets {
            let clear = seen.iter().filter(|s| s.rim >= MIN_RIM).collect::<Vec<_>>();
            let clear_name = format!("{name}, rim 60 % or more");
            for (name, some) in [(*name, seen.iter().collect()), (&clear_name, clear)] {
                let near = WITHIN.map(|w| share(&some, |s| s.outline_error <= w));
                row!(table; name, some.len(); near);
            }
        }
        let table = Table::new(["frames", "outline"].into_iter().chain(RATES));
        for (name, seen) in &sets {
            for (k, outline) in ["found", "true"].into_iter().enumerate() {
                let outcomes: Vec<FrameOutcome> = seen.iter().map(|s| s.outcomes[k]).collect();
                row!(table; *name, outline; rates(&outcomes));
            }
        }
        Ok(())
    }
}
