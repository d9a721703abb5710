//! `spindoe calibrate`: the dots of a ball as they were really drawn, from a clip of it.

mod clip;
mod live;
mod marks;
mod unknown;
mod words;

use std::path::PathBuf;

use clap::Args;

use super::images::{ImageArguments, TimesArgument, read_balls};
use super::output::Counter;
use crate::calibrate::{CalibrationConfig, KnownDots};
use crate::clip::BatchConfig;
use crate::error::{Error, Result, counted};
use crate::files::{self, Replacement};
use crate::pattern::{MAX_DOTS, MIN_DOTS};
use crate::report::CHECKPOINT;
use crate::report::calibration::{
    CalibrationEvaluationConfig, CalibrationSource, FILES, evaluate_calibration,
};
use crate::source::pipe::PipeFormat;
use crate::validate::check_samples;
use crate::vision::EstimatorConfig;
use marks::MarkNumbers;

#[derive(Debug, Args)]
#[command(after_help = "\
Film the ball while you turn it slowly, once about one axis and once about another, so that every dot faces
the camera for a while: 60 frames or more, sharp, with the ball 60 pixels wide or wider.

The folder holds pattern.csv and table.npz of the ball as it is drawn (give the table to estimate, identify
and validate as any other), report.html to view and share, report.json, and the offsets of the dots as a table
and a picture.

Dots that are never found where they should be are left out; steady marks that the pattern lacks are reported
and, with --learn-extra, taken in. Where --table is given several times, the one that fits best is taken.

Without --table, marks.png in the folder shows the ball's surface with all marks numbered. Where marks are in
doubt, or another number of dots was found than the ball has, say with --marks which of them are the dots.

Examples:
  spindoe calibrate --table table.npz clip.mp4 -o my-ball
  spindoe calibrate clip.mp4 --dots 18 -o my-ball")]
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
    /// Read the frames of a pipe (- is standard input) while the ball is filmed, say which part of it is
    /// missing, and end when all of it was shown. Without --fps a frame's time is that of its arrival.
    #[arg(long, conflicts_with_all = ["table", "times"])]
    live: bool,
    /// The pipe holds raw video of this size, 8 bits a channel: gray, rgb or bgr [default: image files one after
    /// another, PNG, JPEG, PGM or PPM].
    #[arg(long, value_name = "WxH,PIXEL", value_parser = crate::cli::pipe::pipe_format, requires = "live")]
    raw: Option<PipeFormat>,
    /// Number of dots on the ball, if you know it: it decides which marks in doubt are dots; another number is refused.
    #[arg(long, value_name = "N", value_parser = dots_number)]
    dots: Option<usize>,
    /// Which marks of a ball without a table are its dots, by their numbers in marks.png, which an earlier run
    /// on this clip left in the folder: `0-17,19`.
    #[arg(long, value_name = "NUMBERS", value_parser = str::parse::<MarkNumbers>, conflicts_with_all = ["table", "live"])]
    marks: Option<MarkNumbers>,
    /// The folder to write to.
    #[arg(short, long, value_name = "DIR", default_value = "calibrated")]
    output: PathBuf,
    /// Replace a calibration that the folder holds already, with all its files.
    #[arg(long)]
    overwrite: bool,
    /// Add steady marks that the pattern lacks to it.
    #[arg(long, requires = "table")]
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
    #[command(flatten)]
    times: TimesArgument,
    /// Print the report as one JSON object instead of words.
    #[arg(long)]
    json: bool,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let images = &arguments.images;
    images.settle_camera(&arguments.clip, arguments.raw)?;
    let config = arguments.config()?;
    arguments.reject_taken()?;
    if arguments.samples > 0 {
        check_samples(arguments.samples)?;
    }
    let balls = read_balls(&arguments.table)?;
    let known = arguments.known()?;
    let set = Replacement::begin(&arguments.output)?;
    let clip = match arguments.live {
        true => live::read(arguments, known.clone(), &config)?,
        false => clip::read(arguments, balls, &known, &config)?,
    };
    errln!("judging the calibration on frames that take no part, and by Monte Carlo");
    let evaluation = CalibrationEvaluationConfig {
        samples: arguments.samples,
        seed: arguments.seed,
        ..CalibrationEvaluationConfig::default()
    };
    let source = CalibrationSource {
        nominal: clip.ball.pattern(),
        is_design: clip.is_design,
        frames: &clip.frames.estimates,
        times_s: clip.frames.times_s.as_deref(),
        dot_radius_rad: clip.dot_radius_rad,
    };
    let counter = Counter::new(100, "% of the evaluation");
    let done = |share: f64| counter.set((100.0 * share) as u64);
    let mut evaluated =
        evaluate_calibration(&clip.calibration, &source, &config, &evaluation, &done)?;
    counter.finish();
    evaluated.report.command = Some(crate::cli::output::command_line());
    evaluated.ball = evaluated.ball.with_design(clip.ball.design().cloned())?;
    if let Some(surface) = &clip.surface {
        evaluated.report.number_marks(surface);
    }
    evaluated.write(set.path())?;
    if let Some(surface) = &clip.surface {
        marks::write(set.path(), surface)?;
    }
    // Marks of another ball are not to stand beside this one.
    let gone: Vec<&str> = FILES.iter().chain(&marks::FILES).copied().collect();
    set.publish(&gone, "report.json")?;
    if clip.surface.is_some() && known == KnownDots::Nothing {
        arguments.note_marks(clip.ball.pattern().len());
    }
    if arguments.json {
        return crate::cli::print_json(&evaluated.report);
    }
    words::say(&clip.calibration, &evaluated, &arguments.output);
    Ok(())
}

impl Arguments {
    /// Whether the output is free or may be replaced; its pattern is not to stand beside another's stencil and search.
    fn reject_taken(&self) -> Result<()> {
        let of_design = [CHECKPOINT, "stencil"];
        let advice = "choose another folder";
        files::reject_taken(&self.output, &of_design, "a design", advice)?;
        if self.overwrite {
            return Ok(());
        }
        let advice = "choose another folder, or --overwrite it";
        files::reject_taken(&self.output, &FILES, "a calibration", advice)
    }

    /// Print that looks like a dot is one to every test.
    fn note_marks(&self, dots: usize) {
        errln!(
            "note: {} taken for dots: compare them with the ball and with {}; where they differ name the dots \
             (--overwrite --marks)",
            counted(dots, "mark"),
            self.output.join(marks::PICTURE).display()
        );
    }

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
            bright_dots: self.images.bright_dots,
            clock: self.images.clock(&self.times)?,
            max_pixels: self.images.max_pixels,
            ..BatchConfig::default()
        })
    }

    /// What is said of the dots of a ball without a table.
    fn known(&self) -> Result<KnownDots> {
        if self.dots.is_some() && !self.is_unknown() {
            let problem = "expected without --table, which says how many they are";
            return Err(Error::argument("--dots", problem));
        }
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
}

/// Parses a number of dots.
fn dots_number(text: &str) -> std::result::Result<usize, String> {
    let number = text.parse().ok();
    let number = number.filter(|n| (MIN_DOTS..=MAX_DOTS).contains(n));
    number.ok_or_else(|| format!("expected {MIN_DOTS} to {MAX_DOTS}"))
}

/// The clip of this name cannot be calibrated.
fn no_answer(path: PathBuf, reason: &dyn std::fmt::Display) -> Error {
    Error::NoAnswer {
        path,
        reason: reason.to_string(),
    }
}
