//! The screening: a fast score of every alignment of one observed pair with the pattern.
//!
//! The score is the log-likelihood ratio of the model with four simplifications: single precision;
//! the kernel as three straight lines; visibility as straight lines; and no exclusion (two observed
//! dots may take one pattern dot). The variance of each dot is widened by what the error of the
//! pair's two dots does to it. A hypothesis is dropped as soon as the remaining dots cannot raise
//! its score to the threshold.

use nalgebra::Matrix3;
use wide::f32x4;

use super::model::{MAX_DETECTION, PreparedDot, ViewTables};
use super::pairs::{LANES, PatternPairs, frame};
use crate::geometry::Vec3;
use crate::view::{LOGISTIC, VISIBILITY_SOFTNESS, ViewModel};

/// Nats behind the best score from which on a hypothesis is dropped.
const MARGIN: f32 = 16.0;
/// Maximum number of hypotheses kept; a pattern with 60 symmetries has 60 of equal score.
const MAX_KEPT: usize = 96;
/// Cosine-space reach of similar pairs, in standard deviations of their angle.
const PAIR_GATE: f64 = 3.5;
const FAR: f32 = -1e30;

/// A hypothesis that passed.
#[derive(Debug, Clone, Copy)]
pub(super) struct Screened {
    pub score: f32,
    /// Position among the pattern's pairs.
    pub pair: u32,
}

/// An observed dot in the frame of the current pair.
#[derive(Debug, Clone, Copy)]
struct Local {
    direction: [f32; 3],
    axes: [[f32; 3]; 2],
    /// Inverse variance, and half of it negated for `h = -u^2 / 2`.
    radial: f32,
    /// Gain of a perfect match before detection.
    peak: f32,
    isotropic: bool,
    /// Maximum gain of this dot and those after it.
    at_most: f32,
}

/// Scratch memory of the screening.
#[derive(Debug, Default)]
pub(super) struct Screen {
    local: Vec<Local>,
    worth: Vec<f32x4>,
    kept: Vec<Screened>,
}

/// Constants of the screening in single precision.
#[derive(Debug, Clone)]
pub(super) struct ScreenModel {
    lines: [[f32; 2]; 3],
    visibility_limit: f32,
    ln_detected: f32,
    ln_missed: f32,
    max_worth: f32,
    /// The penalty that the padding adds.
    padding: f32,
}

impl ScreenModel {
    pub fn new(view: &ViewModel, model: &ViewTables, dots: usize, pairs: &PatternPairs) -> Self {
        let detected = view.detection_rate(dots).min(MAX_DETECTION);
        let mut this = Self {
            lines: model.lines.map(|l| l.map(|x| x as f32)),
            visibility_limit: view.visibility_limit as f32,
            ln_detected: detected.ln() as f32,
            ln_missed: (1.0 - detected).ln() as f32,
            max_worth: 0.0,
            padding: 0.0,
        };
        this.max_worth = this.ln_detected - this.ln_missed;
        let [missed, ..] = this.visibility(f32x4::ZERO).1.to_array();
        this.padding = missed * (pairs.row() * LANES - dots) as f32;
        this
    }

    /// ln of detection and of missing at these z, by straight lines.
    #[inline(always)]
    fn visibility(&self, z: f32x4) -> (f32x4, f32x4) {
        let slope = (LOGISTIC / VISIBILITY_SOFTNESS) as f32;
        let t = (z - f32x4::splat(self.visibility_limit)) * slope;
        let share = (t * 0.25 + 0.5).fast_max(f32x4::ZERO).fast_min(f32x4::ONE);
        let detected = t.fast_min(f32x4::ZERO) + self.ln_detected;
        (detected, share * self.ln_missed)
    }

    /// The maximum of the kernel's lines at `h`.
    #[inline(always)]
    fn ln_kernel(&self, h: f32x4) -> f32x4 {
        let [a, b, c] = self.lines.map(|[at, slope]| h * slope + at);
        a.fast_max(b).fast_max(c)
    }
}

impl Screen {
    pub fn with_capacity_for(dots: usize, row: usize) -> Self {
        Self {
            local: Vec::with_capacity(dots),
            worth: Vec::with_capacity(row),
            kept: Vec::with_capacity(MAX_KEPT + 1),
        }
    }

    /// The hypotheses that passed in the last run, best first.
    pub fn kept(&self) -> &[Screened] {
        &self.kept
    }

    /// Scores every alignment of the observed dots `a` and `b` with pattern dots of similar angle.
    /// `bias` is the logarithm of the prior for each.
    pub fn run(
        &mut self,
        model: &ScreenModel,
        pairs: &PatternPairs,
        dots: &[PreparedDot],
        (a, b): (usize, usize),
        bias: Option<impl Fn(usize) -> f64>,
    ) -> Option<()> {
        self.kept.clear();
        let (oa, ob) = (&dots[a], &dots[b]);
        let observed = crate::geometry::angle_between(&oa.direction, &ob.direction);
        let spread = oa.sigma_max.hypot(ob.sigma_max);
        let low = (observed + PAIR_GATE * spread)
            .min(std::f64::consts::PI)
            .cos();
        let high = (observed - PAIR_GATE * spread).max(0.0).cos();
        let axes = frame(&oa.direction, &ob.direction);
        self.localize(model, dots, (a, b), &axes)?;
        let towards = axes.row(2);
        let view = [towards[0] as f32, towards[1] as f32, towards[2] as f32];
        let own = dots[a].ln_peak + dots[b].ln_peak;
        let mut threshold = FAR;
        for index in pairs.between(low, high) {
            let misfit = (pairs.pair(index).angle_rad - observed) / spread;
            let prior = bias.as_ref().map_or(0.0, |b| b(index));
            let own = (own + prior) as f32
                + self.pair_kernel(model, misfit as f32)
                + 2.0 * model.max_worth;
            let Some(score) = self.score(model, pairs.in_frame(index), view, own, threshold) else {
                continue;
            };
            threshold = self.keep(score, index as u32, threshold);
        }
        Some(())
    }

    /// The cost of the pair's own misfit, shared by its two dots.
    fn pair_kernel(&self, model: &ScreenModel, misfit: f32) -> f32 {
        2.0 * model
            .ln_kernel(f32x4::splat(-0.25 * misfit * misfit))
            .to_array()[0]
    }

    /// Takes the observed dots but a and b to the pair's frame, and widens their variances.
    fn localize(
        &mut self,
        model: &ScreenModel,
        dots: &[PreparedDot],
        (a, b): (usize, usize),
        axes: &Matrix3<f64>,
    ) -> Option<()> {
        let mut information = Matrix3::zeros();
        for k in [a, b] {
            for row in jacobian(&dots[k]) {
                information += row * row.transpose();
            }
        }
        let covariance = information.cholesky()?.inverse();
        let to_local = axes.transpose();
        let single = |v: Vec3| [v.x as f32, v.y as f32, v.z as f32];
        self.local.clear();
        for (k, dot) in dots.iter().enumerate() {
            if k == a || k == b {
                continue;
            }
            let [j1, j2] = jacobian(dot);
            let ratio = 1.0 + 0.5 * (j1.dot(&(covariance * j1)) + j2.dot(&(covariance * j2)));
            let narrow = ratio.sqrt().recip();
            self.local.push(Local {
                direction: single(to_local * dot.direction),
                axes: dot.axes.map(|u| single(to_local * u * narrow)),
                radial: (dot.radial / ratio) as f32,
                peak: (dot.ln_peak - ratio.ln()) as f32,
                isotropic: dot.isotropic,
                at_most: 0.0,
            });
        }
        let mut at_most = 0.0;
        let most = model.max_worth + model.ln_kernel(f32x4::ZERO).to_array()[0];
        for local in self.local.iter_mut().rev() {
            at_most += max(local.peak + most, 0.0);
            local.at_most = at_most;
        }
        Some(())
    }

    /// The score of a hypothesis, or `None` where it stays under the threshold.
    #[inline]
    fn score(
        &mut self,
        model: &ScreenModel,
        [x, y, z]: [&[f32x4]; 3],
        view: [f32; 3],
        own: f32,
        threshold: f32,
    ) -> Option<f32> {
        self.worth.clear();
        let mut penalty = f32x4::ZERO;
        for ((x, y), z) in x.iter().zip(y).zip(z) {
            let (detected, missed) = model.visibility(*x * view[0] + *y * view[1] + *z * view[2]);
            penalty += missed;
            self.worth.push(detected - missed);
        }
        let mut score = own + penalty.reduce_add() - model.padding;
        for dot in &self.local {
            if score + dot.at_most < threshold {
                return None;
            }
            let gain = if dot.isotropic {
                best_isotropic(model, dot, [x, y, z], &self.worth)
            } else {
                best_gain(model, dot, [x, y, z], &self.worth)
            };
            score += max(dot.peak + gain, 0.0);
        }
        (score > threshold).then_some(score)
    }

    /// Keeps a score; returns the threshold for the next.
    fn keep(&mut self, score: f32, pair: u32, threshold: f32) -> f32 {
        let at = self.kept.partition_point(|k| k.score >= score);
        if self.kept.len() == MAX_KEPT {
            self.kept.pop();
        }
        self.kept.insert(at, Screened { score, pair });
        let full = (self.kept.len() == MAX_KEPT).then(|| self.kept[MAX_KEPT - 1].score);
        max(
            threshold,
            max(self.kept[0].score - MARGIN, full.unwrap_or(FAR)),
        )
    }
}

/// Best gain of an isotropic dot over the pattern's dots, before its peak.
#[inline(always)]
fn best_isotropic(
    model: &ScreenModel,
    dot: &Local,
    [x, y, z]: [&[f32x4]; 3],
    worth: &[f32x4],
) -> f32 {
    let [ox, oy, oz] = dot.direction.map(|v| f32x4::splat(v * dot.radial));
    let mut best = f32x4::splat(FAR);
    for (((x, y), z), worth) in x.iter().zip(y).zip(z).zip(worth) {
        let h = ox * *x + oy * *y + oz * *z - dot.radial;
        best = best.fast_max(model.ln_kernel(h) + *worth);
    }
    best.to_array().into_iter().fold(FAR, max)
}

/// As [`best_isotropic`], for any covariance.
#[inline(always)]
fn best_gain(model: &ScreenModel, dot: &Local, [x, y, z]: [&[f32x4]; 3], worth: &[f32x4]) -> f32 {
    let mut best = f32x4::splat(FAR);
    for (((x, y), z), worth) in x.iter().zip(y).zip(z).zip(worth) {
        let along = |d: [f32; 3]| *x * d[0] + *y * d[1] + *z * d[2];
        let (p, q) = (along(dot.axes[0]), along(dot.axes[1]));
        let depth = along(dot.direction) - 1.0;
        let h = (p * p + q * q + depth * depth * dot.radial) * -0.5;
        best = best.fast_max(model.ln_kernel(h) + *worth);
    }
    best.to_array().into_iter().fold(FAR, max)
}

/// Change of the dot's whitened displacement with a small rotation of the pattern at it.
fn jacobian(dot: &PreparedDot) -> [Vec3; 2] {
    dot.axes.map(|u| dot.direction.cross(&u))
}

/// The maximum of two numbers, as one instruction; no NaN occurs here.
#[inline(always)]
fn max(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}
