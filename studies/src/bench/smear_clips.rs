//! Do smears settle how many turns lie between two frames? Clips of one ball at ordinary frame rates and exposures, with spins that
//! the orientations leave open.
//!
//! Every clip is estimated in two passes; of the spins that its orientations allow, the one is taken for which they and the smears
//! speak together. *Apart* are the clips whose candidates smear by 5 degrees or more differently from the true spin, where turns
//! beyond 16 degrees, which are not measured, count as these. A spin is decided where its probability among the candidates exceeds
//! 0.99; without a decision the slowest is taken. Spins within a quarter of the frame rate are the same; *another one* are the clips
//! whose orientations do not allow the true spin.
//!
//!     cargo run --release -p spindoe-studies -- smear-clips --help

use std::f64::consts::TAU;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use spindoe::clip::{NamedFrame, SequenceConfig, SequenceSmears, estimate_sequence, orientations};
use spindoe::geometry::{CameraFrame, Vec3, random_direction};
use spindoe::image::ImageView;
use spindoe::pattern::Pattern;
use spindoe::spin::alias::AliasConfig;
use spindoe::spin::estimate::{MotionModel, SpinEstimate};
use spindoe::spin::robust::SpinConfig;
use spindoe::synth::SynthConfig;
use spindoe::synth::dataset::{ClipConfig, SynthSequence};
use spindoe::vision::Estimator;
use spindoe_studies::frames::{DOTS20, blur_estimator};
use spindoe_studies::score::share;
use spindoe_studies::table::Table;
use spindoe_studies::{Outcome, row};

/// The difference of the candidates' turns from which they should be distinguished, degrees.
const APART_DEG: f64 = 5.0;
/// The largest turn that is measured of the dots of 4 mm on a table tennis ball, degrees.
const LONGEST_DEG: f64 = 16.0;
/// A spin is decided from this probability on.
const DECIDED: f64 = 0.99;
/// Set in the seed of a clip's spin.
const SPIN: u64 = 0x5b14 << 32;

#[derive(clap::Args)]
pub struct Args {
    /// Clips of a frame rate and an exposure.
    #[arg(long, default_value_t = 40)]
    clips: u64,
    /// Frames of a clip.
    #[arg(long, default_value_t = 12)]
    frames: usize,
    /// Seed of the clips.
    #[arg(long, default_value_t = 32_510_001)]
    seed: u64,
    /// Frames per second.
    #[arg(long, value_delimiter = ',', default_value = "30,60,120,240")]
    fps: Vec<f64>,
    /// Reciprocal exposures, 1/s.
    #[arg(long, value_delimiter = ',', default_value = "2000,1000,500,250")]
    shutter: Vec<f64>,
    /// Diameter of the ball, pixels.
    #[arg(long, default_value_t = 60.0)]
    px: f64,
    /// The exposure that is stated, over the true one.
    #[arg(long, default_value_t = 1.0)]
    exposure_factor: f64,
    /// Spins, revolutions per second.
    #[arg(long, value_delimiter = ',', default_value = "10,150")]
    rps: Vec<f64>,
}

/// What came of a clip with a spin that is the true one but for whole turns.
#[derive(Clone, Copy)]
struct Clip {
    /// Whether the true spin is among those that the orientations allow.
    is_open: bool,
    is_apart: bool,
    is_right: bool,
    /// Whether it would be right without the smears.
    is_slowest: bool,
    probability: f64,
}

impl Clip {
    fn is_decided(&self) -> bool {
        self.probability > DECIDED
    }
}

impl Args {
    pub fn run(&self) -> Outcome {
        let pattern = Pattern::read_csv(DOTS20.as_ref())?;
        let estimator = blur_estimator(&pattern)?;
        println!(
            "{} clips of {} frames a row, ball of {} px, {} to {} rps, seed {}",
            self.clips, self.frames, self.px, self.rps[0], self.rps[1], self.seed
        );
        let table = Table::new([
            "fps",
            "exposure",
            "clips with a spin",
            "another one",
            "apart",
            "of these right",
            "right and decided",
            "wrong and decided",
            "right without smears",
            "others: right",
            "right without smears",
            "wrong and decided",
        ]);
        for &fps in &self.fps {
            for &shutter in &self.shutter {
                let clip = |k| self.clip(&estimator, fps, 1.0 / shutter, self.seed + k);
                let clips = (0..self.clips)
                    .into_par_iter()
                    .map(clip)
                    .collect::<spindoe::Result<Vec<Option<Clip>>>>()?;
                let found: Vec<Clip> = clips.into_iter().flatten().collect();
                let (open, lost): (Vec<Clip>, Vec<Clip>) =
                    found.iter().partition(|clip| clip.is_open);
                let (apart, others): (Vec<Clip>, Vec<Clip>) =
                    open.iter().partition(|clip| clip.is_apart);
                row!(table; fps, format!("1/{shutter} s"), found.len(), lost.len(), apart.len(),
                    share(&apart, |c| c.is_right),
                    share(&apart, |c| c.is_right && c.is_decided()),
                    share(&apart, |c| !c.is_right && c.is_decided()),
                    share(&apart, |c| c.is_slowest),
                    share(&others, |c| c.is_right),
                    share(&others, |c| c.is_slowest),
                    share(&others, |c| !c.is_right && c.is_decided()));
            }
        }
        Ok(())
    }

    fn clip(
        &self,
        estimator: &Estimator,
        fps: f64,
        exposure_s: f64,
        seed: u64,
    ) -> spindoe::Result<Option<Clip>> {
        let config = SynthConfig {
            ball_px: Some([self.px; 2]),
            ..SynthConfig::good()
        };
        // The same axis and spin for all rates and exposures.
        let spin = spin(seed, &self.rps);
        let clip = ClipConfig {
            fps,
            spin: Some(spin.into()),
            exposure_s: Some(exposure_s),
            ..ClipConfig::default()
        };
        let sequence =
            SynthSequence::random(estimator.pattern(), &config, &clip, seed, self.frames)?;
        let (mut images, mut times_s) = (Vec::new(), Vec::new());
        for k in 0..self.frames {
            let frame = sequence.frame(k)?;
            times_s.push(frame.truth.time_s.unwrap_or_default());
            images.push(frame.image);
        }
        let views: Vec<ImageView<'_>> = images.iter().map(ImageView::from).collect();
        let (frames, _) =
            estimate_sequence(estimator, &SequenceConfig::default(), &times_s, &views);
        let named = NamedFrame::of_times(&times_s, &frames);
        let found = orientations(&named, CameraFrame::View, true);
        let (measurements, config) = (
            found.measurements(),
            found.spin_config(SpinConfig::default()),
        );
        let stated_s = exposure_s * self.exposure_factor;
        let smears = SequenceSmears::new(estimator, &named, stated_s, CameraFrame::View);
        let slowest = SpinEstimate::fit(&measurements, MotionModel::Constant, &config);
        let (Ok(slowest), Some(smears)) = (slowest, smears) else {
            return Ok(None);
        };
        let fitted = SpinEstimate::fit_with(&measurements, MotionModel::Constant, &config, &smears);
        let Ok(fitted) = fitted else {
            return Ok(None);
        };
        let listed = AliasConfig::of(&config);
        let summary = fitted
            .summary(&measurements, fitted.middle_s(), &listed, self.frames)
            .weighed(&smears, &listed);
        let all = slowest.summary(&measurements, slowest.middle_s(), &listed, self.frames);
        // Spins a quarter of the frame rate off are others.
        let (scene, _) = sequence.scene(0);
        let truth = scene.to_view()? * spin;
        let is_true = |spin: &Vec3| (spin - truth).norm() < 0.25 * fps * TAU;
        let others = all.alternatives.iter().map(|a| a.spin);
        let candidates: Vec<Vec3> = others.chain([all.fit.motion.spin]).collect();
        let turn_deg = |spin: &Vec3| (spin.norm() * exposure_s).to_degrees().min(LONGEST_DEG);
        let is_apart = |spin: &Vec3| (turn_deg(spin) - turn_deg(&truth)).abs() >= APART_DEG;
        let odds = summary
            .alternatives
            .iter()
            .map(|a| a.log_likelihood_ratio.exp());
        Ok(Some(Clip {
            is_open: candidates.iter().any(is_true),
            is_apart: candidates.iter().filter(|s| !is_true(s)).all(is_apart),
            is_right: is_true(&summary.fit.motion.spin),
            is_slowest: is_true(&slowest.at(slowest.middle_s()).motion.spin),
            probability: 1.0 / (1.0 + odds.sum::<f64>()),
        }))
    }
}

/// The true spin of a clip, camera frame, rad/s.
fn spin(seed: u64, rps: &[f64]) -> Vec3 {
    let mut rng = ChaCha8Rng::seed_from_u64(seed ^ SPIN);
    let magnitude = rng.random_range(rps[0]..=rps[1]);
    random_direction(&mut rng) * (magnitude * TAU)
}
