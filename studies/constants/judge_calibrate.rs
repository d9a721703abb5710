//! What clips of unknown balls come to as a constant changes: compiled by `sweep.py` into a copy of the sources whose constants are scaled
//! at run time.

use cpu_time::ProcessTime;
use rayon::prelude::*;
use spindoe::Pattern;
use spindoe::calibrate::{CalibrationConfig, KnownDots, calibrate_built, survey};
use spindoe::geometry::angle_between;
use spindoe::sweep::{NAMES, scale};
use spindoe::synth::SynthConfig;
use spindoe::vision::FrameEstimate;
use spindoe_studies::Outcome;
use spindoe_studies::frames::{alone, estimator};
use spindoe_studies::hand::{Habits, HandClip};

use crate::marks::{SeenClip, named};

/// A dot that is off by more is wrong, degrees.
const RIGHT_DEG: f64 = 1.0;

/// Rendered clips, and what is asked of each.
#[derive(clap::Args)]
pub struct Args {
    /// Clips of each of the three kinds: balls drawn and turned as the guide asks, without and with print, and plain ones turned without
    /// a plan whose number of dots is given.
    #[arg(long, default_value_t = 4)]
    clips: u64,
    /// Seed of the clips.
    #[arg(long, default_value_t = 37_100_001)]
    seed: u64,
    /// Factors by which each constant is scaled.
    #[arg(long, num_args = 1.., default_values_t = [0.7, 1.4])]
    factors: Vec<f64>,
    /// Only constants whose name contains this.
    #[arg(long, default_value = "")]
    only: String,
}

/// A clip, what its frames show without a table, and what they show with the table that it gives when no constant is scaled.
struct Clip {
    clip: HandClip,
    seen: SeenClip,
    known: KnownDots,
    built: Option<(Pattern, Vec<FrameEstimate>)>,
}

/// Whole tables, wrong ones, dots of all, and the sum of the errors of the whole ones' dots (root mean square).
#[derive(Default)]
struct Tally {
    whole: usize,
    wrong: usize,
    dots: usize,
    errors_deg: f64,
}

impl Args {
    pub fn run(&self) -> Outcome {
        let mut clips = self.clips()?;
        println!("constant,factor,right,wrong,others,sum_of_errors_deg,judged,cpu_s");
        for clip in &mut clips {
            clip.built = clip.built_alone()?;
        }
        self.show("none", 1.0, &clips)?;
        for (k, name) in NAMES.iter().enumerate() {
            if !name.contains(&self.only) {
                continue;
            }
            for &factor in &self.factors {
                scale(k, factor);
                self.show(name, factor, &clips)?;
            }
            scale(usize::MAX, 1.0);
        }
        self.show("none", 1.0, &clips)
    }

    fn clips(&self) -> Outcome<Vec<Clip>> {
        let kinds = [
            (SynthConfig::good().unprinted(), Habits::Guided),
            (SynthConfig::good(), Habits::Guided),
            (SynthConfig::good().unprinted(), Habits::Any),
        ];
        let all: Result<Vec<Clip>, String> = (0..3 * self.clips)
            .into_par_iter()
            .map(|k| {
                let (looks, habits) = &kinds[(k % 3) as usize];
                let clip = HandClip::random(looks, *habits, self.seed, k).map_err(|e| e.to_string())?;
                let seen = SeenClip::of(&clip).map_err(|e| e.to_string())?;
                let known = match habits {
                    Habits::Guided => KnownDots::Nothing,
                    Habits::Any => KnownDots::Number(seen.shown.hidden.iter().filter(|h| !**h).count()),
                };
                Ok(Clip { clip, seen, known, built: None })
            })
            .collect();
        Ok(all?)
    }

    fn show(&self, name: &str, factor: f64, clips: &[Clip]) -> Outcome {
        let begun = ProcessTime::now();
        let judged: Result<Vec<Tally>, String> =
            clips.par_iter().map(|clip| clip.judge().map_err(|e| e.to_string())).collect();
        let sum = judged?.into_iter().fold(Tally::default(), |a, b| Tally {
            whole: a.whole + b.whole,
            wrong: a.wrong + b.wrong,
            dots: a.dots + b.dots,
            errors_deg: a.errors_deg + b.errors_deg,
        });
        let cpu = begun.elapsed().as_secs_f64();
        println!("{name},{factor},{},{},{},{:.4},{},{cpu:.2}", sum.whole, sum.wrong, sum.dots, sum.errors_deg, clips.len());
        Ok(())
    }
}

impl Clip {
    fn built_alone(&self) -> Outcome<Option<(Pattern, Vec<FrameEstimate>)>> {
        let config = CalibrationConfig::default();
        let found = survey(&self.seen.estimates, &self.seen.taken, &self.known, &config)?;
        let Ok(built) = found.pattern else {
            return Ok(None);
        };
        let frames = self.frames(&built.pattern)?;
        Ok(Some((built.pattern, frames)))
    }

    fn frames(&self, pattern: &Pattern) -> Outcome<Vec<FrameEstimate>> {
        let estimator = estimator(pattern)?;
        let mut workspace = estimator.workspace();
        let mut frames = Vec::with_capacity(self.clip.frames());
        self.clip.show(|seen| frames.push(alone(&estimator, &seen.image, &mut workspace)))?;
        Ok(frames)
    }

    fn judge(&self) -> Outcome<Tally> {
        let config = CalibrationConfig::default();
        let found = survey(&self.seen.estimates, &self.seen.taken, &self.known, &config)?;
        let Ok(built) = found.pattern else {
            return Ok(Tally::default());
        };
        let is_same = |kept: &&(Pattern, Vec<FrameEstimate>)| kept.0.dots() == built.pattern.dots();
        let again;
        let frames = match self.built.as_ref().filter(is_same) {
            Some((_, frames)) => frames,
            None => {
                again = self.frames(&built.pattern)?;
                &again
            }
        };
        let times: Vec<f64> = (0..self.clip.frames()).map(|k| k as f64 / self.clip.fps).collect();
        let Ok(found) = calibrate_built(&built, frames, &self.seen.taken, Some(&times), &config)? else {
            return Ok(Tally::default());
        };
        self.tally(&found.pattern()?)
    }

    fn tally(&self, pattern: &Pattern) -> Outcome<Tally> {
        let named = named(pattern, &self.clip.truth)?;
        let errors = pattern.dots().iter().zip(&named);
        let errors: Vec<f64> = errors
            .filter_map(|(dot, found)| Some(angle_between(dot, &found.as_ref()?.direction).to_degrees()))
            .collect();
        let is_missed = |j: &usize| !self.seen.shown.hidden[*j] && !named.iter().flatten().any(|n| n.number == *j);
        let is_whole = errors.len() == pattern.len()
            && !(0..self.clip.truth.len()).any(|j| is_missed(&j))
            && errors.iter().all(|e| *e < RIGHT_DEG);
        let squares: f64 = errors.iter().map(|e| e * e).sum();
        Ok(Tally {
            whole: usize::from(is_whole),
            wrong: usize::from(!is_whole),
            dots: pattern.len(),
            errors_deg: if is_whole { (squares / errors.len() as f64).sqrt() } else { 0.0 },
        })
    }
}
