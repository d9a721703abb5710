//! What a user knows of the camera and of the ball before it, and the scenes that follow from it.

use std::f64::consts::TAU;

use rand::{Rng, RngExt};
use serde::{Deserialize, Serialize};

use crate::error::{Error, Result, require};
use crate::geometry::{Vec3, random_direction};
use crate::pattern::Pattern;
use crate::spin::DEFAULT_FPS;
use crate::synth::dataset::frame_rng;
use crate::synth::{Scene, SynthConfig};

/// Distances of the camera from the ball, ball radii, where none is stated.
const DISTANCE_RADII: [f64; 2] = [6.0, 60.0];

/// What surrounds the ball.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Surroundings {
    /// As a user arranges it: a background darker than the ball, even light, nothing before it.
    Dark,
    /// Anything: bright and textured backgrounds, lamps, hands and bats, shadows, hard compression. The
    /// default: a dark room is for whoever has one to say.
    #[default]
    Any,
}

impl Surroundings {
    /// All surroundings.
    pub const ALL: [Self; 2] = [Self::Dark, Self::Any];

    /// The name on the command line.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Dark => "dark",
            Self::Any => "any",
        }
    }
}

impl std::str::FromStr for Surroundings {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        crate::error::by_name(&Self::ALL, Self::as_str, "surroundings", name)
    }
}

/// The camera, the ball and its spin, as far as they are known. What is not stated is drawn as
/// widely as [`SynthConfig`] does.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CameraConditions {
    /// The ball's diameter in the image, pixels. Default: 60.
    pub ball_px: f64,
    /// Frames per second. Default: 350.
    pub fps: f64,
    /// Exposure, s. Default: 0.1 ms.
    pub exposure_s: f64,
    /// Distance of the camera from the ball's center, ball radii. Default: none, 6 to 60.
    pub distance_radii: Option<f64>,
    /// Standard deviation of the lens' blur, pixels. Default: none, that of the surroundings.
    pub defocus_px: Option<f64>,
    /// Standard deviation of a pixel's noise, of 255 levels, before the encoding. Default: none,
    /// that of the surroundings.
    pub noise_levels: Option<f64>,
    /// Diameter of a dot over that of the ball. Default: 0.1, 4 mm on 40.
    pub dot_diameter: f64,
    /// Spins from the smallest to the greatest, revolutions per second. Default: 0 to 100.
    pub rps: [f64; 2],
    /// Greatest speed of the ball across the image, ball diameters a second; the smallest is 0.
    /// Default: 100, 4 m/s for 40 mm.
    pub max_speed: f64,
    /// What surrounds the ball. Default: any.
    pub surroundings: Surroundings,
}

impl Default for CameraConditions {
    fn default() -> Self {
        Self {
            ball_px: 60.0,
            fps: DEFAULT_FPS,
            exposure_s: 1e-4,
            distance_radii: None,
            defocus_px: None,
            noise_levels: None,
            dot_diameter: 0.1,
            rps: [0.0, 100.0],
            max_speed: 100.0,
            surroundings: Surroundings::default(),
        }
    }
}

impl CameraConditions {
    /// Checks the domains of all values.
    ///
    /// # Errors
    /// [`Error::Argument`] naming the value.
    pub fn check(&self) -> Result<()> {
        let inside = |range: [f64; 2], x: f64| (range[0]..=range[1]).contains(&x);
        let check = |name: &'static str, range: [f64; 2], unit: &str, x: f64| {
            let expected = format!("{} to {}{unit}", range[0], range[1]);
            require(inside(range, x), name, &expected, x)
        };
        check("ball_px", [20.0, 200.0], " pixels", self.ball_px)?;
        check("fps", [1.0, 1e5], " frames a second", self.fps)?;
        let longest = 1.0 / self.fps;
        let expected = format!("0 to {longest} s, the time between two frames");
        require(
            inside([0.0, longest], self.exposure_s),
            "exposure_s",
            &expected,
            self.exposure_s,
        )?;
        if let Some(distance) = self.distance_radii {
            check("distance_radii", [4.0, 1e6], " ball radii", distance)?;
        }
        if let Some(blur) = self.defocus_px {
            check("defocus_px", [0.0, 10.0], " pixels", blur)?;
        }
        if let Some(noise) = self.noise_levels {
            check("noise_levels", [0.0, 40.0], " levels", noise)?;
        }
        check(
            "dot_diameter",
            [0.03, 0.2],
            " ball diameters",
            self.dot_diameter,
        )?;
        let [low, high] = self.rps;
        require(
            low >= 0.0 && low <= high && high <= 1e4,
            "rps",
            "0 to 10000, the smaller first",
            format_args!("{low},{high}"),
        )?;
        check(
            "max_speed",
            [0.0, 1e5],
            " diameters a second",
            self.max_speed,
        )
    }

    /// The ranges of everything that is not stated.
    pub fn synth(&self) -> SynthConfig {
        let base = match self.surroundings {
            Surroundings::Dark => SynthConfig::good(),
            Surroundings::Any => SynthConfig::default(),
        };
        let mut config = SynthConfig {
            ball_px: Some([self.ball_px; 2]),
            dot_radius_rad: [self.dot_diameter; 2],
            rps: self.rps,
            camera_distance_radii: DISTANCE_RADII,
            ..base
        };
        if let Some(distance) = self.distance_radii {
            config.camera_distance_radii = [distance; 2];
            config.parallel_share = 0.0;
        }
        config
    }

    /// Scene number `k` of a seed: another ball, view and spin each; the same for every pattern but
    /// for its dots.
    ///
    /// # Errors
    /// [`Error::Argument`] for a value outside its domain.
    pub fn scene(&self, pattern: &Pattern, seed: u64, k: u64) -> Result<Scene> {
        let mut rng = frame_rng(seed, k);
        let mut scene = Scene::random(pattern, &self.synth(), &mut rng)?;
        scene.exposure_s = self.exposure_s;
        scene.spin = self.random_spin(&mut rng);
        let shift = self.max_speed * rng.random::<f64>() * self.ball_px * self.exposure_s;
        let (s, c) = (TAU * rng.random::<f64>()).sin_cos();
        scene.shift_px = [shift * c, shift * s];
        if let Some(blur) = self.defocus_px {
            scene.sensor.defocus_px = blur;
        }
        if let Some(levels) = self.noise_levels {
            scene.sensor.read_noise = (levels / 255.0) as f32;
            scene.sensor.shot_noise = 0.0;
            scene.sensor.color_noise = 0.0;
        }
        Ok(scene)
    }

    fn random_spin<R: Rng + ?Sized>(&self, rng: &mut R) -> Vec3 {
        let [low, high] = self.rps;
        random_direction(rng) * (TAU * (low + (high - low) * rng.random::<f64>()))
    }
}
