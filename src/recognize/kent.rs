//! The Kent (Fisher-Bingham FB5) density on the unit sphere.
//!
//! `f(x) = exp(kappa g1.x + beta ((g2.x)^2 - (g3.x)^2)) / c(kappa, beta)` per steradian, with the
//! orthonormal frame mean g1, major g2, minor g3, and (J. T. Kent, "The Fisher-Bingham distribution
//! on the sphere", JRSS B 44, 1982, Eq. 2.3)
//!
//! `c = 2 pi sum_j G(j+1/2)/G(j+1) beta^(2j) (kappa/2)^(-2j-1/2) I_(2j+1/2)(kappa)`, `0 <= 2 beta <
//! kappa`.
//!
//! The series is summed relative to its first term, `4 pi sinh(kappa)/kappa`, whose logarithm is
//! known in closed form. Each further term follows from the one before: `t_(j+1)/t_j =
//! (j+1/2)/(j+1) (2 beta/kappa)^2 I_(2j+5/2)/I_(2j+1/2)`, where the ratios of successive Bessel
//! functions `r_v = I_(v+1)/I_v` come from the recurrence `r_v = 1/(2(v+1)/kappa + r_(v+1))` run
//! downwards, in which errors shrink (W. Gautschi, "Computational aspects of three-term recurrence
//! relations", SIAM Review 9, 1967). All terms are positive and no term can overflow.

use std::f64::consts::PI;

use crate::error::{Error, Result};
use crate::geometry::Vec3;

/// Maximum concentration: the series has at most about `11 sqrt(kappa)` terms.
pub const MAX_KAPPA: f64 = 1e8;

/// Maximum deviation of a frame from orthonormality.
const FRAME_TOLERANCE: f64 = 1e-9;

/// Terms below this fraction of the sum end the series.
const NEGLIGIBLE: f64 = 1e-17;

/// Concentration, ovalness and normalization of a Kent density, without its frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KentShape {
    kappa: f64,
    beta: f64,
    ln_normalization: f64,
}

impl KentShape {
    /// The shape with concentration `kappa` and ovalness `beta`, `0 <= 2 beta < kappa` (or both
    /// zero: the uniform density).
    ///
    /// # Errors
    /// [`Error::Argument`] naming the parameter outside its domain.
    pub fn new(kappa: f64, beta: f64) -> Result<Self> {
        if !(0.0..=MAX_KAPPA).contains(&kappa) {
            let problem = format!("expected 0 <= kappa <= {MAX_KAPPA:e}, found {kappa}");
            return Err(Error::argument("kappa", problem));
        }
        if beta.is_nan() || beta < 0.0 || (beta > 0.0 && 2.0 * beta >= kappa) {
            let problem = format!("expected 0 <= 2 beta < kappa = {kappa}, found beta = {beta}");
            return Err(Error::argument("beta", problem));
        }
        Ok(Self {
            kappa,
            beta,
            ln_normalization: ln_normalization(kappa, beta),
        })
    }

    /// Concentration.
    pub fn kappa(&self) -> f64 {
        self.kappa
    }

    /// Ovalness.
    pub fn beta(&self) -> f64 {
        self.beta
    }

    /// `ln c(kappa, beta)`.
    pub fn ln_normalization(&self) -> f64 {
        self.ln_normalization
    }

    /// Logarithm of the density (per steradian) at a direction given by its cosines with the
    /// frame's mean, major and minor axis.
    pub fn ln_density(&self, mean: f64, major: f64, minor: f64) -> f64 {
        self.kappa * mean + self.beta * (major * major - minor * minor) - self.ln_normalization
    }
}

/// A Kent density with its frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KentDistribution {
    mean: Vec3,
    major: Vec3,
    minor: Vec3,
    shape: KentShape,
}

impl KentDistribution {
    /// The density around `mean`, elongated along `major` and narrowed along `minor` (an
    /// orthonormal frame, right- or left-handed).
    ///
    /// # Errors
    /// [`Error::Argument`] where the frame is not orthonormal, or `kappa`, `beta` are outside
    /// `0 <= 2 beta < kappa`.
    pub fn new(mean: Vec3, major: Vec3, minor: Vec3, kappa: f64, beta: f64) -> Result<Self> {
        let frame = nalgebra::Matrix3::from_columns(&[mean, major, minor]);
        let error = (frame.transpose() * frame - nalgebra::Matrix3::identity()).norm();
        // Not `>`: it would let a NaN pass.
        let orthonormal = error <= FRAME_TOLERANCE;
        if !orthonormal {
            let problem = "expected mean, major and minor to be orthonormal";
            return Err(Error::argument("kent frame", problem));
        }
        Ok(Self {
            mean,
            major,
            minor,
            shape: KentShape::new(kappa, beta)?,
        })
    }

    /// Logarithm of the density (per steradian) at the unit vector `direction`.
    pub fn ln_density(&self, direction: &Vec3) -> f64 {
        self.shape.ln_density(
            self.mean.dot(direction),
            self.major.dot(direction),
            self.minor.dot(direction),
        )
    }

    /// The shape.
    pub fn shape(&self) -> &KentShape {
        &self.shape
    }
}

/// `ln c(kappa, beta)` for parameters within their domain.
fn ln_normalization(kappa: f64, beta: f64) -> f64 {
    // ln(4 pi sinh(kappa)/kappa) without overflow, and without cancellation for small kappa.
    let sinhc = if kappa < 1e-8 {
        1.0
    } else {
        -(-2.0 * kappa).exp_m1() / (2.0 * kappa)
    };
    let first = (4.0 * PI).ln() + kappa + sinhc.ln();
    if beta == 0.0 {
        return first;
    }
    let ratios = bessel_ratios(kappa);
    let ovalness = (2.0 * beta / kappa).powi(2);
    let (mut term, mut sum) = (1.0, 1.0);
    for (j, pair) in ratios.chunks_exact(2).enumerate() {
        let j = j as f64;
        term *= (j + 0.5) / (j + 1.0) * ovalness * pair[0] * pair[1];
        sum += term;
        if term < NEGLIGIBLE * sum {
            break;
        }
    }
    first + f64::ln(sum)
}

/// `I_(v+1)(x)/I_v(x)` for v = 1/2, 3/2, ... up to where `I_v(x)/I_(1/2)(x)` is negligible.
fn bessel_ratios(x: f64) -> Vec<f64> {
    // I_v/I_(1/2) falls about as exp(-v^2/2x), and faster than by half a step where v > x; e^-60 is
    // far below rounding.
    let count = (120.0 * x).sqrt() as usize + 60;
    let mut ratios = vec![0.0; count];
    let top = count as f64 + 0.5;
    // Amos' bound as the start: it is already close, and its error shrinks with each step down.
    let mut ratio = x / (top + 1.0 + ((top + 1.0).powi(2) + x * x).sqrt());
    for (i, slot) in ratios.iter_mut().enumerate().rev() {
        let order = i as f64 + 0.5;
        ratio = 1.0 / (2.0 * (order + 1.0) / x + ratio);
        *slot = ratio;
    }
    ratios
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::tangent_frame;

    #[test]
    fn without_ovalness_it_is_von_mises_fisher() {
        for kappa in [1e-6, 0.1, 1.0, 10.0, 500.0, 700.0] {
            let shape = KentShape::new(kappa, 0.0).expect("in the domain");
            let closed = (4.0 * PI * f64::sinh(kappa) / kappa).ln();
            assert!(
                (shape.ln_normalization() - closed).abs() < 1e-12 * closed.abs(),
                "kappa {kappa}"
            );
        }
        // Beyond the range of sinh: c = 2 pi e^kappa / kappa.
        let shape = KentShape::new(1e5, 0.0).expect("in the domain");
        assert!((shape.ln_normalization() - (1e5 + (2.0 * PI / 1e5).ln())).abs() < 1e-9);
        let uniform = KentShape::new(0.0, 0.0).expect("in the domain");
        assert!((uniform.ln_normalization() - (4.0 * PI).ln()).abs() < 1e-15);
    }

    /// `int exp(kappa (z - 1) + beta (1 - z^2) cos 2 phi) dphi dz`: midpoints in phi (exact for
    /// periodic functions), Simpson in `u`, where `1 - z = 2 u^2` resolves the peak.
    fn scaled_integral(kappa: f64, beta: f64) -> f64 {
        let (steps, sectors) = (40_000, 400);
        let reach = (60.0 / (kappa - 2.0 * beta).max(1e-9) / 2.0)
            .sqrt()
            .min(1.0);
        let ring = |u: f64| {
            let (below, s2) = (2.0 * u * u, 4.0 * u * u * (1.0 - u * u));
            let sum: f64 = (0..sectors)
                .map(|i| {
                    let phi = 2.0 * PI * (f64::from(i) + 0.5) / f64::from(sectors);
                    (beta * s2 * (2.0 * phi).cos() - kappa * below).exp()
                })
                .sum();
            4.0 * u * sum * 2.0 * PI / f64::from(sectors)
        };
        let h = reach / f64::from(steps);
        let inner: f64 = (1..steps)
            .map(|i| ring(f64::from(i) * h) * if i % 2 == 1 { 4.0 } else { 2.0 })
            .sum();
        (ring(0.0) + inner + ring(reach)) * h / 3.0
    }

    #[test]
    fn integrates_to_one_over_the_sphere() {
        let cases = [
            (0.5, 0.1),
            (5.0, 2.0),
            (50.0, 0.0),
            (50.0, 24.9),
            (500.0, 100.0),
            (500.0, 249.0),
            (1e5, 2e4),
            (1e5, 4.99e4),
        ];
        for (kappa, beta) in cases {
            let shape = KentShape::new(kappa, beta).expect("in the domain");
            let integral = scaled_integral(kappa, beta);
            let total = (integral.ln() + kappa - shape.ln_normalization()).exp();
            assert!(
                (total - 1.0).abs() < 1e-8,
                "kappa {kappa} beta {beta}: {total}"
            );
        }
    }

    #[test]
    fn concentrated_limit_is_a_plane_gaussian() {
        // c -> 2 pi e^kappa / sqrt((kappa - 2 beta)(kappa + 2 beta)) for large kappa (Kent, Eq.
        // 2.5).
        let (kappa, beta) = (1e5, 3e4);
        let shape = KentShape::new(kappa, beta).expect("in the domain");
        let limit: f64 = kappa + (2.0 * PI / (kappa * kappa - 4.0 * beta * beta).sqrt()).ln();
        assert!((shape.ln_normalization() - limit).abs() < 1e-4);
    }

    #[test]
    fn is_widest_along_the_major_axis() {
        let mean = Vec3::new(1.0, 2.0, -0.5).normalize();
        let [major, minor] = tangent_frame(&mean);
        let kent = KentDistribution::new(mean, major, minor, 100.0, 30.0).expect("valid");
        let at = |side: &Vec3| kent.ln_density(&(mean + side * 0.1).normalize());
        assert!(kent.ln_density(&mean) > at(&major) && at(&major) > at(&minor));
    }

    #[test]
    fn rejects_values_outside_its_domain() {
        for (kappa, beta) in [
            (-1.0, 0.0),
            (f64::NAN, 0.0),
            (10.0, 5.0),
            (10.0, -0.1),
            (10.0, f64::NAN),
            (f64::INFINITY, 0.0),
            (0.0, 0.1),
        ] {
            assert!(KentShape::new(kappa, beta).is_err(), "{kappa} {beta}");
        }
        let (x, y) = (Vec3::x(), Vec3::y());
        assert!(KentDistribution::new(x, y, y, 1.0, 0.0).is_err());
    }
}
