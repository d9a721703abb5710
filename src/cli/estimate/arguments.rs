//! The arguments of `spindoe estimate`, and what they make.

use std::path::PathBuf;

use clap::Args;

use super::balls;
use crate::ball::Ball;
use crate::cli::flashes::Flashes;
use crate::cli::images::{ImageArguments, read_balls};
use crate::cli::output::one_of;
use crate::clip::BatchConfig;
use crate::error::{Error, Result, require};
use crate::geometry::CameraFrame;
use crate::source::pipe::PipeFormat;
use crate::spin::estimate::MotionModel;
use crate::spin::golf::{self, Flight};
use crate::vision::frame::config::CameraModel;
use crate::vision::{Estimator, EstimatorConfig};

#[derive(Debug, Args)]
#[command(after_help = "\
Images: PNG, JPEG, BMP, TIFF, PNM, GIF or WebP files, folders of them, or videos (through ffmpeg, 4.2 or later). They are
processed in the order of the numbers in their names. The ball may fill the image, or be a part of it.

Times: a name that is a whole number is a time in nanoseconds, unless the names step by less than 10000 in the median: such
number the frames; a video's frames carry their own times; --times or --fps override both. Where all frames have a time, the spin is estimated, and its prediction is a hint for
frames that cannot be estimated independently (--no-sequence turns this off).

Orientations: CSV, frame,time_s,qw,qx,qy,qz,dots,matched,residual_deg,confidence,camera_frame and the covariance;
scalar first; the fields are empty where a frame is rejected. The confidence is the probability that the orientation
is correct. The quaternion maps the pattern's frame to that of the column camera_frame: camera, or without
--intrinsics view, whose z points from the ball to the camera; x right, y up, z towards the camera. With --frame
optical they are optical and optical_view: x right, y down, z forward, R_optical = diag(1,-1,-1) R_camera; the
covariance and the spin's vector are rotated likewise.

All frames together decide whether the table fits these images, which of several tables it is, and whether the
images are mirrored: frames of another ball are identified by accident now and then, but not one after the other.

Rejected frames are listed on standard error with the reason, and in --json.

Examples:
  spindoe estimate --table a.npz --table b.npz --balls auto clip.mp4 -o b.csv
  spindoe estimate --table table.npz --strobe-ms 0,0.9,2.1 --golf exposures/
  spindoe estimate --table table.npz crops/ -o orientations.csv --overlay seen/
  ffmpeg -i CAMERA -f rawvideo -pix_fmt gray - |
      spindoe estimate --table table.npz --follow - --raw 640x480,gray --fps 350")]
pub struct Arguments {
    /// Images, folders of images, or videos.
    #[arg(value_name = "IMAGES_OR_DIR", required = true)]
    pub(super) images: Vec<PathBuf>,
    /// The ball: a shipped pattern by its name (dots20), a table (.npz), a pattern (CSV of unit vectors x,y,z), or the
    /// folder of a design or calibration. Given several times, the one that fits all frames best is chosen.
    #[arg(long, value_name = "TABLE.npz")]
    pub(super) table: Vec<PathBuf>,
    /// Write the orientations to this file instead of standard output.
    #[arg(short, long, value_name = "ORIENTATIONS.csv")]
    pub(super) output: Option<PathBuf>,
    #[command(flatten)]
    pub(super) source: ImageArguments,
    /// Draw every frame with its detections, and a contact sheet, into this folder; or, where the name
    /// ends in .mp4, an annotated video (through ffmpeg; more than 30 frames a second play slower).
    #[cfg(feature = "plot")]
    #[arg(long, value_name = "DIR_OR_MP4", conflicts_with_all = ["follow", "painted"])]
    pub(super) overlay: Option<PathBuf>,
    /// Write a report to view and share: frames, orientations over time, the spin, rejected frames.
    #[cfg(feature = "plot")]
    #[arg(long, value_name = "FILE.html", conflicts_with_all = ["balls", "strobe_ms", "painted"])]
    pub(super) report: Option<PathBuf>,
    /// The axes that orientations and spin are written in: camera, x right, y up, z towards the camera; optical, x right, y down,
    /// z forward. Without --intrinsics the frame is the view frame, whose z points from the ball to the camera.
    #[arg(long, value_parser = one_of(&CameraFrame::AXES, CameraFrame::as_str), default_value_t = CameraFrame::Camera)]
    pub(super) frame: CameraFrame,
    /// The images are mirrored (a flipped camera, a selfie video): exchange left and right first.
    /// Pixels in the output are those of the images so exchanged, and --intrinsics those of a camera that takes such.
    #[arg(long)]
    pub(super) mirrored: bool,
    /// Judge every frame for itself: no verdict over all of them on whether the table fits and the
    /// images are mirrored.
    #[arg(hide = true, long)]
    pub(super) no_verdict: bool,
    /// Minimum probability of a reported orientation, 0 to 1.
    #[arg(
        long,
        value_name = "P",
        default_value_t = EstimatorConfig::default().min_confidence,
        allow_negative_numbers = true
    )]
    pub(super) min_confidence: f64,
    /// Calibrate the ball on these frames first, and use its dots as they are drawn.
    #[arg(long)]
    pub(super) calibrate: bool,
    /// Placement error: standard deviation of a drawn dot's place from the pattern's, along one tangent
    /// axis, degrees. The dots of a calibrated table have their own [default: 1.2].
    #[arg(hide = true, long, value_name = "S", allow_negative_numbers = true)]
    pub(super) placement_sigma_deg: Option<f64>,
    /// Estimate every frame independently.
    #[arg(long)]
    pub(super) no_sequence: bool,
    /// Maximum spin considered, revolutions per second [default: 175; with --golf 250].
    #[arg(long, value_name = "MAX_SPIN_RPS", allow_negative_numbers = true)]
    pub(super) max_spin_rps: Option<f64>,
    /// All balls of every frame: so many, or auto, as many as there are. Each has its own row, with a column ball, whose number it
    /// keeps from frame to frame; of several tables each has the one that fits it, in a column table.
    #[arg(
        long,
        value_name = "N|auto",
        value_parser = balls::count,
        conflicts_with_all = ONE_BALL
    )]
    pub(super) balls: Option<balls::Count>,
    /// Flashes of one exposure, milliseconds, ascending, or PERIODxN, as in 0.7x3: a frame shows one ball once for each flash, and its spin follows from these
    /// images alone. Rows have the times of their flashes and a column flash.
    #[arg(
        long,
        value_name = "MS,MS..",
        allow_hyphen_values = true,
        conflicts_with_all = ONE_BALL
    )]
    pub(super) strobe_ms: Option<Flashes>,
    /// Direction in which a strobed ball flies across the picture [default: by the images; where they leave it open, both are
    /// reported].
    #[arg(
        long,
        value_parser = one_of(&Flight::ALL, Flight::as_str),
        requires = "strobe_ms"
    )]
    pub(super) flight: Option<Flight>,
    /// Golf: the spin of strobed balls as backspin, sidespin, tilt and rpm; a ball of 42.67 mm seen from 0.4 to 0.6 m, unless
    /// --intrinsics or --camera-distance-radii say more; spins up to 15 000 rpm.
    #[arg(long, requires = "strobe_ms")]
    pub(super) golf: bool,
    /// How the ball moves: at a constant or a decaying spin, precessing as an uneven ball does (the spin reported is then the mean
    /// one), free, as one that is pushed (the spin is then the mean over the time), or auto, the one of these for which there is evidence. The spin is that in the middle of the clip.
    #[arg(
        long,
        value_parser = one_of(&MotionModel::ALL, MotionModel::as_str),
        default_value_t,
        conflicts_with_all = ["no_sequence", "follow"]
    )]
    pub(super) motion: MotionModel,
    /// Exposure of a frame, milliseconds, to within a tenth. How far dots are smeared then settles how many whole turns lie between
    /// two frames, where the frame rate leaves that open; an exposure that is far off settles it wrongly.
    #[arg(
        long,
        value_name = "MS",
        conflicts_with_all = ["no_sequence", "follow"],
        allow_negative_numbers = true
    )]
    pub(super) exposure_ms: Option<f64>,
    /// Rolling shutter: time from the exposure of a picture's first row to that of its last, milliseconds (phones 8 to 33), for whole
    /// pictures, not crops. Times and orientations are then those at which the ball's center is exposed, and the rows settle how many
    /// whole turns lie between two frames.
    #[arg(
        long,
        value_name = "MS",
        conflicts_with_all = ["no_sequence", "follow", "calibrate"],
        allow_negative_numbers = true
    )]
    pub(super) readout_ms: Option<f64>,
    /// A ball painted with marks of any shape, without dots: orientations relative to the first frame; with --table, a surface that
    /// --write-surface wrote, in that clip's frame. Give --camera-distance-radii or --intrinsics where the ball turns far.
    #[arg(long, conflicts_with_all = DOTS_ONLY)]
    pub(super) painted: bool,
    /// Write the painted ball's surface, the --table of its further clips, to this file.
    #[arg(long, value_name = "SURFACE.npz", requires = "painted")]
    pub(super) write_surface: Option<PathBuf>,
    /// Print one JSON object instead, with every dot, rejection and the spin.
    #[arg(long)]
    pub(super) json: bool,
    /// Follow one ball through the frames of a pipe (- is standard input) and write a JSON line for
    /// each at once: its orientation, and the spin of the last quarter of a second. Without --fps a
    /// frame's time is that of its arrival; frames that come faster than they can be processed are then
    /// dropped and counted.
    #[arg(long, conflicts_with_all = FILES_ONLY)]
    pub(super) follow: bool,
    /// The pipe holds raw video of this size, 8 bits a channel: gray, rgb or bgr [default: image
    /// files one after another, PNG, JPEG, PGM or PPM].
    #[arg(long, value_name = "WxH,PIXEL", value_parser = crate::cli::pipe::pipe_format, requires = "follow")]
    pub(super) raw: Option<PipeFormat>,
    /// The most time for a frame, milliseconds: then the search for the ball ends, and the frame has no answer [default:
    /// no limit].
    #[arg(
        long,
        value_name = "MS",
        requires = "follow",
        allow_negative_numbers = true
    )]
    pub(super) max_latency_ms: Option<f64>,
}

/// What only a set of files has; overlays say so themselves, since they are not in every build, and so it is below.
const FILES_ONLY: [&str; 5] = ["output", "times", "no_sequence", "json", "calibrate"];

/// What only balls with dots have.
const DOTS_ONLY: [&str; 11] = [
    "balls",
    "strobe_ms",
    "follow",
    "calibrate",
    "motion",
    "exposure_ms",
    "readout_ms",
    "no_sequence",
    "min_confidence",
    "placement_sigma_deg",
    "no_verdict",
];

/// What is for one ball alone.
const ONE_BALL: [&str; 5] = ["calibrate", "circle", "motion", "exposure_ms", "readout_ms"];

impl Arguments {
    /// One for each table.
    pub(super) fn estimators(&self) -> Result<Vec<Estimator>> {
        let balls = read_balls(&self.table)?;
        balls.iter().map(|ball| self.estimator(ball)).collect()
    }

    /// Rejects numbers outside their domains.
    pub(super) fn check_numbers(&self) -> Result<()> {
        if !(0.0..=1.0).contains(&self.min_confidence) {
            let problem = format!("expected 0 to 1, found {}", self.min_confidence);
            return Err(Error::argument("--min-confidence", problem));
        }
        self.source.check_rate()?;
        let max_rps = self.max_spin_rps();
        if !(max_rps > 0.0 && max_rps.is_finite()) {
            let problem = format!("expected a positive number, found {max_rps}");
            return Err(Error::argument("--max-spin-rps", problem));
        }
        for (flag, ms) in [
            ("--exposure-ms", self.exposure_ms),
            ("--readout-ms", self.readout_ms),
        ] {
            if let Some(ms) = ms.filter(|ms| !(*ms > 0.0 && ms.is_finite())) {
                let problem = format!("expected a positive number, found {ms}");
                return Err(Error::argument(flag, problem));
            }
        }
        Ok(())
    }

    pub(super) fn estimator(&self, ball: &Ball) -> Result<Estimator> {
        self.check_numbers()?;
        let mut config = EstimatorConfig {
            camera: self.camera()?,
            outline: self.source.outline,
            min_confidence: self.min_confidence,
            measures_blur: self.exposure_ms.is_some(),
            ..EstimatorConfig::default()
        };
        if let Some(degrees) = self.placement_sigma_deg {
            if ball.dot_covariances().is_some() {
                let problem = "expected none: the table is calibrated and has each dot's own error";
                return Err(Error::argument("--placement-sigma-deg", problem));
            }
            let inside = degrees > 0.0 && degrees < 25.0;
            require(
                inside,
                "--placement-sigma-deg",
                "more than 0 and less than 25",
                degrees,
            )?;
            config.placement_sigma_rad = degrees.to_radians();
        }
        Estimator::for_ball(ball, config, self.source.detector()?)
    }

    /// The maximum spin considered, revolutions per second.
    pub(super) fn max_spin_rps(&self) -> f64 {
        let usual = if self.golf { golf::MAX_RPS } else { 175.0 };
        self.max_spin_rps.unwrap_or(usual)
    }

    /// What is known of the camera.
    pub(super) fn camera(&self) -> Result<CameraModel> {
        let given = self.source.camera()?;
        let is_open = self.golf && given == CameraModel::default();
        Ok(if is_open { balls::golf_camera() } else { given })
    }

    /// The frame of orientations and spin.
    pub(super) fn frame(&self) -> Result<CameraFrame> {
        Ok(self.frame.of_view(self.source.camera()?.is_view()))
    }

    pub(super) fn batch(&self) -> Result<BatchConfig> {
        let (outline, circles) = self.source.outlines()?;
        let mut config = BatchConfig {
            outline,
            circles,
            roi: self.source.roi()?,
            clock: self.source.clock()?,
            independent: self.no_sequence,
            readout_s: 1e-3 * self.readout_ms.unwrap_or(0.0),
            mirrored: self.mirrored,
            verdict: !self.no_verdict,
            max_pixels: self.source.max_pixels,
            ..BatchConfig::default()
        };
        config.sequence.spin.max_rps = self.max_spin_rps();
        Ok(config)
    }
}
