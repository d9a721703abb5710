//! `spindoe estimate`: from images to orientations, and with times to the spin.

mod output;
#[cfg(feature = "plot")]
mod overlay;

use std::io::Write;
use std::path::PathBuf;

use clap::{Args, ValueEnum};
use rayon::prelude::*;

use super::output::one_of;
use crate::error::{Error, Result};
use crate::files;
use crate::pattern::Pattern;
use crate::spin::{Fit, SpinRejection};
use crate::vision::estimator::{
    CameraModel, SequenceConfig, SequenceSummary, estimate_spin, track_sequence,
};
use crate::vision::input::{self, InputFrame};
use crate::vision::net::Weights;
use crate::vision::net::detector::CnnConfig;
use crate::vision::{
    BallCircle, Camera, CnnDetector, DetectorName, Estimator, EstimatorConfig, FrameEstimate,
    Intrinsics, NamedDetector, Pixel, RgbImage,
};
use output::Report;

/// The camera frame that orientations are written in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Frame {
    /// x right, y up, z from the ball towards the camera.
    Ours,
    /// x right, y down, z forward (REP 103).
    Optical,
}

#[derive(Debug, Args)]
#[command(after_help = "\
Images: PNG, JPEG, BMP, TIFF or PNM files of any depth, folders of them, or videos (through ffmpeg). They are
processed in the order of the numbers in their names. The ball may fill the image, or be a part of it.

Times: a name that is a whole number is a time in nanoseconds; a video's frames carry their own times; --times
or --fps override both. Where all frames have a time, the spin is estimated, and its prediction is a hint for
frames that cannot be estimated independently (--no-sequence turns this off).

Orientations: CSV, frame,time_s,qw,qx,qy,qz,dots,matched,residual_deg,confidence; scalar first; the fields are
empty where a frame is rejected. The confidence is the probability that the orientation is correct. The
quaternion maps the pattern's frame to the camera's. --frame ours: x right, y up, z towards the camera.
--frame optical: x right, y down, z forward, R_optical = diag(1,-1,-1) R_ours; the spin's vector is rotated
likewise.

Rejected frames are listed on standard error with the reason, and in --json.

Example:
  spindoe estimate --table table.npz crops/ -o orientations.csv --overlay seen/")]
pub struct Arguments {
    /// Images, folders of images, or videos.
    #[arg(value_name = "IMAGES_OR_DIR", required = true)]
    images: Vec<PathBuf>,
    /// The pattern's hash table (.npz), or the pattern (CSV of unit vectors x,y,z).
    #[arg(long, value_name = "TABLE.npz")]
    table: PathBuf,
    /// Write the orientations to this file instead of standard output.
    #[arg(short, long, value_name = "ORIENTATIONS.csv")]
    output: Option<PathBuf>,
    /// The dot detector.
    #[arg(long, value_parser = one_of(&DetectorName::ALL, DetectorName::as_str), default_value_t = DetectorName::Cnn)]
    detector: DetectorName,
    /// The net's weights, an .npz made by `spindoe-train` [default: those built in].
    #[arg(long, value_name = "WEIGHTS.npz")]
    weights: Option<PathBuf>,
    /// Draw every frame enlarged, with its detections, and a contact sheet, into this folder.
    #[cfg(feature = "plot")]
    #[arg(long, value_name = "DIR")]
    overlay: Option<PathBuf>,
    /// The ball's outline in all frames: center and radius in pixels [default: detected].
    #[arg(
        long,
        value_name = "U,V,R",
        value_delimiter = ',',
        allow_negative_numbers = true
    )]
    circle: Vec<f64>,
    /// Distance from the camera to the ball's center in ball radii; `inf` for parallel rays
    /// [default: it is estimated with the orientation].
    #[arg(
        long,
        value_name = "D",
        conflicts_with = "intrinsics",
        allow_negative_numbers = true
    )]
    camera_distance_radii: Option<f64>,
    /// The camera's focal lengths and principal point in pixels: the distance then follows from the
    /// ball's size.
    #[arg(
        long,
        value_name = "FX,FY,CX,CY",
        value_delimiter = ',',
        allow_negative_numbers = true
    )]
    intrinsics: Vec<f64>,
    /// Frames per second, for frames at equal intervals.
    #[arg(long, value_name = "F", conflicts_with = "times")]
    fps: Option<f64>,
    /// Times of the frames: CSV with the header frame,time_s.
    #[arg(long, value_name = "CSV")]
    times: Option<PathBuf>,
    /// The camera frame that orientations and spin are written in.
    #[arg(long, value_enum, default_value = "ours")]
    frame: Frame,
    /// Minimum probability of a reported orientation, 0 to 1.
    #[arg(
        long,
        value_name = "P",
        default_value_t = 0.5,
        allow_negative_numbers = true
    )]
    min_confidence: f64,
    /// Estimate every frame independently.
    #[arg(long)]
    no_sequence: bool,
    /// Maximum spin considered, revolutions per second.
    #[arg(long, default_value_t = 175.0, allow_negative_numbers = true)]
    max_spin_rps: f64,
    /// Print one JSON object instead, with every dot, rejection and the spin.
    #[arg(long)]
    json: bool,
}

/// Number of frames estimated at once.
const AT_ONCE: usize = 64;

/// All frames, and their estimates.
#[derive(Default)]
struct Seen {
    names: Vec<String>,
    paths: Vec<PathBuf>,
    times: Vec<Option<f64>>,
    frames: Vec<FrameEstimate>,
    /// Pictures for the overlays, with the corner at which each was cropped.
    pictures: Vec<(RgbImage, usize, usize)>,
}

/// The times of a sequence, and its result.
struct Sequence {
    summary: SequenceSummary,
    spin: std::result::Result<Fit, SpinRejection>,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let pattern = super::read_table(&arguments.table)?.pattern().clone();
    let estimator = arguments.estimator(&pattern)?;
    let circle = arguments.circle()?;
    #[cfg(feature = "plot")]
    if let Some(dir) = &arguments.overlay {
        files::create_writable_dir(dir)?;
    }
    let mut workspace = estimator.workspace();
    let mut seen = arguments.detect(&estimator, circle.as_ref())?;
    arguments.set_times(&mut seen)?;
    let config = arguments.sequence_config();
    let times: Option<Vec<f64>> = seen.times.iter().copied().collect();
    let rising = |t: &Vec<f64>| t.windows(2).all(|w| w[0] < w[1]);
    let sequence = match times {
        Some(times) if rising(&times) && times.len() > 1 => {
            let summary = if arguments.no_sequence {
                SequenceSummary::default()
            } else {
                track_sequence(
                    &estimator,
                    &config,
                    &times,
                    &mut seen.frames,
                    &mut workspace,
                )
            };
            let spin = estimate_spin(&config, &times, &seen.frames);
            Some(Sequence { summary, spin })
        }
        Some(times) if times.len() > 1 => {
            errln!(
                "spindoe: the times do not increase from frame to frame: every frame is estimated independently"
            );
            None
        }
        _ => None,
    };
    #[cfg(feature = "plot")]
    if let Some(dir) = &arguments.overlay {
        overlay::draw(dir, &estimator, &seen)?;
    }
    let report = Report {
        arguments,
        seen: &seen,
        sequence: sequence.as_ref(),
    };
    let text = report.orientations_csv();
    if let Some(path) = &arguments.output {
        files::write_bytes(path, text.as_bytes())?;
    }
    if arguments.json {
        super::print_json(&report.to_json())?;
    } else if arguments.output.is_none() {
        std::io::stdout()
            .write_all(text.as_bytes())
            .map_err(|e| Error::write("standard output", e))?;
    }
    report.say();
    Ok(())
}

impl Arguments {
    fn estimator(&self, pattern: &Pattern) -> Result<Estimator<NamedDetector>> {
        if !(0.0..=1.0).contains(&self.min_confidence) {
            let problem = format!("expected 0 to 1, found {}", self.min_confidence);
            return Err(Error::argument("--min-confidence", problem));
        }
        for (name, value) in [
            ("--fps", self.fps),
            ("--max-spin-rps", Some(self.max_spin_rps)),
        ] {
            if let Some(x) = value.filter(|x| !(*x > 0.0 && x.is_finite())) {
                let problem = format!("expected a positive number, found {x}");
                return Err(Error::argument(name, problem));
            }
        }
        let camera = match (&self.intrinsics[..], self.camera_distance_radii) {
            ([], None) => CameraModel::default(),
            ([], Some(distance)) if distance > 1.0 => CameraModel::Known(Camera::Near {
                inverse_distance: 1.0 / distance,
            }),
            ([], Some(distance)) => {
                let problem = format!("expected more than 1 ball radius, found {distance}");
                return Err(Error::argument("camera_distance_radii", problem));
            }
            (&[fx, fy, cx, cy], _) if fx > 0.0 && fy > 0.0 => {
                CameraModel::Known(Camera::Perspective(Intrinsics { fx, fy, cx, cy }))
            }
            _ => {
                let problem = "expected FX,FY,CX,CY with positive focal lengths";
                return Err(Error::argument("intrinsics", problem));
            }
        };
        let config = EstimatorConfig {
            camera,
            min_confidence: self.min_confidence,
            ..EstimatorConfig::default()
        };
        Estimator::new(pattern, config, self.detector()?)
    }

    fn detector(&self) -> Result<NamedDetector> {
        match (&self.weights, self.detector) {
            (None, name) => name.build(),
            (Some(path), DetectorName::Cnn) => {
                let net = CnnDetector::new(&Weights::read(path)?, CnnConfig::default())?;
                Ok(NamedDetector::Cnn(net))
            }
            (Some(_), DetectorName::Blob) => {
                let problem = "expected --detector cnn: blobs have no weights";
                Err(Error::argument("--weights", problem))
            }
        }
    }

    fn circle(&self) -> Result<Option<BallCircle>> {
        match self.circle[..] {
            [] => Ok(None),
            [u, v, radius] if radius > 0.0 && radius.is_finite() => Ok(Some(BallCircle {
                center: Pixel { u, v },
                radius,
            })),
            _ => {
                let problem = "expected U,V,R in pixels with a positive radius";
                Err(Error::argument("--circle", problem))
            }
        }
    }

    fn sequence_config(&self) -> SequenceConfig {
        let mut config = SequenceConfig::default();
        config.spin.max_rps = self.max_spin_rps;
        config
    }

    /// Detects and estimates all frames, each independently.
    fn detect(
        &self,
        estimator: &Estimator<NamedDetector>,
        circle: Option<&BallCircle>,
    ) -> Result<Seen> {
        let mut seen = Seen::default();
        let mut waiting = Vec::with_capacity(AT_ONCE);
        for source in input::sources(&self.images)? {
            let first = seen.times.len();
            let mut visit = |frame: InputFrame| {
                waiting.push(frame);
                if waiting.len() == AT_ONCE {
                    self.estimate(estimator, circle, &mut waiting, &mut seen)?;
                }
                Ok(())
            };
            let times = input::read_frames(&source, &mut visit)?;
            self.estimate(estimator, circle, &mut waiting, &mut seen)?;
            for (k, time) in times.into_iter().enumerate() {
                seen.times[first + k] = time;
            }
        }
        Ok(seen)
    }

    /// Estimates the waiting frames, spread over all cores. Each is independent, so the order of
    /// work changes nothing.
    fn estimate(
        &self,
        estimator: &Estimator<NamedDetector>,
        circle: Option<&BallCircle>,
        waiting: &mut Vec<InputFrame>,
        seen: &mut Seen,
    ) -> Result<()> {
        let done: Result<Vec<_>> = waiting
            .par_drain(..)
            .map_init(
                || estimator.workspace(),
                |workspace, frame| {
                    let mut estimate = FrameEstimate::default();
                    estimator.estimate_frame(&frame.image, circle, None, workspace, &mut estimate);
                    #[cfg(feature = "plot")]
                    let picture = (self.overlay.is_some())
                        .then(|| overlay::picture(&frame.image, &estimate))
                        .transpose()?;
                    #[cfg(not(feature = "plot"))]
                    let picture = None;
                    Ok((frame, estimate, picture))
                },
            )
            .collect();
        for (frame, estimate, picture) in done? {
            seen.names.push(frame.name);
            seen.paths.push(frame.path);
            seen.times.push(frame.time_s);
            seen.frames.push(estimate);
            seen.pictures.extend(picture);
        }
        Ok(())
    }

    /// Sets the times that the user specifies.
    fn set_times(&self, seen: &mut Seen) -> Result<()> {
        if let Some(fps) = self.fps {
            for (k, time) in seen.times.iter_mut().enumerate() {
                *time = Some(k as f64 / fps);
            }
        }
        if let Some(path) = &self.times {
            let known = input::read_times(path)?.of_frames(&seen.paths)?;
            seen.times = known.into_iter().map(Some).collect();
        }
        Ok(())
    }
}
