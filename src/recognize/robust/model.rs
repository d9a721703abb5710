//! The likelihood of a view: visibility, displacement, false dots. All logarithms are natural.
//!
//! Under the rotation `R` pattern dot `j` appears at `q_j = R p_j` and is detected with probability
//! `d(z) = P_d / (1 + exp(-1.7 (z - z_min) / w))`. A detected dot is displaced by noise whose
//! density at the Mahalanobis distance `u` is `exp(ln_kernel(u)) / (2 pi sqrt(det C))`, of mass 1
//! over the tangent plane ([`NoiseShape`](crate::view::NoiseShape) has the kernels). False dots are a Poisson process of
//! density `lambda / (2 pi (1 - z_min))` per steradian of their cap; where their usual number
//! is known, all but a fiftieth of the views have that.
//!
//! Where a fixed number `m` of the visible dots is given, any `m` of the `V` visible ones are as
//! likely: `1 / C(V, m)` takes the place of the product of detections and misses, with `V` the sum
//! of the dots' probabilities to be visible.

use std::f64::consts::TAU;

use crate::geometry::{Vec3, tangent_frame};
use crate::pattern::LENGTH_TOLERANCE;
use crate::view::{Detection, DotUncertainty, NoiseShape, ObservedDot, POLE, ViewModel, visible};

/// Maximum probability of a detection: no detector finds every dot, and the limit is not sharp.
pub(super) const MAX_DETECTION: f64 = 0.98;
/// Standard deviations that a dot's direction may have, radians. Less than a nanoradian is no
/// measurement, and more than a radian no direction; the screening's single precision holds both.
const SIGMAS_RAD: std::ops::RangeInclusive<f64> = 1e-9..=1.0;
/// A dot farther than this many standard deviations from a pattern dot is no match.
pub(super) const GATE: f64 = 10.0;
/// Matches that cost more than this many nats do not count, even to bring the number of dots left out nearer to
/// the usual one.
pub(super) const MIN_GAIN: f64 = -7.0;
/// Maximum weight of a dot during the search: near the pole one dot alone would determine the
/// rotation.
pub(super) const SEARCH_WEIGHT: f64 = 1.0;
/// Maximum weight of a dot in the reported rotation.
pub(super) const FINAL_WEIGHT: f64 = 4.0;
/// Steps of the kernel's table for one standard deviation.
const KERNEL_STEPS: f64 = 32.0;
/// Steps of the visibility table over z in [-1, 1].
const Z_STEPS: usize = 2048;
/// Steps of the table of fixed numbers of dots, for one visible dot.
const GIVEN_STEPS: f64 = 64.0;
/// Where, in standard deviations, the screening's straight lines touch the kernel.
const TANGENTS: [f64; 3] = [0.8, 2.4, 5.0];

/// The tables of one view model.
#[derive(Debug, Clone)]
pub(super) struct ViewTables {
    kernel: Vec<f64>,
    weight: Vec<f64>,
    visibility: Vec<Visibility>,
    /// ln of the probability of the dots that are given, by the number of visible ones in steps of
    /// 1 / [`GIVEN_STEPS`]; empty where their number is not fixed.
    ln_given: Vec<f64>,
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
    /// Maximum worth of a pattern dot.
    max_worth: f64,
}

/// What a pattern dot at some z adds to the log-likelihood.
#[derive(Debug, Clone, Copy)]
pub(super) struct Visibility {
    /// What it gains where it is matched rather than missed.
    pub worth: f64,
    /// Where it is missed.
    pub missed: f64,
    /// Probability that it is visible.
    pub visible: f64,
}

/// An observed dot, prepared.
#[derive(Debug, Clone, Copy)]
pub(super) struct PreparedDot {
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
    /// Squared distance, in standard deviations, beyond which no match gains [`MIN_GAIN`].
    pub reach_squared: f64,
    /// Upper bound of what the dot adds to the log-likelihood ratio, the penalty of missing it
    /// included.
    pub most: f64,
}

impl PreparedDot {
    /// Squared Mahalanobis distance of the direction `q`; for an isotropic dot `|q - o|^2 /
    /// sigma^2`.
    pub fn distance_squared(&self, q: &Vec3) -> f64 {
        let [a, b] = self.axes.map(|u| u.dot(q));
        let depth = 1.0 - self.direction.dot(q);
        a * a + b * b + depth * depth * self.radial
    }

    /// The same dot with an independent error of this variance (rad^2) along either tangent axis
    /// besides.
    pub fn widened(&self, variance: f64) -> Self {
        // In the whitened axes W the covariance becomes I + v W W^T = L L^T; the rows of L^-1 W are
        // the new axes.
        let [a, b] = self.axes;
        let l11 = (1.0 + variance * a.norm_squared()).sqrt();
        let l21 = variance * a.dot(&b) / l11;
        let l22 = (1.0 + variance * b.norm_squared() - l21 * l21).sqrt();
        let sigma_max = self.sigma_max.hypot(variance.sqrt());
        Self {
            axes: [a / l11, (b - a * (l21 / l11)) / l22],
            radial: 1.0 / (sigma_max * sigma_max),
            sigma_max,
            ln_peak: self.ln_peak - (l11 * l22).ln(),
            ..*self
        }
    }

    /// Reverses x.
    pub fn mirror(&mut self) {
        self.direction.x = -self.direction.x;
        for axis in &mut self.axes {
            axis.x = -axis.x;
        }
    }
}

impl ViewTables {
    /// The tables of a view model, for a pattern of so many dots.
    pub fn new(view: &ViewModel, pattern_dots: usize) -> Self {
        let shape = view.noise.shape();
        let steps = (GATE * KERNEL_STEPS) as usize + 2;
        let kernel = (0..steps)
            .map(|k| shape.ln_kernel(k as f64 / KERNEL_STEPS))
            .collect();
        let weight = (0..steps)
            .map(|k| tangent(shape, (k as f64 / KERNEL_STEPS).max(POLE))[1])
            .collect();
        let given = match view.detection {
            Detection::Each { .. } => None,
            Detection::Given { dots } => Some(dots),
        };
        let detected = view.detection_rate(pattern_dots).min(MAX_DETECTION);
        let visibility = (0..=Z_STEPS).map(|k| {
            let z = 2.0 * k as f64 / Z_STEPS as f64 - 1.0;
            let visible = visible(z, view.visibility_limit);
            let missed = match given {
                None => (1.0 - detected * visible).ln(),
                Some(_) => 0.0,
            };
            let found = if given.is_none() { detected } else { 1.0 };
            Visibility {
                worth: (found * visible).ln() - missed,
                missed,
                visible,
            }
        });
        let visibility: Vec<_> = visibility.collect();
        let max_worth = visibility
            .iter()
            .map(|v| v.worth)
            .fold(f64::NEG_INFINITY, f64::max);
        let false_count = view.false_dots.over_poisson();
        let mut max_false_count = false_count.clone();
        for k in (1..max_false_count.len()).rev() {
            max_false_count[k - 1] = max_false_count[k - 1].max(max_false_count[k]);
        }
        let mean_false = view.false_dots.mean();
        let peak = shape.ln_kernel(0.0);
        Self {
            kernel,
            weight,
            visibility,
            ln_given: given.map_or_else(Vec::new, |given| ln_given(given, pattern_dots)),
            lines: TANGENTS.map(|u| tangent(shape, u)),
            ln_false_density: mean_false.ln() + view.ln_false_density(),
            mean_false,
            noise_scale: view.noise_scale,
            false_count,
            max_false_count,
            most: peak + if given.is_none() { detected.ln() } else { 0.0 },
            max_worth,
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

    /// The squared distance from which on the kernel, which falls, does not exceed `least`; at most the gate's.
    fn reach_squared(&self, least: f64) -> f64 {
        let steps = self.kernel.partition_point(|&ln| ln > least);
        (steps as f64 / KERNEL_STEPS).min(GATE).powi(2)
    }

    /// Weight of a displacement in a least-squares step towards the kernel's maximum,
    /// `-ln_kernel'(u) / u`: 1 for one Gaussian, less for heavier tails, and more towards a pole,
    /// up to `most`.
    pub fn weight(&self, d2: f64, most: f64) -> f64 {
        let k = (d2.sqrt() * KERNEL_STEPS) as usize;
        self.weight[k.min(self.weight.len() - 1)].min(most)
    }

    /// What a pattern dot at this z adds.
    pub fn visibility(&self, z: f64) -> Visibility {
        let k = ((z + 1.0) * (0.5 * Z_STEPS as f64) + 0.5) as usize;
        self.visibility[k.min(Z_STEPS)]
    }

    /// ln of the probability of the dots that are given, of so many visible ones, where their number
    /// is fixed; else 0.
    pub fn ln_given(&self, visible: f64) -> f64 {
        if self.ln_given.is_empty() {
            return 0.0;
        }
        let at = visible * GIVEN_STEPS;
        let k = (at as usize).min(self.ln_given.len() - 2);
        let here = self.ln_given[k];
        here + (self.ln_given[k + 1] - here) * (at - k as f64)
    }

    /// ln of the prior of `count` false dots over the Poisson distribution's.
    pub fn false_count(&self, count: usize) -> f64 {
        self.false_count[count.min(self.false_count.len() - 1)]
    }

    /// How many numbers of false dots differ in [`ViewTables::false_count`]: the last holds for all larger ones.
    pub fn false_counts(&self) -> usize {
        self.false_count.len()
    }

    /// The maximum [`ViewTables::false_count`] of `count` or more false dots.
    pub fn max_false_count(&self, count: usize) -> f64 {
        self.max_false_count[count.min(self.max_false_count.len() - 1)]
    }

    /// ln of the density of `count` dots that are all false, up to the prior of their number.
    pub fn ln_all_false(&self, count: usize) -> f64 {
        count as f64 * self.ln_false_density - self.mean_false
    }

    /// ln of the Gaussian's peak density of a prepared dot, per steradian.
    pub fn ln_gaussian_peak(&self, dot: &PreparedDot) -> f64 {
        dot.ln_peak + self.ln_false_density
    }

    /// Ratio of the dots' standard deviations to those given.
    pub fn noise_scale(&self) -> f64 {
        self.noise_scale
    }

    /// Prepares a dot; `None` where its direction or its covariance is invalid.
    pub fn prepare(&self, dot: &ObservedDot) -> Option<PreparedDot> {
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
        Some(PreparedDot {
            direction,
            axes,
            radial: 1.0 / (sigma_max * sigma_max),
            isotropic,
            sigma_max,
            ln_peak,
            reach_squared: self.reach_squared(MIN_GAIN - ln_peak - self.max_worth),
            most: (ln_peak + self.most).max(0.0),
        })
    }
}

/// ln of `1 / C(V, given)` for V from 0 to the number of pattern dots in steps of 1 / [`GIVEN_STEPS`]; of fewer
/// visible dots than are given as of those.
fn ln_given(given: usize, pattern_dots: usize) -> Vec<f64> {
    let ln_factorial = |x: f64| libm::lgamma(x + 1.0);
    let given = given as f64;
    let steps = 0..=pattern_dots * GIVEN_STEPS as usize + 1;
    let of_step = |k: usize| {
        let visible = (k as f64 / GIVEN_STEPS).max(given);
        ln_factorial(given) + ln_factorial(visible - given) - ln_factorial(visible)
    };
    steps.map(of_step).collect()
}

/// The line `a + b h` over `h = -u^2 / 2` that touches the kernel at `u`.
fn tangent(noise: NoiseShape, u: f64) -> [f64; 2] {
    let step = 1e-4;
    let slope = (noise.ln_kernel(u + step) - noise.ln_kernel(u - step)) / (2.0 * step);
    let b = -slope / u;
    [noise.ln_kernel(u) + b * 0.5 * u * u, b]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::view::FalseDots;

    #[test]
    fn what_is_beyond_the_gate_has_no_kernel() {
        let model = ViewTables::new(&ViewModel::default(), 20);
        assert!(model.ln_kernel(GATE * GATE).is_some());
        for d2 in [GATE * GATE * 1.001, 1e300, f64::INFINITY, f64::NAN] {
            assert_eq!(model.ln_kernel(d2), None, "{d2}");
        }
        let exact = NoiseShape::HeavyTailed.ln_kernel(2.345);
        let table = model.ln_kernel(2.345 * 2.345).expect("within the gate");
        assert!((exact - table).abs() < 1e-3, "{exact} {table}");
    }

    #[test]
    fn nothing_matches_beyond_the_reach() {
        for noise in [
            crate::view::Noise::RandomAxis { sigma_rad: 0.05 },
            ViewModel::default().noise,
        ] {
            let view = ViewModel {
                noise,
                ..ViewModel::default()
            };
            let model = ViewTables::new(&view, 20);
            for least in [-30.0, -12.0, -6.5, -1.0, 0.5] {
                let reach = model.reach_squared(least);
                for k in 0..=1000 {
                    let d2 = reach + 1e-3 + 0.1 * f64::from(k);
                    let more = model.ln_kernel(d2).filter(|ln| *ln > least + 1e-12);
                    assert_eq!(more, None, "{least}: {d2} beyond {reach}");
                }
            }
        }
    }

    #[test]
    fn dots_given_are_any_of_the_visible_ones() {
        let view = ViewModel {
            detection: Detection::Given { dots: 4 },
            ..ViewModel::default()
        };
        let model = ViewTables::new(&view, 20);
        // C(4, 4), C(7, 4), C(20, 4).
        for (visible, ways) in [(2.0, 1.0), (4.0, 1.0), (7.0, 35.0), (20.0, 4845.0f64)] {
            assert!(
                (model.ln_given(visible) + ways.ln()).abs() < 1e-12,
                "{visible}"
            );
        }
        // 6.51 lies between two steps: 6.51! / (4! 2.51!) by the gamma function.
        let between = libm::lgamma(5.0) + libm::lgamma(3.51) - libm::lgamma(7.51);
        assert!((model.ln_given(6.51) - between).abs() < 1e-5);
    }

    #[test]
    fn the_bound_on_the_false_dots_prior_bounds_it() {
        let view = ViewModel {
            false_dots: FalseDots::Usual(2),
            ..ViewModel::default()
        };
        let model = ViewTables::new(&view, 20);
        for from in 0..6 {
            let brute = (from..40).map(|k| model.false_count(k));
            let brute = brute.fold(f64::NEG_INFINITY, f64::max);
            assert_eq!(model.max_false_count(from), brute, "from {from}");
        }
        // Poisson's 2 of mean 2 has 0.2707; 98 % and a fiftieth of Poisson's is 1.3 nats more.
        assert!((model.max_false_count(0) - (0.02f64 + 0.98 / 0.270_67).ln()).abs() < 1e-4);
    }
}
