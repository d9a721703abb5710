//! How small may a ball be? Balls of 10 to 24 pixels in diameter in good conditions: regions of 48 x 48, each alone, with the outline
//! found and with the true one, and clips whose frames help each other, as such and as frames of 640 x 480.
//!
//!     cargo run --release -p spindoe-studies -- small --help

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use spindoe::camera::FrameOutcome;
use spindoe::geometry::Rotation;
use spindoe::pattern::Pattern;
use spindoe::synth::dataset::independent_frame;
use spindoe::synth::{SynthConfig, SynthKind};
use spindoe::validate::ORIENTATION_FAILURE_RAD;
use spindoe::vision::pose::{PoseSource, TrustMap};
use spindoe::vision::{
    BallCircle, Budget, DetectorName, Estimator, EstimatorConfig, FrameEstimate, OutlinePrior,
    Prior,
};
use spindoe_studies::frames::{DOTS20, all_conditions, alone, each, good_conditions, outcome};
use spindoe_studies::score::{Claim, RATES, bins, claimed, rates};
use spindoe_studies::table::{Table, figure};
use spindoe_studies::{Outcome, row};

use crate::sequences;
use crate::trust::kinds::Judged;

/// Side of the regions, pixels.
const REGION: usize = 48;
/// Displacement of the ball over a clip of whole frames, pixels: it stays in the image.
const DRIFT_PX: [f64; 2] = [12.0, -5.0];
/// Diameters of the balls that the confidence is fitted on, pixels.
const FITTED_PX: [f64; 2] = [11.0, 26.0];

#[derive(clap::Args)]
pub struct Args {
    /// Frames of a line.
    #[arg(long, default_value_t = 600)]
    frames: usize,
    /// Clips of a line.
    #[arg(long, default_value_t = 40)]
    clips: u64,
    /// Frames of a clip.
    #[arg(long, default_value_t = 12)]
    clip_frames: usize,
    /// Seed of the frames and clips.
    #[arg(long, default_value_t = 32_400_001)]
    seed: u64,
    /// Diameters of the balls, pixels.
    #[arg(long, value_delimiter = ',', default_values_t = [10.0, 12.0, 14.0, 16.0, 18.0, 20.0, 24.0])]
    ball_px: Vec<f64>,
    /// Pattern of the ball.
    #[arg(long, default_value = DOTS20)]
    pattern: std::path::PathBuf,
    /// Not these, but what is claimed of poses by all pixels of a small ball: of so many images, of which every second shows the ball.
    #[arg(long)]
    claims: Option<u64>,
    /// Minimum radius of a ball that is looked for, pixels [default: the estimator's].
    #[arg(long)]
    min_radius_px: Option<f64>,
}

impl Args {
    pub fn run(&self) -> Outcome {
        let pattern = Pattern::read_csv(&self.pattern)?;
        let mut config = EstimatorConfig::default();
        if let Some(px) = self.min_radius_px {
            config.circle.min_radius_px = px;
        }
        let estimator = [Estimator::new(
            &pattern,
            config,
            DetectorName::Cnn.build()?,
        )?];
        println!(
            "{} frames a line, {} clips of {}, seed {}, {}",
            self.frames,
            self.clips,
            self.clip_frames,
            self.seed,
            self.pattern.display()
        );
        if let Some(images) = self.claims {
            return show_claims(&judged_images(&estimator[0], images, self.seed)?);
        }
        let table = Table::new(["ball, px", "images"].into_iter().chain(RATES));
        for &px in &self.ball_px {
            let config = SynthConfig {
                ball_px: Some([px; 2]),
                image_px: Some([REGION; 2]),
                ..good_conditions().config
            };
            if self.frames > 0 {
                let alone = self.alone(&estimator, &config)?;
                for (k, name) in ["48 x 48", "48 x 48, the true outline"]
                    .into_iter()
                    .enumerate()
                {
                    let outcomes: Vec<_> = alone.iter().map(|o| o[k]).collect();
                    row!(table; px, name; rates(&outcomes));
                }
            }
            let whole = SynthConfig {
                image_px: Some([640, 480]),
                ..config.clone()
            };
            let sets = [
                ("clips of 48 x 48", &config, None),
                ("clips of 640 x 480", &whole, Some(DRIFT_PX)),
            ];
            for (name, config, drift) in sets.into_iter().filter(|_| self.clips > 0) {
                let clips = (0..self.clips).into_par_iter().map(|k| {
                    let count = self.clip_frames;
                    sequences::clip(&estimator[0], config, drift, self.seed + k, count)
                });
                let clips = clips.collect::<spindoe::Result<Vec<_>>>()?;
                for (way, words) in ["each alone", "two passes"].into_iter().enumerate() {
                    let outcomes: Vec<_> = clips.iter().flat_map(|p| p.0[way].clone()).collect();
                    row!(table; px, format!("{name}, {words}"); rates(&outcomes));
                }
            }
        }
        Ok(())
    }

    /// Each frame with its outline found, and with the true one.
    fn alone(
        &self,
        estimator: &[Estimator; 1],
        config: &SynthConfig,
    ) -> spindoe::Result<Vec<[FrameOutcome; 2]>> {
        each(
            estimator,
            config,
            self.seed,
            self.frames,
            |frame, [found]| {
                let prior = Prior {
                    outline: Some(OutlinePrior::given(BallCircle::new(
                        frame.truth.center,
                        frame.truth.radius_px,
                    ))),
                    ..Prior::default()
                };
                let mut given = FrameEstimate::default();
                let mut ws = estimator[0].workspace();
                estimator[0].estimate(
                    &frame.image,
                    &prior,
                    &Budget::default(),
                    &mut ws,
                    &mut given,
                );
                [&found, &given].map(|f| outcome(f, &frame.truth))
            },
        )
    }
}

/// The poses by all pixels of images of which every second shows the ball, half of them in good conditions, and the balls' diameters.
fn judged_images(
    estimator: &Estimator,
    images: u64,
    seed: u64,
) -> spindoe::Result<Vec<(Judged, f64)>> {
    let all = (0..images).into_par_iter();
    let all = all.map(|k| judged(estimator, seed, k));
    Ok(all.collect::<spindoe::Result<Vec<_>>>()?.concat())
}

/// The poses by all pixels that the weights of [`TrustMap`](spindoe::vision::pose::TrustMap) for these are fitted to.
pub fn fitting_answers(images: u64, seed: u64) -> spindoe::Result<Vec<Judged>> {
    let pattern = Pattern::read_csv(DOTS20.as_ref())?;
    let detector = DetectorName::Cnn.build()?;
    let estimator = Estimator::new(&pattern, EstimatorConfig::default(), detector)?;
    let judged = judged_images(&estimator, images, seed)?;
    Ok(judged.into_iter().map(|(pose, _)| pose).collect())
}

/// What poses claim, and how often they are right.
fn show_claims(shown: &[(Judged, f64)]) -> Outcome {
    let claim = |(pose, _): &&(Judged, f64)| Claim {
        confidence: TrustMap::DEFAULT.probability(&pose.evidence),
        is_right: pose.is_correct,
    };
    let table = Table::new(["ball, px", "claimed", "poses", "mean claim", "right"]);
    for (name, sizes) in [
        ("all", 0.0..99.0),
        ("below 16", 0.0..16.0),
        ("from 16 on", 16.0..99.0),
    ] {
        let some = shown.iter().filter(|(_, px)| sizes.contains(px));
        let claims: Vec<Claim> = some.map(|pose| claim(&pose)).collect();
        for bin in bins(&[0.0, 0.2, 0.5, 0.7, 0.85, 0.9, 0.95, 0.99]) {
            let (mean, right) = claimed(&claims, bin);
            let mean = figure(100.0 * mean, 2, "%");
            row!(table; name, bin.named(""), right.trials, mean, right);
        }
    }
    Ok(())
}

/// The pose by all pixels of an image, if one was looked for, and the ball's diameter.
fn judged(estimator: &Estimator, seed: u64, k: u64) -> spindoe::Result<Vec<(Judged, f64)>> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(k);
    let config = match k % 2 {
        0 => good_conditions().config,
        _ => all_conditions().config,
    };
    let others: Vec<SynthKind> = SynthKind::ALL
        .into_iter()
        .filter(|k| !k.has_pattern())
        .collect();
    let kind = match (k / 2) % 2 {
        0 => SynthKind::Dotted,
        _ => others[rng.random_range(0..others.len())],
    };
    let px = FITTED_PX[0] * (FITTED_PX[1] / FITTED_PX[0]).powf(rng.random());
    let config = SynthConfig {
        kind,
        ball_px: Some([px; 2]),
        image_px: Some([REGION; 2]),
        ..config
    };
    let frame = independent_frame(estimator.pattern(), &config, seed, k as usize)?;
    let found = alone(estimator, &frame.image, &mut estimator.workspace());
    let truth = frame.truth.orientation();
    let is_right = |r: &Rotation| truth.angle_to(r) < ORIENTATION_FAILURE_RAD;
    let poses = found
        .hypotheses()
        .filter(|h| matches!(h.evidence.source, PoseSource::Pixels(_)));
    let judged = poses.map(|h| Judged {
        evidence: h.evidence,
        is_correct: kind.has_pattern() && is_right(&h.rotation),
    });
    Ok(judged.map(|pose| (pose, px)).collect())
}
