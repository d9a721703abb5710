//! How much of a dot a sensor shows, computed from a scene without rendering it.
//!
//! A dot of the radius `r` pixels and the contrast `c` (encoded values) in noise of the deviation `n` a pixel stands
//! out by `c sqrt(pi r^2 facing) / n` for a filter that matches it, less what blur takes. The numbers follow from the
//! scene by the same light, ink and sensor that [`Scene::render`] uses, at single points instead of at every pixel.
//!
//! Not included: print, seams, streaks of the pen, and what the codec does.

use std::f64::consts::PI;

use super::color::luma;
use super::render::TrueDot;
use super::scene::Scene;
use super::view::View;
use crate::error::Result;
use crate::geometry::{Rotation, Vec3};
use crate::vision::optics::camera::BallCircle;

/// Deviation of eight-bit values, of full.
const ROUNDING: f64 = 1.0 / (255.0 * 3.464_101_615_137_754);
/// Standard deviation of a pixel's own box, pixels.
const PIXEL_BLUR: f64 = 0.288_675_134_594_812_9;

/// A dot in the camera's sight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DotSignal {
    /// Its truth.
    pub truth: TrueDot,
    /// The encoded value of the bare surface there, of full.
    pub brightness: f64,
    /// How much darker it is than that, of full.
    pub contrast: f64,
    /// Standard deviation of a pixel's noise there, of full.
    pub noise: f64,
    /// Standard deviation of all blur there, along the stronger axis, pixels.
    pub blur_px: f64,
}

/// The ball and its dots as a detector meets them.
#[derive(Debug, Clone, PartialEq)]
pub struct BallSignal {
    /// Pattern to view frame, at mid-exposure.
    pub rotation: Rotation,
    /// The circle nearest to the outline.
    pub circle: BallCircle,
    /// The dots on the visible part of the ball, hidden or not.
    pub dots: Vec<DotSignal>,
}

impl BallSignal {
    /// How far a dot stands out of the noise for a filter that matches it, standard deviations. A disc of the radius
    /// `r` has the deviation `r / 2` along each axis, so that blur of `b` radii takes `sqrt(1 + 4 b^2)`.
    pub fn strength(&self, dot: &DotSignal) -> f64 {
        let radius_px = self.circle.radius * dot.truth.radius_rad;
        let area = PI * radius_px * radius_px * dot.truth.facing.max(0.05);
        let blur = dot.blur_px / radius_px;
        dot.contrast * area.sqrt() / dot.noise / (1.0 + 4.0 * blur * blur).sqrt()
    }
}

/// Light of a point of the ball after the sensor's encoding.
#[derive(Debug, Clone, Copy)]
struct Level {
    value: f64,
    /// Deviation of its noise.
    noise: f64,
}

impl Scene {
    /// The ball and how much of its dots the sensor shows.
    ///
    /// # Errors
    /// [`crate::Error::Argument`] where the circle or the camera is not finite or not positive.
    pub fn signal(&self) -> Result<BallSignal> {
        let view = View::new(&self.camera, self.circle)?;
        let truths = self.true_dots(&view).into_iter();
        Ok(BallSignal {
            rotation: view.to_view() * self.rotation,
            circle: view.outline().circle(),
            dots: truths.map(|truth| self.dot_signal(&view, truth)).collect(),
        })
    }

    fn dot_signal(&self, view: &View, truth: TrueDot) -> DotSignal {
        let n = view.to_view().inverse() * truth.direction;
        let under = luma(self.surface.under(&(self.rotation.inverse() * n)));
        let ball = luma(self.surface.ball);
        let bare = self.level(view, &n, under);
        let inked = self.level(view, &n, under - truth.contrast as f32 * ball);
        DotSignal {
            truth,
            brightness: bare.value,
            contrast: (bare.value - inked.value).max(0.0),
            noise: 0.5 * (bare.noise + inked.noise) + ROUNDING,
            blur_px: self.blur_at(view, &n),
        }
    }

    /// The encoded value and noise of the ball's surface of this gray at the normal `n`.
    fn level(&self, view: &View, n: &Vec3, albedo: f32) -> Level {
        let [factor, gloss] = self.light.at(n, view.facing(n).max(0.0), &view.towards());
        let light = albedo * luma(factor) + luma(gloss);
        let sensor = &self.sensor;
        let signal = sensor.gain * light.max(0.0);
        let deviation = (sensor.read_noise.powi(2) + sensor.shot_noise * signal).sqrt();
        // Noise goes through the slope of the encoding, which is steep in the dark.
        let step = deviation.max(1e-3);
        let slope =
            (sensor.encode(signal + step) - sensor.encode((signal - step).max(0.0))) / (2.0 * step);
        Level {
            value: f64::from(sensor.encode(signal)),
            noise: f64::from(slope * deviation),
        }
    }

    /// Standard deviation of all blur at a point of the ball, pixels.
    fn blur_at(&self, view: &View, n: &Vec3) -> f64 {
        let half = Rotation::from_scaled_axis(self.spin * (0.5 * self.exposure_s));
        let (a, b) = (
            view.project(&(half * n)),
            view.project(&(half.inverse() * n)),
        );
        let motion = (a.u - b.u + self.shift_px[0]).hypot(a.v - b.v + self.shift_px[1]);
        (self.sensor.defocus_px.powi(2) + motion * motion / 12.0 + PIXEL_BLUR.powi(2)).sqrt()
    }
}
