//! Several images of balls in one picture: exposures of one ball with several flashes, clips of two and three flying balls of different
//! tables, and what each further ball costs.
//!
//!     cargo run --release -p spindoe-studies -- strobe --help

use cpu_time::ThreadTime;
use rayon::prelude::*;
use spindoe::camera::{ExposureOutcome, ExposureRates, ExposureTrials};
use spindoe::clip::BallsEstimator;
use spindoe::geometry::CameraFrame;
use spindoe::pattern::Pattern;
use spindoe::synth::SynthConfig;
use spindoe::synth::dataset::SynthFrame;
use spindoe::vision::frame::{CameraDistance, CameraModel};
use spindoe::vision::{
    Budget, Camera, DetectorName, Estimator, EstimatorConfig, FrameEstimate, Prior,
};
use spindoe_studies::frames::{DOTS20, estimator};
use spindoe_studies::score::{mean, median, share};
use spindoe_studies::table::{Table, figure};
use spindoe_studies::{Outcome, row};

#[derive(clap::Args)]
pub struct Args {
    /// Exposures.
    #[arg(long, default_value_t = 500)]
    frames: u64,
    /// Seed of the exposures and clips.
    #[arg(long, default_value_t = 36_500_001)]
    seed: u64,
    /// Times of the flashes, milliseconds.
    #[arg(long, value_delimiter = ',', default_values_t = [0.0, 0.9, 2.1])]
    strobe_ms: Vec<f64>,
    /// Diameter of the ball, pixels.
    #[arg(long, default_value_t = 100.0)]
    ball_px: f64,
    /// Overlap of the nearest images, parts of the diameter.
    #[arg(long, value_delimiter = ',', default_values_t = [0.0, 0.6])]
    overlap: Vec<f64>,
    /// Pattern of the ball.
    #[arg(long, default_value = DOTS20)]
    pattern: std::path::PathBuf,
    /// Names of exposures that are not right, on standard error.
    #[arg(long)]
    failures: bool,
    /// The number of images is known rather than found.
    #[arg(long)]
    count: Option<usize>,
    /// The camera's intrinsics are known.
    #[arg(long)]
    intrinsics: bool,
    /// The camera stands 0.4 to 0.6 m from a golf ball, and that is all that is known of it.
    #[arg(long)]
    golf_distance: bool,
    /// Not exposures, but so many clips of two and three flying balls of different tables.
    #[arg(long)]
    clips: Option<u64>,
    /// Frames of a clip.
    #[arg(long, default_value_t = 20)]
    clip_frames: usize,
    /// Standard deviation of the drawn dots' places, degrees [default: 0.23 to 1.15].
    #[arg(long)]
    placement_sigma_deg: Option<f64>,
}

/// What became of an exposure, and its costs.
struct Read {
    outcome: ExposureOutcome,
    ms: f64,
    alone_ms: f64,
}

impl Args {
    pub fn run(&self) -> Outcome {
        let pattern = Pattern::read_csv(&self.pattern)?;
        if let Some(clips) = self.clips {
            return super::flying::run(clips, self.clip_frames, self.seed, self.failures);
        }
        let single = match self.golf_distance {
            false => estimator(&pattern)?,
            true => {
                let config = EstimatorConfig {
                    camera: CameraModel::Unknown(CameraDistance {
                        inverse_distance: 0.0434,
                        sigma: 0.006,
                    }),
                    ..EstimatorConfig::default()
                };
                Estimator::new(&pattern, config, DetectorName::Cnn.build()?)?
            }
        };
        let all = BallsEstimator::new(vec![single.clone()], self.count)?;
        let config = SynthConfig {
            ball_px: Some([self.ball_px; 2]),
            placement_sigma_rad: match self.placement_sigma_deg {
                Some(sigma) => [sigma.to_radians(); 2],
                None => SynthConfig::golf().placement_sigma_rad,
            },
            ..SynthConfig::golf()
        };
        let times = self.strobe_ms.iter().map(|ms| 1e-3 * ms).collect();
        let [low, high] = self.overlap[..] else {
            return Err("expected two numbers for --overlap".into());
        };
        let mut trials = ExposureTrials::golf(times, self.seed);
        (trials.synth, trials.strobe.overlap) = (config, [low, high]);
        println!(
            "{} exposures, seed {}, flashes {:?} ms, balls of {} px, {}",
            self.frames,
            self.seed,
            self.strobe_ms,
            self.ball_px,
            self.pattern.display()
        );
        let reads = (0..self.frames)
            .into_par_iter()
            .map(|k| {
                let frame = trials.frame(&pattern, k)?;
                let known = frame.truth.intrinsics.filter(|_| self.intrinsics);
                match known {
                    None => self.read(&trials, &all, &frame, k),
                    Some(k_camera) => {
                        let config = EstimatorConfig {
                            camera: CameraModel::Known(Camera::Perspective(k_camera)),
                            ..EstimatorConfig::default()
                        };
                        let one = Estimator::new(&pattern, config, DetectorName::Cnn.build()?)?;
                        let all = BallsEstimator::new(vec![one], self.count)?;
                        self.read(&trials, &all, &frame, k)
                    }
                }
            })
            .collect::<spindoe::Result<Vec<Read>>>()?;
        report(&reads, self.seed);
        Ok(())
    }

    fn read(
        &self,
        trials: &ExposureTrials,
        all: &BallsEstimator,
        frame: &SynthFrame,
        k: u64,
    ) -> spindoe::Result<Read> {
        let single = &all.estimators()[0];
        let mut ws = all.workspace()?;
        let gray = frame.image.to_gray();
        let (mut own, mut out) = (single.workspace(), FrameEstimate::default());
        let budget = Budget::default();
        let begun = ThreadTime::now();
        single.estimate(&gray, &Prior::default(), &budget, &mut own, &mut out);
        let alone_ms = 1e3 * begun.elapsed().as_secs_f64();
        let truth = &frame.truth.balls;
        let strobe = trials.flashes(truth)?;
        let begun = ThreadTime::now();
        let balls = all.estimate_strobed(&gray, None, &strobe, &budget, &mut ws);
        let ms = 1e3 * begun.elapsed().as_secs_f64();
        let hypotheses = strobe.read(&balls, CameraFrame::default());
        let outcome = ExposureOutcome::of(truth, &balls, &hypotheses, !self.intrinsics);
        if self.failures {
            say(k, &outcome);
        }
        Ok(Read {
            outcome,
            ms,
            alone_ms,
        })
    }
}

/// Names what is not right.
fn say(k: u64, outcome: &ExposureOutcome) {
    let mut words = Vec::new();
    let missing = [
        (outcome.images - outcome.found, "not found"),
        (outcome.found - outcome.posed, "without a pose"),
        (outcome.wrong, "wrong"),
        (outcome.invented, "invented"),
    ];
    for (count, what) in missing.into_iter().filter(|(count, _)| *count > 0) {
        words.push(format!("{count} {what}"));
    }
    if !outcome.is_right() {
        words.push(match outcome.spin {
            Some(s) => format!(
                "spin off by {:.0} of {:.0} rpm, p {:.2}",
                s.error_rpm, outcome.true_rpm, s.probability
            ),
            None => "no spin".into(),
        });
    }
    if !words.is_empty() {
        eprintln!("{k}: overlap {:.2}: {}", outcome.overlap, words.join("; "));
    }
}

fn report(reads: &[Read], seed: u64) {
    let table = Table::new([
        "overlap",
        "exposures",
        "images found",
        "with a pose",
        "poses wrong",
        "median error, deg",
        "spin right",
        "rate right",
        "back and side right",
        "median error, rpm",
    ]);
    let bands = [
        ("all", -9.0..9.0),
        ("below 0.2", -9.0..0.2),
        ("0.2 to 0.4", 0.2..0.4),
        ("0.4 to 0.6", 0.4..9.0),
    ];
    for (name, band) in bands {
        let outcomes = reads.iter().map(|r| &r.outcome);
        let some: Vec<_> = outcomes.filter(|o| band.contains(&o.overlap)).collect();
        let count = some.len();
        let rates = ExposureRates::of(some, seed);
        row!(
            table; name, count, rates.found, rates.posed, rates.wrong,
            figure(rates.median_error_deg, 3, ""),
            rates.right, rates.rate_right, rates.golf_right,
            figure(rates.median_error_rpm, 0, "")
        );
    }
    let chi2 = median(reads, |r| r.outcome.spin.map_or(f64::NAN, |s| s.chi2));
    let open = share(reads, |r| r.outcome.spin.is_some_and(|s| s.hypotheses > 1));
    println!("median chi^2 of the spin {chi2:.2} (2.37 expected); more than one hypothesis {open}");
    let all_poses: Vec<&Read> = reads
        .iter()
        .filter(|r| r.outcome.posed == r.outcome.images)
        .collect();
    println!(
        "exposures with all poses: {}, spin right of these {}",
        share(reads, |r| r.outcome.posed == r.outcome.images),
        share(&all_poses, |r| r.outcome.is_right())
    );
    println!(
        "CPU time of one thread: one ball {:.2} ms (median {:.2}), all balls {:.2} ms (median {:.2})",
        mean(reads, |r| r.alone_ms),
        median(reads, |r| r.alone_ms),
        mean(reads, |r| r.ms),
        median(reads, |r| r.ms)
    );
}
