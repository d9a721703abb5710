//! How far a ball turns while the shutter is open, by how its dots are smeared: against the rendered truth, each frame alone.

use nalgebra::Vector2;
use spindoe::geometry::Vec3;
use spindoe::pattern::Pattern;
use spindoe::synth::SynthConfig;
use spindoe::vision::dots::smear::{Smear, SmearedDot, Turn};
use spindoe_studies::frames::{DOTS20, blur_estimator, each};
use spindoe_studies::score::{bins, median, share};
use spindoe_studies::table::{Table, figure};
use spindoe_studies::{Outcome, row};

/// Turns that are distinguished, degrees.
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

/// Lengths of smears that are distinguished, over the dot's diameter.
const LENGTHS: [f64; 9] = [0.0, 0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 2.0, 3.0];
/// A squared residual that a blur that is the dot's own exceeds in 1 of 100, of three degrees of freedom.
const OFF: f64 = 11.3;

/// What came of a frame.
struct Seen {
    truth: Vec3,
    is_answered: bool,
    turn: Option<Turn>,
    /// Its dots under the true turn.
    dots: Vec<SmearedDot>,
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
        let estimator = [blur_estimator(&pattern)?];
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
        let mut dots: Vec<SmearedDot> = Vec::new();
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
                |frame, [found]| {
                    let truth = frame.truth.turn();
                    let smear = estimator[0].smear(&found, Vector2::zeros());
                    Seen {
                        truth,
                        is_answered: found.pose().is_some(),
                        turn: smear.as_ref().and_then(Smear::turn),
                        dots: smear.map_or(Vec::new(), |s| s.dots_under(&truth).collect()),
                    }
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
            dots.extend(seen.iter().flat_map(|s| s.dots.iter().copied()));
        }
        let table = Table::new([
            "smear over the dot's diameter",
            "named dots",
            "blur measured",
            "median squared residual",
            "residual that 1 of 100 exceeds",
        ]);
        for bin in bins(&LENGTHS) {
            let is_in = |dot: &&SmearedDot| (bin.from..bin.to).contains(&dot.length);
            let these: Vec<&SmearedDot> = dots.iter().filter(is_in).collect();
            let squares: Vec<f64> = these.iter().filter_map(|dot| dot.square).collect();
            row!(table; format!("{} to {}", bin.from, bin.to), these.len(),
                share(&these, |dot| dot.square.is_some()),
                figure(median(&squares, |square| *square), 2, ""),
                share(&squares, |square| *square > OFF));
        }
        Ok(())
    }
}
