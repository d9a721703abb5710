//! Several balls that fly across one camera's images.

use std::f64::consts::{PI, TAU};

use rand::{Rng, RngExt};

use super::config::SynthConfig;
use super::dataset::{ClipConfig, SynthSequence, frame_rng};
use super::scene::{Scene, pinhole};
use super::several::{BallImage, ImageOf};
use super::view::View;
use crate::error::{Error, Result};
use crate::pattern::Pattern;
use crate::vision::optics::camera::{BallCircle, Camera, Pixel};

/// Balls of one sequence, and columns and rows of their frames where none are given.
const MAX_BALLS: usize = 8;
const BALLS_IMAGE: [usize; 2] = [640, 480];
/// The stream of the further balls' numbers: no frame has its number.
const FELLOWS: u64 = 1 << 40;

impl SynthSequence {
    /// Random balls, one of each pattern, that fly across whole images and cross each other's paths about the middle of the sequence.
    /// Without [`SynthConfig::image_px`] the images have 640 x 480 pixels.
    ///
    /// # Errors
    /// Those of [`SynthSequence::random`]; [`Error::Argument`] for a rolling shutter or a drift, which these balls do not have.
    pub fn of_balls(
        patterns: &[Pattern],
        config: &SynthConfig,
        clip: &ClipConfig,
        seed: u64,
        count: usize,
    ) -> Result<Self> {
        let (Some(first), 1..=MAX_BALLS) = (patterns.first(), patterns.len()) else {
            let problem = format!("expected 1 to {MAX_BALLS}, found {}", patterns.len());
            return Err(Error::argument("patterns", problem));
        };
        if clip.drift_px.is_some() || clip.readout_s != 0.0 {
            let problem = "expected neither drift nor readout where several balls fly";
            return Err(Error::argument("drift_px", problem));
        }
        let image_px = config.image_px.unwrap_or(BALLS_IMAGE);
        let config = &SynthConfig {
            image_px: Some(image_px),
            cut_share: 0.0,
            ..config.clone()
        };
        let mut sequence = Self::random(first, config, clip, seed, count)?;
        let mut rng = frame_rng(seed, FELLOWS);
        let radius = sequence.first.circle.radius;
        let crossing = Crossing {
            size: image_px.map(|n| n as f64),
            balls: patterns.len(),
            start: rng.random_range(0.0..TAU),
        };
        let axis = crossing.middle();
        let mut path = |ball, radius| crossing.path(ball, radius, &mut rng);
        let (center, drift) = path(0, radius);
        sequence.drift_px = drift;
        let speed = clip.fps / count.max(2) as f64;
        let own = &mut sequence.first;
        own.circle.center = center;
        own.fly(drift.map(|d| d * speed), axis)?;
        let exposure_s = own.exposure_s;
        for (ball, pattern) in patterns.iter().enumerate().skip(1) {
            let other =
                Scene::random(pattern, config, &mut frame_rng(seed, FELLOWS + ball as u64))?;
            let radius = radius * (0.85 + 0.35 * other.circle.center.u.rem_euclid(1.0));
            let (center, drift) = path(ball, radius);
            let image = BallImage {
                of: ImageOf { ball, flash: 0 },
                late_s: 0.0,
                surface: other.surface,
                circle: BallCircle::new(center, radius),
                rotation: other.rotation,
                spin: other.spin,
                shift_px: drift.map(|d| d * speed * exposure_s),
            };
            sequence.fellows.push((image, drift));
        }
        Ok(sequence)
    }
}

impl Scene {
    /// Lets the ball move, pixels/s, before a camera whose axis is at this place.
    fn fly(&mut self, velocity_px_s: [f64; 2], axis: Pixel) -> Result<()> {
        self.velocity_px_s = velocity_px_s;
        self.shift_px = velocity_px_s.map(|v| v * self.exposure_s);
        self.occluder = None;
        self.background.origin = axis;
        if !matches!(self.camera, Camera::Orthographic) {
            let distance = View::new(&self.camera, self.circle)?.distance();
            let on_axis = BallCircle::new(axis, self.circle.radius);
            self.camera = pinhole(&on_axis, distance.unwrap_or(20.0), 0.0, 0.0);
        }
        Ok(())
    }
}

/// Where balls meet on their ways across whole images.
struct Crossing {
    /// Columns and rows.
    size: [f64; 2],
    balls: usize,
    /// Direction of the first way, radians.
    start: f64,
}

impl Crossing {
    fn middle(&self) -> Pixel {
        let [u, v] = self.size.map(|n| 0.5 * (n - 1.0));
        Pixel { u, v }
    }

    /// Where a ball's center begins, pixels, and how far it comes. Directions are well apart, through places near each other at nearly
    /// the same time.
    fn path(&self, ball: usize, radius: f64, rng: &mut impl Rng) -> (Pixel, [f64; 2]) {
        let turn = PI * (ball as f64 + 0.3 * rng.random::<f64>()) / self.balls as f64;
        let (s, c) = (self.start + turn).sin_cos();
        let room = self.size.map(|n| 0.5 * n - 1.3 * radius);
        let reach = (room[0] / c.abs().max(1e-3)).min(room[1] / s.abs().max(1e-3));
        let length = 1.8 * reach.max(0.0);
        let drift = [length * c, length * s];
        let late = 0.08 * rng.random_range(-1.0..1.0);
        let off = [0, 1].map(|_| 0.4 * radius * rng.random_range(-1.0..1.0));
        let Pixel { u, v } = self.middle();
        let center = Pixel {
            u: u + off[0] - late * drift[0],
            v: v + off[1] - late * drift[1],
        };
        (center, drift)
    }
}
