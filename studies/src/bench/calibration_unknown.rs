//! Patterns built from rendered clips alone. The table of docs/measurements/calibrate.md comes from here.
//!
//!     cargo run --release -p spindoe-studies -- calibration-unknown --help
//!
//! The balls are those of `spindoe_studies::hand`: nothing but dots on them with --plain, otherwise logos, seams and stains as in
//! `SynthConfig::good`. A clip is *whole* where its calibration has all dots that print does not hide and no others, each within
//! 1 deg; *wrong* where it is answered and not whole; *complete* where its frames show 97 % of the ball. Of dozens of dots one or two
//! may lie in the other 3 %: clips that show every dot are counted apart.

use std::collections::BTreeMap;
use std::path::PathBuf;

use rayon::prelude::*;
use spindoe::Pattern;
use spindoe::calibrate::{CalibrationConfig, KnownDots, Survey, calibrate_built, survey};
use spindoe::geometry::{Vec3, angle_between};
use spindoe::plot::surface_views;
use spindoe::synth::SynthConfig;
use spindoe::validate::Proportion;
use spindoe_studies::Outcome;
use spindoe_studies::frames::{alone, estimator};
use spindoe_studies::hand::{Habits, HandClip, Strokes};

use crate::marks::{SeenClip, named};

/// A clip that shows so much of the ball should be answered.
const COMPLETE: f64 = 0.97;
/// A ring that is off its dot's middle by so many radii is not its own to a person who looks.
const OFF_CENTER: f64 = 0.5;

/// What became of a clip.
enum Built {
    Rejected(String),
    Pattern {
        /// Dots of the ball that can be seen and are not in the pattern.
        missed: usize,
        /// Dots of the pattern that are none of the ball's.
        invented: usize,
        /// The largest error of the others, degrees.
        worst_deg: f64,
    },
}

impl Built {
    fn is_whole(&self) -> bool {
        matches!(self, Self::Pattern { missed: 0, invented: 0, worst_deg } if *worst_deg < 1.0)
    }
}

/// A clip and what became of it.
struct Judged {
    words: String,
    shown: f64,
    shows_dots: bool,
    built: Built,
}

/// What is asked for.
#[derive(clap::Args)]
pub struct Args {
    /// Clips.
    #[arg(long, default_value_t = 20)]
    clips: u64,
    /// Number of the first clip.
    #[arg(long, default_value_t = 0)]
    first: u64,
    /// Seed of the clips.
    #[arg(long, default_value_t = 17)]
    seed: u64,
    /// Nothing but dots on the balls.
    #[arg(long)]
    plain: bool,
    /// Dots and turns as docs/hand-drawn.md asks for.
    #[arg(long)]
    guided: bool,
    /// Even strokes, each about another axis from one frame to the next.
    #[arg(long)]
    abrupt: bool,
    /// Give the number of the dots that can be seen.
    #[arg(long)]
    counted: bool,
    /// The same, and where marks are in doubt say which are dots, as a person does who looks at the ball's surface.
    #[arg(long, conflicts_with = "counted")]
    marks_named: bool,
    /// Draw the surface of every ball into this folder.
    #[arg(long)]
    pictures: Option<PathBuf>,
    /// A line for every clip.
    #[arg(long)]
    each: bool,
}

impl Args {
    pub fn run(&self) -> Outcome {
        let looks = match self.plain {
            false => SynthConfig::good(),
            true => SynthConfig::good().unprinted(),
        };
        let habits = match self.guided {
            false => Habits::Any,
            true => Habits::Guided,
        };
        let clips = self.first..self.first + self.clips;
        let judged: Result<Vec<Judged>, String> = clips
            .into_par_iter()
            .map(|k| self.judge(&looks, habits, k).map_err(|e| e.to_string()))
            .collect();
        let judged = judged?;
        let mut reasons: BTreeMap<&str, usize> = BTreeMap::new();
        for (k, clip) in (self.first..).zip(&judged) {
            let outcome = match &clip.built {
                Built::Rejected(why) => {
                    let reason = why.split(':').next().unwrap_or(why);
                    *reasons.entry(reason).or_default() += 1;
                    format!("refused: {why}")
                }
                built if built.is_whole() => "whole".to_owned(),
                Built::Pattern {
                    missed,
                    invented,
                    worst_deg,
                } => {
                    format!("WRONG: {missed} missed, {invented} invented, worst {worst_deg:.2} deg")
                }
            };
            if self.each || outcome.starts_with("WRONG") {
                let shown = 100.0 * clip.shown;
                let dots = if clip.shows_dots { "all" } else { "not all" };
                println!(
                    "clip {k}: {}, {shown:.1} % and {dots} dots shown: {outcome}",
                    clip.words
                );
            }
        }
        for (reason, count) in &reasons {
            println!("refused {count} times: {reason}");
        }
        let count = |is: &dyn Fn(&&Judged) -> bool| judged.iter().filter(is).count() as u64;
        let complete = count(&|c| c.shown >= COMPLETE);
        let whole = count(&|c| c.shown >= COMPLETE && c.built.is_whole());
        let wrong = count(&|c| matches!(c.built, Built::Pattern { .. }) && !c.built.is_whole());
        println!(
            "whole, of the complete clips: {}",
            Proportion::new(whole, complete)
        );
        let showing = count(&|c| c.shows_dots);
        let whole = count(&|c| c.shows_dots && c.built.is_whole());
        println!(
            "whole, of the clips that show every dot: {}",
            Proportion::new(whole, showing)
        );
        println!(
            "whole, of all: {}",
            Proportion::new(count(&|c| c.built.is_whole()), self.clips)
        );
        println!("wrong, of all: {}", Proportion::new(wrong, self.clips));
        Ok(())
    }
}

impl Args {
    fn judge(&self, looks: &SynthConfig, habits: Habits, k: u64) -> Outcome<Judged> {
        let strokes = match self.abrupt {
            false => Strokes::Eased,
            true => Strokes::Abrupt,
        };
        let clip = HandClip::random(looks, habits, strokes, self.seed, k)?;
        let config = CalibrationConfig::default();
        let SeenClip {
            estimates,
            taken,
            shown,
        } = SeenClip::of(&clip, &config)?;
        let visible = shown.hidden.iter().filter(|h| !**h).count();
        let known = match self.counted || self.marks_named {
            true => KnownDots::Number(visible),
            false => KnownDots::Nothing,
        };
        let mut found = survey(&estimates, &taken, &known, &config)?;
        if let (Some(folder), Some(surface)) = (&self.pictures, &found.surface) {
            let path = folder.join(format!("{k}.png"));
            surface_views(&path, surface)?;
        }
        let is_unclear = found.pattern.as_ref().is_err_and(|r| r.is_of_marks());
        let mut lack = String::new();
        if self.marks_named && is_unclear {
            match by_person(&found, &clip, &shown.hidden)? {
                Ok(marks) => {
                    found = survey(&estimates, &taken, &KnownDots::Marks(marks), &config)?;
                }
                Err(dots) => lack = format!("; {dots} dots are none of the marks"),
            }
        }
        let built = match found.pattern {
            Err(rejection) => Built::Rejected(format!("{rejection}{lack}")),
            Ok(built) => {
                let estimator = estimator(&built.pattern)?;
                let mut workspace = estimator.workspace();
                let mut frames = Vec::with_capacity(clip.frames());
                clip.show(|seen| frames.push(alone(&estimator, &seen.image, &mut workspace)))?;
                let times: Vec<f64> = (0..clip.frames()).map(|k| k as f64 / clip.fps).collect();
                match calibrate_built(&built, &frames, &taken, Some(&times), &config)? {
                    Err(rejection) => Built::Rejected(rejection.to_string()),
                    Ok(found) => judged(&found.pattern()?, &clip.truth, &shown.hidden)?,
                }
            }
        };
        Ok(Judged {
            words: format!(
                "{} dots of {:.3} rad, {} hidden, {:.0} px, {} frames at {} fps",
                clip.truth.len(),
                clip.dot_radius_rad,
                shown.hidden.iter().filter(|h| **h).count(),
                clip.ball_px,
                clip.frames(),
                clip.fps
            ),
            shown: shown.share,
            shows_dots: shown.all_dots,
            built,
        })
    }
}

/// The marks that a person takes for the ball's dots, or how many of these have no ring that is theirs.
fn by_person(
    found: &Survey,
    clip: &HandClip,
    hidden: &[bool],
) -> Outcome<std::result::Result<Vec<Vec3>, usize>> {
    let visible = hidden.iter().filter(|h| !**h).count();
    let marks = found.surface.iter().flat_map(|s| s.worth_a_look());
    let marks: Vec<Vec3> = marks.map(|m| m.direction).collect();
    // More marks than a pattern has dots are too many to look through.
    let Ok(pattern) = Pattern::new(marks.clone()) else {
        return Ok(Err(visible));
    };
    let named = named(&pattern, &clip.truth)?;
    let own = marks.iter().zip(&named).filter_map(|(mark, dot)| {
        let dot = dot.as_ref()?;
        let off = angle_between(mark, &dot.direction);
        (off < OFF_CENTER * clip.dot_radius_rad).then_some((*mark, dot.number))
    });
    let own: Vec<(Vec3, usize)> = own.collect();
    let is_there = |j: usize| own.iter().any(|(_, number)| *number == j);
    let lacking = (0..clip.truth.len()).filter(|j| !hidden[*j] && !is_there(*j));
    Ok(match lacking.count() {
        0 => Ok(own.into_iter().map(|(mark, _)| mark).collect()),
        lacking => Err(lacking),
    })
}

/// A pattern against the true one.
fn judged(built: &Pattern, truth: &Pattern, hidden: &[bool]) -> Outcome<Built> {
    let named = named(built, truth)?;
    if named.is_empty() {
        return Ok(Built::Rejected("not the ball's dots".to_owned()));
    }
    let errors = built.dots().iter().zip(&named);
    let errors =
        errors.filter_map(|(dot, found)| Some(angle_between(dot, &found.as_ref()?.direction)));
    let is_missed = |j: &usize| !hidden[*j] && !named.iter().flatten().any(|n| n.number == *j);
    Ok(Built::Pattern {
        missed: (0..truth.len()).filter(is_missed).count(),
        invented: named.iter().filter(|n| n.is_none()).count(),
        worst_deg: errors.fold(0.0, f64::max).to_degrees(),
    })
}
