//! `spindoe calibrate`: the dots of a ball as they were really drawn, from a clip of it.

mod live;
mod marks;

use std::path::{Path, PathBuf};

use clap::Args;

use super::images::{ImageArguments, order_warning, read_balls};
use crate::ball::Ball;
use crate::calibrate::{
    BuiltPattern, Calibration, CalibrationConfig, DotState, KnownDots, MissingSide,
    SurfaceObserver, UnknownRejection, calibrate, confirmed, identify_frames, matching_design,
    survey,
};
use crate::error::{Error, Result};
use crate::files::{self, Replacement};
use crate::geometry::spiral_directions;
use crate::pattern::Pattern;
use crate::report::CHECKPOINT;
use crate::report::calibration::{
    CalibrationEvaluation, CalibrationEvaluationConfig, CalibrationReport, CalibrationSource,
    FILES, evaluate_calibration,
};
use crate::source::pipe::PipeFormat;
use crate::validate::check_samples;
use crate::vision::estimator::{BatchConfig, SequenceOutcome, estimate_inputs};
use crate::vision::painted::PaintedFrame;
use crate::vision::{Estimator, EstimatorConfig, FrameEstimate, NamedDetector};
use marks::MarkNumbers;

#[derive(Debug, Args)]
#[command(after_help = "\
Film the ball while you turn it slowly, once about one axis and once about another, so that every dot faces
the camera for a while: 60 frames or more, sharp, with the ball 60 pixels wide or wider.

The folder holds pattern.csv and table.npz of the ball as it is drawn (give the table to estimate, identify
and validate as any other), report.html to look at, report.json, and the offsets of the dots as a table and a
picture.

Dots that are never found where they should be are left out; steady marks that the pattern lacks are reported
and, with --learn-extra, taken in. Where --table is given several times, the one that fits best is taken.

Without --table, marks.png in the folder shows the ball's surface with all marks numbered. Where marks are in
doubt, or another number of dots was found than the ball has, say with --marks which of them are the dots.

Example:
  spindoe calibrate --table table.npz clip.mp4 -o my-ball")]
pub struct Arguments {
    /// Images, folders of images, or videos of one ball.
    #[arg(value_name = "CLIP_OR_FOLDER", required = true)]
    clip: Vec<PathBuf>,
    /// What the ball was drawn from: a table, a pattern, or the folder of a design or calibration; several: the ball is one
    /// of them. Without it the pattern is built from the clip alone.
    #[arg(long, value_name = "TABLE.npz")]
    table: Vec<PathBuf>,
    /// Build the pattern from the clip also where --table is given, and say which of these designs it is.
    #[arg(hide = true, long)]
    unknown: bool,
    /// Look at the frames of a pipe (- is standard input) while the ball is filmed, say what of it is shown and what is
    /// missing, and end when all of it is. Without --fps a frame's time is that of its arrival.
    #[arg(long, conflicts_with_all = ["table", "times"])]
    live: bool,
    /// The pipe holds raw video of this size, 8 bits a channel: gray, rgb or bgr [default: image files one after
    /// another, PNG, JPEG, PGM or PPM].
    #[arg(long, value_name = "WxH,PIXEL", value_parser = crate::cli::pipe::pipe_format, requires = "live")]
    raw: Option<PipeFormat>,
    /// Number of dots on the ball, where it is known: another number is refused.
    #[arg(long, value_name = "N")]
    dots: Option<usize>,
    /// Which marks of a ball without a table are its dots, by the numbers in the marks.png of the folder that an earlier run
    /// on this clip has left there: `0-17,19`.
    #[arg(long, value_name = "NUMBERS", value_parser = str::parse::<MarkNumbers>, conflicts_with_all = ["table", "live"])]
    marks: Option<MarkNumbers>,
    /// The folder to write to.
    #[arg(short, long, value_name = "DIR", default_value = "calibrated")]
    output: PathBuf,
    /// Replace a calibration that the folder holds already, with all its files.
    #[arg(long)]
    overwrite: bool,
    /// Take steady marks that the pattern lacks into it.
    #[arg(long)]
    learn_extra: bool,
    /// Expected error of a drawn dot per tangent axis, degrees.
    #[arg(
        hide = true,
        long,
        value_name = "DEG",
        default_value_t = 3.0,
        allow_negative_numbers = true
    )]
    search_sigma_deg: f64,
    /// Use no smooth rotation, whatever the frames' times.
    #[arg(hide = true, long)]
    no_smooth: bool,
    /// Monte Carlo trials for each protocol; 0 for none.
    #[arg(long, value_name = "N", default_value_t = 2000)]
    samples: u64,
    /// Seed of the trials.
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    #[command(flatten)]
    images: ImageArguments,
    /// Print the report as one JSON object instead of words.
    #[arg(long)]
    json: bool,
}

/// The frames of the clip, as the ball that fits best identifies them.
struct Clip {
    ball: Ball,
    origin: Origin,
    frames: Vec<FrameEstimate>,
    times_s: Option<Vec<f64>>,
}

/// Where the ball comes from.
enum Origin {
    /// A file.
    Design(PathBuf),
    /// The clip itself.
    Clip(BuiltClip),
    /// A clip that was calibrated while it was filmed.
    Live(Calibration),
}

/// A pattern built from a clip.
struct BuiltClip {
    built: BuiltPattern,
    /// What the frames show of the ball, and their names.
    shown: Vec<PaintedFrame>,
    names: Vec<String>,
}

/// Directions of the pattern that stands in where none is known: only its detections are used.
const STAND_IN_DOTS: usize = 20;

pub fn run(arguments: &Arguments) -> Result<()> {
    let config = arguments.config()?;
    // Its pattern is not to stand beside another's stencil and search.
    let of_design = [CHECKPOINT, "stencil"];
    files::reject_taken(
        &arguments.output,
        &of_design,
        "a design",
        "choose another folder",
    )?;
    if !arguments.overwrite {
        let advice = "choose another folder, or --overwrite it";
        files::reject_taken(&arguments.output, &FILES, "a calibration", advice)?;
    }
    if arguments.samples > 0 {
        check_samples(arguments.samples)?;
    }
    let balls = read_balls(&arguments.table)?;
    let known = arguments.known()?;
    let set = Replacement::begin(&arguments.output)?;
    let clip = arguments.read(balls, known, &config)?;
    match &clip.origin {
        Origin::Design(path) if arguments.is_unknown() || arguments.table.len() > 1 => {
            errln!("the ball is drawn from {}", path.display());
        }
        Origin::Clip(_) if !arguments.table.is_empty() => {
            errln!("the ball is none of these designs")
        }
        _ => {}
    }
    let (nominal, times) = (clip.ball.pattern(), clip.times_s.as_deref());
    let calibration = arguments.calibration(&clip, &config)?;
    errln!("judging the calibration on frames that take no part, and by Monte Carlo");
    let evaluation = CalibrationEvaluationConfig {
        samples: arguments.samples,
        seed: arguments.seed,
    };
    let source = CalibrationSource {
        nominal,
        is_design: matches!(clip.origin, Origin::Design(_)),
        frames: &clip.frames,
        times_s: times,
    };
    let mut evaluated = evaluate_calibration(&calibration, &source, &config, &evaluation)?;
    evaluated.report.command = Some(crate::cli::output::command_line());
    evaluated.ball = evaluated.ball.with_design(clip.ball.design().cloned())?;
    evaluated.write(set.path())?;
    let is_built = matches!(clip.origin, Origin::Clip(_));
    // Marks of another ball are not to stand beside this one.
    let gone = marks::FILES.iter().filter(|_| !is_built);
    let gone: Vec<&str> = FILES.iter().chain(gone).copied().collect();
    set.publish(&gone, &[], "report.json")?;
    if arguments.json {
        return crate::cli::print_json(&evaluated.report);
    }
    say(&calibration, &evaluated, &arguments.output);
    Ok(())
}

impl Arguments {
    /// Whether the pattern is built from the clip.
    fn is_unknown(&self) -> bool {
        self.unknown || self.table.is_empty()
    }

    fn config(&self) -> Result<CalibrationConfig> {
        self.images.check_rate()?;
        let config = CalibrationConfig {
            estimator: EstimatorConfig {
                camera: self.images.camera()?,
                outline: self.images.outline,
                ..EstimatorConfig::default()
            },
            placement_sigma_rad: self.search_sigma_deg.to_radians(),
            learn_extra: self.learn_extra,
            smooth: !self.no_smooth,
            ..CalibrationConfig::default()
        };
        config.check()?;
        Ok(config)
    }

    fn batch(&self) -> Result<BatchConfig> {
        let (outline, circles) = self.images.outlines()?;
        Ok(BatchConfig {
            outline,
            circles,
            roi: self.images.roi()?,
            clock: self.images.clock()?,
            ..BatchConfig::default()
        })
    }

    /// What is said of the dots of a ball without a table.
    fn known(&self) -> Result<KnownDots> {
        Ok(match (&self.marks, self.dots) {
            (Some(marks), Some(number)) if marks.len() != number => {
                let problem = format!(
                    "expected {number} marks as --dots says, found {}",
                    marks.len()
                );
                return Err(Error::argument("--marks", problem));
            }
            (Some(numbers), _) => KnownDots::Marks(marks::read(&self.output, numbers)?),
            (None, Some(number)) => KnownDots::Number(number),
            (None, None) => KnownDots::Nothing,
        })
    }

    /// The clip cannot be calibrated.
    fn no_answer(&self, reason: &dyn std::fmt::Display) -> Error {
        no_answer(&self.clip[0], reason)
    }

    /// Reads the clip, and identifies its frames with the ball that fits.
    fn read(&self, balls: Vec<Ball>, known: KnownDots, config: &CalibrationConfig) -> Result<Clip> {
        if self.live {
            return live::read(self, known, config);
        }
        let (ball, origin) = match self.is_unknown() {
            true => self.unknown_ball(balls, &known, config)?,
            false => return self.best_ball(balls, config),
        };
        let (frames, times_s) = self.estimate(&ball, config)?;
        Ok(Clip {
            ball,
            origin,
            frames,
            times_s,
        })
    }

    /// The calibration of a clip.
    fn calibration(&self, clip: &Clip, config: &CalibrationConfig) -> Result<Calibration> {
        if let Origin::Live(calibration) = &clip.origin {
            return Ok(calibration.clone());
        }
        let times = clip.times_s.as_deref();
        let found = calibrate(clip.ball.pattern(), &clip.frames, times, config)?;
        let found = found.map_err(|r| self.no_answer(&r))?;
        match &clip.origin {
            Origin::Clip(clip) => {
                let confirmed = confirmed(found, &clip.built, &clip.shown, times, config)?;
                confirmed.map_err(|r| match r {
                    UnknownRejection::Unconfirmed {
                        first: Some(side), ..
                    } => self.no_answer(&lacking(&r, &side, &clip.names)),
                    _ => self.no_answer(&r),
                })
            }
            _ => Ok(found),
        }
    }

    /// The frames with their times.
    fn estimate(
        &self,
        ball: &Ball,
        config: &CalibrationConfig,
    ) -> Result<(Vec<FrameEstimate>, Option<Vec<f64>>)> {
        let estimator = Estimator::for_ball(ball, config.estimator, self.images.detector()?)?;
        let batch = estimate_inputs(&estimator, &self.clip, &self.batch()?, &())?;
        if matches!(batch.sequence, SequenceOutcome::TimesNotIncreasing) {
            errln!("spindoe: the times do not increase from frame to frame: they are not used");
        }
        if let Some(problem) = batch.times.problem() {
            errln!("spindoe: {problem}: give --fps");
        }
        if let Some(warning) = order_warning(batch.frames.iter().map(|f| f.name.as_str())) {
            errln!("spindoe: {warning}");
        }
        let times_s = batch.times_s();
        Ok((
            batch.frames.into_iter().map(|f| f.estimate).collect(),
            times_s,
        ))
    }

    /// The frames with the ball that fits them best.
    fn best_ball(&self, balls: Vec<Ball>, config: &CalibrationConfig) -> Result<Clip> {
        let mut balls = balls.into_iter().zip(&self.table);
        let (ball, path) = balls
            .next()
            .ok_or_else(|| Error::argument("table", "expected a table"))?;
        let (frames, times_s) = self.estimate(&ball, config)?;
        let mut best = Clip {
            ball,
            origin: Origin::Design(path.clone()),
            frames,
            times_s,
        };
        for (ball, path) in balls {
            let frames = identify_frames(&ball, &config.estimator, &best.frames)?;
            if trust(&frames) > trust(&best.frames) {
                best = Clip {
                    ball,
                    origin: Origin::Design(path.clone()),
                    frames,
                    ..best
                };
            }
        }
        Ok(best)
    }

    /// An estimator for its detections only.
    fn stand_in(&self, config: &CalibrationConfig) -> Result<Estimator<NamedDetector>> {
        let pattern = Pattern::new(spiral_directions(STAND_IN_DOTS).collect())?;
        Estimator::new(&pattern, config.estimator, self.images.detector()?)
    }

    /// The pattern built from the clip, or the design that it is.
    fn unknown_ball(
        &self,
        balls: Vec<Ball>,
        known: &KnownDots,
        config: &CalibrationConfig,
    ) -> Result<(Ball, Origin)> {
        let estimator = self.stand_in(config)?;
        let settings = SurfaceObserver::settings(self.batch()?);
        let batch = estimate_inputs(
            &estimator,
            &self.clip,
            &settings,
            &SurfaceObserver::default(),
        )?;
        let names: Vec<String> = batch.frames.iter().map(|f| f.name.clone()).collect();
        let (frames, shown): (Vec<FrameEstimate>, Vec<PaintedFrame>) = batch
            .frames
            .into_iter()
            .map(|f| (f.estimate, f.kept))
            .unzip();
        let survey = survey(&frames, &shown, known, config)?;
        let surface = survey.surface.as_ref();
        // What the numbers are of that a person gave stays.
        let is_other = matches!(survey.pattern, Err(UnknownRejection::OtherMarks { .. }));
        let surface = surface.filter(|_| !is_other);
        let picture = surface.map(|s| marks::write(&self.output, s)).transpose()?;
        let built = match survey.pattern {
            Ok(built) => built,
            Err(rejection) => {
                let mut reason = match survey.missing {
                    Some(side) => lacking(&rejection, &side, &names),
                    None => rejection.to_string(),
                };
                let picture = picture.as_ref().map(|p| p.display());
                reason += &match picture {
                    Some(picture) if rejection.is_of_marks() => {
                        format!("; name the dots by their numbers in {picture} (--marks)")
                    }
                    Some(picture) => format!("; {picture} shows the ball's surface"),
                    None if is_other => "; run it without --marks and look at marks.png".to_owned(),
                    None => String::new(),
                };
                return Err(self.no_answer(&reason));
            }
        };
        if *known == KnownDots::Nothing
            && let Some(picture) = &picture
        {
            // Print that looks like a dot is one to every test.
            errln!(
                "spindoe: {} dots were found: compare that with the ball and with {}; where it differs name the dots \
                 (--overwrite --marks)",
                built.pattern.len(),
                picture.display()
            );
        }
        let designs: Vec<Pattern> = balls.iter().map(|b| b.pattern().clone()).collect();
        let known = matching_design(&built.pattern, &designs)?
            .and_then(|k| Some((balls.into_iter().nth(k)?, self.table[k].clone())));
        Ok(match known {
            Some((ball, path)) => (ball, Origin::Design(path)),
            None => {
                let ball = Ball::new(built.pattern.clone());
                let clip = BuiltClip {
                    built,
                    shown,
                    names,
                };
                (ball, Origin::Clip(clip))
            }
        })
    }
}

/// Why there is no answer, and where what is missing lies in the frames of these names.
fn lacking(rejection: &UnknownRejection, side: &MissingSide, names: &[String]) -> String {
    let (there, frame) = (side.there.words(), &names[side.nearest]);
    format!("{rejection}: what is missing lies {there} in frame {frame}")
}

/// The clip of this name cannot be calibrated.
fn no_answer(path: &Path, reason: &dyn std::fmt::Display) -> Error {
    Error::NoAnswer {
        path: path.to_path_buf(),
        reason: reason.to_string(),
    }
}

/// The sum of the poses' probabilities: the expected number of frames identified correctly.
fn trust(frames: &[FrameEstimate]) -> f64 {
    let poses = frames.iter().filter_map(FrameEstimate::pose);
    poses.map(|p| p.confidence).sum()
}

/// Summarizes the calibration.
fn say(calibration: &Calibration, evaluated: &CalibrationEvaluation, out: &Path) {
    let CalibrationReport {
        frames,
        held_out,
        motion,
        advice,
        ..
    } = &evaluated.report;
    outln!(
        "{}: {} of {} dots measured from {} of {} frames, {:.2} deg rms off their nominal places",
        out.display(),
        calibration.measured(),
        calibration.dots.len(),
        frames.fitted,
        frames.given,
        evaluated.report.rms_offset_deg
    );
    for (state, words) in [
        (
            DotState::Missing,
            "never found where they should be, left out",
        ),
        (DotState::Unseen, "not seen, left at their nominal places"),
        (
            DotState::Doubtful,
            "may be print or stains, taken for less certain",
        ),
    ] {
        let dots = evaluated.report.dots.iter().filter(|d| d.state == state);
        let numbers: Vec<String> = dots.map(|d| d.nominal_number.to_string()).collect();
        if !numbers.is_empty() {
            outln!("  {words}: dots {}", numbers.join(", "));
        }
    }
    for mark in &evaluated.report.marks {
        let [x, y, z] = mark.direction;
        let taken = match mark.number {
            Some(number) => format!("taken in as dot {number}"),
            None => "left out (--learn-extra takes it in)".to_owned(),
        };
        outln!(
            "  a mark at ({x:.3}, {y:.3}, {z:.3}), found in {} of {} views: {taken}",
            mark.found,
            mark.views
        );
    }
    if frames.with_other_balls > 0 {
        outln!(
            "  {} frames show more than one ball",
            frames.with_other_balls
        );
    }
    if !held_out.frames.is_empty() {
        outln!(
            "  frames that took no part: median residual {:.2} deg before, {:.2} deg after; {:.1} and {:.1} dots a frame",
            held_out.median_deg[0],
            held_out.median_deg[1],
            held_out.mean_matched[0],
            held_out.mean_matched[1]
        );
    }
    if let Some([before, after]) = motion {
        outln!(
            "  off one smooth rotation{}: median {:.2} deg before, {:.2} deg after",
            if after.precessing {
                " (precessing)"
            } else {
                ""
            },
            before.median_deg,
            after.median_deg
        );
    }
    for line in advice {
        outln!("  {line}");
    }
    if let Some(set) = &evaluated.report.dot_set {
        outln!("is this set of dots good? (numbers as in dots.png)");
        for line in set.words() {
            outln!("  {line}");
        }
    }
}
