//! The arguments of `spindoe estimate`, and what they make.

use std::path::PathBuf;

use clap::parser::ValueSource;
use clap::{ArgMatches, Args};

use super::Asked;
use crate::cli::images::TimesArgument;
use crate::cli::output::one_of;
use crate::clip::BatchConfig;
use crate::error::{Error, Result};
use crate::spin::estimate::MotionModel;
use crate::surface::SurfaceMap;

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

With --intrinsics the columns x_m,y_m,z_m and cov_m2_xx to cov_m2_zz have the center of the ball in that frame, in meters, also of
rejected frames whose outline was found; the diameter is --ball-diameter-mm, else the table's.

All frames together decide whether the table fits these images, which of several tables it is, and whether the
images are mirrored: frames of another ball are identified by accident now and then, but not one after the other.

With --rig the orientations, positions and the spin are in the frame of the rig's first camera, and the column cameras says how many
cameras a row is of. A frame that one camera misses is answered by the others.

Rejected frames are listed on standard error with the reason, and in --json.

Examples:
  spindoe estimate --table my-ball clip.mp4 -o o.csv --report report.html
  spindoe estimate --table a.npz --table b.npz --balls auto clip.mp4 -o b.csv
  spindoe estimate --table dots24 --strobe-ms 0,0.9,2.1 --preset golf exposures/
  spindoe estimate --painted clip.mp4 --write-surface ball.npz -o o.csv
  spindoe estimate --table dots20 --rig rig.yaml left/ right/ -o o.csv")]
pub struct Arguments {
    /// Images, folders of images, or videos.
    #[arg(value_name = "IMAGES_OR_DIR", required = true)]
    pub(super) images: Vec<PathBuf>,
    /// File of orientations [default: standard output].
    #[arg(short, long, value_name = "ORIENTATIONS.csv")]
    pub(super) output: Option<PathBuf>,
    /// Clips of several cameras, by their rig's file: their intrinsics and where they stand, as OpenCV's of `stereoCalibrate` (K1, D1, K2, D2, R, T), Kalibr's
    /// camchain, or a transform of each as ROS' tf has it. The inputs are then one folder or video for each camera, in the file's order. Frames of
    /// one time are one measurement, in the first camera's frame.
    #[arg(long, value_name = "RIG.yaml", conflicts_with_all = ONE_CAMERA)]
    #[cfg_attr(feature = "plot", arg(conflicts_with_all = ["overlay", "report"]))]
    pub(super) rig: Option<PathBuf>,
    #[command(flatten)]
    pub(super) asked: Asked,
    #[command(flatten)]
    pub(super) times: TimesArgument,
    /// Draw frames with what was found into this folder; of a painted ball the borders of its paint; and a contact sheet, or, where the name ends in .mp4, an annotated video (through ffmpeg; more than 30 frames a second play slower).
    #[cfg(feature = "plot")]
    #[arg(long, value_name = "DIR_OR_MP4")]
    pub(super) overlay: Option<PathBuf>,
    /// Write a report to view and share: frames, orientations over time, the spin, rejected frames; of each ball, where there are several.
    #[cfg(feature = "plot")]
    #[arg(long, value_name = "FILE.html", conflicts_with = "strobe_ms")]
    pub(super) report: Option<PathBuf>,
    /// Judge every frame for itself: no verdict over all of them on whether the table fits and the
    /// images are mirrored.
    #[arg(hide = true, long)]
    pub(super) no_verdict: bool,
    /// Calibrate the ball on these frames first: its dots are then used as they are drawn.
    #[arg(long, conflicts_with_all = SEVERAL)]
    pub(super) calibrate: bool,
    /// Estimate every frame independently.
    #[arg(long)]
    pub(super) no_sequence: bool,
    /// How the ball moves: at a constant or a decaying spin, precessing as an uneven ball does (the spin reported is then the mean
    /// one), free, as one that is pushed (the spin is then the mean over the time), or auto, the one of these for which there is evidence. The spin is that in the middle of the clip.
    #[arg(
        long,
        value_parser = one_of(&MotionModel::ALL, MotionModel::as_str),
        default_value_t,
        conflicts_with_all = [SEVERAL[1], "no_sequence"]
    )]
    pub(super) motion: MotionModel,
    /// Exposure of a frame, milliseconds: to within a tenth. How far dots are smeared then settles how many whole turns lie between
    /// two frames, where the frame rate leaves that open; an exposure that is far off settles it wrongly.
    #[arg(
        long,
        value_name = "MS",
        conflicts_with_all = [SEVERAL[0], SEVERAL[1], "no_sequence"],
        allow_negative_numbers = true
    )]
    pub(super) exposure_ms: Option<f64>,
    /// Rolling shutter, first row to last, milliseconds: the time from the exposure of a picture's first row to that of its last (phones 8
    /// to 33), for whole pictures, not crops. Times and orientations are then those at which the ball's center is exposed, and the rows settle how many
    /// whole turns lie between two frames.
    #[arg(
        long,
        value_name = "MS",
        conflicts_with_all = [SEVERAL[0], SEVERAL[1], "no_sequence", "calibrate"],
        allow_negative_numbers = true
    )]
    pub(super) readout_ms: Option<f64>,
    /// A painted ball that has no surface yet: marks of any shape, and no dots. Orientations are relative to the first frame. Where --table is a surface that --write-surface wrote, they are in that clip's frame. Give --camera-distance-radii or
    /// --intrinsics where the ball turns far.
    #[arg(long)]
    pub(super) painted: bool,
    /// Write the painted ball's surface to this file: the --table of its further clips.
    #[arg(long, value_name = "NPZ")]
    pub(super) write_surface: Option<PathBuf>,
    /// Print one JSON object instead: every dot, every rejection and the spin.
    #[arg(long, conflicts_with = "format")]
    pub(super) json: bool,
}

/// What is of one camera's picture, or not for several cameras.
const ONE_CAMERA: [&str; 13] = [
    "intrinsics",
    "camera_distance_radii",
    "circle",
    "roi",
    "balls",
    "strobe_ms",
    "preset",
    "calibrate",
    "exposure_ms",
    "readout_ms",
    "painted",
    "write_surface",
    "no_verdict",
];
/// What is for several balls, or several images of one.
const SEVERAL: [&str; 2] = ["balls", "strobe_ms"];
/// What only balls with dots have.
const DOTS_ONLY: [&str; 13] = [
    "balls",
    "max_latency_ms",
    "strobe_ms",
    "calibrate",
    "exposure_ms",
    "readout_ms",
    "no_sequence",
    "min_confidence",
    "placement_sigma_deg",
    "no_verdict",
    "preset",
    "weights",
    "detector",
];

/// What ball the frames show.
pub(super) enum AskedBall {
    /// One with dots.
    Dots,
    /// One that is painted, with its surface where an earlier clip left it.
    Painted(Option<SurfaceMap>),
}

/// Refuses flags for which a painted ball has no use.
pub(in crate::cli) fn check_painted(given: Option<&ArgMatches>) -> Result<()> {
    let is_given = |id: &&&str| {
        let source = given.filter(|g| g.try_contains_id(id).is_ok());
        source.and_then(|g| g.value_source(id)) == Some(ValueSource::CommandLine)
    };
    match DOTS_ONLY.iter().find(is_given) {
        Some(id) => {
            let flag = format!("--{}", id.replace('_', "-"));
            Err(Error::argument(flag, "cannot be used with a painted ball"))
        }
        None => Ok(()),
    }
}

impl Arguments {
    /// What ball the frames show, by its table or --painted; flags that it has no use for are refused.
    pub(super) fn shown(&self, given: Option<&ArgMatches>) -> Result<AskedBall> {
        let surface = self.asked.surface()?;
        let is_painted = self.painted || surface.is_some();
        if self.write_surface.is_some() {
            let problem = match (is_painted, &self.asked.table[..]) {
                (true, []) => None,
                (true, _) => Some("expected without --table: that surface stays as it is"),
                (false, _) => Some("expected with --painted"),
            };
            problem.map_or(Ok(()), |problem| {
                Err(Error::argument("--write-surface", problem))
            })?;
        }
        if self.painted && !self.asked.table.is_empty() {
            let problem = "expected without --table: the surface of a painted ball says by itself that it is one";
            return Err(Error::argument("--painted", problem));
        }
        if !is_painted {
            return Ok(AskedBall::Dots);
        }
        check_painted(given)?;
        Ok(AskedBall::Painted(surface))
    }

    /// Rejects numbers outside their domains.
    pub(super) fn check_numbers(&self) -> Result<()> {
        self.asked.check_numbers()?;
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

    /// Whether frames are drawn.
    pub(super) fn wants_pictures(&self) -> bool {
        #[cfg(feature = "plot")]
        return self.overlay.is_some() || self.report.is_some();
        #[cfg(not(feature = "plot"))]
        false
    }

    /// How the frames are read.
    pub(super) fn batch(&self) -> Result<BatchConfig> {
        let source = &self.asked.source;
        let (outline, circles) = source.outlines()?;
        let mut config = BatchConfig {
            outline,
            circles,
            roi: source.roi()?,
            clock: source.clock(&self.times)?,
            independent: self.no_sequence,
            readout_s: 1e-3 * self.readout_ms.unwrap_or(0.0),
            mirrored: self.asked.mirrored,
            bright_dots: source.bright_dots,
            verdict: !self.no_verdict,
            max_pixels: source.max_pixels,
            ..BatchConfig::default()
        };
        config.sequence.spin.max_rps = self.asked.max_rps();
        Ok(config)
    }
}
