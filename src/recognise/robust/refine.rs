//! From a rough rotation to an explanation: assignment and Gauss-Newton in turns, then the evidence.
//!
//! For an assignment `A` of observed to pattern dots the log-likelihood ratio against "all dots are
//! false" is
//!
//! ```text
//! S(R, A) = sum_matched ln( d_j N(o_i; q_j, C_i) / rho ) + sum_unmatched ln(1 - d_j)
//! ```
//!
//! and the evidence of `A` is `S` at its best rotation plus Laplace's factor for the rotations around
//! it, `(2 pi)^(3/2) / (8 pi^2 sqrt(det H))`, with `H` the information matrix and a uniform prior.

use std::f64::consts::{PI, TAU};

use nalgebra::{Matrix3, Rotation3};

use super::model::{Dot, GATE, Model};
use crate::geometry::Vec3;

/// Marks an observed dot without a pattern dot.
pub(super) const UNASSIGNED: u16 = u16::MAX;
/// Variance ratio of the first assignment: a rotation from two noisy dots carries their error on.
const FIRST_WIDENING: f64 = 2.5;
/// Turns of assignment and Gauss-Newton; they settle in two or three.
const MOST_TURNS: usize = 8;
/// Fewest dots that support an explanation.
const LEAST_MATCHED: usize = 2;
/// Links that cost more than this many nats do not count even as alternatives.
const LEAST_GAIN: f64 = -7.0;

/// Nats that the turns after the second one hardly ever add.
const UNSETTLED: f64 = 5.0;

/// What is seen, and what of.
#[derive(Debug)]
pub(super) struct View<'a> {
    pub model: &'a Model,
    pub pattern: &'a [Vec3],
    pub dots: &'a [Dot],
}

/// A possible match.
#[derive(Debug, Clone, Copy)]
struct Link {
    gain: f64,
    dot: u16,
    pattern_dot: u16,
}

/// An explanation's figures; its assignment is left in [`Refiner::assignment`].
#[derive(Debug, Clone, Copy)]
pub(super) struct Refined {
    pub rotation: Matrix3<f64>,
    /// Log-evidence against "all dots are false".
    pub ln_evidence: f64,
    /// The part of it that Laplace's factor makes up; not above 0.
    pub ln_volume: f64,
    /// ln of the evidence of all assignments near this rotation over this one's; not below 0.
    pub ln_alternatives: f64,
}

/// Scratch memory of the refinement.
#[derive(Debug, Default)]
pub(super) struct Refiner {
    rotated: Vec<Vec3>,
    /// ln detected - ln missed.
    worth: Vec<f64>,
    links: Vec<Link>,
    assignment: Vec<u16>,
    previous: Vec<u16>,
    /// For each pattern dot its observed dot, and what that match gains.
    holder: Vec<u16>,
    gain: Vec<f64>,
}

impl Refiner {
    pub fn with_room(dots: usize, pattern: usize) -> Self {
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

    /// Refines a rotation on its inliers; `None` if too few dots support it, or if it has not settled
    /// and its log-evidence is far below `least`.
    pub fn refine(&mut self, view: &View<'_>, start: &Matrix3<f64>, least: f64) -> Option<Refined> {
        let &View {
            model,
            pattern,
            dots,
        } = view;
        let mut rotation = *start;
        let mut ratio = FIRST_WIDENING;
        for turn in 0..MOST_TURNS {
            let penalty = self.project(model, pattern, &rotation);
            let score = penalty + self.assign(model, dots, ratio);
            let matched = self.assignment.iter().filter(|&&j| j != UNASSIGNED).count();
            if matched < LEAST_MATCHED {
                return None;
            }
            let (information, moved) = self.step(dots, &rotation)?;
            let settled = turn > 1 && self.assignment == self.previous;
            if settled || turn + 1 == MOST_TURNS {
                let ln_volume = ln_volume(&information);
                return Some(Refined {
                    rotation: moved,
                    ln_evidence: score + ln_volume,
                    ln_volume,
                    ln_alternatives: self.ln_alternatives(),
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

    /// Rotates the pattern; the penalty of missing every dot.
    fn project(&mut self, model: &Model, pattern: &[Vec3], rotation: &Matrix3<f64>) -> f64 {
        self.rotated.clear();
        self.worth.clear();
        let mut penalty = 0.0;
        for p in pattern {
            let q = rotation * p;
            let (detected, missed) = model.visibility(q.z);
            self.rotated.push(q);
            self.worth.push(detected - missed);
            penalty += missed;
        }
        penalty
    }

    /// Assigns observed to pattern dots, best link first; what the matches gain over missing.
    fn assign(&mut self, model: &Model, dots: &[Dot], ratio: f64) -> f64 {
        self.links.clear();
        let (narrow, widened) = (1.0 / ratio, ratio.ln());
        for (i, dot) in dots.iter().enumerate() {
            let least_cosine = 1.0 - 0.5 * GATE * GATE * ratio * dot.sigma_max * dot.sigma_max;
            for (j, q) in self.rotated.iter().enumerate() {
                if dot.direction.dot(q) < least_cosine {
                    continue;
                }
                let Some(core) = model.core(dot.distance_squared(q) * narrow) else {
                    continue;
                };
                let gain = dot.ln_peak - widened + core + self.worth[j];
                if gain > LEAST_GAIN {
                    self.links.push(Link {
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
        for link in self.links.iter().take_while(|l| l.gain > 0.0) {
            let (i, j) = (usize::from(link.dot), usize::from(link.pattern_dot));
            if self.assignment[i] == UNASSIGNED && self.holder[j] == UNASSIGNED {
                self.assignment[i] = link.pattern_dot;
                self.holder[j] = link.dot;
                self.gain[i] = link.gain;
                score += link.gain;
            }
        }
        score
    }

    /// ln of 1 + the share of assignments that differ in one dot, or in two that change places; dots are
    /// taken as independent.
    fn ln_alternatives(&self) -> f64 {
        let mut total = 0.0;
        for (i, &own) in self.gain.iter().enumerate() {
            let mut others = if self.assignment[i] == UNASSIGNED {
                0.0
            } else {
                (-own).exp()
            };
            for link in self.links.iter().filter(|l| usize::from(l.dot) == i) {
                if link.pattern_dot == self.assignment[i] {
                    continue;
                }
                let holder = self.holder[usize::from(link.pattern_dot)];
                let lost = match holder {
                    UNASSIGNED => 0.0,
                    other => self.gain[usize::from(other)] - self.swapped(other, i),
                };
                others += (link.gain - own - lost).exp();
            }
            total += others.ln_1p();
        }
        total
    }

    /// What `other` gains from the pattern dot that `i` leaves, where that is more than nothing.
    fn swapped(&self, other: u16, i: usize) -> f64 {
        let left = self.assignment[i];
        self.links
            .iter()
            .find(|l| l.dot == other && l.pattern_dot == left)
            .map_or(0.0, |l| l.gain.max(0.0))
    }

    /// One Gauss-Newton step on the assigned dots: the information matrix and the moved rotation.
    fn step(&self, dots: &[Dot], rotation: &Matrix3<f64>) -> Option<(Matrix3<f64>, Matrix3<f64>)> {
        let mut information = Matrix3::zeros();
        let mut gradient = Vec3::zeros();
        for (dot, &j) in dots.iter().zip(&self.assignment) {
            if j == UNASSIGNED {
                continue;
            }
            let q = self.rotated[usize::from(j)];
            for u in &dot.axes {
                // A small rotation w moves q by w x q, and the whitened displacement u.q by w.(q x u).
                let row = q.cross(u);
                information += row * row.transpose();
                gradient -= row * u.dot(&q);
            }
        }
        let w = information.cholesky()?.solve(&gradient);
        Some((information, Rotation3::new(w).matrix() * rotation))
    }
}

/// Laplace's factor: the share of all rotations that the data leave, at most 1.
fn ln_volume(information: &Matrix3<f64>) -> f64 {
    let det = information.determinant().max(f64::MIN_POSITIVE);
    (1.5 * TAU.ln() - 0.5 * det.ln() - (8.0 * PI * PI).ln()).min(0.0)
}
