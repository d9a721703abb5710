//! How often a spin's motion is the right one, and whether its region holds the truth: constant, decaying, precessing and pushed balls.
//!
//! Sequences of a ball whose dots are drawn ([`DrawnScenario`], [`PushedScenario`]: noise that differs between frames, errors that frames share, wrong and
//! missing orientations) are fitted by the motion for which there is evidence. There is no error that frames share, or it is known, as `estimate`
//! knows it by the residuals of dots, or it is not; or the ball crosses the picture of an unknown camera besides. The spin that sums the sequence up is
//! compared with the truth: the share of those whose squared Mahalanobis distance is below the 95 % quantile of chi-square with three
//! degrees of freedom. The truth of a ball that is said to precess is the spin along its angular momentum, of others that in the middle,
//! and of those that precess or are pushed the mean over the time.
//!
//!     cargo run --release -p spindoe-studies -- spin-motion --help

use rayon::prelude::*;
use spindoe::Vec3;
use spindoe::spin::Measurement;
use spindoe::spin::estimate::{MotionModel, SpinEstimate};
use spindoe::spin::motion::PrecessingSpin;
use spindoe::spin::robust::SpinConfig;
use spindoe::spin::shared::SharedError;
use spindoe::spin::simulate::{DrawnScenario, PushedScenario};
use spindoe_studies::score::share;
use spindoe_studies::table::Table;
use spindoe_studies::{Outcome, row};

/// Balls: rates of decay, 1/s, and rotations fixed in the ball over those fixed in space; or pushed.
const BALLS: [(&str, Option<(f64, f64)>); 6] = [
    ("constant", Some((0.0, 0.0))),
    ("decay 0.1 /s", Some((0.1, 0.0))),
    ("decay 0.5 /s", Some((0.5, 0.0))),
    ("in the ball 0.02", Some((0.0, 0.02))),
    ("in the ball 0.05, decay 0.1 /s", Some((0.1, 0.05))),
    ("pushed", None),
];
/// Times at which a spin that changes is averaged.
const AVERAGED: usize = 256;
/// SciPy's `chi2(3).ppf(0.95)`.
const WITHIN: f64 = 7.815;

/// What frames share.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Errors {
    None,
    Known,
    Unknown,
    Crossing,
}

impl Errors {
    const ALL: [(&str, Self); 4] = [
        ("none", Self::None),
        ("known", Self::Known),
        ("unknown", Self::Unknown),
        ("known, crossing", Self::Crossing),
    ];
}

/// The motion that was taken, whether a lack of fit was evident, and whether the spin is covered.
type Answer = Option<(MotionModel, bool, bool)>;

/// The true spin that an answer is compared with: of a motion, over a time.
type Truth = Box<dyn Fn(MotionModel, [f64; 2]) -> Vec3>;

/// The spin of a ball over a time.
fn truth(ball: PrecessingSpin) -> Truth {
    Box::new(move |model, [from_s, to_s]| {
        let middle_s = 0.5 * (from_s + to_s);
        if model == MotionModel::Precessing || ball.body_rate == Vec3::zeros() {
            return ball.rebased(middle_s).mean().spin;
        }
        let at = |i: usize| {
            let time_s = from_s + (to_s - from_s) * (i as f64 + 0.5) / AVERAGED as f64;
            let now = ball.rebased(time_s);
            now.space.spin + now.space.orientation * now.body_rate
        };
        (0..AVERAGED).map(at).sum::<Vec3>() / AVERAGED as f64
    })
}

fn answer(
    measurements: &[Measurement],
    sigma_rad: f64,
    shared: Option<SharedError>,
    truth: &Truth,
) -> Answer {
    let config = match shared {
        Some(_) => SpinConfig {
            sigma_rad,
            shared,
            ..SpinConfig::default()
        },
        None => SpinConfig::default(),
    };
    let found = SpinEstimate::fit(measurements, MotionModel::Auto, &config).ok()?;
    let (fit, model) = (found.overall(), found.motion.model());
    let off = fit.motion.spin - truth(model, found.span_s());
    let inverse = fit.spin_covariance?.try_inverse()?;
    let is_covered = off.dot(&(inverse * off)) < WITHIN;
    Some((model, fit.lack_of_fit.is_some(), is_covered))
}

fn sequence(
    ball: Option<(f64, f64)>,
    errors: Errors,
    frames: usize,
    (seed, index): (u64, u64),
) -> Answer {
    let exact_dots = errors == Errors::None;
    let known = |shared: SharedError| match errors {
        Errors::Unknown => None,
        _ => Some(shared),
    };
    let Some((decay_per_s, body_share)) = ball else {
        let pushed = PushedScenario { frames, exact_dots }.sequence(seed, index);
        let (measurements, sigma_rad) = (pushed.measurements.clone(), pushed.sigma_rad);
        let shared = known(pushed.shared);
        let truth: Truth = Box::new(move |_, span_s| pushed.mean_spin(span_s));
        return answer(&measurements, sigma_rad, shared, &truth);
    };
    let scenario = DrawnScenario {
        frames,
        decay_per_s,
        body_share,
        exact_dots,
    };
    let mut drawn = scenario.sequence(seed, index);
    if errors == Errors::Crossing {
        drawn = drawn.crossing(seed + 1, index);
    }
    let shared = known(drawn.shared);
    answer(
        &drawn.measurements,
        drawn.sigma_rad,
        shared,
        &truth(drawn.truth),
    )
}

#[derive(clap::Args)]
pub struct Args {
    /// Sequences of a line.
    #[arg(long, default_value_t = 1000)]
    sequences: u64,
    /// Seed of the sequences.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Frames of a sequence.
    #[arg(long, value_delimiter = ',', default_value = "8,12,22,40,80,155")]
    frames: Vec<usize>,
    /// Balls whose name has this in it only.
    #[arg(long, default_value = "")]
    ball: String,
}

impl Args {
    pub fn run(&self) -> Outcome {
        let (count, seed) = (self.sequences, self.seed);
        println!("{count} sequences a line, seed {seed}");
        let table = Table::new([
            "ball",
            "shared errors",
            "frames",
            "constant",
            "decaying",
            "precessing",
            "free",
            "lack of fit",
            "spin within 95 %",
            "rejected",
        ]);
        for (name, ball) in BALLS.iter().filter(|b| b.0.contains(&self.ball)) {
            for (shared, errors) in Errors::ALL {
                if ball.is_none() && errors == Errors::Crossing {
                    continue;
                }
                for &frames in &self.frames {
                    // Other sequences for each number of frames.
                    let first = frames as u64 * count;
                    let answers: Vec<Answer> = (first..first + count)
                        .into_par_iter()
                        .map(|index| sequence(*ball, errors, frames, (seed, index)))
                        .collect();
                    let given: Vec<_> = answers.iter().flatten().copied().collect();
                    let is = |model| share(&given, |g| g.0 == model);
                    row!(
                        table; *name, shared, frames,
                        is(MotionModel::Constant), is(MotionModel::Decaying), is(MotionModel::Precessing),
                        is(MotionModel::Free), share(&given, |g| g.1), share(&given, |g| g.2),
                        share(&answers, Option::is_none)
                    );
                }
            }
        }
        Ok(())
    }
}
