//! `spindoe estimate`: from images to orientations, and with times to the spin.

mod output;
#[cfg(feature = "plot")]
mod overlay;
#[cfg(feature = "plot")]
mod page;

use std::io::Write;
use std::path::PathBuf;

use clap::{Args, ValueEnum};

use super::output::{Counter, one_of};
use crate::error::{Error, Result};
use crate::files;
use crate::pattern::Pattern;
use crate::vision::estimator::{
    BatchConfig, BatchObserver, CameraModel, FrameClock, SequenceOutcome, estimate_inputs,
};
use crate::vision::input;
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
    /// Write a page to look at: frames, orientations over time, the spin, rejected frames.
    #[cfg(feature = "plot")]
    #[arg(long, value_name = "FILE.html")]
    report: Option<PathBuf>,
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

/// Keeps the pictures that overlays need, and counts the frames.
struct Pictures {
    #[cfg_attr(not(feature = "plot"), allow(dead_code))]
    wanted: bool,
    counter: Counter,
}

/// A picture, with the corner at which it was cropped.
type Picture = Option<(RgbImage, usize, usize)>;

impl BatchObserver for Pictures {
    type Kept = Picture;

    #[cfg(feature = "plot")]
    fn keep(&self, image: &RgbImage, estimate: &FrameEstimate) -> Result<Picture> {
        self.counter.add(1);
        self.wanted
            .then(|| overlay::picture(image, estimate))
            .transpose()
    }

    #[cfg(not(feature = "plot"))]
    fn keep(&self, _: &RgbImage, _: &FrameEstimate) -> Result<Picture> {
        self.counter.add(1);
        Ok(None)
    }
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let pattern = super::read_table(&arguments.table)?.pattern().clone();
    let estimator = arguments.estimator(&pattern)?;
    let config = arguments.batch()?;
    #[cfg(feature = "plot")]
    let wanted = arguments.overlay.is_some() || arguments.report.is_some();
    #[cfg(not(feature = "plot"))]
    let wanted = false;
    #[cfg(feature = "plot")]
    if let Some(dir) = &arguments.overlay {
        files::create_writable_dir(dir)?;
    }
    let pictures = Pictures {
        wanted,
        counter: Counter::new(0, "frames"),
    };
    let batch = estimate_inputs(&estimator, &arguments.images, &config, &pictures)?;
    pictures.counter.finish();
    if matches!(batch.sequence, SequenceOutcome::TimesNotIncreasing) {
        errln!(
            "spindoe: the times do not increase from frame to frame: every frame is estimated independently"
        );
    }
    #[cfg(feature = "plot")]
    if let Some(dir) = &arguments.overlay {
        overlay::draw(dir, &estimator, &batch)?;
    }
    #[cfg(feature = "plot")]
    if let Some(path) = &arguments.report {
        page::write(path, &estimator, &pattern, &batch, arguments.max_spin_rps)?;
    }
    let report = Report {
        arguments,
        batch: &batch,
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

    fn batch(&self) -> Result<BatchConfig> {
        let mut config = BatchConfig {
            circle: self.circle()?,
            independent: self.no_sequence,
            ..BatchConfig::default()
        };
        config.sequence.spin.max_rps = self.max_spin_rps;
        if let Some(rate) = self.fps {
            config.clock = FrameClock::FramesPerSecond(rate);
        }
        if let Some(path) = &self.times {
            config.clock = FrameClock::Table(input::read_times(path)?);
        }
        Ok(config)
    }
}
