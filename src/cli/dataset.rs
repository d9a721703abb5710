//! `spindoe dataset`: clips to flights with positions and spins, in the format of the published ones.

use std::path::PathBuf;

use clap::Args;

use super::images::{ImageArguments, TimesArgument, read_balls};
use super::inputs::Counting;
use super::output::one_of;
use crate::ball::Ball;
use crate::clip::BatchConfig;
use crate::dataset::{self, BounceConfig, DatasetConfig, Destination, FlightClip, Record};
use crate::error::{Result, are, counted, require};
use crate::geometry::CameraFrame;
use crate::vision::{Estimator, EstimatorConfig};

#[derive(Debug, Args)]
#[command(after_help = "\
A clip is a video or a folder of images. Its frames are estimated as `spindoe estimate` does, and cut into flights where the
path has a kink: before and after a bounce a ball has different spins. The folder holds, as the SpinDOE authors' reader takes it,
index.csv (traj_file,x_spin,y_spin,z_spin, rad/s) and a file for each flight (000.csv: t;x;y;z, seconds and meters); and
dataset.json (tables, camera, clips, times, spins with covariances, bounces), orientations/ (each frame with its covariances) and plots/.

Positions need --intrinsics and the ball's diameter, spins times: a video's own, names in nanoseconds, or --fps.

Examples:
  spindoe dataset --table dots20 --intrinsics camera.yml shots/*.mp4 -o flights
  spindoe dataset --table my-ball --intrinsics camera.yml run/ --fps 350 -o set")]
pub struct Arguments {
    /// Clips: videos, or folders of images.
    #[arg(value_name = "CLIP", required = true)]
    clips: Vec<PathBuf>,
    /// The folder to write.
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// Replace the data set that the folder holds: the files that its dataset.json lists, and no others.
    #[arg(long)]
    overwrite: bool,
    /// The ball: a shipped pattern, a table, a pattern, or the folder of a design or calibration. Of several each clip has the one that
    /// fits it best.
    #[arg(long, value_name = "TABLE.npz", required = true)]
    table: Vec<PathBuf>,
    #[command(flatten)]
    source: ImageArguments,
    /// Ball's diameter: it says how far the ball is, millimeters [default: the table's or 40].
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    ball_diameter_mm: Option<f64>,
    /// Axes written: of positions, orientations and spins.
    #[arg(hide = true, long, value_parser = one_of(&CameraFrame::AXES, CameraFrame::as_str), default_value_t = CameraFrame::Camera)]
    frame: CameraFrame,
    /// The images are mirrored.
    #[arg(hide = true, long)]
    mirrored: bool,
    /// Maximum spin considered: revolutions per second.
    #[arg(
        hide = true,
        long,
        value_name = "RPS",
        default_value_t = 175.0,
        allow_negative_numbers = true
    )]
    max_spin_rps: f64,
    /// Minimum confidence of an orientation.
    #[arg(hide = true, long, value_name = "P", default_value_t = EstimatorConfig::default().min_confidence, allow_negative_numbers = true)]
    min_confidence: f64,
    /// Positions before a bounce, and after it, that are fitted.
    #[arg(hide = true, long, value_name = "N", default_value_t = BounceConfig::default().half_window)]
    half_window: usize,
    /// Natural logarithm of the odds for a bounce, at least.
    #[arg(hide = true, long, value_name = "LN", default_value_t = BounceConfig::default().min_log_odds)]
    min_log_odds: f64,
    /// Change of the velocity by a bounce, at least, m/s.
    #[arg(hide = true, long, value_name = "V", default_value_t = BounceConfig::default().min_jump_m_s)]
    min_jump_m_s: f64,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let source = &arguments.source;
    source.check_rate()?;
    source.settle_camera(&arguments.clips, None)?;
    let config = arguments.config()?;
    let estimators = arguments.estimators()?;
    // What cannot be written is known before the work.
    let to = Destination::begin(&arguments.output, &arguments.clips, arguments.overwrite)?;
    let mut clips = Vec::with_capacity(arguments.clips.len());
    for path in &arguments.clips {
        let counting = Counting::new(std::slice::from_ref(path), ());
        let clip = dataset::read_clip(&estimators, path, &config, &counting)?;
        counting.finish();
        say(&clip);
        clips.push(clip);
    }
    let names: Vec<String> = arguments
        .table
        .iter()
        .map(|t| t.display().to_string())
        .collect();
    let record = Record::new(&names, &estimators, &config, &clips);
    dataset::write(to, &clips, &record)?;
    let flights = record.flights().count();
    let spun = record
        .flights()
        .filter(|flight| flight.spin.is_some())
        .count();
    errln!(
        "{} of {}, {spun} with a spin, {} in {}",
        counted(flights, "flight"),
        counted(clips.len(), "clip"),
        are(flights),
        arguments.output.display()
    );
    Ok(())
}

/// What a clip shows, on standard error.
fn say(clip: &FlightClip) {
    errln!(
        "{}: {} of {} frames identified, {}",
        clip.path.display(),
        clip.identified,
        clip.frames,
        counted(clip.flights.len(), "flight")
    );
    for flight in &clip.flights {
        let begins = match &flight.bounce {
            Some(bounce) => format!("after a bounce at {:.3} s", bounce.time_s),
            None => "from the beginning".to_owned(),
        };
        match &flight.spin {
            Ok(spin) => errln!(
                "  {begins}: {:.3} rps, {}",
                spin.overall().motion.rps(),
                spin.motion.model()
            ),
            Err(why) => errln!("  {begins}: {why}"),
        }
    }
}

impl Arguments {
    fn config(&self) -> Result<DatasetConfig> {
        let source = &self.source;
        let (outline, circles) = source.outlines()?;
        let mut batch = BatchConfig {
            outline,
            circles,
            roi: source.roi()?,
            clock: source.clock(&TimesArgument::default())?,
            mirrored: self.mirrored,
            bright_dots: source.bright_dots,
            verdict: true,
            max_pixels: source.max_pixels,
            ..BatchConfig::default()
        };
        batch.sequence.spin.max_rps = self.max_spin_rps;
        let bounces = BounceConfig {
            half_window: self.half_window,
            min_log_odds: self.min_log_odds,
            min_jump_m_s: self.min_jump_m_s,
        };
        bounces.check()?;
        Ok(DatasetConfig {
            batch,
            bounces,
            axes: self.frame,
        })
    }

    fn estimators(&self) -> Result<Vec<Estimator>> {
        if let Some(mm) = self.ball_diameter_mm {
            require(
                (1.0..=1000.0).contains(&mm),
                "ball_diameter_mm",
                "1 to 1000 mm",
                mm,
            )?;
        }
        let camera = self.source.camera()?;
        let config = EstimatorConfig {
            camera,
            outline: self.source.outline,
            min_confidence: self.min_confidence,
            ball_radius_m: self.ball_diameter_mm.map(|mm| 0.5e-3 * mm),
            ..EstimatorConfig::default()
        };
        let estimator = |ball: &Ball| Estimator::for_ball(ball, config, self.source.detector()?);
        read_balls(&self.table)?.iter().map(estimator).collect()
    }
}
