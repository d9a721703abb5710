//! Refinement of a rough rotation to an explanation: assignment and Gauss-Newton alternate, then
//! the evidence is computed.
//!
//! For an assignment `A` of observed to pattern dots the log-likelihood ratio against "all dots are
//! false" is
//!
//! ```text
//! S(R, A) = sum_matched ln( d_j N(o_i; q_j, C_i) / rho ) + sum_unmatched ln(1 - d_j)
//! ```
//!
//! and the evidence of `A` is `S` at its best rotation plus Laplace's factor for the rotations
//! around it, `(2 pi)^(3/2) / (8 pi^2 sqrt(det H))`, with `H` the information matrix and a uniform
//! prior.

use std::f64::consts::TAU;

use nalgebra::{Matrix3, Rotation3};

use super::hint::HintPrior;
use super::model::{FINAL_WEIGHT, MIN_GAIN, PreparedDot, SEARCH_WEIGHT, ViewTables};
use crate::geometry::{ROTATIONS, Vec3};

/// Marks an observed dot without a pattern dot.
pub(super) const UNASSIGNED: u16 = u16::MAX;
/// Variance ratio of the first assignment from a pair's rotation.
const PAIR_WIDENING: f64 = 2.5;
/// Maximum number of alternations of assignment and Gauss-Newton; they settle in two or three.
const MAX_TURNS: usize = 8;
/// Steps towards the reported rotation.
const POLISH_STEPS: usize = 5;
/// Minimum number of dots that support an explanation.
pub(super) const MIN_MATCHED: usize = 2;
/// Nats that the alternations after the second one hardly ever add.
const UNSETTLED: f64 = 5.0;

/// The observed dots, and the pattern and model they are compared with.
#[derive(Debug)]
pub(super) struct ComparedDots<'a> {
    pub model: &'a ViewTables,
    pub pattern: &'a [Vec3],
    pub dots: &'a [PreparedDot],
    pub prior: Option<&'a HintPrior>,
    /// Minimum z of a visible dot.
    pub visibility_limit: f64,
    /// For each dot of the pattern the variance of its place beyond what the observed dots'
    /// covariances hold, rad^2; empty where there is none.
    pub spread: &'a [f64],
}

/// The observed dot as it is compared with pattern dot `j`: the uncertainty of that dot's place widens its own.
pub(super) fn widened(spread: &[f64], j: usize, dot: &PreparedDot) -> PreparedDot {
    spread
        .get(j)
        .map_or(*dot, |variance| dot.widened(*variance))
}

/// A rough rotation.
#[derive(Debug, Clone, Copy)]
pub(super) struct RoughRotation {
    pub rotation: Matrix3<f64>,
    /// Ratio by which its error widens the dots' variances.
    pub widening: f64,
}

impl RoughRotation {
    /// A rotation that aligns two dots with two others carries their error to the rest.
    pub fn of_pair(rotation: Matrix3<f64>) -> Self {
        Self {
            rotation,
            widening: PAIR_WIDENING,
        }
    }
}

/// A possible match.
#[derive(Debug, Clone, Copy)]
struct RefineLink {
    gain: f64,
    dot: u16,
    pattern_dot: u16,
}

/// An explanation's values; its assignment is left in [`ExplanationRefiner::assignment`].
#[derive(Debug, Clone, Copy)]
pub(super) struct RefinedExplanation {
    pub rotation: Matrix3<f64>,
    /// Log-evidence against "all dots are false".
    pub ln_evidence: f64,
    /// The part of it from the rotations around: Laplace's factor, not above 0, or what the integral over them
    /// makes of it.
    pub ln_volume: f64,
    /// The part of it from a hint.
    pub ln_prior: f64,
    /// ln of the evidence of all assignments near this rotation over this one's; not below 0. Known once
    /// the search has ended.
    pub ln_alternatives: f64,
}

impl RefinedExplanation {
    /// Log-evidence without the hint's part.
    pub fn ln_of_dots(&self) -> f64 {
        self.ln_evidence - self.ln_prior
    }
}

/// Scratch memory of the refinement.
#[derive(Debug, Default)]
pub(super) struct ExplanationRefiner {
    rotated: Vec<Vec3>,
    /// ln detected - ln missed.
    worth: Vec<f64>,
    links: Vec<RefineLink>,
    assignment: Vec<u16>,
    previous: Vec<u16>,
    /// For each pattern dot its observed dot, and what that match gains.
    holder: Vec<u16>,
    gain: Vec<f64>,
}

impl ExplanationRefiner {
    pub fn with_capacity_for(dots: usize, pattern: usize) -> Self {
        Self {
            rotated: Vec::with_capacity(pattern),
            worth: Vec::with_capacity(pattern),
            links: Vec::with_capacity(4 * dots),
            assignment: Vec::with_capacity(dots),
            previous: Vec::with_capacity(dots),
            holder: Vec::with_capacity(pattern),
            gain: Vec::with_capacity(dots),
        }
    }

    /// For each observed dot its pattern dot or [`UNASSIGNED`], of the last explanation.
    pub fn assignment(&self) -> &[u16] {
        &self.assignment
    }

    /// Refines a rotation on its inliers; `None` if too few dots support it, or if it has not
    /// settled and its log-evidence is far below `least`.
    pub fn refine(
        &mut self,
        view: &ComparedDots<'_>,
        start: &RoughRotation,
        least: f64,
    ) -> Option<RefinedExplanation> {
        let &ComparedDots {
            model,
            pattern,
            dots,
            prior,
            spread,
            ..
        } = view;
        let mut rotation = start.rotation;
        let mut ratio = start.widening;
        for turn in 0..MAX_TURNS {
            let penalty = self.project(model, pattern, &rotation);
            let score = penalty + self.assign(model, dots, spread, ratio);
            let matched = self.assignment.iter().filter(|&&j| j != UNASSIGNED).count();
            if matched < MIN_MATCHED {
                return None;
            }
            let (information, moved) = self.step(view, &rotation, [ratio, SEARCH_WEIGHT])?;
            let settled = turn > 1 && self.assignment == self.previous;
            if settled || turn + 1 == MAX_TURNS {
                let ln_volume = ln_volume(&information);
                let ln_prior = prior.map_or(0.0, |p| p.ln_ratio(&moved, Some(&information)));
                return Some(RefinedExplanation {
                    rotation: moved,
                    ln_evidence: score + ln_volume + ln_prior,
                    ln_volume,
                    ln_prior,
                    ln_alternatives: 0.0,
                });
            }
            if turn > 0 && score + ln_volume(&information) < least - UNSETTLED {
                return None;
            }
            std::mem::swap(&mut self.assignment, &mut self.previous);
            rotation = moved;
            ratio = 1.0;
        }
        None
    }

    /// The most likely rotation near `rotation` for a given assignment: the dots are weighted by
    /// how peaked their noise is.
    pub fn polish(
        &mut self,
        view: &ComparedDots<'_>,
        rotation: &Matrix3<f64>,
        assignment: &[u16],
    ) -> Matrix3<f64> {
        let mut polished = *rotation;
        for _ in 0..POLISH_STEPS {
            let Some((_, moved)) = self.fit(view, &polished, assignment, FINAL_WEIGHT) else {
                break;
            };
            polished = moved;
        }
        polished
    }

    /// One step towards the most likely rotation for a given assignment: the information matrix at
    /// `rotation`, and the rotation after the step. `None` where the dots do not determine it.
    pub fn fit(
        &mut self,
        view: &ComparedDots<'_>,
        rotation: &Matrix3<f64>,
        assignment: &[u16],
        max_weight: f64,
    ) -> Option<(Matrix3<f64>, Matrix3<f64>)> {
        self.assignment.clear();
        self.assignment.extend_from_slice(assignment);
        self.project(view.model, view.pattern, rotation);
        self.step(view, rotation, [1.0, max_weight])
    }

    /// Rotates the pattern; the penalty of missing every dot.
    fn project(&mut self, model: &ViewTables, pattern: &[Vec3], rotation: &Matrix3<f64>) -> f64 {
        self.rotated.clear();
        self.worth.clear();
        let (mut penalty, mut visible) = (0.0, 0.0);
        for p in pattern {
            let q = rotation * p;
            let at = model.visibility(q.z);
            self.rotated.push(q);
            self.worth.push(at.worth);
            penalty += at.missed;
            visible += at.visible;
        }
        penalty + model.ln_given(visible)
    }

    /// Assigns observed to pattern dots, best link first; what the matches gain over missing.
    fn assign(
        &mut self,
        model: &ViewTables,
        dots: &[PreparedDot],
        spread: &[f64],
        ratio: f64,
    ) -> f64 {
        self.links.clear();
        let ln_ratio = ratio.ln();
        for (i, dot) in dots.iter().enumerate() {
            let reach = 0.5 * dot.reach_squared * ratio * dot.sigma_max * dot.sigma_max;
            for (j, q) in self.rotated.iter().enumerate() {
                let own = spread.get(j).map_or(1.0, |v| 1.0 + v * dot.radial);
                if dot.direction.dot(q) < 1.0 - reach * own {
                    continue;
                }
                let dot = widened(spread, j, dot);
                let Some(kernel) = model.ln_kernel(dot.distance_squared(q) / ratio) else {
                    continue;
                };
                let gain = dot.ln_peak - ln_ratio + kernel + self.worth[j];
                if gain > MIN_GAIN {
                    self.links.push(RefineLink {
                        gain,
                        dot: i as u16,
                        pattern_dot: j as u16,
                    });
                }
            }
        }
        self.links
            .sort_unstable_by(|a, b| b.gain.total_cmp(&a.gain));
        self.assignment.clear();
        self.assignment.resize(dots.len(), UNASSIGNED);
        self.gain.clear();
        self.gain.resize(dots.len(), 0.0);
        self.holder.clear();
        self.holder.resize(self.rotated.len(), UNASSIGNED);
        let mut score = 0.0;
        for k in 0..self.links.len() {
            let link = self.links[k];
            let (i, j) = (usize::from(link.dot), usize::from(link.pattern_dot));
            if link.gain > 0.0 && self.assignment[i] == UNASSIGNED && self.holder[j] == UNASSIGNED {
                self.take(link);
                score += link.gain;
            }
        }
        score + model.false_count(self.left_out()) + self.balance(model)
    }

    /// Brings the number of dots left out nearer to the usual one where that gains; what it gains.
    fn balance(&mut self, model: &ViewTables) -> f64 {
        let mut total = 0.0;
        loop {
            let left_out = self.left_out();
            let now = model.false_count(left_out);
            let least = (0..self.gain.len())
                .filter(|&i| self.assignment[i] != UNASSIGNED)
                .min_by(|&a, &b| self.gain[a].total_cmp(&self.gain[b]));
            let leave = least.map_or(f64::NEG_INFINITY, |i| {
                model.false_count(left_out + 1) - now - self.gain[i]
            });
            // The links are in order: the first that is free is the best.
            let free = self.links.iter().position(|l| {
                self.assignment[usize::from(l.dot)] == UNASSIGNED
                    && self.holder[usize::from(l.pattern_dot)] == UNASSIGNED
            });
            let take = free.map_or(f64::NEG_INFINITY, |k| {
                model.false_count(left_out.saturating_sub(1)) - now + self.links[k].gain
            });
            let gained = match (least, free) {
                (Some(i), _) if leave > 0.0 && leave >= take => {
                    let held = std::mem::replace(&mut self.assignment[i], UNASSIGNED);
                    self.holder[usize::from(held)] = UNASSIGNED;
                    self.gain[i] = 0.0;
                    leave
                }
                (_, Some(k)) if take > 0.0 => {
                    self.take(self.links[k]);
                    take
                }
                _ => return total,
            };
            total += gained;
        }
    }

    fn take(&mut self, link: RefineLink) {
        self.assignment[usize::from(link.dot)] = link.pattern_dot;
        self.holder[usize::from(link.pattern_dot)] = link.dot;
        self.gain[usize::from(link.dot)] = link.gain;
    }

    /// Number of observed dots without a pattern dot.
    fn left_out(&self) -> usize {
        self.assignment.iter().filter(|&&j| j == UNASSIGNED).count()
    }

    /// One Gauss-Newton step on the assigned dots, reweighted for the kernel's tails: the
    /// information matrix and the moved rotation.
    fn step(
        &self,
        view: &ComparedDots<'_>,
        rotation: &Matrix3<f64>,
        [ratio, max_weight]: [f64; 2],
    ) -> Option<(Matrix3<f64>, Matrix3<f64>)> {
        let mut information = Matrix3::zeros();
        let mut weighted = Matrix3::zeros();
        let mut gradient = Vec3::zeros();
        for (dot, &j) in view.dots.iter().zip(&self.assignment) {
            if j == UNASSIGNED {
                continue;
            }
            let q = self.rotated[usize::from(j)];
            let dot = widened(view.spread, usize::from(j), dot);
            let residual = dot.axes.map(|u| u.dot(&q));
            let d2 = residual[0] * residual[0] + residual[1] * residual[1];
            let weight = view.model.weight(d2 / ratio, max_weight);
            for (u, r) in dot.axes.iter().zip(residual) {
                // A small rotation w moves q by w x q, and the whitened displacement u.q by w.(q x
                // u).
                let row = q.cross(u);
                let square = row * row.transpose();
                information += square;
                weighted += square * weight;
                gradient -= row * (r * weight);
            }
        }
        let w = weighted.cholesky()?.solve(&gradient);
        Some((information, Rotation3::new(w).matrix() * rotation))
    }
}

/// Laplace's factor: the share of all rotations that the data leave, at most 1.
pub(super) fn ln_volume(information: &Matrix3<f64>) -> f64 {
    let det = information.determinant().max(f64::MIN_POSITIVE);
    (1.5 * TAU.ln() - 0.5 * det.ln() - ROTATIONS.ln()).min(0.0)
}
