//! The pixels about a rim, between the knots of its light, and their normal equations.

use std::f64::consts::TAU;

use fearless_simd::prelude::*;
use fearless_simd::{Level, Simd, dispatch, f64x4};
use nalgebra::{SVector, Vector2};

use super::chain::{BY_PIXEL, KNOTS, LIGHTS, LimbChain};
use super::limb::{LimbLight, LimbTable, TERMS};
use super::state::{LONGEST, LOSS, LimbState};
use crate::fit::{FourPixels, LanePixels, LaneSums, Sums};
use crate::image::GrayImage;
use crate::vision::dots::cap::Tone;
use crate::vision::optics::ball_pixels::BallPixels;
use crate::vision::optics::camera::{BallCircle, BallView, Pixel};

/// Pixels are read from so many within the outline to so many beyond it, and so many deviations of the blur; within, so many radii, too.
const READ: ([f64; 2], [f64; 2]) = ([3.0, 1.5], [1.2, 2.5]);
const READ_RADII: f64 = 0.04;
/// Of larger balls every second, third, ... pixel is read, so that there are about so many.
const MANY_PIXELS: f64 = 1800.0;
/// The least light that the ball is taken for.
const LEAST_LIGHT: f64 = 1e-3;
/// Added to the tone curve's slope where a pixel is weighed: a small slope is not known well.
const SOFT_SLOPE: f64 = 0.1;
/// Capacity for pixels between two knots beforehand.
const EXPECTED_PIXELS: usize = 768;
/// And for circles.
const EXPECTED_HIDDEN: usize = 64;

/// The pixels between two knots: how many pixels each lies within the outline, its value, how far it is from the first to the second,
/// and outwards in the image.
type RimPixels = LanePixels<5>;

/// All of them; keeps its memory.
#[derive(Debug)]
pub(super) struct RimBand {
    level: Level,
    pixels: [RimPixels; KNOTS],
    /// What hides the rim, in the image.
    hidden: Vec<BallCircle>,
}

impl Default for RimBand {
    fn default() -> Self {
        Self {
            level: Level::new(),
            pixels: std::array::from_fn(|_| RimPixels::with_capacity(EXPECTED_PIXELS)),
            hidden: Vec::with_capacity(EXPECTED_HIDDEN),
        }
    }
}

/// A knot of the rim.
#[derive(Debug, Clone, Copy, Default)]
struct Knot {
    /// Outwards, unit vector in the image.
    normal: Vector2<f64>,
    /// Ball radii along a pixel.
    scale: f64,
    /// From the outline's center, pixels.
    off: f64,
}

impl RimBand {
    /// Hides what these circles of the image show.
    pub(super) fn hide(&mut self, circles: impl Iterator<Item = BallCircle>) {
        self.hidden.clear();
        self.hidden.extend(circles);
    }

    /// How many pixels were read.
    pub(super) fn count(&self) -> usize {
        self.pixels.iter().map(RimPixels::len).sum()
    }

    /// The normal equations at a state, and the weighted mean of the squares that it leaves.
    pub(super) fn equations(
        &self,
        table: &LimbTable,
        state: &LimbState,
        bend: f64,
    ) -> (LimbChain, f64) {
        let (mut chain, [mut squares, mut weights]) = (LimbChain::default(), [0.0; 2]);
        self.each_sector(table, state, bend, |knot, part| {
            squares += part.squares;
            weights += part.weights;
            chain.add(knot, part);
        });
        (chain, squares / weights)
    }

    /// The same, and the gradient of each sector: of the pixels between a knot and the next.
    pub(super) fn pulls(
        &self,
        table: &LimbTable,
        state: &LimbState,
        bend: f64,
    ) -> (LimbChain, [SVector<f64, BY_PIXEL>; KNOTS]) {
        let (mut chain, mut pulls) = (LimbChain::default(), [SVector::zeros(); KNOTS]);
        self.each_sector(table, state, bend, |knot, part| {
            pulls[knot] = SVector::from(part.gradient);
            chain.add(knot, part);
        });
        (chain, pulls)
    }

    /// Hands out the sums over the pixels between each knot and the next.
    fn each_sector(
        &self,
        table: &LimbTable,
        state: &LimbState,
        bend: f64,
        mut take: impl FnMut(usize, &Sums<BY_PIXEL>),
    ) {
        for (knot, pixels) in self.pixels.iter().enumerate() {
            let part =
                dispatch!(self.level, simd => sums(simd, pixels, table, (state, knot), bend));
            take(knot, &part);
        }
    }

    /// The light of the ball or of what is behind it, whichever is brighter.
    pub(super) fn light_scale(&self, bend: f64) -> f64 {
        let mut sums = [[0.0; 2]; 2];
        for [within, value, ..] in self.pixels.iter().flat_map(RimPixels::each) {
            let sum = &mut sums[usize::from(within > 0.0)];
            sum[0] += Tone::light(bend, value);
            sum[1] += 1.0;
        }
        let means = sums.map(|[sum, count]| sum / f64::max(count, 1.0));
        means[0].max(means[1]).max(LEAST_LIGHT)
    }

    /// Reads the pixels near the rim, or means of squares of them; the depths between which they lie.
    pub(super) fn read(
        &mut self,
        pixels: &BallPixels<'_>,
        blur: f64,
        level: u32,
    ) -> Option<[f64; 2]> {
        let BallPixels { gray, grid, view } = pixels;
        let cell = 1usize << level;
        let side = grid.side * cell as f64;
        let circle = view.circle();
        let (depths, blurs) = READ;
        let [inner, outer] = [0, 1].map(|k| depths[k] * side + blurs[k] * blur);
        let inner = inner + READ_RADII * circle.radius;
        let area = TAU * circle.radius * (inner + outer) / (side * side);
        let stride = ((area / MANY_PIXELS).ceil() as usize).max(1);
        let mut knots = [Knot::default(); KNOTS];
        for (k, knot) in knots.iter_mut().enumerate() {
            *knot = knot_at(view, TAU * k as f64 / KNOTS as f64)?;
        }
        // Off the axis the outline is no circle about where the ball's center is seen.
        let [nearest, farthest] = knots
            .iter()
            .fold([f64::INFINITY, 0.0], |[least, most], knot| {
                [knot.off.min(least), knot.off.max(most)]
            });
        let ring = [nearest - inner - 2.0 * side, farthest + outer + 2.0 * side];
        let ring = ring.map(|radius| radius.max(0.0) / side);
        let middle = grid.pixel_to_part(circle.center);
        let half = 0.5 * (cell as f64 - 1.0);
        // In squares.
        let middle = [middle.u, middle.v].map(|at| (at - half) / cell as f64);
        // From the first to the last of so many that lie within `reach` of the middle; the image's border is not read.
        let near = |middle: f64, reach: f64, count: usize| {
            let end = (middle + reach + 1.0).clamp(0.0, (count / cell) as f64 - 1.0);
            (middle - reach).ceil().max(1.0) as usize..end as usize
        };
        self.pixels.iter_mut().for_each(RimPixels::clear);
        for row in near(middle[1], ring[1], gray.height()) {
            let off = (row as f64 - middle[1]).powi(2);
            let [hole, end] = ring.map(|radius| (radius * radius - off).max(0.0).sqrt());
            for column in near(middle[0], end, gray.width()) {
                if (column as f64 - middle[0]).abs() < hole || (row + column) % stride != 0 {
                    continue;
                }
                let at = grid.pixel_to_image(Pixel {
                    u: (column * cell) as f64 + half,
                    v: (row * cell) as f64 + half,
                });
                let aside = view.aside(at);
                let turn = aside.y.atan2(aside.x).rem_euclid(TAU) / TAU * KNOTS as f64;
                let knot = (turn as usize).min(KNOTS - 1);
                let share = turn - knot as f64;
                let [from, to] = [&knots[knot], &knots[(knot + 1) % KNOTS]];
                let scale = from.scale + share * (to.scale - from.scale);
                let within = (1.0 - aside.norm()) / scale;
                if !(-outer..=inner).contains(&within) || self.is_hidden(at) {
                    continue;
                }
                let normal = (from.normal * (1.0 - share) + to.normal * share).normalize();
                let value = mean(gray, [column, row].map(|k| k * cell), cell);
                self.pixels[knot].push(&[within, value, share, normal.x, normal.y]);
            }
        }
        let moved = LONGEST.0 * side;
        Some([-outer - 2.0 * moved, inner + 2.0 * moved])
    }

    fn is_hidden(&self, at: Pixel) -> bool {
        self.hidden.iter().any(|by| {
            let off = (at.u - by.center.u).powi(2) + (at.v - by.center.v).powi(2);
            off < by.radius * by.radius
        })
    }
}

/// The mean of a square of pixels.
fn mean(gray: &GrayImage, [left, top]: [usize; 2], side: usize) -> f64 {
    let rows = (top..top + side).map(|v| gray.row(v, left, side));
    let sum: f64 = rows.flatten().map(|value| f64::from(*value)).sum();
    sum / (side * side) as f64
}

/// The knot of the rim at an angle of the view frame.
fn knot_at(view: &BallView, angle: f64) -> Option<Knot> {
    let at = view.limb(angle);
    let radii = |du: f64, dv: f64| {
        let pixel = Pixel {
            u: at.u + du,
            v: at.v + dv,
        };
        view.aside(pixel).norm()
    };
    let by_pixel = Vector2::new(
        radii(0.5, 0.0) - radii(-0.5, 0.0),
        radii(0.0, 0.5) - radii(0.0, -0.5),
    );
    let scale = by_pixel.norm();
    (scale > 0.0).then(|| Knot {
        normal: by_pixel / scale,
        scale,
        off: (at.u - view.circle().center.u).hypot(at.v - view.circle().center.v),
    })
}

/// The sums over the pixels between a knot and the next.
#[inline(always)]
fn sums<S: Simd>(
    simd: S,
    pixels: &RimPixels,
    table: &LimbTable,
    (state, knot): (&LimbState, usize),
    bend: f64,
) -> Sums<BY_PIXEL> {
    let (from, to) = (&state.light[knot], &state.light[(knot + 1) % KNOTS]);
    let mut sums = LaneSums::new(simd);
    for FourPixels { numbers, counts } in pixels.fours() {
        let [within, value, share, u, v] = numbers.map(|x| f64x4::simd_from(simd, x));
        let [twice_u, twice_v] = [u * u - v * v, u * v * 2.0];
        let depth = u * state.change.x + v * state.change.y + within + state.change.z;
        let depth = twice_u * state.oval.x + twice_v * state.oval.y + depth;
        let LimbLight {
            terms,
            by_depth,
            by_blur,
            by_darkening,
        } = table.at(depth);
        let light: [f64x4<S>; LIGHTS] =
            std::array::from_fn(|k| share * (to[k] - from[k]) + from[k]);
        let lit = |by: &[f64x4<S>; TERMS]| by[0] * light[1] + by[1] * light[2] + by[2] * light[3];
        let one = f64x4::splat(simd, 1.0);
        let before = one - share;
        let at = [one, terms[0], terms[1], terms[2]];
        let moved = lit(&by_depth);
        let mut by = [one; BY_PIXEL];
        for (k, basis) in at.into_iter().enumerate() {
            (by[k], by[LIGHTS + k]) = (before * basis, share * basis);
        }
        let shared = [
            moved * u,
            moved * v,
            moved,
            lit(&by_blur),
            moved * twice_u,
            moved * twice_v,
            lit(&by_darkening),
            value - value * value,
        ];
        by[2 * LIGHTS..].copy_from_slice(&shared);
        let residual = (value * bend + (1.0 - bend)) * value - lit(&terms) - light[0];
        let soft = value * (2.0 * bend) + (1.0 - bend + SOFT_SLOPE);
        let weight = f64x4::simd_from(simd, *counts) / (soft * soft);
        let weight = match state.noise {
            Some(variance) => {
                let squares = residual * residual / (soft * soft) * variance.recip();
                weight * LOSS.weight_each(squares)
            }
            None => weight,
        };
        sums.add(&by, residual, weight);
    }
    sums.total()
}
