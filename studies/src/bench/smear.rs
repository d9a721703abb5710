//! How far a ball turns while the shutter is open, by how its dots are smeared: against the rendered truth, each frame alone.

use nalgebra::Vector2;
use spindoe::geometry::Vec3;
use spindoe::pattern::Pattern;
use spindoe::synth::SynthConfig;
use spindoe::vision::smear::Turn;
use spindoe::vision::{DetectorName, Estimator, EstimatorConfig};
use spindoe_studies::frames::{DOTS20, each};
use spindoe_studies::score::{bins, median, share};
use spindoe_studies::table::{Table, figure};
use spindoe_studies::{Outcome, row};

/// Turns that are told apart, degrees.
const TURNS_DEG: [f64; 7] = [0.0, 1.0, 3.0, 6.0, 9.0, 12.0, 15.0];
/// The evidence, as ln odds, from which a turn counts as seen.
const SEEN: f64 = 5.0;

#[derive(clap::Args)]
pub struct Args {
    /// Frames of a size.
    #[arg(long, default_value_t = 1000)]
    frames: usize,
    /// Seed of the frames.
    #[arg(long, default_value_t = 32_500_001)]
    seed: u64,
    /// Diameters of the balls, pixels.
    #[arg(long, value_delimiter = ',', default_value = "40,60,120")]
    px: Vec<f64>,
    /// Largest turn, degrees.
    #[arg(long, default_value_t = 20.0)]
    max_turn_deg: f64,
}

/// What came of a frame.
struct Seen {
    truth: Vec3,
    is_answered: bool,
    turn: Option<Turn>,
}

impl Seen {
    fn is_clear(&self) -> bool {
        self.turn.is_some_and(|t| t.evidence >= SEEN)
    }

    /// Of the angle and of the vector up to its sign, degrees; NaN where no turn is clear.
    fn errors_deg(&self) -> [f64; 2] {
        let Some(turn) = self.turn.filter(|_| self.is_clear()) else {
            return [f64::NAN; 2];
        };
        let off = |sign: f64| (turn.rotation * sign - self.truth).norm();
        let of_angle = (turn.angle() - self.truth.norm()).abs();
        [of_angle, off(1.0).min(off(-1.0))].map(f64::to_degrees)
    }
}

impl Args {
    pub fn run(&self) -> Outcome {
        let pattern = Pattern::read_csv(DOTS20.as_ref())?;
        let config = EstimatorConfig {
            measures_blur: true,
            ..EstimatorConfig::default()
        };
        let estimator = [Estimator::new(
            &pattern,
            config,
            DetectorName::Cnn.build()?,
        )?];
        println!("{} frames a size, seed {}", self.frames, self.seed);
        let table = Table::new([
            "ball, px",
            "turn, deg",
            "frames",
            "answered",
            "turn clear",
            "median error of the angle, deg",
            "of the vector, deg",
        ]);
        for &px in &self.px {
            let config = SynthConfig {
                ball_px: Some([px; 2]),
                max_arc_rad: self.max_turn_deg.to_radians(),
                max_shift_px: 0.0,
                ..SynthConfig::good()
            };
            let seen = each(
                &estimator,
                &config,
                self.seed,
                self.frames,
                |frame, [found]| Seen {
                    truth: frame.truth.turn(),
                    is_answered: found.pose().is_some(),
                    turn: estimator[0]
                        .smear(&found, Vector2::zeros())
                        .and_then(|smear| smear.turn()),
                },
            )?;
            for bin in bins(&TURNS_DEG) {
                let is_in = |s: &&Seen| (bin.from..bin.to).contains(&s.truth.norm().to_degrees());
                let these: Vec<&Seen> = seen.iter().filter(is_in).collect();
                let error = |k: usize| figure(median(&these, |s| s.errors_deg()[k]), 2, "");
                let name = match bin.to.is_finite() {
                    true => format!("{} to {}", bin.from, bin.to),
                    false => format!("{} or more", bin.from),
                };
                row!(table; px, name, these.len(), share(&these, |s| s.is_answered),
                    share(&these, |s| s.is_clear()), error(0), error(1));
            }
        }
        Ok(())
    }
}
