//! The likelihood of a view: visibility, displacement, false dots. All logarithms are natural.
//!
//! Under the rotation `R` pattern dot `j` appears at `q_j = R p_j` and is detected with probability
//! `d(z) = P_d / (1 + exp(-1.7 (z - z_min) / w))`. A detected dot is displaced by noise whose density at
//! the Mahalanobis distance `u` is `exp(core(u)) / (2 pi sqrt(det C))`. False dots are a Poisson process of
//! density `lambda / (2 pi (1 - z_min))` per steradian of the visible cap; where their usual number is
//! known, all but a fiftieth of the views have that.

use std::f64::consts::{PI, TAU};

use super::config::{NoiseShape, RobustConfig};
use crate::geometry::{Vec3, tangent_frame};
use crate::pattern::LENGTH_TOLERANCE;
use crate::recognize::{DotUncertainty, ObservedDot};

/// Width, in z, over which a dot fades from visible to hidden at the limit.
pub(super) const VISIBILITY_SOFTNESS: f64 = 0.03;
/// The logistic curve of this slope stands in for the normal distribution function.
pub(super) const LOGISTIC: f64 = 1.7;
/// Share and widening of the Gaussian core's second, wider Gaussian.
const TAIL_SHARE: f64 = 0.1;
const TAIL_WIDENING: f64 = 2.0;
/// A dot further than this many standard deviations from a pattern dot is not it.
pub(super) const GATE: f64 = 10.0;
/// Nearer than this many standard deviations nothing is gained: the random-axis density has a pole.
const POLE: f64 = 0.3;
/// A dot's largest weight while the explanation is sought: near the pole it would hold the rotation alone.
pub(super) const SEARCH_WEIGHT: f64 = 1.0;
/// A dot's largest weight in the rotation that is reported.
pub(super) const FINAL_WEIGHT: f64 = 4.0;
/// Steps of the core's table for one standard deviation.
const CORE_STEPS: f64 = 32.0;
/// Steps of the visibility table over z in [-1, 1].
const Z_STEPS: usize = 2048;
/// Share of views whose number of false dots is not the usual one.
const UNUSUAL: f64 = 0.02;
/// Where, in standard deviations, the screening's straight lines touch the core.
const TANGENTS: [f64; 3] = [0.8, 2.4, 5.0];

/// The tables of one configuration.
#[derive(Debug, Clone)]
pub(super) struct Model {
    core: Vec<f64>,
    weight: Vec<f64>,
    ln_detected: Vec<f64>,
    ln_missed: Vec<f64>,
    /// `core` as the greatest of three lines `a + b h` over `h = -u^2 / 2`: (a, b).
    pub lines: [[f64; 2]; 3],
    /// False dots per steradian.
    ln_false_density: f64,
    /// ln of the prior of so many false dots over Poisson's.
    false_count: Vec<f64>,
    /// What is gained at most by a dot beyond its peak density: `ln P_d + core(0)`.
    most: f64,
}

/// An observed dot, prepared.
#[derive(Debug, Clone, Copy)]
pub(super) struct Dot {
    /// Unit vector, camera frame.
    pub direction: Vec3,
    /// Tangent axes over their standard deviations: their products with a displacement are independent
    /// and of unit variance.
    pub axes: [Vec3; 2],
    /// Inverse of the largest variance, 1/rad^2.
    pub radial: f64,
    /// Whether all tangent directions are alike.
    pub isotropic: bool,
    /// Largest standard deviation, radians.
    pub sigma_max: f64,
    /// ln of the Gaussian's peak over the false-dot density.
    pub ln_peak: f64,
    /// Upper bound of what the dot adds to the log-likelihood ratio, the penalty of missing it included.
    pub most: f64,
}

impl Dot {
    /// Squared Mahalanobis distance of the direction `q`; for all directions alike `|q - o|^2 / sigma^2`.
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
    pub fn new(config: &RobustConfig) -> Self {
        let steps = (GATE * CORE_STEPS) as usize + 2;
        let core = (0..steps)
            .map(|k| ln_kernel(config.noise, k as f64 / CORE_STEPS))
            .collect();
        let weight = (0..steps)
            .map(|k| tangent(config.noise, (k as f64 / CORE_STEPS).max(POLE))[1])
            .collect();
        let detected = (0..=Z_STEPS).map(|k| {
            let z = 2.0 * k as f64 / Z_STEPS as f64 - 1.0;
            let t = LOGISTIC * (z - config.visibility_limit) / VISIBILITY_SOFTNESS;
            config.detection_probability / (1.0 + (-t.clamp(-20.0, 20.0)).exp())
        });
        let cap = TAU * (1.0 - config.visibility_limit.max(-0.999));
        Self {
            core,
            weight,
            ln_detected: detected.clone().map(f64::ln).collect(),
            ln_missed: detected.map(|d| (1.0 - d).ln()).collect(),
            lines: TANGENTS.map(|u| tangent(config.noise, u)),
            ln_false_density: (config.expected_false_dots / cap).ln(),
            false_count: false_count(config),
            most: config.detection_probability.ln() + ln_kernel(config.noise, 0.0),
        }
    }

    /// The log-density at squared Mahalanobis distance `d2`, relative to the Gaussian's peak; `None`
    /// beyond the gate.
    pub fn ln_kernel(&self, d2: f64) -> Option<f64> {
        let at = d2.sqrt() * CORE_STEPS;
        let k = at as usize;
        let next = *self.core.get(k + 1)?;
        Some(self.core[k] + (next - self.core[k]) * (at - k as f64))
    }

    /// Weight of a displacement in a least-squares step towards the core's maximum, `-core'(u) / u`: 1 for a
    /// Gaussian, less for the heavier tails of others, and more towards a pole, up to `most`.
    pub fn weight(&self, d2: f64, most: f64) -> f64 {
        let k = (d2.sqrt() * CORE_STEPS) as usize;
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

    /// Prepares a dot; `None` where it is no direction or its uncertainty no covariance.
    pub fn prepare(&self, dot: &ObservedDot) -> Option<Dot> {
        let direction = dot.direction;
        let off = (direction.norm_squared() - 1.0).abs();
        if off.is_nan() || off > 2.0 * LENGTH_TOLERANCE {
            return None;
        }
        let [e1, e2] = tangent_frame(&direction);
        let (axes, det_root, sigma_max, isotropic) = match dot.uncertainty {
            DotUncertainty::Isotropic { sigma_rad } => {
                if !(sigma_rad > 0.0 && sigma_rad.is_finite()) {
                    return None;
                }
                let axes = [e1 / sigma_rad, e2 / sigma_rad];
                (axes, sigma_rad * sigma_rad, sigma_rad, true)
            }
            DotUncertainty::Tangent { covariance: c } => {
                // C = L L^T; the rows of L^-1 [e1; e2] are the whitened axes.
                let l11 = c[(0, 0)].sqrt();
                let l21 = 0.5 * (c[(1, 0)] + c[(0, 1)]) / l11;
                let l22 = (c[(1, 1)] - l21 * l21).sqrt();
                if !(l11 > 0.0 && l22 > 0.0 && l11.is_finite() && l22.is_finite()) {
                    return None;
                }
                let half = 0.5 * c.trace();
                let det_root = l11 * l22;
                let largest = half + (half * half - det_root * det_root).max(0.0).sqrt();
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

/// ln of the prior over Poisson's for 0, 1, ... false dots; the last stands for all that follow.
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

/// ln of the density at `u` standard deviations over the Gaussian's density at 0.
fn ln_kernel(noise: NoiseShape, u: f64) -> f64 {
    match noise {
        NoiseShape::Gaussian => {
            let h = -0.5 * u * u;
            let wide = (TAIL_SHARE / TAIL_WIDENING.powi(2)).ln() + h / TAIL_WIDENING.powi(2);
            h.max(wide)
        }
        NoiseShape::RandomAxis => {
            let u = u.max(POLE);
            ((PI / 6.0).sqrt() / u).ln() + ln_erfc(u / 6f64.sqrt())
        }
    }
}

/// The line `a + b h` over `h = -u^2 / 2` that touches the core at `u`.
fn tangent(noise: NoiseShape, u: f64) -> [f64; 2] {
    let step = 1e-4;
    let slope = (ln_kernel(noise, u + step) - ln_kernel(noise, u - step)) / (2.0 * step);
    let b = -slope / u;
    [ln_kernel(noise, u) + b * 0.5 * u * u, b]
}

/// ln erfc(x) for x >= 0 (W. J. Cody's problem by the Chebyshev fit of Numerical Recipes, Sec. 6.2; the
/// relative error of erfc is below 1.2e-7).
fn ln_erfc(x: f64) -> f64 {
    const FIT: [f64; 10] = [
        -1.265_512_23,
        1.000_023_68,
        0.374_091_96,
        0.096_784_18,
        -0.186_288_06,
        0.278_868_07,
        -1.135_203_98,
        1.488_515_87,
        -0.822_152_23,
        0.170_872_77,
    ];
    let t = 1.0 / (1.0 + 0.5 * x);
    t.ln() - x * x + FIT.iter().rev().fold(0.0, |sum, c| sum * t + c)
}
