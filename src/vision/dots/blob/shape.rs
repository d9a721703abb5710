//! Fits the projection of a dot to a dark blob.
//!
//! A round dot of the size `a` at `(x, y)` on the ball (in radii) is seen with the covariance `S =
//! a^2 (I - (x, y)(x, y)^T) + b^2 I`, foreshortened along the radius by `z` and blurred by `b`. As
//! blur keeps the volume, a dot of contrast `c` is `c a^2 z / sqrt(det S) exp(-d^T S^-1 d / 2)`
//! deep. Center, contrast, size and the level around it are fitted by Gauss-Newton with Levenberg's
//! damping; the center's covariance is `s^2 (J^T J)^-1` for the noise `s`.

use nalgebra::{Matrix2, SMatrix, SVector, Vector2};

use super::flatten::Flat;
use super::in_radii;
use crate::fit::{DampedDescent, Damping, Sums};
use crate::vision::dots::patch::{RADIUS, SIZE};

/// Steps to the best shape; one that gains less than this part of the squares is the last.
const DAMPING: Damping = Damping {
    first: 1e-2,
    down: 0.2,
    up: 8.0,
    most: f64::INFINITY,
    steps: 8,
};
const CONVERGED: f64 = 1e-4;
/// Pixels within so many standard deviations of the blob take part.
const REACH: f64 = 2.6;
/// Minimum and maximum half width of what takes part, patch values.
const WINDOW: (f64, f64) = (3.0, 8.0);
/// A center that leaves its start by more than this (patch values) has gone to another blob.
const STRAYED: f64 = 3.5;
/// Error of a center, patch values, that is there without any noise: the dot's true shape, the
/// shading's rest.
const SYSTEMATIC: f64 = 0.25;

/// A fitted blob.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Blob {
    /// Center, patch values.
    pub column: f64,
    pub row: f64,
    /// Its covariance (column, row), patch values squared.
    pub covariance: Matrix2<f64>,
    /// Depth at the center, in the patch's brightness.
    pub contrast: f64,
    /// Radius of the dot, patch values: a disc's standard deviation is half its radius.
    pub radius: f64,
    /// z on the unit ball.
    pub depth: f64,
    /// The fitted dot's root energy over the noise.
    pub signal_to_noise: f64,
    /// Part of the window's variance that the fit explains.
    pub explained: f64,
}

/// Column, row, contrast, ln of the size, level.
type Parameters = SVector<f64, 5>;

/// The model of one set of parameters.
struct BlobModel {
    center: Vector2<f64>,
    inverse: Matrix2<f64>,
    /// Depth at the center for a contrast of 1.
    gain: f64,
    z: f64,
}

impl BlobModel {
    fn new(p: &Parameters, blur: f64) -> Option<Self> {
        let (x, y) = in_radii(p[0], p[1]);
        let out = Vector2::new(x, y);
        // A dot at the limb or beyond is taken as one just before it.
        let out = out * (0.995 / out.norm().max(0.995));
        let size = p[3].exp();
        let spread = size * size * (Matrix2::identity() - out * out.transpose())
            + Matrix2::from_diagonal_element(blur * blur);
        let z = (1.0 - out.norm_squared()).sqrt();
        Some(Self {
            center: Vector2::new(p[0], p[1]),
            inverse: spread.try_inverse()?,
            gain: size * size * z / spread.determinant().sqrt(),
            z,
        })
    }

    fn depth(&self, column: f64, row: f64) -> f64 {
        let d = Vector2::new(column, row) - self.center;
        self.gain * (-0.5 * d.dot(&(self.inverse * d))).exp()
    }
}

/// The pixels that a fit is made to.
#[derive(Clone, Copy)]
struct BlobWindow<'a> {
    flat: &'a Flat,
    mask: &'a [f32],
    /// Column and row of its middle, and half its width.
    middle: (f64, f64),
    half: f64,
    blur: f64,
}

/// A state of the fit.
struct BlobState<'a> {
    window: BlobWindow<'a>,
    parameters: Parameters,
    sums: Sums<5>,
    /// The values' variance, times their number.
    variance: f64,
}

impl DampedDescent for BlobState<'_> {
    fn cost(&self) -> f64 {
        self.sums.squares
    }

    fn stepped(&self, damping: f64) -> Option<Self> {
        let mut damped = self.sums.symmetric();
        for i in 0..5 {
            damped[(i, i)] *= 1.0 + damping;
            damped[(i, i)] += 1e-9;
        }
        let step = damped
            .cholesky()?
            .solve(&Parameters::from(self.sums.gradient));
        let mut next = self.parameters + step;
        // Sizes outside these are no dot's, and their gradients vanish.
        next[3] = next[3].clamp((0.02 * RADIUS).ln(), (0.25 * RADIUS).ln());
        self.window.state(next)
    }

    fn follow(&mut self, before: Self) -> bool {
        1.0 - self.cost() / before.cost() >= CONVERGED
    }
}

/// Fits a dot near `start` (column, row) of the size `sigma` to the flattened patch; `None` where
/// there is none.
pub(crate) fn fit(
    flat: &Flat,
    mask: &[f32],
    start: (f64, f64),
    sigma: f64,
    blur: f64,
) -> Option<Blob> {
    let at_start = -f64::from(flat.values()[start.1 as usize * SIZE + start.0 as usize]);
    let mut p = Parameters::new(start.0, start.1, at_start.max(0.1), sigma.ln(), 0.0);
    let gain = BlobModel::new(&p, blur)?.gain;
    p[2] /= gain.max(0.1);
    let half = (REACH * sigma.hypot(blur)).clamp(WINDOW.0, WINDOW.1);
    let window = BlobWindow {
        flat,
        mask,
        middle: start,
        half,
        blur,
    };
    DAMPING.descend(window.state(p)?).finish()
}

impl BlobState<'_> {
    fn finish(&self) -> Option<Blob> {
        let Self {
            window,
            parameters: p,
            sums,
            variance,
        } = self;
        let BlobWindow {
            flat,
            middle: start,
            blur,
            ..
        } = window;
        let dot = BlobModel::new(p, *blur)?;
        let strayed = (p[0] - start.0).hypot(p[1] - start.1) > STRAYED;
        let (x, y) = in_radii(p[0], p[1]);
        if strayed || p[2] <= 0.0 || x.hypot(y) > 1.0 || sums.weights < 8.0 {
            return None;
        }
        let left = sums.squares / (sums.weights - 5.0).max(1.0);
        let noise2 = left.max(f64::from(flat.noise()).powi(2));
        let held = sums.symmetric() + SMatrix::<f64, 5, 5>::identity() * 1e-9;
        let inverse = held.try_inverse()? * noise2;
        let covariance = inverse.fixed_view::<2, 2>(0, 0).into_owned()
            + Matrix2::from_diagonal_element(SYSTEMATIC * SYSTEMATIC);
        let energy = p[2] * p[2] * dot.gain * dot.gain * std::f64::consts::PI
            / dot.inverse.determinant().sqrt();
        Some(Blob {
            column: p[0],
            row: p[1],
            covariance: 0.5 * (covariance + covariance.transpose()),
            contrast: p[2] * dot.gain,
            radius: 2.0 * p[3].exp(),
            depth: dot.z,
            signal_to_noise: (energy / f64::from(flat.noise()).powi(2)).sqrt(),
            explained: 1.0 - sums.squares / variance.max(1e-12),
        })
    }
}

impl<'a> BlobWindow<'a> {
    /// The state of these parameters: residuals and derivatives over the window.
    fn state(self, p: Parameters) -> Option<BlobState<'a>> {
        let Self {
            flat,
            mask,
            middle: (column0, row0),
            half,
            blur,
        } = self;
        let dot = BlobModel::new(&p, blur)?;
        let nudge = 0.02;
        let mut larger = p;
        larger[3] += nudge;
        let larger = BlobModel::new(&larger, blur)?;
        let mut sums = Sums::<5>::default();
        let [mut sum, mut squares] = [0.0, 0.0];
        let range = |at: f64| {
            let low = (at - half).ceil().max(0.0) as usize;
            let high = (at + half).floor().min((SIZE - 1) as f64) as usize;
            low..=high
        };
        for row in range(row0) {
            for column in range(column0) {
                let i = row * SIZE + column;
                let (c, r) = (column as f64, row as f64);
                if mask[i] == 0.0 || (c - column0).hypot(r - row0) > half {
                    continue;
                }
                let value = -f64::from(flat.values()[i]);
                let unit = dot.depth(c, r);
                let depth = p[2] * unit;
                // d(depth)/d(center), the foreshortening's own change left out: it is of second order.
                let slope = dot.inverse * (Vector2::new(c, r) - dot.center) * depth;
                let by_size = p[2] * (larger.depth(c, r) - unit) / nudge;
                let by = [slope.x, slope.y, unit, by_size, 1.0];
                sums.add(&by, value - depth - p[4], 1.0);
                sum += value;
                squares += value * value;
            }
        }
        Some(BlobState {
            window: self,
            parameters: p,
            variance: squares - sum * sum / sums.weights.max(1.0),
            sums,
        })
    }
}
