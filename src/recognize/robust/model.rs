//! The likelihood of a view: visibility, displacement, false dots. All logarithms are natural.
//!
//! Under the rotation `R` pattern dot `j` appears at `q_j = R p_j` and is detected with probability
//! `d(z) = P_d / (1 + exp(-1.7 (z - z_min) / w))`. A detected dot is displaced by noise whose
//! density at the Mahalanobis distance `u` is `exp(ln_kernel(u)) / (2 pi sqrt(det C))`, of mass 1
//! over the tangent plane ([`NoiseShape`] has the kernels). False dots are a Poisson process of
//! density `lambda / (2 pi (1 - z_min))` per steradian of the visible cap; where their usual number
//! is known, all but a fiftieth of the views have that.

use std::f64::consts::{PI, TAU};

use super::config::{NoiseShape, RobustConfig};
use crate::geometry::{Vec3, tangent_frame};
use crate::pattern::LENGTH_TOLERANCE;
use crate::recognize::{DotUncertainty, ObservedDot};

/// Width, in z, over which a dot fades from visible to hidden at the limit.
pub(super) const VISIBILITY_SOFTNESS: f64 = 0.03;
/// The logistic curve of this slope approximates the normal distribution function.
pub(super) const LOGISTIC: f64 = 1.7;
/// Share and widening of the mixture's second, wider Gaussian.
const TAIL_SHARE: f64 = 0.1;
const TAIL_WIDENING: f64 = 2.0;
/// Standard deviations that a dot's direction may have, radians. Less than a nanoradian is no
/// measurement, and more than a radian no direction; the screening's single precision holds both.
const SIGMAS_RAD: std::ops::RangeInclusive<f64> = 1e-9..=1.0;
/// A dot farther than this many standard deviations from a pattern dot is no match.
pub(super) const GATE: f64 = 10.0;
/// Below this many standard deviations the density stays constant: the random-axis density has a
/// pole.
const POLE: f64 = 0.3;
/// Maximum weight of a dot during the search: near the pole one dot alone would determine the
/// rotation.
pub(super) const SEARCH_WEIGHT: f64 = 1.0;
/// Maximum weight of a dot in the reported rotation.
pub(super) const FINAL_WEIGHT: f64 = 4.0;
/// Steps of the kernel's table for one standard deviation.
const KERNEL_STEPS: f64 = 32.0;
/// Steps of the visibility table over z in [-1, 1].
const Z_STEPS: usize = 2048;
/// Share of views whose number of false dots is not the usual one.
const UNUSUAL: f64 = 0.02;
/// Where, in standard deviations, the screening's straight lines touch the kernel.
const TANGENTS: [f64; 3] = [0.8, 2.4, 5.0];

/// The tables of one configuration.
#[derive(Debug, Clone)]
pub(super) struct Model {
    kernel: Vec<f64>,
    weight: Vec<f64>,
    ln_detected: Vec<f64>,
    ln_missed: Vec<f64>,
    /// The kernel as the maximum of three lines `a + b h` over `h = -u^2 / 2`: (a, b).
    pub lines: [[f64; 2]; 3],
    /// False dots per steradian.
    ln_false_density: f64,
    /// Mean number of false dots.
    mean_false: f64,
    /// Ratio of the dots' standard deviations to those given.
    noise_scale: f64,
    /// ln of the prior of so many false dots over Poisson's.
    false_count: Vec<f64>,
    /// For each number of false dots the maximum of these from it on.
    max_false_count: Vec<f64>,
    /// Maximum gain of a dot beyond its peak density: `ln P_d + ln_kernel(0)`.
    most: f64,
}

/// An observed dot, prepared.
#[derive(Debug, Clone, Copy)]
pub(super) struct Dot {
    /// Unit vector, camera frame.
    pub direction: Vec3,
    /// Tangent axes over their standard deviations: their products with a displacement are
    /// independent and of unit variance.
    pub axes: [Vec3; 2],
    /// Inverse of the largest variance, 1/rad^2.
    pub radial: f64,
    /// Whether all tangent directions have the same standard deviation.
    pub isotropic: bool,
    /// Largest standard deviation, radians.
    pub sigma_max: f64,
    /// ln of the Gaussian's peak over the false-dot density.
    pub ln_peak: f64,
    /// Upper bound of what the dot adds to the log-likelihood ratio, the penalty of missing it
    /// included.
    pub most: f64,
}

impl Dot {
    /// Squared Mahalanobis distance of the direction `q`; for an isotropic dot `|q - o|^2 /
    /// sigma^2`.
    pub fn distance_squared(&self, q: &Vec3) -> f64 {
        let [a, b] = self.axes.map(|u| u.dot(q));
        let depth = 1.0 - self.direction.dot(q);
        a * a + b * b + depth * depth * self.radial
    }

    /// Reverses x.
    pub fn mirror(&mut self) {
        self.direction.x = -self.direction.x;
        for axis in &mut self.axes {
            axis.x = -axis.x;
        }
    }
}

impl Model {
    /// The tables of a configuration, for dots whose standard deviations are `noise_scale` times
    /// those given.
    pub fn new(config: &RobustConfig, noise_scale: f64) -> Self {
        let steps = (GATE * KERNEL_STEPS) as usize + 2;
        let kernel = (0..steps)
            .map(|k| ln_kernel(config.noise, k as f64 / KERNEL_STEPS))
            .collect();
        let weight = (0..steps)
            .map(|k| tangent(config.noise, (k as f64 / KERNEL_STEPS).max(POLE))[1])
            .collect();
        let detected = (0..=Z_STEPS).map(|k| {
            let z = 2.0 * k as f64 / Z_STEPS as f64 - 1.0;
            let t = LOGISTIC * (z - config.visibility_limit) / VISIBILITY_SOFTNESS;
            config.detection_probability / (1.0 + (-t.clamp(-20.0, 20.0)).exp())
        });
        let false_count = false_count(config);
        let mut max_false_count = false_count.clone();
        for k in (1..max_false_count.len()).rev() {
            max_false_count[k - 1] = max_false_count[k - 1].max(max_false_count[k]);
        }
        let cap = TAU * (1.0 - config.visibility_limit.max(-0.999));
        Self {
            kernel,
            weight,
            ln_detected: detected.clone().map(f64::ln).collect(),
            ln_missed: detected.map(|d| (1.0 - d).ln()).collect(),
            lines: TANGENTS.map(|u| tangent(config.noise, u)),
            ln_false_density: (config.expected_false_dots / cap).ln(),
            mean_false: config.expected_false_dots,
            noise_scale,
            false_count,
            max_false_count,
            most: config.detection_probability.ln() + ln_kernel(config.noise, 0.0),
        }
    }

    /// The log-density at squared Mahalanobis distance `d2`, relative to the Gaussian's peak;
    /// `None` beyond the gate.
    pub fn ln_kernel(&self, d2: f64) -> Option<f64> {
        // Not `>`: it would let a NaN pass. Beyond the gate no value can be an index.
        let inside = d2 <= GATE * GATE;
        if !inside {
            return None;
        }
        let at = d2.sqrt() * KERNEL_STEPS;
        let k = at as usize;
        let here = self.kernel[k];
        Some(here + (self.kernel[k + 1] - here) * (at - k as f64))
    }

    /// Weight of a displacement in a least-squares step towards the kernel's maximum,
    /// `-ln_kernel'(u) / u`: 1 for one Gaussian, less for heavier tails, and more towards a pole,
    /// up to `most`.
    pub fn weight(&self, d2: f64, most: f64) -> f64 {
        let k = (d2.sqrt() * KERNEL_STEPS) as usize;
        self.weight[k.min(self.weight.len() - 1)].min(most)
    }

    /// ln of the probabilities that a dot at this z is detected and missed.
    pub fn visibility(&self, z: f64) -> (f64, f64) {
        let k = ((z + 1.0) * (0.5 * Z_STEPS as f64) + 0.5) as usize;
        let k = k.min(Z_STEPS);
        (self.ln_detected[k], self.ln_missed[k])
    }

    /// ln of the prior of `count` false dots over the Poisson distribution's.
    pub fn false_count(&self, count: usize) -> f64 {
        self.false_count[count.min(self.false_count.len() - 1)]
    }

    /// The maximum [`Model::false_count`] of `count` or more false dots.
    pub fn max_false_count(&self, count: usize) -> f64 {
        self.max_false_count[count.min(self.max_false_count.len() - 1)]
    }

    /// ln of the density of `count` dots that are all false, up to the prior of their number.
    pub fn ln_all_false(&self, count: usize) -> f64 {
        count as f64 * self.ln_false_density - self.mean_false
    }

    /// ln of the Gaussian's peak density of a prepared dot, per steradian.
    pub fn ln_gaussian_peak(&self, dot: &Dot) -> f64 {
        dot.ln_peak + self.ln_false_density
    }

    /// Ratio of the dots' standard deviations to those given.
    pub fn noise_scale(&self) -> f64 {
        self.noise_scale
    }

    /// Prepares a dot; `None` where its direction or its covariance is invalid.
    pub fn prepare(&self, dot: &ObservedDot) -> Option<Dot> {
        let direction = dot.direction;
        let off = (direction.norm_squared() - 1.0).abs();
        if off.is_nan() || off > 2.0 * LENGTH_TOLERANCE {
            return None;
        }
        let [e1, e2] = tangent_frame(&direction);
        let (axes, det_root, sigma_max, isotropic) = match dot.uncertainty {
            DotUncertainty::Isotropic { sigma_rad } => {
                let sigma_rad = sigma_rad * self.noise_scale;
                if !SIGMAS_RAD.contains(&sigma_rad) {
                    return None;
                }
                let axes = [e1 / sigma_rad, e2 / sigma_rad];
                (axes, sigma_rad * sigma_rad, sigma_rad, true)
            }
            DotUncertainty::Tangent { covariance } => {
                let c = covariance * (self.noise_scale * self.noise_scale);
                // C = L L^T; the rows of L^-1 [e1; e2] are the whitened axes.
                let l11 = c[(0, 0)].sqrt();
                let l21 = 0.5 * (c[(1, 0)] + c[(0, 1)]) / l11;
                let l22 = (c[(1, 1)] - l21 * l21).sqrt();
                let half = 0.5 * c.trace();
                let det_root = l11 * l22;
                let largest = half + (half * half - det_root * det_root).max(0.0).sqrt();
                let (max, min) = (largest.sqrt(), det_root / largest.sqrt());
                if !(SIGMAS_RAD.contains(&max) && SIGMAS_RAD.contains(&min)) {
                    return None;
                }
                let axes = [e1 / l11, (e2 - e1 * (l21 / l11)) / l22];
                (axes, det_root, largest.sqrt(), false)
            }
        };
        let ln_peak = -(TAU * det_root).ln() - self.ln_false_density;
        Some(Dot {
            direction,
            axes,
            radial: 1.0 / (sigma_max * sigma_max),
            isotropic,
            sigma_max,
            ln_peak,
            most: (ln_peak + self.most).max(0.0),
        })
    }
}

/// ln of the prior over Poisson's for 0, 1, ... false dots; the last holds for all larger numbers.
fn false_count(config: &RobustConfig) -> Vec<f64> {
    let Some(usual) = config.usual_false_dots else {
        return vec![0.0];
    };
    let mean = config.expected_false_dots;
    let mut ln_poisson = -mean;
    let mut ratios = Vec::with_capacity(usize::from(usual) + 2);
    for count in 0..=usual {
        if count > 0 {
            ln_poisson += (mean / f64::from(count)).ln();
        }
        ratios.push(UNUSUAL.ln());
    }
    ratios[usize::from(usual)] = (UNUSUAL + (1.0 - UNUSUAL) * (-ln_poisson).exp()).ln();
    ratios.push(UNUSUAL.ln());
    ratios
}

/// ln of the probability of `count` false dots times the number of their orders, `count!`: Poisson
/// with this mean, or for all but a few views the usual number.
pub(super) fn ln_false_dots(mean: f64, usual: Option<usize>, count: usize) -> f64 {
    let ln_poisson = count as f64 * mean.ln() - mean;
    match usual {
        None => ln_poisson,
        Some(usual) if usual != count => UNUSUAL.ln() + ln_poisson,
        Some(_) => {
            let orders: f64 = (1..=count).map(|k| k as f64).product();
            (UNUSUAL * ln_poisson.exp() + (1.0 - UNUSUAL) * orders).ln()
        }
    }
}

/// ln of the density at `u` standard deviations over the Gaussian's density at 0.
pub(super) fn ln_kernel(noise: NoiseShape, u: f64) -> f64 {
    match noise {
        NoiseShape::Gaussian => {
            let h = -0.5 * u * u;
            let spread = TAIL_WIDENING.powi(2);
            // Beyond the gate both terms may underflow alone: the wider one never does within.
            ((1.0 - TAIL_SHARE) * h.exp() + TAIL_SHARE / spread * (h / spread).exp()).ln()
        }
        NoiseShape::RandomAxis => {
            let u = u.max(POLE);
            ((PI / 6.0).sqrt() / u).ln() + ln_erfc(u / 6f64.sqrt())
        }
    }
}

/// The line `a + b h` over `h = -u^2 / 2` that touches the kernel at `u`.
fn tangent(noise: NoiseShape, u: f64) -> [f64; 2] {
    let step = 1e-4;
    let slope = (ln_kernel(noise, u + step) - ln_kernel(noise, u - step)) / (2.0 * step);
    let b = -slope / u;
    [ln_kernel(noise, u) + b * 0.5 * u * u, b]
}

/// ln erfc(x), for x up to 26, where erfc underflows; the gate ends at 4.2.
fn ln_erfc(x: f64) -> f64 {
    libm::erfc(x).ln()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `int_0^reach u exp(ln_kernel(u)) du` by the midpoint rule: the density's mass in the plane.
    fn mass(noise: NoiseShape, reach: f64) -> f64 {
        let steps = 200_000;
        let h = reach / f64::from(steps);
        let ring = |k: i32| {
            let u = h * (f64::from(k) + 0.5);
            u * ln_kernel(noise, u).exp() * h
        };
        (0..steps).map(ring).sum()
    }

    #[test]
    fn the_gaussian_mixture_has_mass_one() {
        let found = mass(NoiseShape::Gaussian, 30.0);
        assert!((found - 1.0).abs() < 1e-9, "{found}");
        // One dot in ten from a Gaussian twice as wide: its share beyond u is exp(-u^2 / 8).
        let within = mass(NoiseShape::Gaussian, 3.0);
        let expected = 1.0 - 0.9 * (-4.5f64).exp() - 0.1 * (-4.5f64 / 4.0).exp();
        assert!((within - expected).abs() < 1e-9, "{within} of {expected}");
    }

    #[test]
    fn the_random_axis_density_has_mass_one_but_for_its_pole() {
        // The pole is cut off at POLE: the density there is constant, and what lies above is lost.
        // Without it int u sqrt(pi/6)/u erfc(u/sqrt 6) du = sqrt(pi/6) sqrt(6/pi) = 1.
        let c = (PI / 6.0).sqrt();
        let found = mass(NoiseShape::RandomAxis, 30.0);
        let steps = 100_000;
        let h = POLE / f64::from(steps);
        let cut = |k: i32| {
            let u = h * (f64::from(k) + 0.5);
            let flat = u / POLE * libm::erfc(POLE / 6f64.sqrt());
            c * (libm::erfc(u / 6f64.sqrt()) - flat) * h
        };
        let lost: f64 = (0..steps).map(cut).sum();
        assert!((found + lost - 1.0).abs() < 1e-6, "{found} and {lost}");
    }

    #[test]
    fn what_is_beyond_the_gate_has_no_kernel() {
        let model = Model::new(&RobustConfig::default(), 1.0);
        assert!(model.ln_kernel(GATE * GATE).is_some());
        for d2 in [GATE * GATE * 1.001, 1e300, f64::INFINITY, f64::NAN] {
            assert_eq!(model.ln_kernel(d2), None, "{d2}");
        }
        let exact = ln_kernel(NoiseShape::Gaussian, 2.345);
        let table = model.ln_kernel(2.345 * 2.345).expect("within the gate");
        assert!((exact - table).abs() < 1e-3, "{exact} {table}");
    }

    #[test]
    fn the_bound_on_the_false_dots_prior_bounds_it() {
        let config = RobustConfig {
            expected_false_dots: 2.0,
            usual_false_dots: Some(2),
            ..RobustConfig::default()
        };
        let model = Model::new(&config, 1.0);
        for from in 0..6 {
            let brute = (from..40).map(|k| model.false_count(k));
            let brute = brute.fold(f64::NEG_INFINITY, f64::max);
            assert_eq!(model.max_false_count(from), brute, "from {from}");
        }
        // Poisson's 2 of mean 2 has 0.2707; 98 % and a fiftieth of Poisson's is 1.3 nats more.
        assert!((model.max_false_count(0) - (0.02f64 + 0.98 / 0.270_67).ln()).abs() < 1e-4);
    }
}
