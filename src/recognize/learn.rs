//! Unknown conditions: noise, missed dots and false dots, learned from the frames themselves.
//!
//! A file of frames comes from one camera, one detector and one ball. What the recognizer has to
//! expect (noise, visibility limit, detection rate, false dots) is therefore shared by its frames,
//! and the frames that are easy to identify show it for those that are not: empirical Bayes (B.
//! Efron, "Large-Scale Inference", 2010, ch. 1), with a weak prior.
//!
//! Given an explanation of a frame (rotation and assignment), the likelihood is a product of three
//! factors with one group of unknowns each:
//!
//! ```text
//! ln p(frame, e | n, v, f) = c_e + N_e(n) + V_e(v) + F_e(f)
//! N_e(n) = sum_matched ln_kernel_n(u / s) + (3 - 2 matched) ln s      noise: its scale s and shape
//! V_e(v) = sum_matched ln d_v(z) + sum_missed ln(1 - d_v(z))          visibility limit, detection rate
//! F_e(f) = ln P_f(k) + ln k! - k ln A                                 k false dots, uniform over A
//! ```
//!
//! The noise's part is that of the explanation's rotation with Laplace's factor, exact for one Gaussian. For a peaked
//! density it is biased: once some frames have had a say it is integrated over the rotations (module `integral`).
//!
//! Each group has a grid and a discrete distribution over it. [`ConditionsPosterior::learn`]
//! alternates the explanations' probabilities and the groups' distributions until they settle (mean
//! field: D. Blei et al., "Variational inference: a review for statisticians", JASA 112, 2017,
//! eq. 17). For a single explanation the sum over all conditions is then exact: a product of three
//! sums.
//!
//! A share of the frames shows something else than the ball, or its mirror image. These shares are
//! learned beside the groups: each frame counts for what it shows with its probability, and the prior
//! counts as one frame more.
//!
//! False dots are uniform over the hemisphere towards the camera, whatever the limit of the real
//! ones: a limit must not explain away a false dot that lies beyond it.
//!
//! Guarantees: the same frames give the same bits. Not guaranteed: that conditions which change
//! within the file, or from frame to frame, are followed.

mod integral;
mod steps;

use std::f64::consts::TAU;
use std::ops::Range;

use nalgebra::Matrix3;

use crate::error::{Result, require};
use crate::recognize::ln_sum::ln_sum;
use crate::view::{Detection, FalseDots, Noise, NoiseShape, ViewModel, visible};
use integral::Densities;
pub(super) use integral::{Displacement, information};
use steps::over_steps;

/// The noise's scales: steps of an eighth from 0.3 to 3.1.
const SCALES: usize = 21;
const MIN_SCALE: f64 = 0.3;
const SCALE_STEP: f64 = 1.125;
/// Steps from the likeliest scale up to which the noise is integrated: to 0.6 and 1.6 times it.
const LIKELY_STEPS: usize = 4;
const SHAPES: [NoiseShape; 2] = [NoiseShape::HeavyTailed, NoiseShape::RandomAxis];
const NOISES: usize = SCALES * SHAPES.len();

const LIMITS: usize = 12;
const MIN_LIMIT: f64 = 0.0;
const LIMIT_STEP: f64 = 0.05;
const RATES: [f64; 10] = [0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.87, 0.93, 0.97, 0.99];
/// Their prior probabilities: most detectors find most dots.
const RATES_PRIOR: [f64; RATES.len()] =
    [0.03, 0.04, 0.06, 0.08, 0.10, 0.16, 0.18, 0.18, 0.12, 0.05];
const VISIBILITIES: usize = LIMITS * RATES.len();

/// Mean numbers of false dots, where their number varies (Poisson).
const MEANS: [f64; 9] = [0.02, 0.06, 0.15, 0.35, 0.7, 1.3, 2.2, 4.0, 8.0];
/// Numbers of false dots that nearly every frame has.
const USUALS: usize = 6;
const FALSE_DOTS: usize = MEANS.len() + USUALS;
/// Prior probability that nearly every frame has the same number of false dots.
const USUAL_PRIOR: f64 = 0.3;
/// Steps of the kernels' tables for one standard deviation, and their end: farther dots are as
/// unlikely as there.
const KERNEL_STEPS: f64 = 16.0;
const MAX_DEVIATIONS: f64 = 24.0;
/// Steps of the visibility tables over z in [-1, 1].
const Z_STEPS: usize = 512;
/// Area over which false dots are uniform, steradians.
const FALSE_AREA: f64 = TAU;
/// Maximum number of alternations; they settle in about ten.
const MAX_TURNS: usize = 40;
/// Change of a probability below which the alternations have settled.
const SETTLED: f64 = 1e-6;
/// A posterior from as many frames is as good as known: marginalizing changes nothing.
const ENOUGH_FRAMES: usize = 64;

/// What is known of the conditions before the frames are seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ConditionsPrior {
    /// Standard deviation of the logarithm of the noise's scale.
    pub ln_scale_sigma: f64,
    /// Expected visibility limit, and its standard deviation.
    pub visibility_limit: f64,
    /// See above.
    pub visibility_sigma: f64,
    /// The detection probability, where it is known.
    pub detection_probability: Option<f64>,
    /// The mean number of false dots, where it is known.
    pub expected_false_dots: Option<f64>,
    /// The share of frames that show something else than the ball, where it is known.
    pub foreign_share: Option<f64>,
}

impl Default for ConditionsPrior {
    /// Noise as given to within a factor of 1.65, a visibility limit of 0.1 +- 0.2; nothing else is
    /// known.
    fn default() -> Self {
        Self {
            ln_scale_sigma: 0.5,
            visibility_limit: 0.1,
            visibility_sigma: 0.2,
            detection_probability: None,
            expected_false_dots: None,
            foreign_share: None,
        }
    }
}

/// Shares of what frames show besides the ball as it is.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Shares {
    foreign: f64,
    mirrored: f64,
}

impl Shares {
    /// Before any frame; as in [`ViewModel::default`] where the share of foreign frames is not known.
    fn of_prior(prior: &ConditionsPrior) -> Self {
        let usual = ViewModel::default();
        Self {
            foreign: prior.foreign_share.unwrap_or(usual.foreign_share),
            mirrored: usual.mirrored_share,
        }
    }

    fn own(&self) -> f64 {
        1.0 - self.foreign - self.mirrored
    }
}

/// A distribution over the conditions, given some frames.
#[derive(Debug, Clone)]
pub struct ConditionsPosterior {
    grid: ConditionsGrid,
    prior: GridWeights,
    weights: GridWeights,
    prior_shares: Shares,
    shares: Shares,
    /// Whether the share of foreign frames is known.
    knows_foreign: bool,
    frames: usize,
}

/// Logarithms of the probabilities of all settings.
#[derive(Debug, Clone, Copy, PartialEq)]
struct GridWeights {
    noise: [f64; NOISES],
    visibility: [f64; VISIBILITIES],
    false_dots: [f64; FALSE_DOTS],
}

/// The settings, and the tables of the likelihood under each.
#[derive(Debug, Clone)]
struct ConditionsGrid {
    /// ln of detection and of missing by z, a row of all visibilities each.
    detected: Vec<[f64; VISIBILITIES]>,
    missed: Vec<[f64; VISIBILITIES]>,
    /// ln of each shape's kernel by the number of standard deviations.
    kernels: [Vec<f64>; SHAPES.len()],
    /// The same with the pole, for the integral.
    densities: Densities,
    rates: [f64; RATES.len()],
    means: [f64; MEANS.len()],
}

/// An explanation's log-likelihood under every setting, up to a constant of the frame.
#[derive(Debug, Clone, Copy)]
pub(super) struct LnLikelihood {
    /// Independent of the conditions.
    pub constant: f64,
    noise: [f64; NOISES],
    visibility: [f64; VISIBILITIES],
    false_dots: [f64; FALSE_DOTS],
}

/// What a frame's best explanations say of the conditions.
#[derive(Debug, Clone, Default)]
pub struct FrameEvidence {
    pub(super) explanations: Vec<LnLikelihood>,
    /// ln of the probability of the dots, if they are not the pattern's.
    pub(super) ln_null: f64,
    /// The same, if they are the mirrored pattern's.
    pub(super) ln_mirrored: f64,
    /// Scratch memory: the dots of the explanation in hand.
    pub(super) displacements: Vec<Displacement>,
}

fn scale(noise: usize) -> f64 {
    MIN_SCALE * SCALE_STEP.powi((noise % SCALES) as i32)
}

fn limit(visibility: usize) -> f64 {
    MIN_LIMIT + LIMIT_STEP * (visibility / RATES.len()) as f64
}

impl ConditionsGrid {
    fn new(prior: &ConditionsPrior) -> Self {
        // What is known has one value, whatever the place on the grid.
        let rates = prior
            .detection_probability
            .map_or(RATES, |p| [p; RATES.len()]);
        let means = prior
            .expected_false_dots
            .map_or(MEANS, |m| [m; MEANS.len()]);
        let probability = |step: usize, visibility: usize| {
            let z = 2.0 * step as f64 / Z_STEPS as f64 - 1.0;
            rates[visibility % RATES.len()] * visible(z, limit(visibility))
        };
        let row = |of: fn(f64) -> f64| {
            (0..=Z_STEPS)
                .map(|step| std::array::from_fn(|v| of(probability(step, v))))
                .collect()
        };
        Self {
            detected: row(f64::ln),
            missed: row(|d| (1.0 - d).ln()),
            kernels: SHAPES.map(|shape| {
                let at = |k| shape.ln_kernel(k as f64 / KERNEL_STEPS);
                (0..=(MAX_DEVIATIONS * KERNEL_STEPS) as usize + 1)
                    .map(at)
                    .collect()
            }),
            densities: Densities::new(),
            rates,
            means,
        }
    }

    /// ln of the kernel of this noise's shape.
    fn ln_kernel(&self, noise: usize, deviations: f64) -> f64 {
        let at = deviations.min(MAX_DEVIATIONS) * KERNEL_STEPS;
        let k = at as usize;
        let table = &self.kernels[noise / SCALES];
        table[k] + (table[k + 1] - table[k]) * (at - k as f64)
    }

    fn false_dots(&self, setting: usize) -> FalseDots {
        match setting.checked_sub(MEANS.len()) {
            None => FalseDots::Poisson(self.means[setting]),
            Some(usual) => FalseDots::Usual(usual as u16),
        }
    }

    /// ln of the density of `count` false dots, in any order.
    fn ln_false(&self, setting: usize, count: usize) -> f64 {
        self.false_dots(setting).ln_orders(count) - count as f64 * FALSE_AREA.ln()
    }
}

fn normalize(ln_weights: &mut [f64]) {
    let sum = ln_sum(ln_weights.iter().copied());
    ln_weights.iter_mut().for_each(|w| *w -= sum);
}

/// ln of the sum of the exponentials of `a + b`.
fn ln_sum_of_sums(a: &[f64], b: &[f64]) -> f64 {
    ln_sum(a.iter().zip(b).map(|(a, b)| a + b))
}

impl GridWeights {
    fn of_prior(prior: &ConditionsPrior) -> Self {
        // A known mean leaves no number of its own to nearly every frame.
        let usual = match prior.expected_false_dots {
            Some(_) => f64::NEG_INFINITY,
            None => (USUAL_PRIOR / USUALS as f64).ln(),
        };
        let varying = ((1.0 - USUAL_PRIOR) / MEANS.len() as f64).ln();
        let mut weights = Self {
            noise: std::array::from_fn(|n| -0.5 * (scale(n).ln() / prior.ln_scale_sigma).powi(2)),
            visibility: std::array::from_fn(|v| {
                let off = (limit(v) - prior.visibility_limit) / prior.visibility_sigma;
                RATES_PRIOR[v % RATES.len()].ln() - 0.5 * off * off
            }),
            false_dots: std::array::from_fn(|f| if f < MEANS.len() { varying } else { usual }),
        };
        weights.normalize();
        weights
    }

    fn normalize(&mut self) {
        normalize(&mut self.noise);
        normalize(&mut self.visibility);
        normalize(&mut self.false_dots);
    }

    /// ln of an explanation's likelihood, summed over all settings.
    fn ln_marginal(&self, e: &LnLikelihood) -> f64 {
        e.constant
            + ln_sum_of_sums(&self.noise, &e.noise)
            + ln_sum_of_sums(&self.visibility, &e.visibility)
            + ln_sum_of_sums(&self.false_dots, &e.false_dots)
    }

    fn distance(&self, other: &Self) -> f64 {
        let all = |w: &Self| {
            let [n, v, f] = [
                w.noise.to_vec(),
                w.visibility.to_vec(),
                w.false_dots.to_vec(),
            ];
            [n, v, f].concat()
        };
        let pairs = all(self).into_iter().zip(all(other));
        pairs
            .map(|(a, b)| (a.exp() - b.exp()).abs())
            .fold(0.0, f64::max)
    }
}

/// The parts of a [`LnLikelihood`] that the explanation of a frame fills in.
pub(super) struct Tally<'a> {
    grid: &'a ConditionsGrid,
    to: LnLikelihood,
    /// Scale that the distances were measured with.
    scale: f64,
    matched: usize,
}

impl Tally<'_> {
    /// A pattern dot at this z that was matched, at this many standard deviations.
    pub fn matched(&mut self, z: f64, deviations: f64) {
        self.matched += 1;
        for (n, to) in self.to.noise.iter_mut().enumerate() {
            *to += self.grid.ln_kernel(n, deviations * self.scale / scale(n));
        }
        self.add_row(&self.grid.detected, z);
    }

    /// A pattern dot at this z that was missed.
    pub fn missed(&mut self, z: f64) {
        self.add_row(&self.grid.missed, z);
    }

    fn add_row(&mut self, rows: &[[f64; VISIBILITIES]], z: f64) {
        let step = ((z + 1.0) * (0.5 * Z_STEPS as f64) + 0.5) as usize;
        let row = &rows[step.min(Z_STEPS)];
        for (to, x) in self.to.visibility.iter_mut().zip(row) {
            *to += x;
        }
    }

    /// The sum, with as many false dots.
    pub fn finish(mut self, false_dots: usize) -> LnLikelihood {
        // The Gaussian's peak has s^-2 for every dot, the rotations that the dots leave s^3.
        let power = 3.0 - 2.0 * self.matched as f64;
        for (n, to) in self.to.noise.iter_mut().enumerate() {
            *to += power * (scale(n) / self.scale).ln();
        }
        for (f, to) in self.to.false_dots.iter_mut().enumerate() {
            *to = self.grid.ln_false(f, false_dots);
        }
        self.to
    }
}

impl ConditionsPosterior {
    /// The prior: nothing is seen yet.
    ///
    /// # Errors
    /// [`Error::Argument`](crate::Error::Argument) for a value outside its domain.
    pub fn new(prior: &ConditionsPrior) -> Result<Self> {
        let positive = |x: f64| x > 0.0 && x.is_finite();
        let sigma = prior.ln_scale_sigma;
        require(
            positive(sigma),
            "ln_scale_sigma",
            "a positive number",
            sigma,
        )?;
        let sigma = prior.visibility_sigma;
        require(
            positive(sigma),
            "visibility_sigma",
            "a positive number",
            sigma,
        )?;
        let z = prior.visibility_limit;
        let inside = (-1.0..1.0).contains(&z);
        require(inside, "visibility_limit", "a z in [-1, 1)", z)?;
        if let Some(p) = prior.detection_probability {
            let inside = p > 0.0 && p < 1.0;
            require(
                inside,
                "detection_probability",
                "a probability in (0, 1)",
                p,
            )?;
        }
        if let Some(share) = prior.foreign_share {
            let inside = (0.0..0.95).contains(&share);
            require(inside, "foreign_share", "a share in [0, 0.95)", share)?;
        }
        if let Some(mean) = prior.expected_false_dots {
            let inside = mean > 0.0 && mean.is_finite();
            require(inside, "expected_false_dots", "a positive number", mean)?;
        }
        let weights = GridWeights::of_prior(prior);
        let shares = Shares::of_prior(prior);
        Ok(Self {
            grid: ConditionsGrid::new(prior),
            prior: weights,
            weights,
            prior_shares: shares,
            shares,
            knows_foreign: prior.foreign_share.is_some(),
            frames: 0,
        })
    }

    /// Number of frames that had a say.
    pub fn frames(&self) -> usize {
        self.frames
    }

    /// Whether the conditions are known so well that their spread changes no answer.
    pub fn is_settled(&self) -> bool {
        self.frames >= ENOUGH_FRAMES
    }

    /// The posterior given these frames; earlier ones are forgotten.
    pub fn learn(&mut self, frames: &[FrameEvidence]) {
        (self.weights, self.shares) = (self.prior, self.prior_shares);
        for _ in 0..MAX_TURNS {
            let (weights, shares) = self.turn(frames);
            let change = weights
                .distance(&self.weights)
                .max((shares.foreign - self.shares.foreign).abs())
                .max((shares.mirrored - self.shares.mirrored).abs());
            (self.weights, self.shares) = (weights, shares);
            if change < SETTLED {
                break;
            }
        }
        self.frames = frames.iter().filter(|f| !f.explanations.is_empty()).count();
    }

    /// One alternation: the explanations' probabilities, then the groups' distributions and the
    /// shares.
    fn turn(&self, frames: &[FrameEvidence]) -> (GridWeights, Shares) {
        let mut next = self.prior;
        // The prior counts as one frame.
        let Shares {
            mut foreign,
            mut mirrored,
        } = self.prior_shares;
        let mut parts = Vec::new();
        for frame in frames {
            parts.clear();
            let own = self.shares.own().ln();
            let marginals = frame.explanations.iter();
            parts.extend(marginals.map(|e| own + self.weights.ln_marginal(e)));
            parts.push(self.shares.foreign.ln() + frame.ln_null);
            parts.push(self.shares.mirrored.ln() + frame.ln_mirrored);
            let total = ln_sum(parts.iter().copied());
            if let [.., of_foreign, of_mirrored] = parts[..] {
                foreign += (of_foreign - total).exp();
                mirrored += (of_mirrored - total).exp();
            }
            for (e, part) in frame.explanations.iter().zip(&parts) {
                let part = (part - total).exp();
                if part < 1e-9 {
                    continue;
                }
                let add = |to: &mut [f64], from: &[f64]| {
                    to.iter_mut().zip(from).for_each(|(t, f)| *t += part * f);
                };
                add(&mut next.noise, &e.noise);
                add(&mut next.visibility, &e.visibility);
                add(&mut next.false_dots, &e.false_dots);
            }
        }
        next.normalize();
        let all = frames.len() as f64 + 1.0;
        let known = self.knows_foreign.then_some(self.prior_shares.foreign);
        let foreign = known.unwrap_or(foreign / all);
        let mirrored = (mirrored / all).min(0.5 * (1.0 - foreign));
        (next, Shares { foreign, mirrored })
    }

    /// The view expected: the means of the noise's scale, the limit and the rates; the shape
    /// of the noise and the usual number of false dots where they are more likely than not; `base`
    /// holds what is not learned.
    pub fn expected(&self, base: &ViewModel) -> ViewModel {
        let w = &self.weights;
        let [heavy_tailed, random_axis] =
            [0, 1].map(|s| over_steps(&w.noise[s * SCALES..][..SCALES]));
        let best = usize::from(random_axis.0 > heavy_tailed.0);
        let (_, step) = [heavy_tailed, random_axis][best];
        let mean = |of: &dyn Fn(usize) -> f64| -> f64 {
            (0..VISIBILITIES)
                .map(|v| w.visibility[v].exp() * of(v))
                .sum()
        };
        let varying = ln_sum(w.false_dots[..MEANS.len()].iter().copied());
        let usual = (MEANS.len()..FALSE_DOTS)
            .max_by(|&a, &b| w.false_dots[a].total_cmp(&w.false_dots[b]))
            .filter(|&f| w.false_dots[f] > 0.5f64.ln());
        let false_dots = match usual {
            Some(f) => self.grid.false_dots(f),
            // The logarithm's mean: the grid spans decades.
            None => {
                let ln_means = (0..MEANS.len())
                    .map(|f| (w.false_dots[f] - varying).exp() * self.grid.means[f].ln());
                FalseDots::Poisson(ln_means.sum::<f64>().exp())
            }
        };
        ViewModel {
            visibility_limit: mean(&limit),
            noise: Noise::of_shape(SHAPES[best], base.noise.tangent_sigma_rad()),
            noise_scale: MIN_SCALE * SCALE_STEP.powf(step),
            detection: Detection::Each {
                probability: mean(&|v| self.grid.rates[v % RATES.len()]),
            },
            false_dots,
            false_dot_limit: 0.0,
            foreign_share: self.shares.foreign,
            mirrored_share: self.shares.mirrored,
            ..*base
        }
    }

    /// Begins the likelihood of an explanation whose dots' deviations were measured with this
    /// scale of the noise.
    pub(super) fn tally(&self, constant: f64, scale: f64) -> Tally<'_> {
        Tally {
            grid: &self.grid,
            to: LnLikelihood {
                constant,
                noise: [0.0; NOISES],
                visibility: [0.0; VISIBILITIES],
                false_dots: [0.0; FALSE_DOTS],
            },
            scale,
            matched: 0,
        }
    }

    /// Integrates the noise's part of an explanation, whose dots have this information, over the rotations about its own, for the scales that are likely;
    /// the others keep what they have there, as far above the nearest one's.
    pub(super) fn integrate_noise(
        &self,
        scale: f64,
        dots: &mut [Displacement],
        information: &Matrix3<f64>,
        to: &mut LnLikelihood,
    ) {
        let at_rotation = to.noise;
        let likely = self.likely_scales();
        let ends = [likely.start, likely.end - 1];
        let densities = &self.grid.densities;
        let integrated = densities.integrate(scale, dots, information, likely, &mut to.noise);
        if integrated.is_none() {
            return;
        }
        for n in 0..NOISES {
            let nearest = n - n % SCALES + (n % SCALES).clamp(ends[0], ends[1]);
            if nearest != n {
                to.noise[n] = at_rotation[n] + to.noise[nearest] - at_rotation[nearest];
            }
        }
    }

    /// The scales within [`LIKELY_STEPS`] of the likeliest one.
    fn likely_scales(&self) -> Range<usize> {
        let noise = &self.weights.noise;
        let best = (0..NOISES).max_by(|&a, &b| noise[a].total_cmp(&noise[b]));
        let best = best.unwrap_or_default() % SCALES;
        best.saturating_sub(LIKELY_STEPS)..(best + LIKELY_STEPS + 1).min(SCALES)
    }

    /// ln of the density of so many dots, uniform over [`FALSE_AREA`], if they are not the pattern's: as many as a
    /// view of a pattern of `pattern_dots` dots has (Poisson), summed over all conditions.
    pub(super) fn ln_null(&self, dots: usize, pattern_dots: usize) -> f64 {
        let w = &self.weights;
        let of_visibility: [f64; VISIBILITIES] = std::array::from_fn(|v| {
            let seen = 0.5 * (1.0 - limit(v)) * pattern_dots as f64;
            let real = seen * self.grid.rates[v % RATES.len()];
            let of_false_dots: [f64; FALSE_DOTS] = std::array::from_fn(|f| {
                let mean = real + self.grid.false_dots(f).mean();
                w.false_dots[f] + dots as f64 * (mean / FALSE_AREA).ln() - mean
            });
            w.visibility[v] + ln_sum(of_false_dots.iter().copied())
        });
        ln_sum(of_visibility.iter().copied())
    }

    /// ln of an explanation's likelihood, summed over all conditions.
    pub(super) fn ln_marginal(&self, e: &LnLikelihood) -> f64 {
        self.weights.ln_marginal(e)
    }
}
