//! The flags that describe a camera, alike in all commands that render its frames, and the file that
//! may hold them.

use std::path::{Path, PathBuf};

use clap::Args;
use serde::{Deserialize, Serialize};

use super::output::one_of;
use super::settings::read_toml;
use crate::ball::USUAL_BALL_MM;
use crate::camera::{CameraConditions, DotSize, FrameRates, Surroundings};
use crate::error::{Error, Result};
use crate::spin::golf;
use crate::synth::SynthConfig;

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
    /// Measure on rendered frames of a camera: with a dark and even background, with any, or as a TOML file says, as in
    /// `ball_px = 80` or `rps = [10, 60]`; flags come before it.
    #[arg(long, value_name = "dark|any|CAMERA.toml", help_heading = "Camera")]
    camera: Option<CameraSource>,
    #[command(flatten)]
    stated: CameraFile,
}

/// What `--camera` names.
#[derive(Debug, Clone, PartialEq)]
pub enum CameraSource {
    /// The usual camera before these.
    Surroundings(Surroundings),
    /// What a file states.
    File(PathBuf),
}

impl std::str::FromStr for CameraSource {
    type Err = std::convert::Infallible;

    fn from_str(text: &str) -> std::result::Result<Self, Self::Err> {
        let named = text.parse().map(Self::Surroundings);
        Ok(named.unwrap_or_else(|_| Self::File(text.into())))
    }
}

/// What a file, or the flags, may state.
#[derive(Debug, Clone, Default, PartialEq, Args, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[command(next_help_heading = "Camera")]
struct CameraFile {
    /// The ball's diameter in the image, pixels [default: 60].
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    ball_px: Option<f64>,
    /// Frames per second [default: 350].
    #[arg(long, value_name = "F", allow_negative_numbers = true)]
    fps: Option<f64>,
    /// Exposure, milliseconds [default: 0.1].
    #[arg(long, value_name = "MS", allow_negative_numbers = true)]
    exposure_ms: Option<f64>,
    /// Distance from the camera to the ball's center in ball radii [default: 6 to 60].
    #[arg(long, hide = true, value_name = "D", allow_negative_numbers = true)]
    camera_distance_radii: Option<f64>,
    /// Standard deviation of the lens' blur, pixels [default: that of the surroundings].
    #[arg(long, hide = true, value_name = "B", allow_negative_numbers = true)]
    defocus_px: Option<f64>,
    /// Standard deviation of a pixel's noise, of 255 levels [default: that of the surroundings].
    #[arg(long, hide = true, value_name = "N", allow_negative_numbers = true)]
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
        hide = true,
        value_name = "MIN,MAX",
        value_delimiter = ',',
        allow_negative_numbers = true
    )]
    rps: Option<Vec<f64>>,
    /// Greatest speed of the ball across the image, m/s [default: 4].
    #[arg(long, hide = true, value_name = "V", allow_negative_numbers = true)]
    max_speed_m_s: Option<f64>,
    /// What surrounds the ball: dark and even as arranged, or anything [default: any].
    #[arg(long, hide = true, value_parser = one_of(&Surroundings::ALL, Surroundings::as_str))]
    surroundings: Option<Surroundings>,
}

impl CameraArguments {
    /// Diameter of the ball, mm.
    pub fn ball_mm(&self) -> Result<f64> {
        Ok(self.both()?.ball_diameter_mm.unwrap_or(USUAL_BALL_MM))
    }

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

    /// A launch monitor's camera as far as it is stated: the ball's diameter, mm, and the size of the dots over it.
    pub fn state_golf(&self, synth: &mut SynthConfig) -> Result<GolfBall> {
        let stated = CameraFile {
            ball_diameter_mm: self.stated.ball_diameter_mm.or(Some(golf::BALL_MM)),
            ball_px: self.stated.ball_px.or(synth.ball_px.map(|px| px[0])),
            ..self.stated.clone()
        };
        let conditions = stated.conditions().map_err(named_as_flag)?;
        synth.ball_px = Some([conditions.ball_px; 2]);
        if let Some(distance) = conditions.distance_radii {
            synth.camera_distance_radii = [distance; 2];
        }
        if let Some(blur) = conditions.defocus_px {
            synth.defocus_px = [blur; 2];
        }
        let ball_mm = stated.ball_diameter_mm.unwrap_or(golf::BALL_MM);
        let dots = match stated.dot_diameter_mm {
            Some(_) => DotSize::Stated,
            None => DotSize::Designed { ball_mm },
        };
        Ok(GolfBall {
            ball_mm,
            dots,
            conditions,
        })
    }

    /// What is assumed of the camera and the ball where nothing is stated, in words.
    pub fn assumed(&self) -> Result<String> {
        Ok(self.both()?.assumed())
    }

    /// Whether there is a camera.
    pub fn is_given(&self) -> bool {
        self.camera.is_some()
    }

    /// Rejects properties of a camera where there is none.
    pub fn reject_without_camera(&self) -> Result<()> {
        let stated = serde_json::to_value(&self.stated)
            .map_err(|e| Error::Internal(format!("a camera as JSON: {e}")))?;
        let mut stated = stated.as_object().into_iter().flatten();
        match stated.find(|(_, value)| !value.is_null()) {
            Some((name, _)) if !self.is_given() => {
                let problem = "is of a camera: expected --camera dark, any, or a file beside it";
                Err(Error::argument(name.clone(), problem))
            }
            _ => Ok(()),
        }
    }

    /// The conditions: flags before the file, the file before the defaults.
    pub fn conditions(&self) -> Result<CameraConditions> {
        self.both()?.conditions().map_err(named_as_flag)
    }

    fn both(&self) -> Result<CameraFile> {
        let file = match &self.camera {
            Some(source) => source.read()?,
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

/// A golf ball before a launch monitor.
pub struct GolfBall {
    /// Its diameter, mm.
    pub ball_mm: f64,
    /// The size of its dots.
    pub dots: DotSize,
    /// What is stated beside it.
    pub conditions: CameraConditions,
}

impl std::fmt::Display for CameraSource {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Surroundings(surroundings) => f.write_str(surroundings.as_str()),
            Self::File(path) => path.display().fmt(f),
        }
    }
}

impl CameraSource {
    /// What is assumed where it states nothing, in words.
    pub fn assumed(&self) -> Result<String> {
        Ok(self.read()?.assumed())
    }

    /// The conditions that it states.
    pub fn conditions(&self) -> Result<CameraConditions> {
        self.read()?.conditions().map_err(named_as_flag)
    }

    fn read(&self) -> Result<CameraFile> {
        match self {
            Self::File(path) => read(path),
            Self::Surroundings(surroundings) => Ok(CameraFile {
                surroundings: Some(*surroundings),
                ..CameraFile::default()
            }),
        }
    }
}

impl CameraFile {
    /// What is not stated of what changes the rates most.
    fn assumed(&self) -> String {
        let usual = CameraConditions::default();
        let ball_mm = self.ball_diameter_mm.unwrap_or(USUAL_BALL_MM);
        let surroundings = match usual.surroundings {
            Surroundings::Any => "any surroundings (a dark room: --camera dark)",
            Surroundings::Dark => "a dark room (else: --camera any)",
        };
        let [low, high] = usual.rps;
        let all = [
            (self.surroundings.is_none(), surroundings.to_owned()),
            (
                self.ball_px.is_none(),
                format!("a ball of {} pixels", usual.ball_px),
            ),
            (
                self.ball_diameter_mm.is_none(),
                format!("{USUAL_BALL_MM} mm wide"),
            ),
            (self.fps.is_none(), format!("{} frames a second", usual.fps)),
            (
                self.exposure_ms.is_none(),
                format!("exposed {} ms", 1e3 * usual.exposure_s),
            ),
            (self.rps.is_none(), format!("spins of {low} to {high} rps")),
            (
                self.max_speed_m_s.is_none(),
                format!("up to {} m/s", 1e-3 * usual.max_speed * ball_mm),
            ),
        ];
        let assumed = all.into_iter().filter(|(is_open, _)| *is_open);
        let assumed: Vec<String> = assumed.map(|(_, words)| words).collect();
        match assumed.is_empty() {
            true => "nothing is assumed of the camera".to_owned(),
            false => format!("assumed, as nothing else is stated: {}", assumed.join(", ")),
        }
    }

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

fn read(path: &Path) -> Result<CameraFile> {
    let file: CameraFile = read_toml(path)?;
    if file == CameraFile::default() {
        let problem = "expected at least one property of the camera, such as ball_px, found none";
        return Err(Error::input(path, "file", problem));
    }
    Ok(file)
}

/// A number with so many decimals; a dash for none.
pub fn shown(number: f64, decimals: usize) -> String {
    match number.is_nan() {
        true => "-".to_owned(),
        false => format!("{number:.decimals$}"),
    }
}

/// Prints what a pattern gives before a camera.
pub fn print_frames(r: &FrameRates) {
    outln!("{} frames of seed {}", r.right.trials, r.seed);
    outln!("  right       {} of {}", r.right, r.right.trials);
    outln!("  wrong       {} of {}", r.wrong, r.wrong.trials);
    outln!("  unanswered  {} of {}", r.unanswered, r.unanswered.trials);
    outln!(
        "  error of the right ones: mean {} deg, median {} deg, root mean square {} deg",
        shown(r.mean_error_deg, 3),
        shown(r.median_error_deg, 3),
        shown(r.rms_error_deg, 3)
    );
    outln!("Right is off by less than 20 degrees. Brackets are 95 % intervals (Wilson).");
}
