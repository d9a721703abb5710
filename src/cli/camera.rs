//! The flags that describe a camera, alike in all commands that render its frames, and the file that
//! may hold them.

use std::path::{Path, PathBuf};

use clap::Args;
use serde::Deserialize;

use super::output::one_of;
use crate::ball::USUAL_BALL_MM;
use crate::camera::{CameraConditions, DotSize, FrameRates, Surroundings};
use crate::error::{Error, Result};
use crate::files;

/// Frames of a camera where none are stated.
pub const CAMERA_FRAMES: u64 = 1000;
/// The flags by the conditions that they state.
const FLAGS: [(&str, &str); 4] = [
    ("exposure_s", "exposure_ms"),
    ("dot_diameter", "dot_diameter_mm"),
    ("max_speed", "max_speed_m_s"),
    ("distance_radii", "camera_distance_radii"),
];

#[derive(Debug, Args)]
pub struct CameraArguments {
    /// A TOML file with any of the flags below, as in `ball_px = 80` or `rps = [10, 60]`; flags come
    /// before it.
    #[arg(long, value_name = "CAMERA.toml", help_heading = "Camera")]
    camera: Option<PathBuf>,
    #[command(flatten)]
    stated: CameraFile,
}

/// What a file, or the flags, may state.
#[derive(Debug, Clone, Default, PartialEq, Args, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[command(next_help_heading = "Camera")]
struct CameraFile {
    /// The ball's diameter in the image, pixels [default: 60].
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    ball_px: Option<f64>,
    /// Frames per second [default: 300].
    #[arg(long, value_name = "F", allow_negative_numbers = true)]
    fps: Option<f64>,
    /// Exposure, milliseconds [default: 0.1].
    #[arg(long, value_name = "MS", allow_negative_numbers = true)]
    exposure_ms: Option<f64>,
    /// Distance from the camera to the ball's center in ball radii [default: 6 to 60].
    #[arg(long, value_name = "D", allow_negative_numbers = true)]
    camera_distance_radii: Option<f64>,
    /// Standard deviation of the lens' blur, pixels [default: that of the surroundings].
    #[arg(long, value_name = "B", allow_negative_numbers = true)]
    defocus_px: Option<f64>,
    /// Standard deviation of a pixel's noise, of 255 levels [default: that of the surroundings].
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    noise_levels: Option<f64>,
    /// Diameter of a dot, mm [default: a tenth of the ball's; for `advise` that of each design, else the
    /// largest that its stencil allows].
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    dot_diameter_mm: Option<f64>,
    /// Diameter of the ball, mm [default: 40].
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    ball_diameter_mm: Option<f64>,
    /// Smallest and greatest spin, revolutions per second [default: 0,100].
    #[arg(
        long,
        value_name = "MIN,MAX",
        value_delimiter = ',',
        allow_negative_numbers = true
    )]
    rps: Option<Vec<f64>>,
    /// Greatest speed of the ball across the image, m/s [default: 4].
    #[arg(long, value_name = "V", allow_negative_numbers = true)]
    max_speed_m_s: Option<f64>,
    /// What surrounds the ball: dark and even as arranged, or anything [default: dark].
    #[arg(long, value_parser = one_of(&Surroundings::ALL, Surroundings::as_str))]
    surroundings: Option<Surroundings>,
}

impl CameraArguments {
    /// The size of the dots: that stated, else that which each pattern was designed for, else the largest
    /// that its stencil allows.
    pub fn dot_size(&self) -> Result<DotSize> {
        let both = self.both()?;
        Ok(match both.dot_diameter_mm {
            Some(_) => DotSize::Stated,
            None => DotSize::Designed {
                ball_mm: both.ball_diameter_mm.unwrap_or(USUAL_BALL_MM),
            },
        })
    }

    /// Whether any of them is given.
    pub fn is_stated(&self) -> bool {
        let s = &self.stated;
        let numbers = [
            s.ball_px,
            s.fps,
            s.exposure_ms,
            s.camera_distance_radii,
            s.defocus_px,
            s.noise_levels,
            s.dot_diameter_mm,
            s.ball_diameter_mm,
            s.max_speed_m_s,
        ];
        self.camera.is_some()
            || numbers.iter().any(Option::is_some)
            || s.rps.is_some()
            || s.surroundings.is_some()
    }

    /// The conditions: flags before the file, the file before the defaults.
    pub fn conditions(&self) -> Result<CameraConditions> {
        self.both()?.conditions().map_err(named_as_flag)
    }

    fn both(&self) -> Result<CameraFile> {
        let file = match &self.camera {
            Some(path) => read(path)?,
            None => CameraFile::default(),
        };
        let stated = self.stated.clone();
        Ok(CameraFile {
            ball_px: stated.ball_px.or(file.ball_px),
            fps: stated.fps.or(file.fps),
            exposure_ms: stated.exposure_ms.or(file.exposure_ms),
            camera_distance_radii: stated.camera_distance_radii.or(file.camera_distance_radii),
            defocus_px: stated.defocus_px.or(file.defocus_px),
            noise_levels: stated.noise_levels.or(file.noise_levels),
            dot_diameter_mm: stated.dot_diameter_mm.or(file.dot_diameter_mm),
            ball_diameter_mm: stated.ball_diameter_mm.or(file.ball_diameter_mm),
            rps: stated.rps.or(file.rps),
            max_speed_m_s: stated.max_speed_m_s.or(file.max_speed_m_s),
            surroundings: stated.surroundings.or(file.surroundings),
        })
    }
}

impl CameraFile {
    fn conditions(&self) -> Result<CameraConditions> {
        let ball_mm = self.ball_diameter_mm.unwrap_or(USUAL_BALL_MM);
        if !(1.0..=1000.0).contains(&ball_mm) {
            let problem = format!("expected 1 to 1000 mm, found {ball_mm}");
            return Err(Error::argument("ball_diameter_mm", problem));
        }
        let rps = match self.rps.as_deref() {
            None => CameraConditions::default().rps,
            Some([low, high]) => [*low, *high],
            Some(other) => {
                let problem = format!("expected MIN,MAX, found {} numbers", other.len());
                return Err(Error::argument("rps", problem));
            }
        };
        let usual = CameraConditions::default();
        let conditions = CameraConditions {
            ball_px: self.ball_px.unwrap_or(usual.ball_px),
            fps: self.fps.unwrap_or(usual.fps),
            exposure_s: self.exposure_ms.map_or(usual.exposure_s, |ms| 1e-3 * ms),
            distance_radii: self.camera_distance_radii,
            defocus_px: self.defocus_px,
            noise_levels: self.noise_levels,
            dot_diameter: self
                .dot_diameter_mm
                .map_or(usual.dot_diameter, |mm| mm / ball_mm),
            rps,
            max_speed: self
                .max_speed_m_s
                .map_or(usual.max_speed, |v| 1e3 * v / ball_mm),
            surroundings: self.surroundings.unwrap_or_default(),
        };
        conditions.check()?;
        Ok(conditions)
    }
}

/// An error about a condition names the flag that states it.
fn named_as_flag(error: Error) -> Error {
    match error {
        Error::Argument { parameter, problem } => {
            let name = parameter.as_str();
            let flag = FLAGS.iter().find(|(condition, _)| *condition == name);
            match flag {
                Some((_, flag)) => Error::argument(*flag, problem),
                None => Error::Argument { parameter, problem },
            }
        }
        error => error,
    }
}

/// The conditions that a file states.
pub fn read_conditions(path: &Path) -> Result<CameraConditions> {
    read(path)?.conditions().map_err(named_as_flag)
}

fn read(path: &Path) -> Result<CameraFile> {
    let file = parse(path)?;
    if file == CameraFile::default() {
        let problem = "expected at least one property of the camera, such as ball_px, found none";
        return Err(Error::input(path, "file", problem));
    }
    Ok(file)
}

fn parse(path: &Path) -> Result<CameraFile> {
    let bytes = files::read_at_most(path, files::MAX_TEXT_BYTES)?;
    let text = String::from_utf8(bytes)
        .map_err(|_| Error::input(path, "file", "expected text in UTF-8"))?;
    toml::from_str(&text).map_err(|error| {
        let line = error
            .span()
            .map_or(1, |s| 1 + text[..s.start].matches('\n').count());
        Error::input(path, format!("line {line}"), error.message())
    })
}

/// Prints what a pattern gives before a camera.
pub fn print_frames(r: &FrameRates) {
    outln!("{} frames of seed {}", r.right.trials, r.seed);
    outln!("  right       {} of {}", r.right, r.right.trials);
    outln!("  wrong       {} of {}", r.wrong, r.wrong.trials);
    outln!("  unanswered  {} of {}", r.unanswered, r.unanswered.trials);
    outln!(
        "  error of the right ones: mean {:.3} deg, median {:.3} deg, root mean square {:.3} deg",
        r.mean_error_deg,
        r.median_error_deg,
        r.rms_error_deg
    );
    outln!("Right is off by less than 20 degrees. Brackets are 95 % intervals (Wilson).");
}
