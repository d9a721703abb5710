//! What `estimate`, `live` and `calibrate` ask alike of images: the detector, the outline, the camera and the
//! times.

use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use clap::Args;

use super::output::one_of;
use crate::ball::Ball;
use crate::clip::FrameClock;
use crate::clip::frame_table::{self, FrameCircles};
use crate::error::{Error, Result};
use crate::image::{DEFAULT_MAX_PIXELS, Roi};
use crate::source::pipe::PipeFormat;
use crate::source::{Frame, FrameSource as _, files};
use crate::surface::SurfaceMap;
use crate::vision::frame::config::{CameraModel, OutlineMethod};
use crate::vision::frame::prior::OutlinePrior;
use crate::vision::net::Weights;
use crate::vision::{
    BallCircle, Camera, CameraCalibration, CnnDetector, DetectorName, DotDetector, Intrinsics,
    Pixel,
};

#[derive(Debug, Args)]
pub struct ImageArguments {
    /// The dot detector.
    #[arg(hide = true, long, value_parser = one_of(&DetectorName::ALL, DetectorName::as_str), default_value_t = DetectorName::Cnn)]
    pub(super) detector: DetectorName,
    /// The net's weights, an .npz made by `python -m train` [default: those built in].
    #[arg(hide = true, long, value_name = "WEIGHTS.npz")]
    weights: Option<PathBuf>,
    /// The ball's outline: of all frames its center and radius, U,V,R pixels; or a CSV with those of single frames,
    /// frame,u,v,radius, and where it is known sigma, the standard deviation of all three [default: 1 % of the radius].
    /// It is detected where it is not given.
    #[arg(long, value_name = "U,V,R|CSV", allow_hyphen_values = true)]
    circle: Option<String>,
    /// The part of each frame to search: its first column and row, its columns and rows [default: all].
    #[arg(
        long,
        value_name = "X,Y,WIDTH,HEIGHT",
        value_delimiter = ',',
        allow_negative_numbers = true
    )]
    roi: Vec<usize>,
    /// How the outline is found: by its edges alone, or with a net where they do not show it whole.
    #[arg(hide = true, long, value_parser = one_of(&OutlineMethod::ALL, OutlineMethod::as_str), default_value_t = OutlineMethod::default())]
    pub(super) outline: OutlineMethod,
    /// Ball's distance in radii: of its center from the camera, `inf` for parallel rays [default: estimated].
    #[arg(
        long,
        value_name = "D",
        conflicts_with = "intrinsics",
        allow_negative_numbers = true
    )]
    camera_distance_radii: Option<f64>,
    /// Camera's intrinsics in pixels, or a file of them: focal lengths and principal point. OpenCV's distortion k1,k2,p1,p2 and so on may stand behind them. A
    /// file is one as OpenCV (YAML, JSON, XML, NPZ), ROS (camera_info), Kalibr, EuRoC, VINS, ORB-SLAM, COLMAP
    /// (cameras.txt), OpenSfM, NeRF (transforms.json), librealsense, ZED or MATLAB (JSON) has it; FILE:NAME is one of
    /// several cameras, as in stereo.yml:left. Where the file says for images of which size, it is scaled to those given. The distance then follows from the ball's size.
    #[arg(long, value_name = "FX,FY,CX,CY|FILE", allow_negative_numbers = true)]
    intrinsics: Option<String>,
    /// Maximum number of pixels of an image.
    #[arg(hide = true, long, value_name = "N", default_value_t = DEFAULT_MAX_PIXELS)]
    pub(super) max_pixels: u64,
    /// A dark ball with bright dots: frames are estimated as negatives.
    #[arg(hide = true, long)]
    pub(super) bright_dots: bool,
    /// Those of the images, once they are settled.
    #[arg(skip)]
    settled: OnceLock<Intrinsics>,
    /// The file and the size that frames must have that are not there yet.
    #[arg(skip)]
    expected: OnceLock<CameraCalibration>,
    /// Frames per second, for frames at equal intervals.
    #[arg(long, value_name = "F", allow_negative_numbers = true)]
    pub(super) fps: Option<f64>,
}

/// The times of frames that lie in files.
#[derive(Debug, Default, Args)]
pub struct TimesArgument {
    /// Times of the frames: CSV with the header frame,time_s, or in the frames' order what `rpicam-vid --save-pts` writes.
    #[arg(long, value_name = "CSV", conflicts_with = "fps")]
    times: Option<PathBuf>,
}

impl ImageArguments {
    /// Rejects a rate that is none; before anything is read.
    pub(super) fn check_rate(&self) -> Result<()> {
        match self.fps.filter(|x| !(*x > 0.0 && x.is_finite())) {
            None => Ok(()),
            Some(rate) => {
                let problem = format!("expected a positive number, found {rate}");
                Err(Error::argument("fps", problem))
            }
        }
    }

    /// Reads the intrinsics' file, and fits it to the images that these inputs, or a pipe of raw frames, hold. Says what is to be
    /// known of it. [`Self::camera`] then has them.
    pub(super) fn settle_camera(&self, inputs: &[PathBuf], raw: Option<PipeFormat>) -> Result<()> {
        let Some(text) = &self.intrinsics else {
            return Ok(());
        };
        let size = || match raw {
            Some(PipeFormat::Raw { width, height, .. }) => Some([width, height]),
            _ => first_size(inputs, self.max_pixels),
        };
        if let Some(numbers) = numbers(text) {
            if let Some(words) =
                size().and_then(|size| Intrinsics::from_numbers(&numbers).ok()?.size_doubt(size))
            {
                errln!("note: --intrinsics: {words}");
            }
            return Ok(());
        }
        let calibration = CameraCalibration::read(text.as_ref())?;
        for note in &calibration.notes {
            errln!("note: {text}: {note}");
        }
        let mut intrinsics = calibration.intrinsics;
        match (size(), calibration.size) {
            (Some(size), Some(_)) => {
                let (fitted, words) = calibration.for_image(size)?;
                intrinsics = fitted;
                if let Some(words) = words {
                    errln!("note: {text}: {words}");
                }
            }
            (None, Some(_)) => {
                let _ = self.expected.set(calibration);
            }
            (size, None) => {
                if let Some(words) = size.and_then(|size| intrinsics.size_doubt(size)) {
                    errln!("note: {text}: {words}");
                }
            }
        }
        let _ = self.settled.set(intrinsics);
        Ok(())
    }

    /// Rejects a frame of another size than its intrinsics are for, where that was not known before.
    pub(super) fn check_size(&self, size: [usize; 2]) -> Result<()> {
        let Some(calibration) = self.expected.get() else {
            return Ok(());
        };
        match calibration.for_image(size)? {
            (_, None) => Ok(()),
            (_, Some(words)) => {
                let [width, height] = size;
                let problem =
                    format!("expected --raw {width}x{height},PIXEL for a pipe with {words}");
                Err(Error::argument("intrinsics", problem))
            }
        }
    }

    pub(super) fn camera(&self) -> Result<CameraModel> {
        if let Some(settled) = self.settled.get() {
            return Ok(CameraModel::Known(Camera::Perspective(*settled)));
        }
        match (&self.intrinsics, self.camera_distance_radii) {
            (None, None) => Ok(CameraModel::default()),
            (None, Some(distance)) => CameraModel::at_distance(distance),
            (Some(text), _) => {
                let intrinsics = match numbers(text) {
                    Some(numbers) => Intrinsics::from_numbers(&numbers)?,
                    None => Intrinsics::read(text.as_ref())?,
                };
                Ok(CameraModel::Known(Camera::Perspective(intrinsics)))
            }
        }
    }

    pub(super) fn detector(&self) -> Result<DotDetector> {
        match (&self.weights, self.detector) {
            (None, name) => name.build(),
            (Some(path), DetectorName::Cnn) => {
                let net = CnnDetector::new(&Weights::read(path)?)?;
                Ok(DotDetector::Cnn(net))
            }
            (Some(_), DetectorName::Blob) => {
                let problem = "expected --config detector=cnn: blobs have no weights";
                Err(Error::argument("weights", problem))
            }
        }
    }

    /// The outlines that are given: one of all frames, or those of a table.
    pub(super) fn outlines(&self) -> Result<(Option<OutlinePrior>, Option<FrameCircles>)> {
        let Some(text) = &self.circle else {
            return Ok((None, None));
        };
        let numbers: Vec<Option<f64>> = text.split(',').map(|n| n.trim().parse().ok()).collect();
        match numbers[..] {
            [Some(u), Some(v), Some(radius)] if radius > 0.0 && radius.is_finite() => {
                let center = Pixel { u, v };
                let given = OutlinePrior::given(BallCircle::new(center, radius));
                Ok((Some(given), None))
            }
            // A name, which is no number.
            [None] => Ok((None, Some(frame_table::read_circles(text.as_ref())?))),
            _ => {
                let problem = "expected U,V,R in pixels with a positive radius, or a CSV";
                Err(Error::argument("circle", problem))
            }
        }
    }

    pub(super) fn roi(&self) -> Result<Option<Roi>> {
        match self.roi[..] {
            [] => Ok(None),
            [left, top, width, height] if width > 0 && height > 0 => Ok(Some(Roi {
                left,
                top,
                width,
                height,
            })),
            _ => {
                let problem =
                    "expected X,Y,WIDTH,HEIGHT in pixels, with at least one column and row";
                Err(Error::argument("roi", problem))
            }
        }
    }

    pub(super) fn clock(&self, times: &TimesArgument) -> Result<FrameClock> {
        Ok(match (self.fps, &times.times) {
            (Some(rate), _) => FrameClock::FramesPerSecond(rate),
            (None, Some(path)) => frame_table::read_clock(path)?,
            (None, None) => FrameClock::Inputs,
        })
    }
}

/// Numbers between commas.
fn numbers(text: &str) -> Option<Vec<f64>> {
    text.split(',').map(|n| n.trim().parse().ok()).collect()
}

/// Columns and rows of the first frame of these inputs; `None` where it cannot be read, which is said of it later.
pub(super) fn first_size(inputs: &[PathBuf], max_pixels: u64) -> Option<[usize; 2]> {
    // Of a pipe it would be lost.
    let is_lasting = |path: &PathBuf| path.is_file() || path.is_dir();
    if !inputs.iter().all(is_lasting) {
        return None;
    }
    let sources = files::sources(inputs).ok()?;
    let mut source = files::open(sources.first()?, max_pixels).ok()?;
    let mut frame = Frame::default();
    source.next_frame(&mut frame).ok()?.then_some(())?;
    let picture = frame.picture.ok()?;
    let view = picture.view().ok()?;
    Some([view.width(), view.height()])
}

/// A ball of dots.
///
/// # Errors
/// As [`Ball::read`]; the surface of a painted ball is called that.
pub(super) fn read_ball(path: &Path) -> Result<Ball> {
    Ball::read(path).map_err(|error| match SurfaceMap::read_npz(path) {
        Ok(_) => {
            let problem = "is the surface of a painted ball, which has no dots: expected it alone, for `spindoe estimate`";
            Error::input(path, "archive", problem)
        }
        Err(_) => error,
    })
}

/// The balls of several files; two must not have the same pattern, rotated or not, since images cannot
/// distinguish them.
pub(super) fn read_balls(paths: &[PathBuf]) -> Result<Vec<Ball>> {
    let mut balls: Vec<Ball> = Vec::new();
    for path in paths {
        let ball = read_ball(path)?;
        let same = balls
            .iter()
            .position(|other| other.pattern().is_turned(ball.pattern()));
        if let Some(other) = same.and_then(|k| paths.get(k)) {
            let problem = format!(
                "has the same pattern as {}, up to a rotation: give one of them",
                other.display()
            );
            return Err(Error::input(path, "pattern", problem));
        }
        balls.push(ball);
    }
    Ok(balls)
}

/// What is to be known of frames whose names are numbers of another notation.
pub(super) fn order_warning<'a>(names: impl Iterator<Item = &'a str> + Clone) -> Option<String> {
    files::unusual_number(names).map(|name| {
        format!(
            "names such as {name:?} are no plain whole numbers: the frames are taken in the order of their names, digits as whole numbers, and have no times of their own"
        )
    })
}

/// What is to be known of a table of outlines some rows of which name no frame.
pub(super) fn unused_warning(
    circles: Option<&FrameCircles>,
    frames: &[PathBuf],
) -> Result<Option<String>> {
    let unused = circles.map(|c| c.unused_lines(frames)).transpose()?;
    let unused = unused.unwrap_or_default();
    Ok(unused.first().map(|line| {
        let count = unused.len();
        match count {
            1 => format!("--circle: the row on line {line} names no frame"),
            _ => format!("--circle: {count} rows name no frame, the first on line {line}"),
        }
    }))
}
