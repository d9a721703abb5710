//! The ball's surface: its color, dots, logos, seams, stains.
//!
//! Positions are unit vectors in the pattern's frame. What the ball has besides the pattern's dots
//! is drawn apart from them, so that a ball keeps its color, logo and stains under every pattern.

use std::f64::consts::TAU;

use rand::{Rng, RngExt};

use super::color::{Color, luma, mix, near};
use super::config::{SynthConfig, SynthKind};
use super::dimples::Dimples;
use super::logo::{Logo, LogoKind};
use super::pen::{Spot, draw_pattern, draw_strangers};
use super::random::{Stream, Streams, between};
use crate::geometry::{Vec3, random_direction, tangent_frame};
use crate::pattern::Pattern;

/// A logo on the ball.
#[derive(Debug, Clone, PartialEq)]
pub struct LogoPrint {
    /// What it looks like.
    pub logo: Logo,
    /// Its middle.
    pub middle: Vec3,
    /// The axes of its plane.
    pub axes: [Vec3; 2],
    /// Its angular radius, radians.
    pub radius: f64,
    /// Its color, linear light.
    pub color: Color,
}

impl LogoPrint {
    /// Ink at a direction (pattern's frame), in [0, 1].
    pub fn ink(&self, direction: &Vec3) -> f32 {
        self.ink_at(
            direction.dot(&self.middle) as f32,
            self.axes.map(|a| direction.dot(&a) as f32),
        )
    }

    /// Ink where a direction has these components along the mark's middle and its axes.
    pub(super) fn ink_at(&self, along: f32, [a, b]: [f32; 2]) -> f32 {
        let across = (a * a + b * b).sqrt();
        let angle = across.atan2(along);
        let scale = if across > 1e-6 { angle / across } else { 1.0 } / self.radius as f32;
        self.logo.ink(a * scale, b * scale)
    }

    /// Turns the mark about the ball's center until its middle is at `middle`.
    pub(super) fn move_to(&mut self, middle: Vec3) {
        self.middle = middle;
        self.axes = tangent_frame(&middle);
    }
}

/// The line where a ball's halves meet.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HalvesSeam {
    /// The axis of its great circle.
    pub axis: Vec3,
    /// Half its angular width, radians.
    pub half_width: f64,
    /// Its color, linear light.
    pub color: Color,
    /// Share of the ball's color that it covers, in [0, 1].
    pub strength: f32,
}

/// All that is on a ball.
#[derive(Debug, Clone, PartialEq)]
pub struct Surface {
    /// Color of the ball, linear light.
    pub ball: Color,
    /// Color of the dots' ink.
    pub ink: Color,
    /// The pattern's dots as drawn, by index; `None` where one was left out.
    pub dots: Vec<Option<Spot>>,
    /// Dots in the same ink that belong to no pattern or to another one.
    pub strangers: Vec<Spot>,
    /// Stains, pores and speckles.
    pub stains: Vec<Spot>,
    /// Color of the stains.
    pub stain_color: Color,
    /// Seams.
    pub seams: Vec<HalvesSeam>,
    /// Logos.
    pub marks: Vec<LogoPrint>,
    /// Hollows, as of a golf ball.
    pub dimples: Option<Dimples>,
}

impl Surface {
    /// A random ball, with the hand-drawn pattern where the kind has one.
    pub(super) fn random(pattern: &Pattern, config: &SynthConfig, streams: Streams) -> Self {
        let mut surface = Self::bare(config, &mut streams.of(Stream::Ball));
        let dots = &mut streams.of(Stream::Dots);
        let pen = &mut streams.of(Stream::Pen);
        surface.ink = ink_color(config, pen);
        match config.kind {
            SynthKind::Dotted => surface.dots = draw_pattern(pattern, config, pen, dots),
            SynthKind::OtherPattern => surface.strangers = draw_strangers(config, pen, dots),
            _ => {}
        }
        if let Some(blotches) = &config.blotches {
            let paint = &mut streams.of(Stream::Paint);
            let mut spots = blotches.draw(paint);
            // Every other ball has a second color.
            let second = if paint.random_bool(0.5) {
                spots.len() / 2
            } else {
                0
            };
            surface
                .strangers
                .extend(spots.split_off(spots.len() - second));
            surface.stains.extend(spots);
        }
        surface
    }

    /// A ball without dots.
    fn bare<R: Rng + ?Sized>(config: &SynthConfig, rng: &mut R) -> Self {
        let any = ball_color(config.kind, rng);
        // Golf balls are white.
        let ball = if config.dimples { [0.85; 3] } else { any };
        // A fixed number of draws comes before what the kind decides.
        let [has_logo, has_second, has_seam] = [
            rng.random_bool(config.logo_probability),
            rng.random_bool(0.15),
            rng.random_bool(config.seam_probability),
        ];
        let kind = config.kind;
        let is_usual = matches!(
            kind,
            SynthKind::Dotted | SynthKind::OtherPattern | SynthKind::Dotless
        );
        let logos = match kind {
            SynthKind::LogoOnly => 1 + usize::from(has_second),
            _ if is_usual && has_logo => 1 + usize::from(has_second),
            _ => 0,
        };
        let seams = match kind {
            SynthKind::SeamsOnly => rng.random_range(1..=3),
            _ if is_usual && has_seam => 1,
            _ => 0,
        };
        let mut marks: Vec<LogoPrint> = (0..logos).map(|_| random_mark(config, rng)).collect();
        if kind == SynthKind::Wheel {
            marks.push(wheel(ball, rng));
        }
        let stain_color = near([0.10, 0.08, 0.06], 0.5, rng);
        let seams = (0..seams).map(|_| random_seam(ball, rng)).collect();
        let stains = match kind {
            SynthKind::Fruit => pores(rng),
            SynthKind::Speckled => speckles(rng),
            _ if config.stains && kind != SynthKind::Lamp => stains(rng),
            _ => Vec::new(),
        };
        Self {
            ball,
            ink: [0.0; 3],
            dots: Vec::new(),
            strangers: Vec::new(),
            stains,
            stain_color,
            seams,
            marks,
            dimples: config.dimples.then(Dimples::golf),
        }
    }

    /// Color under the pattern's dots at a direction (pattern's frame): the ball's or a logo's.
    pub fn under(&self, direction: &Vec3) -> Color {
        self.marks.iter().fold(self.ball, |under, mark| {
            mix(under, mark.color, mark.ink(direction))
        })
    }
}

fn random_mark<R: Rng + ?Sized>(config: &SynthConfig, rng: &mut R) -> LogoPrint {
    let middle = random_direction(rng);
    let [e1, e2] = tangent_frame(&middle);
    let (s, c) = (TAU * rng.random::<f64>()).sin_cos();
    let dark = rng.random_range(0.02..0.25f32);
    let color = if rng.random_bool(0.6) {
        [dark; 3]
    } else {
        // A colored print: one channel may stay bright.
        [0, 1, 2].map(|_| dark * rng.random_range(0.5..2.5f32))
    };
    LogoPrint {
        logo: Logo::random(LogoKind::random(rng), rng),
        middle,
        axes: [e1 * c + e2 * s, e2 * c - e1 * s],
        radius: between(config.logo_radius_rad, rng),
        color,
    }
}

/// Rim, hub and spokes over the whole of the disc.
fn wheel<R: Rng + ?Sized>(ball: Color, rng: &mut R) -> LogoPrint {
    let dark = rng.random_range(0.02..0.4) * luma(ball).max(0.1);
    let middle = Vec3::z();
    LogoPrint {
        logo: Logo::random(LogoKind::Wheel, rng),
        middle,
        axes: tangent_frame(&middle),
        radius: std::f64::consts::FRAC_PI_2,
        color: near([dark; 3], 0.2, rng),
    }
}

fn random_seam<R: Rng + ?Sized>(ball: Color, rng: &mut R) -> HalvesSeam {
    let is_dark = rng.random_bool(0.75);
    HalvesSeam {
        axis: random_direction(rng),
        half_width: rng.random_range(0.004..0.03),
        color: if is_dark {
            ball.map(|c| 0.4 * c)
        } else {
            ball.map(|c| 0.5 + 0.5 * c)
        },
        strength: rng.random_range(0.1..0.8),
    }
}

fn stains<R: Rng + ?Sized>(rng: &mut R) -> Vec<Spot> {
    (0..rng.random_range(0..=5))
        .map(|_| {
            let middle = random_direction(rng);
            let radius = rng.random_range(0.01..0.08);
            let darkness = rng.random_range(0.05..0.4) * if radius > 0.04 { 0.5 } else { 1.0 };
            let along = random_direction(rng);
            Spot::round(
                middle,
                radius,
                rng.random_range(0.3..1.0) * radius,
                darkness,
            )
            .stretched(along, rng.random_range(0.0..0.5))
        })
        .collect()
}

/// The skin of an orange: pores everywhere, and where the stem was.
fn pores<R: Rng + ?Sized>(rng: &mut R) -> Vec<Spot> {
    let darkness = rng.random_range(0.1..0.6f32);
    let mut spots: Vec<Spot> = (0..rng.random_range(60..250))
        .map(|_| {
            let radius = rng.random_range(0.008..0.035);
            let dark = darkness * rng.random_range(0.5..1.0f32);
            Spot::round(random_direction(rng), radius, 0.7 * radius, dark)
        })
        .collect();
    let radius = rng.random_range(0.04..0.16);
    let stem = random_direction(rng);
    spots.push(Spot::round(
        stem,
        radius,
        0.5 * radius,
        rng.random_range(0.4..1.0),
    ));
    spots
}

fn speckles<R: Rng + ?Sized>(rng: &mut R) -> Vec<Spot> {
    let largest = rng.random_range(0.03..0.25);
    (0..rng.random_range(15..150))
        .map(|_| {
            let radius = rng.random_range(0.2..1.0) * largest;
            let softness = radius * rng.random_range(0.05..0.9);
            let darkness = rng.random_range(0.1..1.0);
            Spot::round(random_direction(rng), radius, softness, darkness)
                .stretched(random_direction(rng), rng.random_range(0.0..0.5))
        })
        .collect()
}

/// Mostly black and worn black, sometimes colored.
fn ink_color<R: Rng + ?Sized>(config: &SynthConfig, rng: &mut R) -> Color {
    let dark = rng.random_range(0.015..0.14f32);
    let base = match rng.random_range(0..4) {
        0 => [0.02, 0.05, 0.35],
        1 => [0.35, 0.03, 0.03],
        2 => [0.02, 0.22, 0.06],
        _ => [0.12, 0.05, 0.02],
    };
    if rng.random_bool(config.colored_ink_share) {
        near(base, 0.4, rng)
    } else {
        near([dark; 3], 0.25, rng)
    }
}

/// White, orange, yellow, or any color bright enough for dark dots.
fn ball_color<R: Rng + ?Sized>(kind: SynthKind, rng: &mut R) -> Color {
    let any = [
        rng.random_range(0.2..0.9),
        rng.random_range(0.3..0.9),
        rng.random_range(0.2..0.9),
    ];
    let which = rng.random_range(0..10);
    let base: Color = match (kind, which) {
        (SynthKind::Lamp, _) => [1.0; 3],
        (SynthKind::Fruit, 0..7) => [0.80, 0.32, 0.05],
        (SynthKind::Fruit, _) => any,
        (_, 0..4) => [0.85, 0.85, 0.82],
        (_, 4..7) => [0.80, 0.32, 0.06],
        (_, 7..9) => [0.80, 0.70, 0.12],
        _ => any,
    };
    near(base, 0.14, rng).map(|c| c.clamp(0.02, 0.98))
}
