//! Noise of an observed dot: its distribution, how it is drawn, and what an observer states of it.
//!
//! Densities are given as kernels: the density at the Mahalanobis distance `u`, relative to that of
//! the Gaussian of the same covariance at 0.

use std::f64::consts::PI;

use nalgebra::{Matrix2, Unit};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::dot::{DotUncertainty, ObservedDot};
use crate::error::{Result, require};
use crate::geometry::{Rotation, Vec3, random_direction, tangent_frame};

/// Share and widening of the wider Gaussian of [`NoiseShape::HeavyTailed`].
const TAIL_SHARE: f64 = 0.1;
const TAIL_WIDENING: f64 = 2.0;
/// Below this many standard deviations the random-axis density stays constant: it has a pole.
pub(crate) const POLE: f64 = 0.3;
/// Minimum standard deviation that an observer states, radians: noise-free views must not divide by
/// zero.
const MIN_SIGMA_RAD: f64 = 1e-4;
/// Minimum z, towards the limb, at which a back-projected dot's uncertainty is linearized.
const LIMB_Z: f64 = 0.1;

/// Distribution of the displacements of real dots, for a given covariance.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum NoiseShape {
    /// One Gaussian: `exp(-u^2 / 2)`.
    Normal,
    /// A mixture of two Gaussians: nine dots in ten with the given covariance, one in ten from a
    /// Gaussian twice as wide, `0.9 exp(-u^2 / 2) + 0.1 / 4 exp(-u^2 / 8)`. Manual placement and
    /// detectors have heavier tails than one Gaussian.
    #[serde(alias = "gaussian")]
    HeavyTailed,
    /// A rotation about an axis uniform on the sphere by a normal angle, as the SpinDOE paper makes
    /// its noise: `sqrt(pi / 6) / u erfc(u / sqrt 6)`, peaked, with heavy tails.
    RandomAxis,
}

impl NoiseShape {
    /// All distributions.
    pub const ALL: [Self; 3] = [Self::Normal, Self::HeavyTailed, Self::RandomAxis];

    /// ln of the density at `u` standard deviations over the Gaussian's density at 0; near the pole of
    /// [`NoiseShape::RandomAxis`] it stays constant.
    pub fn ln_kernel(self, u: f64) -> f64 {
        match self {
            Self::Normal | Self::HeavyTailed => self.ln_density(u),
            Self::RandomAxis => {
                let cut = self.ln_density(POLE).exp();
                // Of a mass of 1 the cut pole keeps so much.
                let mass = 1.0 - self.mass_within(POLE) + 0.5 * POLE * POLE * cut;
                self.ln_density(u.max(POLE)) - mass.ln()
            }
        }
    }

    /// The same with the pole, which is infinite at 0.
    pub fn ln_density(self, u: f64) -> f64 {
        let h = -0.5 * u * u;
        match self {
            Self::Normal => h,
            Self::HeavyTailed => {
                let spread = TAIL_WIDENING.powi(2);
                // Far out both terms may underflow alone: the wider one does so last.
                ((1.0 - TAIL_SHARE) * h.exp() + TAIL_SHARE / spread * (h / spread).exp()).ln()
            }
            Self::RandomAxis => ((PI / 6.0).sqrt() / u * libm::erfc(u / 6f64.sqrt())).ln(),
        }
    }

    /// Share of the dots that lie within `u` standard deviations, `int_0^u t exp(ln_density(t)) dt`.
    pub(crate) fn mass_within(self, u: f64) -> f64 {
        let within = |variance: f64| -(-0.5 * u * u / variance).exp_m1();
        match self {
            Self::Normal => within(1.0),
            Self::HeavyTailed => {
                (1.0 - TAIL_SHARE) * within(1.0) + TAIL_SHARE * within(TAIL_WIDENING.powi(2))
            }
            Self::RandomAxis => within(3.0) + u * u * self.ln_density(u).exp(),
        }
    }
}

/// Noise of a visible dot's position: a distribution with its size.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Noise {
    /// Rotated about an axis uniform on the sphere by an angle from N(0, sigma). Per tangent axis
    /// this has the standard deviation sigma / sqrt(3): a third of the axis lies along the dot on
    /// average.
    RandomAxis {
        /// Standard deviation of the rotation's angle, radians.
        sigma_rad: f64,
    },
    /// Moved in the tangent plane by the mixture [`NoiseShape::HeavyTailed`].
    HeavyTailed {
        /// Standard deviation of its narrower part per tangent axis, radians.
        sigma_rad: f64,
    },
    /// Moved in the image by N(0, sigma) per axis, then projected back to the sphere.
    Pixel {
        /// Standard deviation per image axis, pixels.
        sigma_px: f64,
        /// The ball's radius in the image, pixels.
        radius_px: f64,
    },
}

impl Noise {
    /// Noise of this shape with a standard deviation per tangent axis, radians (in the image at the
    /// ball's center for [`NoiseShape::Normal`]).
    pub fn of_shape(shape: NoiseShape, sigma_rad: f64) -> Self {
        match shape {
            NoiseShape::Normal => Self::Pixel {
                sigma_px: sigma_rad,
                radius_px: 1.0,
            },
            NoiseShape::HeavyTailed => Self::HeavyTailed { sigma_rad },
            NoiseShape::RandomAxis => Self::RandomAxis {
                sigma_rad: sigma_rad * 3f64.sqrt(),
            },
        }
    }

    /// The distribution of the displacements, for their covariance.
    pub fn shape(&self) -> NoiseShape {
        match self {
            Self::RandomAxis { .. } => NoiseShape::RandomAxis,
            Self::HeavyTailed { .. } => NoiseShape::HeavyTailed,
            Self::Pixel { .. } => NoiseShape::Normal,
        }
    }

    /// The noise as an angle, radians: of the rotation, per tangent axis, or in the image at the
    /// ball's center.
    pub fn sigma_rad(&self) -> f64 {
        match *self {
            Self::RandomAxis { sigma_rad } | Self::HeavyTailed { sigma_rad } => sigma_rad,
            Self::Pixel {
                sigma_px,
                radius_px,
            } => sigma_px / radius_px,
        }
    }

    /// The noise per tangent axis, radians (in the image at the ball's center): a rotation about a
    /// random axis moves a dot by a third of its variance along each axis.
    pub fn tangent_sigma_rad(&self) -> f64 {
        match self {
            Self::RandomAxis { sigma_rad } => sigma_rad / 3f64.sqrt(),
            Self::HeavyTailed { .. } | Self::Pixel { .. } => self.sigma_rad(),
        }
    }

    /// The same distribution with this value of [`Noise::sigma_rad`].
    #[must_use]
    pub fn with_sigma_rad(mut self, new: f64) -> Self {
        match &mut self {
            Self::RandomAxis { sigma_rad } | Self::HeavyTailed { sigma_rad } => *sigma_rad = new,
            Self::Pixel {
                sigma_px,
                radius_px,
            } => *sigma_px = new * *radius_px,
        }
        self
    }

    /// Checks the size.
    ///
    /// # Errors
    /// [`Error::Argument`](crate::Error::Argument) for `sigma_rad`.
    pub fn check(&self) -> Result<()> {
        let sigma = self.sigma_rad();
        let inside = (0.0..=PI).contains(&sigma);
        require(inside, "sigma_rad", "0 to 180 degrees", sigma.to_degrees())
    }

    /// The dot at `q` as measured: moved by `scale` times the noise, with the uncertainty that an
    /// observer who takes the scale for 1 would state.
    pub(crate) fn displaced(&self, q: &Vec3, scale: f64, rng: &mut ChaCha8Rng) -> ObservedDot {
        let sigma = scale * self.sigma_rad();
        let direction = match self {
            Self::RandomAxis { .. } => {
                let axis = Unit::new_unchecked(random_direction(rng));
                let z: f64 = StandardNormal.sample(rng);
                Rotation::from_axis_angle(&axis, sigma * z) * q
            }
            Self::HeavyTailed { .. } => {
                let (a, b): (f64, f64) = (StandardNormal.sample(rng), StandardNormal.sample(rng));
                let is_wide = rng.random::<f64>() < TAIL_SHARE;
                let sigma = sigma * if is_wide { TAIL_WIDENING } else { 1.0 };
                let [e1, e2] = tangent_frame(q);
                (q + (e1 * a + e2 * b) * sigma).normalize()
            }
            Self::Pixel { .. } => {
                let (a, b): (f64, f64) = (StandardNormal.sample(rng), StandardNormal.sample(rng));
                let (x, y) = (q.x + sigma * a, q.y + sigma * b);
                let r2 = x * x + y * y;
                // A dot measured beyond the limb is taken to lie on it.
                Vec3::new(x, y, (1.0 - r2).max(0.0).sqrt()).normalize()
            }
        };
        self.observed(direction)
    }

    /// A dot measured at `direction`, with the uncertainty that an observer would state.
    pub(super) fn observed(&self, direction: Vec3) -> ObservedDot {
        let uncertainty = match *self {
            Self::RandomAxis { .. } | Self::HeavyTailed { .. } => DotUncertainty::Isotropic {
                sigma_rad: self.tangent_sigma_rad().max(MIN_SIGMA_RAD),
            },
            Self::Pixel {
                sigma_px,
                radius_px,
            } => DotUncertainty::Tangent {
                covariance: foreshortened(&direction, (sigma_px / radius_px).max(MIN_SIGMA_RAD)),
            },
        };
        ObservedDot {
            direction,
            uncertainty,
        }
    }
}

/// Covariance, rad^2, of a direction that is measured in the image with a standard deviation of `s`
/// radii per axis.
///
/// Orthographic: a tangent step moves the image by its x and y; along the radius it is foreshortened
/// by z.
fn foreshortened(direction: &Vec3, s: f64) -> Matrix2<f64> {
    let along = s / direction.z.max(LIMB_Z);
    let [e1, e2] = tangent_frame(direction);
    // The tangent direction that runs outward in the image (towards -z).
    let outward = direction * direction.z - Vec3::z();
    let norm = outward.norm();
    let (c, d) = if norm > 1e-9 {
        (outward.dot(&e1) / norm, outward.dot(&e2) / norm)
    } else {
        (1.0, 0.0)
    };
    let (v, w) = (along * along, s * s);
    let off = (v - w) * c * d;
    Matrix2::new(v * c * c + w * d * d, off, off, v * d * d + w * c * c)
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;

    use super::*;

    /// `int_0^reach u exp(ln_kernel(u)) du` by the midpoint rule: the density's mass in the plane.
    fn mass(noise: NoiseShape, reach: f64) -> f64 {
        let steps = 200_000;
        let h = reach / f64::from(steps);
        let ring = |k: i32| {
            let u = h * (f64::from(k) + 0.5);
            u * noise.ln_kernel(u).exp() * h
        };
        (0..steps).map(ring).sum()
    }

    #[test]
    fn the_heavy_tailed_mixture_has_mass_one() {
        let found = mass(NoiseShape::HeavyTailed, 30.0);
        assert!((found - 1.0).abs() < 1e-9, "{found}");
        // One dot in ten from a Gaussian twice as wide: its share beyond u is exp(-u^2 / 8).
        let within = mass(NoiseShape::HeavyTailed, 3.0);
        let expected = 1.0 - 0.9 * (-4.5f64).exp() - 0.1 * (-4.5f64 / 4.0).exp();
        assert!((within - expected).abs() < 1e-9, "{within} of {expected}");
        assert!((mass(NoiseShape::Normal, 30.0) - 1.0).abs() < 1e-9);
    }

    #[test]
    fn the_random_axis_density_has_mass_one_though_its_pole_is_cut() {
        let found = mass(NoiseShape::RandomAxis, 30.0);
        assert!((found - 1.0).abs() < 1e-6, "{found}");
    }

    /// Against the midpoint rule, and against displacements that are drawn.
    #[test]
    fn so_many_dots_lie_within() {
        let mut rng = ChaCha8Rng::seed_from_u64(64_972);
        for shape in [NoiseShape::HeavyTailed, NoiseShape::RandomAxis] {
            let noise = Noise::of_shape(shape, 0.001);
            let q = Vec3::z();
            let mut drawn = || {
                noise
                    .displaced(&q, 1.0, &mut rng)
                    .squared_deviations(&q)
                    .sqrt()
            };
            let drawn: Vec<f64> = (0..20_000).map(|_| drawn()).collect();
            for u in [0.1, 0.5, 2.0, 4.0] {
                let h = u / 10_000.0;
                let rings = (0..10_000).map(|k| h * (f64::from(k) + 0.5));
                let sum: f64 = rings.map(|t| t * shape.ln_density(t).exp() * h).sum();
                let found = shape.mass_within(u);
                assert!((found - sum).abs() < 1e-5, "{shape:?} {u}: {found} {sum}");
                let share = drawn.iter().filter(|d| **d < u).count() as f64 / 20_000.0;
                assert!(
                    (found - share).abs() < 0.015,
                    "{shape:?} {u}: {found} {share}"
                );
            }
        }
    }
}
