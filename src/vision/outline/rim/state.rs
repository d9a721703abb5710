//! Where the fit of a rim stands, what is known beforehand, and what it ends with.

use nalgebra::{Matrix3, SVector, Vector2};

use super::chain::{BLUR, DARKNESS, KNOTS, LIGHTS, LimbChain, LimbEnds, LimbStep, OVAL};
use crate::fit::Student;
use crate::geometry::Vec3;
use crate::vision::dots::cap::Tone;

/// The longest step of the outline, pixels; of the blur, parts of it.
pub(super) const LONGEST: (f64, [f64; 2]) = (1.0, [-0.3, 0.4]);
/// Standard deviation of the blur, of that from which the fit starts.
const BLUR_SPREAD: f64 = 0.5;
/// The limb's darkening, and its standard deviation: a matt ball has none, a dielectric one 1.
const DARKENING: (f64, f64) = (0.5, 0.5);
/// Standard deviation of what an outline is drawn out beyond the view's, radii; and of what is not, pixels.
const ROUND: f64 = 0.02;
const FIXED_PX: f64 = 1e-6;
/// A step is short that is, in pixels and standard deviations.
const CONVERGED: (f64, f64) = (0.01, 0.2);
/// Standard deviations of what the model leaves out, pixels: of center and radius.
const MODEL_ERROR: [f64; 3] = [0.03, 0.03, 0.08];
/// The pixels' variances are larger than they state: neighbors share noise, mosaics and compression.
const SHARED_NOISE: f64 = 4.0;
/// The least deviation of the tone curve's bend: curves of cameras are not quite of this family.
const MIN_BEND_ERROR: f64 = 0.1;

/// The least blur, of a square's side.
pub(super) const LEAST_BLUR: f64 = 0.3;
/// The pixels' loss.
pub(super) const LOSS: Student = Student::new(3, 1);

/// What outlines a fit tries.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum RimShape {
    /// Those of the view's camera.
    AsViewed,
    /// Those of any camera.
    DrawnOut,
}

/// Where the iteration stands.
#[derive(Debug, Clone, Copy)]
pub(super) struct LimbState {
    pub light: [SVector<f64, LIGHTS>; KNOTS],
    /// Of the outline.
    pub change: Vec3,
    pub blur: f64,
    /// What the outline is drawn out beyond the view's, pixels.
    pub oval: Vector2<f64>,
    pub darkening: f64,
    /// The variance of the values, where it is known.
    pub noise: Option<f64>,
    /// Of the squares that are read, pixels.
    pub side: f64,
}

impl LimbState {
    /// Where a fit begins, after the last one.
    pub fn after(last: Option<&Self>, blur: f64, side: f64) -> Self {
        match last {
            None => Self {
                light: [SVector::zeros(); KNOTS],
                change: Vec3::zeros(),
                blur,
                oval: Vector2::zeros(),
                darkening: DARKENING.0,
                noise: None,
                side,
            },
            // Squares of pixels are blurred, and have less noise.
            Some(last) => Self {
                change: Vec3::zeros(),
                blur: if last.side > side { blur } else { last.blur },
                noise: last.noise.map(|noise| noise * (last.side / side).powi(2)),
                side,
                ..*last
            },
        }
    }

    /// Takes a part of a step; how long it is for the outline, over one that ends a fit.
    pub fn go(&mut self, step: &LimbStep, part: f64, noise: f64) -> f64 {
        for (light, by) in self.light.iter_mut().zip(&step.lights) {
            *light += by * part;
        }
        let shared = step.shared * part;
        let moved = shared.fixed_rows::<3>(0).into_owned();
        let longest = LONGEST.0 * self.side;
        let moved = moved * (longest / moved.amax().max(longest));
        self.change += moved;
        let [less, more] = LONGEST.1.map(|part| part * self.blur);
        self.blur = (self.blur + shared[BLUR].clamp(less, more)).max(LEAST_BLUR * self.side);
        self.oval += shared.fixed_rows::<2>(OVAL);
        self.darkening += shared[DARKNESS];
        let sigma = (step.of_outline.diagonal() * noise).map(f64::sqrt);
        let short = sigma * CONVERGED.1 + Vec3::repeat(CONVERGED.0 * self.side);
        moved.abs().component_div(&short).max()
    }
}

/// What is fitted to the pixels that were read.
#[derive(Debug, Clone, Copy)]
pub(super) struct RimBall {
    pub shape: RimShape,
    pub radius: f64,
    /// As it is expected.
    pub blur: f64,
    pub bend: f64,
    /// The depths between which the pixels lie.
    pub depths: [f64; 2],
}

impl RimBall {
    /// Adds what is known of blur, darkening and oval.
    pub fn hold(&self, state: &LimbState, chain: &mut LimbChain, noise: f64) {
        let round_px = match self.shape {
            RimShape::AsViewed => FIXED_PX,
            RimShape::DrawnOut => ROUND * self.radius,
        };
        let known = [
            (BLUR, BLUR_SPREAD * self.blur, self.blur - state.blur),
            (DARKNESS, DARKENING.1, DARKENING.0 - state.darkening),
            (OVAL, round_px, -state.oval.x),
            (OVAL + 1, round_px, -state.oval.y),
        ];
        for (at, sigma, off) in known {
            chain.hold(at, off, noise / (sigma * sigma));
        }
    }
}

/// Where an iteration has ended.
pub(super) struct FoundRim {
    pub ball: RimBall,
    pub state: LimbState,
    pub ends: LimbEnds,
    pub noise: f64,
}

impl FoundRim {
    /// The variance of the pixels, as many as are independent.
    pub fn scatter(&self) -> f64 {
        self.noise * SHARED_NOISE / LOSS.information()
    }

    /// Of center and radius, where the tone curve is not quite known.
    pub fn covariance(&self, tone: &Tone) -> Option<Matrix3<f64>> {
        let (inverse, by_bend) = self.ends.fitted()?;
        let by_bend = by_bend.fixed_rows::<3>(0);
        let of_bend = tone.variance.max(MIN_BEND_ERROR * MIN_BEND_ERROR);
        let errors = MODEL_ERROR.map(|e| e * e);
        Some(
            inverse.fixed_view::<3, 3>(0, 0) * self.scatter()
                + by_bend * by_bend.transpose() * of_bend
                + Matrix3::from_diagonal(&errors.into()),
        )
    }
}
