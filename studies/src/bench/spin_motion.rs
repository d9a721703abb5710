//! How often a spin's motion is the right one: false alarms of constant spins, and the power for others.
//!
//! Sequences of a ball whose dots are drawn ([`DrawnScenario`]: noise that differs between frames, errors that frames share, wrong and
//! missing orientations) are fitted by the motion for which there is evidence. The error that frames share is known, as `estimate`
//! knows it by the residuals of dots, or it is not. The spin in the middle is compared with the truth: the share of those whose
//! squared Mahalanobis distance is below the 95 % quantile of chi-square with three degrees of freedom.
//!
//!     cargo run --release -p spindoe-studies -- spin-motion --help

use rayon::prelude::*;
use spindoe::spin::estimate::{MotionModel, SpinEstimate};
use spindoe::spin::motion::PrecessingSpin;
use spindoe::spin::robust::SpinConfig;
use spindoe::spin::simulate::DrawnScenario;
use spindoe_studies::score::share;
use spindoe_studies::table::Table;
use spindoe_studies::{Outcome, row};

/// Frames of a sequence.
const FRAMES: [usize; 6] = [8, 12, 22, 40, 80, 155];
/// Rates of decay, 1/s, and rotations fixed in the ball over those fixed in space.
const MOTIONS: [(f64, f64); 5] = [(0.0, 0.0), (0.1, 0.0), (0.5, 0.0), (0.0, 0.02), (0.1, 0.05)];
/// SciPy's `chi2(3).ppf(0.95)`.
const WITHIN: f64 = 7.815;

/// The motion that was taken, whether a lack of fit was evident, and whether the spin is covered.
type Answer = Option<(MotionModel, bool, bool)>;

fn answer(scenario: &DrawnScenario, is_shared_known: bool, seed: u64, index: u64) -> Answer {
    let sequence = scenario.sequence(seed, index);
    let config = match is_shared_known {
        true => SpinConfig {
            sigma_rad: sequence.sigma_rad,
            shared: Some(sequence.shared),
            ..SpinConfig::default()
        },
        false => SpinConfig::default(),
    };
    let found = SpinEstimate::fit(&sequence.measurements, MotionModel::Auto, &config).ok()?;
    let fit = found.at(found.middle_s());
    let truth: PrecessingSpin = sequence.truth.rebased(found.middle_s());
    let off = fit.motion.spin - truth.mean().spin;
    let inverse = fit.spin_covariance?.try_inverse()?;
    let is_covered = off.dot(&(inverse * off)) < WITHIN;
    Some((found.motion.model(), fit.lack_of_fit.is_some(), is_covered))
}

#[derive(clap::Args)]
pub struct Args {
    /// Sequences of a line.
    #[arg(long, default_value_t = 1000)]
    sequences: u64,
    /// Seed of the sequences.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Constant spins only.
    #[arg(long)]
    constant: bool,
}

impl Args {
    pub fn run(&self) -> Outcome {
        let (count, seed) = (self.sequences, self.seed);
        println!("{count} sequences a line, seed {seed}");
        let table = Table::new([
            "decay, 1/s",
            "in the ball",
            "shared errors",
            "frames",
            "constant",
            "decaying",
            "precessing",
            "lack of fit",
            "spin within 95 %",
            "rejected",
        ]);
        let motions = MOTIONS
            .iter()
            .take(if self.constant { 1 } else { MOTIONS.len() });
        for &(decay_per_s, body_share) in motions {
            for is_known in [true, false] {
                for frames in FRAMES {
                    let scenario = DrawnScenario {
                        frames,
                        decay_per_s,
                        body_share,
                    };
                    // Other sequences for each number of frames.
                    let first = frames as u64 * count;
                    let answers: Vec<Answer> = (first..first + count)
                        .into_par_iter()
                        .map(|index| answer(&scenario, is_known, seed, index))
                        .collect();
                    let given: Vec<_> = answers.iter().flatten().copied().collect();
                    let is = |model| share(&given, |g| g.0 == model);
                    row!(
                        table; decay_per_s, body_share, if is_known { "known" } else { "unknown" }, frames,
                        is(MotionModel::Constant), is(MotionModel::Decaying), is(MotionModel::Precessing),
                        share(&given, |g| g.1), share(&given, |g| g.2),
                        share(&answers, Option::is_none)
                    );
                }
            }
        }
        Ok(())
    }
}
