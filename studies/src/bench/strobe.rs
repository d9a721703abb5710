//! Several images of balls in one picture: exposures of one ball with several flashes, clips of two and three flying balls of different
//! tables, and what each further ball costs.
//!
//!     cargo run --release -p spindoe-studies -- strobe --help

use cpu_time::ThreadTime;
use rayon::prelude::*;
use spindoe::geometry::{CameraFrame, Vec3};
use spindoe::pattern::Pattern;
use spindoe::spin::robust::SpinConfig;
use spindoe::stats::Proportion;
use spindoe::synth::SynthConfig;
use spindoe::synth::dataset::{BallTruth, Frame, strobed_frame};
use spindoe::synth::several::StrobeConfig;
use spindoe::validate::ORIENTATION_FAILURE_RAD;
use spindoe::vision::estimator::{
    BallEstimate, BallsEstimator, CameraDistance, CameraModel, Strobe,
};
use spindoe::vision::{
    Budget, Camera, DetectorName, Estimator, EstimatorConfig, FrameEstimate, NamedDetector, Prior,
};
use spindoe_studies::frames::{DOTS20, estimator};
use spindoe_studies::score::{mean, median, share};
use spindoe_studies::table::{Table, figure};
use spindoe_studies::{Outcome, row};

/// rad/s in revolutions per minute.
const RPM: f64 = 60.0 / std::f64::consts::TAU;
/// A spin counts as right within this part of it, or so many rpm.
const RIGHT: (f64, f64) = (0.02, 60.0);

#[derive(clap::Args)]
pub struct Args {
    /// Exposures.
    #[arg(long, default_value_t = 500)]
    frames: usize,
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

/// What became of an exposure.
struct Read {
    overlap: f64,
    images: usize,
    found: usize,
    posed: usize,
    wrong: usize,
    /// Poses that are at no image.
    invented: usize,
    errors_deg: Vec<f64>,
    /// The likeliest spin's error and the spin, rpm; none without one.
    spin: Option<SpinRead>,
    ms: f64,
    alone_ms: f64,
    true_rpm: f64,
}

#[derive(Clone, Copy)]
struct SpinRead {
    error_rpm: f64,
    rate_error_rpm: f64,
    back_error_rpm: f64,
    side_error_rpm: f64,
    probability: f64,
    /// Error over its stated deviation, squared, of three degrees of freedom.
    chi2: f64,
    hypotheses: usize,
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
        let times: Vec<f64> = self.strobe_ms.iter().map(|ms| 1e-3 * ms).collect();
        let [low, high] = self.overlap[..] else {
            return Err("expected two numbers for --overlap".into());
        };
        let strobe = StrobeConfig {
            overlap: [low, high],
            ..StrobeConfig::new(times.clone()).with_golf_spin()
        };
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
                let frame = strobed_frame(&pattern, &config, &strobe, self.seed, k)?;
                let known = frame.truth.intrinsics.filter(|_| self.intrinsics);
                match known {
                    None => self.read(&all, &frame, &times, k),
                    Some(k_camera) => {
                        let config = EstimatorConfig {
                            camera: CameraModel::Known(Camera::Perspective(k_camera)),
                            ..EstimatorConfig::default()
                        };
                        let one = Estimator::new(&pattern, config, DetectorName::Cnn.build()?)?;
                        let all = BallsEstimator::new(vec![one], self.count)?;
                        self.read(&all, &frame, &times, k)
                    }
                }
            })
            .collect::<spindoe::Result<Vec<Read>>>()?;
        report(&reads);
        Ok(())
    }

    fn read(
        &self,
        all: &BallsEstimator<NamedDetector>,
        frame: &Frame,
        times: &[f64],
        k: usize,
    ) -> spindoe::Result<Read> {
        let single = &all.estimators()[0];
        let mut ws = all.workspace()?;
        let gray = frame.image.to_gray();
        let (mut own, mut out) = (single.workspace(), FrameEstimate::default());
        let budget = Budget::default();
        let begun = ThreadTime::now();
        single.estimate(&gray, &Prior::default(), &budget, &mut own, &mut out);
        let alone_ms = 1e3 * begun.elapsed().as_secs_f64();
        let spin = SpinConfig {
            max_rps: 250.0,
            ..SpinConfig::default()
        };
        let truth = &frame.truth.balls;
        let moved = truth[1].center.u - truth[0].center.u;
        let flight = spindoe::spin::golf::Flight::of_motion([moved, 0.0]);
        let strobe = Strobe::new(times.to_vec(), Some(flight), spin)?;
        let begun = ThreadTime::now();
        let balls = all.estimate_strobed(&gray, None, &strobe, &budget, &mut ws)?;
        let ms = 1e3 * begun.elapsed().as_secs_f64();
        let mut read = Read {
            overlap: overlap(truth),
            images: truth.len(),
            found: 0,
            posed: 0,
            wrong: 0,
            invented: 0,
            errors_deg: Vec::new(),
            spin: None,
            ms,
            alone_ms,
            true_rpm: RPM * Vec3::from(truth[0].spin_rad_s).norm(),
        };
        let mut words = Vec::new();
        for image in truth {
            let there = balls.iter().filter(|b| is_at(b, image));
            let best = there.max_by_key(|b| b.frame.pose().is_some());
            read.found += usize::from(best.is_some());
            let Some(pose) = best.and_then(|b| b.frame.pose()) else {
                words.push(match best {
                    Some(ball) => format!("{}: {:?}", image.flash, ball.frame.outcome),
                    None => format!("{}: not found", image.flash),
                });
                continue;
            };
            read.posed += 1;
            let truth = match self.intrinsics {
                true => image.camera_orientation(),
                false => image.orientation(),
            };
            let error = pose.rotation.angle_to(&truth);
            if error < ORIENTATION_FAILURE_RAD {
                read.errors_deg.push(error.to_degrees());
            } else {
                read.wrong += 1;
                words.push(format!("{}: wrong, {:.3}", image.flash, pose.confidence));
            }
        }
        let posed = balls.iter().filter(|b| b.frame.pose().is_some());
        let invented = posed.filter(|b| !truth.iter().any(|t| is_at(b, t)));
        read.invented = invented.count();
        if read.invented > 0 {
            words.push(format!("{} invented", read.invented));
        }
        let hypotheses = strobe.read(&balls, CameraFrame::default());
        let true_spin = Vec3::from(truth[0].spin_rad_s);
        if let Some(best) = hypotheses.first()
            && let Ok((fit, _)) = &best.spin
        {
            let off = fit.motion.spin - true_spin;
            let inverse = fit.spin_covariance.and_then(|c| c.try_inverse());
            read.spin = Some(SpinRead {
                error_rpm: RPM * off.norm(),
                rate_error_rpm: RPM * (fit.motion.spin.norm() - true_spin.norm()).abs(),
                back_error_rpm: RPM * off.z.abs(),
                side_error_rpm: RPM * off.y.abs(),
                probability: best.probability,
                chi2: inverse.map_or(f64::NAN, |inverse| off.dot(&(inverse * off))),
                hypotheses: hypotheses.len(),
            });
        }
        if !read.is_right() {
            words.push(match read.spin {
                Some(s) => format!(
                    "spin off by {:.0} of {:.0} rpm, p {:.2}",
                    s.error_rpm, read.true_rpm, s.probability
                ),
                None => "no spin".into(),
            });
        }
        if self.failures && !words.is_empty() {
            eprintln!("{k}: overlap {:.2}: {}", read.overlap, words.join("; "));
        }
        Ok(read)
    }
}

impl Read {
    fn is_right(&self) -> bool {
        let most = (RIGHT.0 * self.true_rpm).max(RIGHT.1);
        self.spin.is_some_and(|s| s.error_rpm <= most)
    }

    fn is_rate_right(&self) -> bool {
        let most = (RIGHT.0 * self.true_rpm).max(RIGHT.1);
        self.spin.is_some_and(|s| s.rate_error_rpm <= most)
    }

    fn is_back_right(&self) -> bool {
        let most = (RIGHT.0 * self.true_rpm).max(RIGHT.1);
        self.spin
            .is_some_and(|s| s.back_error_rpm <= most && s.side_error_rpm <= most)
    }
}

/// Whether a ball was found where an image is: its center within three tenths of the radius, the radius within a fifth.
pub(crate) fn is_at(ball: &BallEstimate, image: &BallTruth) -> bool {
    ball.circle().is_some_and(|c| {
        let apart = (c.center.u - image.center.u).hypot(c.center.v - image.center.v);
        // An ellipse has its shorter half axis for a radius.
        let radius = c.radius / (1.0 - c.eccentricity.norm_squared()).powf(0.25);
        apart < 0.3 * image.radius_px && (radius / image.radius_px).ln().abs() < 0.2
    })
}

/// The share of the diameter that the two nearest images have in common.
fn overlap(truth: &[BallTruth]) -> f64 {
    let apart = truth.windows(2).map(|w| {
        let [a, b] = [w[0].center, w[1].center];
        (a.u - b.u).hypot(a.v - b.v) / (w[0].radius_px + w[1].radius_px)
    });
    1.0 - apart.fold(f64::INFINITY, f64::min)
}

fn report(reads: &[Read]) {
    let table = Table::new([
        "overlap",
        "exposures",
        "images found",
        "with a pose",
        "poses wrong",
        "invented",
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
        let some: Vec<&Read> = reads.iter().filter(|r| band.contains(&r.overlap)).collect();
        let sum = |count: fn(&Read) -> usize| some.iter().map(|r| count(r)).sum::<usize>() as u64;
        let images = sum(|r| r.images);
        let posed = sum(|r| r.posed) + sum(|r| r.invented);
        let errors: Vec<f64> = some.iter().flat_map(|r| r.errors_deg.clone()).collect();
        let off = |r: &&Read| r.spin.map_or(f64::NAN, |s| s.error_rpm);
        row!(
            table; name, some.len(),
            Proportion::new(sum(|r| r.found), images),
            Proportion::new(sum(|r| r.posed), images),
            Proportion::new(sum(|r| r.wrong) + sum(|r| r.invented), posed),
            sum(|r| r.invented),
            figure(median(&errors, |e| *e), 3, ""),
            share(&some, |r| r.is_right()),
            share(&some, |r| r.is_rate_right()),
            share(&some, |r| r.is_back_right()),
            figure(median(&some, off), 0, "")
        );
    }
    let chi2 = median(reads, |r| r.spin.map_or(f64::NAN, |s| s.chi2));
    let open = share(reads, |r| r.spin.is_some_and(|s| s.hypotheses > 1));
    println!("median chi^2 of the spin {chi2:.2} (2.37 expected); more than one hypothesis {open}");
    let all_poses: Vec<&Read> = reads.iter().filter(|r| r.posed == r.images).collect();
    println!(
        "exposures with all poses: {}, spin right of these {}",
        share(reads, |r| r.posed == r.images),
        share(&all_poses, |r| r.is_right())
    );
    println!(
        "CPU time of one thread: one ball {:.2} ms (median {:.2}), all balls {:.2} ms (median {:.2})",
        mean(reads, |r| r.alone_ms),
        median(reads, |r| r.alone_ms),
        mean(reads, |r| r.ms),
        median(reads, |r| r.ms)
    );
}
