//! Light on the ball: lamps, shadows and highlights.
//!
//! The light from a point of the ball with the normal `n` is
//!
//! `albedo (ambient + s sum_i lamp_i max(0, n . l_i)) (1 - limb (1 - f)) + s sum_i gloss_i max(0, n
//! . h_i)^m_i`,
//!
//! with `f` the cosine at which the surface is seen and `s` the share of light that a shadow leaves
//! (Lambert; a little darker towards the limb; Blinn's highlight with the half vector `h`: J. F.
//! Blinn, SIGGRAPH 1977).

use rand::{Rng, RngExt};

use super::color::{Color, luma, scaled, tint};
use super::config::{SynthConfig, SynthKind};
use super::random::between_f32;
use crate::geometry::{Vec3, random_direction, random_direction_above};

/// A lamp far away.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lamp {
    /// The direction to it, camera frame.
    pub from: Vec3,
    /// Its light on a surface that faces it.
    pub color: Color,
    /// Strength of its highlight.
    pub gloss: f32,
    /// Sharpness of its highlight (Blinn and Phong's exponent).
    pub sharpness: f32,
}

/// The shadow of something, whose edge is a circle on the ball.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shadow {
    /// The middle of the shaded side, camera frame.
    pub towards: Vec3,
    /// Cosine of the angle from there to the edge.
    pub edge: f32,
    /// Half the width of the edge, in the cosine.
    pub softness: f32,
    /// Share of the lamps' light that it takes.
    pub depth: f32,
}

/// All light on the ball.
#[derive(Debug, Clone, PartialEq)]
pub struct Light {
    /// Light from everywhere.
    pub ambient: Color,
    /// Lamps.
    pub lamps: Vec<Lamp>,
    /// A shadow.
    pub shadow: Option<Shadow>,
    /// Darkening at the limb, in [0, 1].
    pub limb: f32,
}

impl Light {
    /// The same light from everywhere.
    pub fn even(color: Color) -> Self {
        Self {
            ambient: color,
            lamps: Vec::new(),
            shadow: None,
            limb: 0.0,
        }
    }

    /// Random light.
    pub(super) fn random<R: Rng + ?Sized>(config: &SynthConfig, rng: &mut R) -> Self {
        let ambient = between_f32(config.ambient, rng);
        let color = tint(rng);
        let lamps = 1 + usize::from(rng.random_bool(config.second_lamp_share));
        let is_shaded = rng.random_bool(config.shadow_share);
        let lamps: Vec<Lamp> = (0..lamps)
            .map(|k| {
                let mut lamp = Lamp::random(config, rng);
                let share = (1.0 - ambient)
                    * if k == 0 {
                        1.0
                    } else {
                        rng.random_range(0.2..0.9)
                    };
                lamp.color = scaled(lamp.color, share);
                lamp
            })
            .collect();
        let light = Self {
            ambient: scaled(color, ambient),
            lamps,
            shadow: is_shaded.then(|| Shadow::random(rng)),
            limb: between_f32([0.0, config.max_limb], rng),
        };
        match config.kind {
            SynthKind::Lamp => Self::even(scaled(color, rng.random_range(1.0..3.0))),
            // A disc is flat.
            SynthKind::Wheel => Self::even(color),
            _ => light,
        }
    }

    /// Gray of a white surface in full light.
    pub fn brightest(&self) -> f32 {
        luma(self.ambient) + self.lamps.iter().map(|l| luma(l.color)).fold(0.0, f32::max)
    }

    /// Factor on the albedo, and highlight, at a normal that is seen at the cosine `facing`;
    /// `towards` leads to the camera.
    pub(super) fn at(&self, n: &Vec3, facing: f64, towards: &Vec3) -> [Color; 2] {
        let left = self.shadow.map_or(1.0, |s| s.leaves(n));
        let (mut factor, mut gloss) = (self.ambient, [0.0; 3]);
        for lamp in &self.lamps {
            let lambert = left * n.dot(&lamp.from).max(0.0) as f32;
            for (f, c) in factor.iter_mut().zip(lamp.color) {
                *f += lambert * c;
            }
            if lamp.gloss > 0.0 {
                let half = (lamp.from + towards)
                    .try_normalize(1e-9)
                    .unwrap_or(*towards);
                let shine = (n.dot(&half).max(0.0) as f32).powf(lamp.sharpness);
                for (g, c) in gloss.iter_mut().zip(lamp.color) {
                    *g += left * lamp.gloss * shine * c;
                }
            }
        }
        let limb = 1.0 - self.limb * (1.0 - facing as f32);
        [scaled(factor, limb), gloss]
    }
}

impl Lamp {
    fn random<R: Rng + ?Sized>(config: &SynthConfig, rng: &mut R) -> Self {
        let is_glossy = rng.random_bool(0.6);
        let gloss = between_f32([0.0, config.max_gloss], rng);
        Self {
            // From behind the ball, too, as far as a crescent is lit.
            from: random_direction_above(rng, -0.2),
            color: scaled(tint(rng), rng.random_range(0.6..1.2)),
            gloss: if is_glossy { gloss } else { 0.0 },
            sharpness: 8.0 * 20f32.powf(rng.random::<f32>()),
        }
    }
}

impl Shadow {
    fn random<R: Rng + ?Sized>(rng: &mut R) -> Self {
        Self {
            towards: random_direction(rng),
            edge: rng.random_range(-0.2..0.8),
            softness: 0.2 * rng.random::<f32>().powi(2) + 0.005,
            depth: rng.random_range(0.4..1.0),
        }
    }

    /// Share of the lamps' light that reaches the ball at the normal `n`.
    fn leaves(&self, n: &Vec3) -> f32 {
        let inside: f32 = (n.dot(&self.towards) as f32 - self.edge) / self.softness.max(1e-6);
        1.0 - self.depth * (0.5 + 0.5 * inside).clamp(0.0, 1.0)
    }
}
