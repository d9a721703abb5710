//! What a detector's success depends on, computed from a scene without rendering it.
//!
//! Each dot in sight and the ball as a whole have a short list of numbers: sizes in pixels, blur,
//! contrast, noise, what is beside and before them. They follow from the scene by the same light,
//! ink and sensor that [`Scene::render`] uses, at single points instead of at every pixel: some
//! thousand times cheaper. [`crate::predict`] learns from them what the estimator sees.
//!
//! Not included: what single pixels do, such as streaks of the pen or the blocks of a codec at a
//! particular place.

use std::f64::consts::{PI, TAU};

use super::color::luma;
use super::compression::Compression;
use super::render::TrueDot;
use super::scene::Scene;
use super::view::View;
use crate::error::Result;
use crate::geometry::{Rotation, Vec3, spiral_directions, tangent_frame};
use crate::vision::camera::{BallCircle, Pixel};

/// The numbers that describe a dot, in their order.
pub const DOT_OBSERVABLES: [&str; 12] = [
    "ln radius px",
    "facing",
    "ln blur over radius",
    "contrast",
    "ln contrast to noise",
    "brightness",
    "ln gap to the next dot",
    "print beside",
    "hidden beside",
    "compression",
    "shading beside",
    "inverse distance",
];

/// The numbers that describe the ball in its image, in their order.
pub const BALL_OBSERVABLES: [&str; 12] = [
    "ln radius px",
    "rim visible",
    "ln blur over radius",
    "edge contrast",
    "share of weak edges",
    "ln noise",
    "brightness",
    "compression",
    "background clutter",
    "print",
    "shading",
    "inverse distance",
];

/// Deviation of eight-bit values, of full.
const ROUNDING: f64 = 1.0 / (255.0 * 3.464_101_615_137_754);
/// Standard deviation of a pixel's own box, pixels.
const PIXEL_BLUR: f64 = 0.288_675_134_594_812_9;
/// Points about a dot at which its surroundings are looked up.
const AROUND: usize = 8;
/// Points of the outline.
const RIM: usize = 24;
/// Points of the visible side.
const SIDE: usize = 48;
/// An edge of less contrast than this, against the ball's brightness there, is weak.
const WEAK_EDGE: f64 = 0.12;
/// A surface that differs from the ball's color by this part of it is printed on.
const PRINTED: f64 = 0.2;

/// A dot in the camera's sight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SeenDot {
    /// Its truth.
    pub truth: TrueDot,
    /// See [`DOT_OBSERVABLES`].
    pub observables: [f64; DOT_OBSERVABLES.len()],
}

/// The ball and its dots as a detector meets them.
#[derive(Debug, Clone, PartialEq)]
pub struct SeenBall {
    /// Pattern to view frame, at mid-exposure.
    pub rotation: Rotation,
    /// The circle nearest to the outline.
    pub circle: BallCircle,
    /// Distance of the camera from the ball's center, ball radii; `None` for parallel rays.
    pub distance: Option<f64>,
    /// See [`BALL_OBSERVABLES`].
    pub observables: [f64; BALL_OBSERVABLES.len()],
    /// The dots on the part of the ball in sight, hidden or not.
    pub dots: Vec<SeenDot>,
    /// Points of the visible side that are printed on, and their neighbors, in the image.
    pub printed: Vec<Pixel>,
}

/// Light of a point of the ball after the sensor's encoding.
#[derive(Debug, Clone, Copy)]
struct Level {
    value: f64,
    /// Deviation of its noise.
    noise: f64,
}

impl Scene {
    /// What a detector's success depends on.
    ///
    /// # Errors
    /// [`crate::Error::Argument`] where the circle or the camera is not finite or not positive.
    pub fn seen(&self) -> Result<SeenBall> {
        let view = View::new(&self.camera, self.circle)?;
        let truths = self.true_dots(&view);
        let middles: Vec<Vec3> = truths.iter().map(|t| t.direction).collect();
        let dots = truths.iter().enumerate().map(|(i, truth)| SeenDot {
            truth: *truth,
            observables: self.dot_observables(&view, truth, i, &middles, &truths),
        });
        let dots = dots.collect();
        let (observables, printed) = self.ball_observables(&view);
        Ok(SeenBall {
            rotation: view.to_view() * self.rotation,
            circle: view.outline().circle(),
            distance: view.distance(),
            observables,
            dots,
            printed,
        })
    }

    fn dot_observables(
        &self,
        view: &View,
        truth: &TrueDot,
        i: usize,
        middles: &[Vec3],
        truths: &[TrueDot],
    ) -> [f64; DOT_OBSERVABLES.len()] {
        let to_camera = view.to_view().inverse();
        let n = to_camera * truth.direction;
        let own = self.rotation.inverse() * n;
        let radius_px = self.circle.radius * truth.radius_rad;
        let under = luma(self.surface.under(&own));
        let ball = luma(self.surface.ball);
        let bare = self.level(view, &n, under);
        let inked = self.level(view, &n, under - truth.contrast as f32 * ball);
        let contrast = (bare.value - inked.value).max(1e-4);
        let noise = 0.5 * (bare.noise + inked.noise) + ROUNDING;
        let area = PI * radius_px * radius_px * truth.facing.max(0.05);
        let gap = middles
            .iter()
            .zip(truths)
            .enumerate()
            .filter(|(j, _)| *j != i)
            .map(|(_, (m, t))| {
                m.dot(&truth.direction).clamp(-1.0, 1.0).acos() / (t.radius_rad + truth.radius_rad)
            })
            .fold(10.0f64, f64::min);
        let [e1, e2] = tangent_frame(&n);
        let (mut print, mut hidden, mut darkest, mut lightest) = (0.0, 0.0, f64::INFINITY, 0.0f64);
        for k in 0..AROUND {
            let (s, c) = (TAU * k as f64 / AROUND as f64).sin_cos();
            let at = |reach: f64| (n + (e1 * c + e2 * s) * (reach * truth.radius_rad)).normalize();
            let beside = at(1.8);
            let there = luma(self.surface.under(&(self.rotation.inverse() * beside)));
            print += f64::from((there - under).abs() / ball);
            let [inside, occluded] = self.inside_and_hidden(view.project(&at(1.0)));
            hidden += f64::from(u8::from(!inside || occluded));
            let level = self.level(view, &beside, ball).value;
            darkest = darkest.min(level);
            lightest = lightest.max(level);
        }
        let count = AROUND as f64;
        [
            radius_px.ln(),
            truth.facing,
            (self.blur_at(view, &n) / radius_px).ln(),
            contrast / bare.value.max(0.02),
            (contrast * area.sqrt() / noise).ln().clamp(-4.0, 7.0),
            bare.value,
            gap.max(0.3).ln().min(1.6),
            (print / count).min(1.0),
            hidden / count,
            self.loss(),
            (lightest - darkest) / bare.value.max(0.02),
            view.distance().map_or(0.0, |d| 1.0 / d),
        ]
    }

    fn ball_observables(&self, view: &View) -> ([f64; BALL_OBSERVABLES.len()], Vec<Pixel>) {
        let radius = self.circle.radius;
        let ball = luma(self.surface.ball);
        let to_camera = view.to_view().inverse();
        let inverse_distance = view.distance().map_or(0.0, |d| 1.0 / d);
        let (mut inner, mut outer, mut edges) = (Vec::new(), Vec::new(), Vec::new());
        let z = (inverse_distance + 0.25).min(0.9);
        let across = (1.0 - z * z).sqrt();
        let outline = view.outline();
        for k in 0..RIM {
            let (s, c) = (TAU * k as f64 / RIM as f64).sin_cos();
            let n = to_camera * Vec3::new(across * c, across * s, z);
            let rim = Pixel {
                u: outline.center.u + 1.12 * radius * c,
                v: outline.center.v - 1.12 * radius * s,
            };
            let [inside, occluded] = self.inside_and_hidden(rim);
            if !inside || occluded {
                continue;
            }
            let within = self.level(view, &n, ball).value;
            let behind = luma(
                self.background
                    .at(rim.u.max(0.0) as usize, rim.v.max(0.0) as usize),
            );
            let behind = self.encoded(behind);
            inner.push(within);
            outer.push(behind);
            edges.push((within - behind).abs() / within.max(behind).max(0.02));
        }
        let (mut printed, mut share, mut level, mut noise, mut count) =
            (Vec::new(), 0.0, 0.0, 0.0, 0.0f64);
        for n in spiral_directions(2 * SIDE) {
            let n = to_camera * n;
            if view.facing(&n) < 0.15 {
                continue;
            }
            count += 1.0;
            let off = f64::from(
                (luma(self.surface.under(&(self.rotation.inverse() * n))) - ball).abs() / ball,
            );
            if off > PRINTED {
                share += 1.0;
                printed.push(view.project(&n));
            }
            let there = self.level(view, &n, ball);
            level += there.value;
            noise += there.noise;
        }
        let count = count.max(1.0);
        let weak = edges.iter().filter(|e| **e < WEAK_EDGE).count();
        let shown = edges.len().max(1) as f64;
        let observables = [
            radius.ln(),
            self.rim(&outline),
            ((self.sensor.defocus_px.powi(2)
                + self.shift_px[0].hypot(self.shift_px[1]).powi(2) / 12.0
                + PIXEL_BLUR.powi(2))
            .sqrt()
                / radius)
                .ln(),
            mean(&edges),
            weak as f64 / shown,
            (noise / count + ROUNDING).ln(),
            level / count,
            self.loss(),
            deviation(&outer),
            share / count,
            deviation(&inner),
            inverse_distance,
        ];
        (
            observables.map(|x| if x.is_finite() { x } else { 0.0 }),
            printed,
        )
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

    fn encoded(&self, light: f32) -> f64 {
        f64::from(self.sensor.encode(self.sensor.gain * light.max(0.0)))
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

    /// How much the compression takes: 0 for none, some 1 for the strongest in use.
    fn loss(&self) -> f64 {
        match self.sensor.compression {
            Compression::None => 0.0,
            Compression::Jpeg { quality, .. } => (100.0 - f64::from(quality)) / 70.0,
            Compression::Video { qp } => ((f64::from(qp) - 14.0) / 22.0).max(0.0),
        }
    }
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

fn deviation(values: &[f64]) -> f64 {
    let middle = mean(values);
    let squares: f64 = values.iter().map(|x| (x - middle).powi(2)).sum();
    (squares / values.len().max(1) as f64).sqrt()
}
