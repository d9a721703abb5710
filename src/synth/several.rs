//! Several images of balls in one frame: of one ball by the flashes of one exposure, or of several balls.
//!
//! A scene has its own ball and further [`BallImage`]s. Each is rendered as the scene's own is. What one flash lights is seen at one
//! instant: of two balls the nearer one, which has the larger outline, hides the other. What several flashes light adds up: a dot in one
//! image lets through the light of another that covers it, and fades. Each of `n` flashes gives the background an `n`th of its light.

use rand::{Rng, RngExt};

pub use super::ball_image::{BallImage, ImageOf};
use super::config::SynthConfig;
use super::random::{between, log_between};
use super::scene::{Scene, pinhole};
use crate::clip::strobe::check_flashes;
use crate::error::{Result, require};
use crate::geometry::{Rotation, Vec3};
use crate::pattern::Pattern;
use crate::vision::optics::camera::{BallCircle, Camera, Pixel};

/// Maximum columns and rows of a picture: as of [`SynthConfig::image_px`].
const MAX_SIDE: usize = 8192;
/// Duration of a flash, s: infrared diodes are pulsed for ten to thirty microseconds.
const FLASH_S: f64 = 2e-5;
/// Images of a ball add up: the sensor is exposed for that.
const HEADROOM: f32 = 0.6;
/// Room around the images of a ball in a picture without a given size, diameters.
const MARGIN: f64 = 0.75;
/// Maximum climb of a flight, radians, and change of the radius over it, as a part.
const MAX_CLIMB: f64 = 0.45;
const MAX_GROWTH: f64 = 0.03;
/// Spin about the line of flight that a club gives at most, rad/s: 300 rpm.
const MAX_RIFLE: f64 = 31.4;

impl Scene {
    /// The scene of each image of a ball, with the others beside it; that of the scene's own comes first.
    pub(super) fn images(&self) -> Vec<Self> {
        let image = |k: usize| {
            let mut scene = self.clone();
            if let Some(other) = k.checked_sub(1).and_then(|k| scene.others.get_mut(k)) {
                std::mem::swap(&mut scene.image, &mut other.of);
                std::mem::swap(&mut scene.late_s, &mut other.late_s);
                std::mem::swap(&mut scene.surface, &mut other.surface);
                std::mem::swap(&mut scene.circle, &mut other.circle);
                std::mem::swap(&mut scene.rotation, &mut other.rotation);
                std::mem::swap(&mut scene.spin, &mut other.spin);
                std::mem::swap(&mut scene.shift_px, &mut other.shift_px);
            }
            scene
        };
        (0..=self.others.len()).map(image).collect()
    }
}

/// The flashes of one exposure, and how a ball flies through them.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct StrobeConfig {
    /// Times of the flashes, s, ascending.
    pub times_s: Vec<f64>,
    /// Part of the diameter that the two images nearest to each other share: 0 where they touch, negative where they are apart.
    pub overlap: [f64; 2],
    /// Backspin and sidespin of a ball that is seen from the side, rad/s; by default any spin of the configuration.
    pub golf_spin: Option<[[f64; 2]; 2]>,
}

impl StrobeConfig {
    /// Flashes at these times, s; images that touch up to those that share 60 % of their diameter.
    pub fn new(times_s: Vec<f64>) -> Self {
        Self {
            times_s,
            overlap: [0.0, 0.6],
            golf_spin: None,
        }
    }

    /// The same with golf's spins: 1 500 to 12 000 rpm of backspin, up to 3 000 rpm of sidespin to either side.
    #[must_use]
    pub fn with_golf_spin(self) -> Self {
        let rad_s = |rpm: f64| rpm * std::f64::consts::TAU / 60.0;
        Self {
            golf_spin: Some([
                [rad_s(1_500.0), rad_s(12_000.0)],
                [rad_s(-3_000.0), rad_s(3_000.0)],
            ]),
            ..self
        }
    }

    /// Checks the domains.
    ///
    /// # Errors
    /// [`crate::Error::Argument`] naming the parameter.
    pub fn check(&self) -> Result<()> {
        check_flashes(&self.times_s)?;
        let [low, high] = self.overlap;
        require(
            -20.0 <= low && low <= high && high <= 0.9,
            "overlap",
            "-20 to 0.9, the smaller first",
            format_args!("{low},{high}"),
        )
    }
}

impl Scene {
    /// A random exposure of one flying ball with several flashes.
    ///
    /// # Errors
    /// [`crate::Error::Argument`] where a configuration is out of its domain.
    pub fn strobed<R: Rng + ?Sized>(
        pattern: &Pattern,
        config: &SynthConfig,
        strobe: &StrobeConfig,
        rng: &mut R,
    ) -> Result<Self> {
        strobe.check()?;
        let mut scene = Self::random(pattern, config, rng)?;
        let times = &strobe.times_s;
        let diameter = 2.0 * scene.circle.radius;
        let flight = StrobedFlight::random(strobe, diameter, rng);
        let distance = log_between(config.camera_distance_radii, rng);
        let rifle = MAX_RIFLE * rng.random_range(-1.0..1.0);
        let golf = strobe.golf_spin.map(|spin| spin.map(|s| between(s, rng)));
        if let Some([back, side]) = golf {
            // Seen from the side: backspin about the flight's direction x up, sidespin clockwise from above.
            let right = flight.velocity[0].signum();
            scene.spin = Vec3::new(right * rifle, -side, right * back);
        }
        scene.size = config.image_px.unwrap_or_else(|| {
            let side = |p: f64| (p.abs() + (1.0 + 2.0 * MARGIN) * diameter).ceil() as usize;
            flight.path().map(side)
        });
        let [width, height] = scene.size;
        require(
            width.max(height) <= MAX_SIDE,
            "strobe_ms",
            "times over which the ball stays within 8192 columns and rows",
            format_args!("a picture of {width} x {height}"),
        )?;
        let middle = scene.size.map(|n| 0.5 * (n as f64 - 1.0));
        let axis = Pixel {
            u: middle[0],
            v: middle[1],
        };
        if !matches!(scene.camera, Camera::Orthographic) {
            let on_axis = BallCircle::new(axis, scene.circle.radius);
            scene.camera = pinhole(&on_axis, distance, 0.0, 0.0);
        }
        (scene.background.origin, scene.occluder) = (axis, None);
        (scene.exposure_s, scene.row_s) = (FLASH_S, 0.0);
        scene.sensor.gain *= HEADROOM;
        let images = times.iter().enumerate();
        let mut images =
            images.map(|(flash, time_s)| flight.image(&scene, flash, time_s - times[0]));
        let own = images.next();
        let others = images.collect();
        if let Some(own) = own {
            (scene.circle, scene.shift_px) = (own.circle, own.shift_px);
        }
        scene.others = others;
        Ok(scene)
    }
}

/// How a ball crosses the picture while flashes light it.
struct StrobedFlight {
    /// Pixels/s.
    velocity: [f64; 2],
    /// From the first flash to the last.
    span_s: f64,
    /// By how much its image grows meanwhile, as a share of its size.
    growth: f64,
    /// Of the path's middle from the picture's, pixels.
    off: [f64; 2],
}

impl StrobedFlight {
    fn random<R: Rng + ?Sized>(strobe: &StrobeConfig, diameter: f64, rng: &mut R) -> Self {
        let times = &strobe.times_s;
        let step = times.windows(2).map(|w| w[1] - w[0]);
        let step_s = step.fold(f64::INFINITY, f64::min);
        let speed = (1.0 - between(strobe.overlap, rng)) * diameter / step_s;
        let right = if rng.random_bool(0.5) { 1.0 } else { -1.0 };
        let climb = MAX_CLIMB * rng.random_range(-0.3..1.0f64);
        Self {
            velocity: [right * speed * climb.cos(), -speed * climb.sin()],
            span_s: times[times.len() - 1] - times[0],
            growth: MAX_GROWTH * rng.random_range(-1.0..1.0),
            off: [0, 1].map(|_| 0.1 * diameter * rng.random_range(-1.0..1.0)),
        }
    }

    fn path(&self) -> [f64; 2] {
        self.velocity.map(|v| v * self.span_s)
    }

    /// The ball of a scene, about whose middle it flies, in the light of a flash so long after the first.
    fn image(&self, scene: &Scene, flash: usize, late_s: f64) -> BallImage {
        let share = late_s / self.span_s - 0.5;
        let (axis, path) = (scene.background.origin, self.path());
        let center = Pixel {
            u: axis.u + self.off[0] + share * path[0],
            v: axis.v + self.off[1] + share * path[1],
        };
        let radius = scene.circle.radius * (1.0 + self.growth * share);
        BallImage {
            of: ImageOf { ball: 0, flash },
            late_s,
            surface: scene.surface.clone(),
            circle: BallCircle::new(center, radius),
            rotation: Rotation::from_scaled_axis(scene.spin * late_s) * scene.rotation,
            spin: scene.spin,
            shift_px: self.velocity.map(|v| v * FLASH_S),
        }
    }
}
