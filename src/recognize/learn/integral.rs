//! The noise's part of an explanation's likelihood, integrated over the rotations about its own.
//!
//! A dot that lies `r` standard deviations (two axes) off its place at the explanation's rotation lies `r + J w` off
//! where that is turned by a small `w`, with `J` the rows `q x u` of its axes `u`. With `L L^T = sum J^T J` the
//! information of the rotation and `w = s L^-T x`, noise of scale `s` and density `k` gives Laplace's factor times
//!
//! ```text
//! s^(3 - 2 matched) int prod_matched k(|r / s + J L^-T x|) dx / (2 pi)^(3/2)
//! ```
//!
//! For one Gaussian, fitted by least squares, it is the value at the explanation's own rotation, `exp(-sum r^2 / 2)`. A
//! peaked density is another matter: the rotation takes a part of the noise, and what is left has no peak. Taken for
//! the noise itself it looks like larger noise, by a third for four dots.
//!
//! The integral is taken by importance sampling at fixed [nodes](crate::recognize::nodes), half of
//! them from a narrow normal distribution and half from a wide one (the balance heuristic: E. Veach and L.
//! Guibas, SIGGRAPH 1995). A density with a pole keeps it: where it is cut at a share of the noise's scale, dots near
//! it favor a smaller scale, by a tenth for a cut at 0.3. The density is its mean only over the disc that the nodes leave
//! between them, as otherwise few nodes miss the pole, and a rare one that does not weighs too much.
//!
//! Not guaranteed: rotations so far off that `q` does not move along `w x q`.

use std::ops::Range;
use std::sync::LazyLock;

use nalgebra::Matrix3;

use super::{NOISES, SCALES, SHAPES, scale};
use crate::geometry::Vec3;
use crate::recognize::ln_sum::LnSum;
use crate::recognize::nodes::normal_nodes;
use crate::view::NoiseShape;

/// Rotations at which the integrand is evaluated. Beside 768 of them the scale learned is off by up to 1.6 %
/// (3 to 18 dots a view); with half as many, views of four dots say a fifth less of the shape.
const NODES: usize = 64;
/// Standard deviations of the two distributions they are taken from, over those that a Gaussian's information
/// leaves: a peaked density leaves less, and heavy tails more. The integral does not depend on them, but how
/// exact the sum is.
const WIDTHS: [f64; 2] = [0.6, 1.25];
/// The side of the cube that one of the narrow distribution's nodes stands for, in standard deviations of the
/// rotation: `n` nodes of a normal distribution of width `w` share `(sqrt(2 pi) w)^3`. Here `n^(1/3)` is that of 32.
const SIDE: f64 = 2.506_628_274_631 * WIDTHS[0] / 3.174_802_103_936;
/// The least disc, and the end of the table, in squared standard deviations.
const NEAR: f64 = 1.0 / 1024.0;
/// Squared standard deviations from which on a density does not fall.
const FAR: f64 = 1024.0;
/// Pieces of a table of densities for each factor of two in squared standard deviations, as a power of two.
const PIECE_BITS: u32 = 5;

/// A turn in the units of the rotation's standard deviations.
#[derive(Debug, Clone, Copy)]
struct RotationNode {
    at: Vec3,
    /// ln of the standard normal density's peak over the density that the node is taken from.
    ln_weight: f64,
}

static ROTATIONS: LazyLock<[RotationNode; NODES]> = LazyLock::new(|| {
    let nodes: [Vec3; NODES] = normal_nodes();
    std::array::from_fn(|k| {
        // Opposite nodes are of the same width.
        let at = nodes[k] * WIDTHS[k / 2 % WIDTHS.len()];
        let density =
            |width: f64| (-0.5 * at.norm_squared() / (width * width)).exp() / width.powi(3);
        let mean = WIDTHS.map(density).iter().sum::<f64>() / WIDTHS.len() as f64;
        RotationNode {
            at,
            ln_weight: -mean.ln(),
        }
    })
});

/// ln of the densities of all shapes by the squared number of standard deviations, over the Gaussian's peak.
#[derive(Debug, Clone)]
pub(super) struct Densities {
    /// At the ends of the pieces, which are equal parts of each factor of two.
    table: Vec<[f64; SHAPES.len()]>,
}

impl Densities {
    pub fn new() -> Self {
        let at = |square: f64| SHAPES.map(|shape| shape.ln_density(square.sqrt()));
        Self {
            table: (0..=piece(FAR) + 1).map(|k| at(end(k))).collect(),
        }
    }

    fn ln_at(&self, square: f64) -> [f64; SHAPES.len()] {
        let square = square.clamp(NEAR, FAR);
        let k = piece(square);
        // What the piece leaves of the mantissa.
        let bits = f64::MANTISSA_DIGITS - 1 - PIECE_BITS;
        let left = square.to_bits() & ((1 << bits) - 1);
        let share = left as f64 / (1u64 << bits) as f64;
        let [from, to] = [self.table[k], self.table[k + 1]];
        std::array::from_fn(|s| from[s] + (to[s] - from[s]) * share)
    }
}

/// The piece that holds a value, not below [`NEAR`].
fn piece(square: f64) -> usize {
    let place = |x: f64| x.to_bits() >> (f64::MANTISSA_DIGITS - 1 - PIECE_BITS);
    (place(square) - place(NEAR)) as usize
}

/// Where a piece begins.
fn end(piece: usize) -> f64 {
    let pieces = 1usize << PIECE_BITS;
    let part = (piece % pieces) as f64 / pieces as f64;
    NEAR * 2f64.powi((piece / pieces) as i32) * (1.0 + part)
}

/// A matched dot's displacement, standard deviations.
#[derive(Debug, Clone, Copy)]
pub(in crate::recognize) struct Displacement {
    /// Along its two axes, and towards the ball's center.
    at: [f64; 3],
    /// What a small rotation (radians, camera frame) adds along either axis, by its product with these.
    by: [Vec3; 2],
    /// Squared standard deviations of its disc, and ln of the mean densities in it.
    disc: f64,
    ln_within: [f64; SHAPES.len()],
}

impl Displacement {
    /// Its disc is known once all dots are.
    pub fn new(at: [f64; 3], by: [Vec3; 2]) -> Self {
        Self {
            at,
            by,
            disc: 0.0,
            ln_within: [0.0; SHAPES.len()],
        }
    }

    /// The disc that nodes of this side, in standard deviations of the rotation, leave between them as the dot sees
    /// it: each stands for the rotations nearest to it.
    fn set_disc(&mut self, covariance: &Matrix3<f64>) {
        let leverage: f64 = self.by.iter().map(|row| row.dot(&(covariance * row))).sum();
        self.disc = (0.5 * SIDE * SIDE * leverage).clamp(NEAR, 1.0);
        let mean = |shape: NoiseShape| (2.0 * shape.mass_within(self.disc.sqrt()) / self.disc).ln();
        self.ln_within = SHAPES.map(mean);
    }
}

impl Densities {
    /// Writes the logarithm of the integral, Laplace's factor left out, for every shape at some of the scales; `None`
    /// where the dots do not determine the rotation.
    ///
    /// The displacements were measured with the scale `measured`; `information` is [theirs](information).
    pub(super) fn integrate(
        &self,
        measured: f64,
        dots: &mut [Displacement],
        information: &Matrix3<f64>,
        scales: Range<usize>,
        noise: &mut [f64; NOISES],
    ) -> Option<()> {
        let factor = information.cholesky()?;
        let covariance = factor.inverse();
        dots.iter_mut().for_each(|dot| dot.set_disc(&covariance));
        let upper = factor.l().transpose();
        let ratios: [f64; SCALES] = std::array::from_fn(|n| measured / scale(n));
        let mut sums = [LnSum::default(); NOISES];
        for node in ROTATIONS.iter() {
            let step = upper.solve_upper_triangular(&node.at)?;
            let mut terms = [node.ln_weight; NOISES];
            for dot in &*dots {
                self.add(dot, &step, &ratios, scales.clone(), &mut terms);
            }
            for n in of_all_shapes(scales.clone()) {
                sums[n].add(terms[n]);
            }
        }
        let power = 3.0 - 2.0 * dots.len() as f64;
        for n in of_all_shapes(scales) {
            noise[n] = sums[n].ln() - (NODES as f64).ln() - power * ratios[n % SCALES].ln();
        }
        Some(())
    }

    /// Adds a dot's logarithms after a turn by `step`, of noise of the scale that was measured with; larger noise turns
    /// farther.
    fn add(
        &self,
        dot: &Displacement,
        step: &Vec3,
        ratios: &[f64; SCALES],
        scales: Range<usize>,
        terms: &mut [f64; NOISES],
    ) {
        let turned = dot.by.map(|row| row.dot(step));
        for n in scales {
            let [a, b, depth] = dot.at.map(|x| x * ratios[n]);
            let (a, b) = (a + turned[0], b + turned[1]);
            let square = a * a + b * b + depth * depth;
            let ln = match square < dot.disc {
                true => dot.ln_within,
                false => self.ln_at(square),
            };
            for (shape, ln) in ln.into_iter().enumerate() {
                terms[shape * SCALES + n] += ln;
            }
        }
    }
}

/// The information about the rotation that dots of normal noise hold.
pub(in crate::recognize) fn information(dots: &[Displacement]) -> Matrix3<f64> {
    let rows = dots.iter().flat_map(|dot| dot.by);
    rows.map(|row| row * row.transpose()).sum()
}

/// The noises of some scales.
fn of_all_shapes(scales: Range<usize>) -> impl Iterator<Item = usize> {
    (0..SHAPES.len()).flat_map(move |shape| scales.clone().map(move |n| shape * SCALES + n))
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix2x3, Vector2};
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::geometry::{random_direction_above, tangent_frame};
    use crate::recognize::learn::steps::over_steps;
    use crate::view::Noise;

    /// Dots moved by this noise, at the rotation of least squares, in standard deviations of 0.01 rad.
    fn displaced(dots: usize, noise: &Noise, rng: &mut ChaCha8Rng) -> Vec<Displacement> {
        let sigma = noise.tangent_sigma_rad();
        let mut all = Vec::new();
        for _ in 0..dots {
            let q = random_direction_above(rng, 0.3);
            let axes = tangent_frame(&q);
            let moved = noise.displaced(&q, 1.0, rng).direction;
            let [a, b] = axes.map(|u| -u.dot(&moved) / sigma);
            all.push(Displacement::new([a, b, 0.0], axes.map(|u| q.cross(&u))));
        }
        let rows = all.iter().flat_map(|d| d.by.into_iter().zip(d.at));
        let gradient: Vec3 = rows.map(|(row, at)| row * at).sum();
        let best = -information(&all).try_inverse().expect("determined") * gradient;
        for dot in &mut all {
            for (at, by) in dot.at.iter_mut().zip(dot.by) {
                *at += by.dot(&best);
            }
        }
        all
    }

    fn integrated(dots: &mut [Displacement]) -> [f64; NOISES] {
        let mut noise = [0.0; NOISES];
        let known = information(dots);
        let all = Densities::new().integrate(1.0, dots, &known, 0..SCALES, &mut noise);
        assert!(all.is_some());
        noise
    }

    /// The heavy-tailed mixture of a few dots is a sum of Gaussians, of which each integral is known: that of
    /// `exp(-(r + J w)^T V^-1 (r + J w) / 2)`.
    #[test]
    fn the_integral_of_a_mixture_is_that_of_its_gaussians() {
        let mut rng = ChaCha8Rng::seed_from_u64(64_970);
        let noise = Noise::HeavyTailed { sigma_rad: 0.01 };
        let mut off = Vec::new();
        for _ in 0..40 {
            let mut dots = displaced(4, &noise, &mut rng);
            let found = integrated(&mut dots);
            for n in [8, 10, 12] {
                let s = scale(n);
                let mut sum = 0.0;
                for wide in 0..1u32 << dots.len() {
                    let (mut h, mut g, mut square, mut share) =
                        (Matrix3::zeros(), Vec3::zeros(), 0.0, 1.0);
                    for (k, dot) in dots.iter().enumerate() {
                        let is_wide = wide >> k & 1 == 1;
                        let variance = if is_wide { 4.0 } else { 1.0 };
                        share *= if is_wide { 0.1 / 4.0 } else { 0.9 };
                        let j = Matrix2x3::from_rows(&dot.by.map(|row| row.transpose()));
                        let r = Vector2::new(dot.at[0], dot.at[1]) / s;
                        h += j.transpose() * j / variance;
                        g += j.transpose() * r / variance;
                        square += r.norm_squared() / variance;
                    }
                    let least = square - g.dot(&(h.try_inverse().expect("determined") * g));
                    sum += share
                        * (-0.5 * least).exp()
                        * (information(&dots).determinant() / h.determinant()).sqrt();
                }
                let expected = sum.ln() + (3.0 - 2.0 * dots.len() as f64) * s.ln();
                off.push(found[n] - expected);
            }
        }
        let rms = (off.iter().map(|x| x * x).sum::<f64>() / off.len() as f64).sqrt();
        assert!(rms < 0.1, "{rms}");
    }

    /// Most likely scale and shape of simulated views are those they were made with.
    #[test]
    fn simulated_noise_is_most_likely_at_its_own_scale() {
        let mut rng = ChaCha8Rng::seed_from_u64(64_971);
        for (shape, of) in SHAPES.iter().enumerate() {
            let noise = Noise::of_shape(*of, 0.01);
            for (dots, views) in [(4, 1500), (9, 600)] {
                let mut sum = [0.0; NOISES];
                for _ in 0..views {
                    let ln = integrated(&mut displaced(dots, &noise, &mut rng));
                    sum.iter_mut().zip(ln).for_each(|(sum, ln)| *sum += ln);
                }
                let of_shape = |s: usize| over_steps(&sum[s * SCALES..][..SCALES]);
                let (ln_own, step) = of_shape(shape);
                assert!(ln_own > of_shape(1 - shape).0, "{of:?}, {dots} dots");
                let found = scale(0) * (scale(1) / scale(0)).powf(step);
                // Four standard deviations of the scale of so many dots are 0.03 to 0.05.
                assert!((found - 1.0).abs() < 0.05, "{of:?}, {dots} dots: {found}");
            }
        }
    }

    #[test]
    fn the_table_holds_the_densities() {
        let table = Densities::new();
        for k in 0..1000 {
            let u = 0.04 + 0.03 * f64::from(k);
            for (shape, found) in SHAPES.iter().zip(table.ln_at(u * u)) {
                let exact = shape.ln_density(u);
                // Between the ends a straight line: the farther out, the more it cuts off.
                assert!(
                    (found - exact).abs() < 1e-3 * (1.0 + u),
                    "{u}: {found} {exact}"
                );
            }
        }
    }
}
