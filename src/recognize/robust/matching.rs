//! The sum over all assignments near a rotation, and its integral over the rotations there.
//!
//! An explanation stands for all rotations near its own and all assignments that are possible there.
//! With the gains `g_ij` of matching dot `i` with pattern dot `j` rather than leaving it out, the
//! assignments of a rotation `R` have together the weight
//!
//! ```text
//! Z(R) = exp(penalty(R)) sum_A F(left out) prod_matched exp(g_ij(R)),
//! ```
//!
//! each pattern dot matched at most once and `F` the prior of the number of dots left out. The sum is
//! taken dot by dot: what has to be remembered of the dots before is which pattern dots they took that
//! later dots may take too, and how many were left out. Dots that share possible matches follow each
//! other, so that this is little.
//!
//! The evidence is the mean of `Z` over all rotations. About an explanation it is taken by importance
//! sampling: [`NODES`] fixed points of a normal distribution of the rotation's covariance
//! ([`nodes`](crate::recognize::nodes)), so that the same dots give the same bits. Unlike
//! Laplace's factor it holds for peaked and heavy-tailed noise, and where a dot is at the edge of
//! what it may be.
//!
//! What it leaves out: rotations farther off than some three standard deviations, and that two dots
//! cannot take the same pattern dot where more than [`MAX_OPEN`] pattern dots are in question at a time.

use std::f64::consts::TAU;
use std::sync::LazyLock;

use nalgebra::{Matrix3, Rotation3};

use super::model::{GATE, PreparedDot, ViewTables};
use super::posterior::{ExplanationWeights, MAX_FOUND};
use super::refine::{ComparedDots, RefinedExplanation, UNASSIGNED, widened};
use crate::geometry::Vec3;
use crate::recognize::ln_sum::ln_sum;
use crate::recognize::nodes::normal_nodes;

/// Rotations at which the integrand is evaluated.
const NODES: usize = 32;
/// Widening of the sampled distribution's standard deviations: its tails must not be lighter than
/// the integrand's.
const WIDENING: f64 = 1.25;
/// Trace of a rotation by 0.8 rad, 1 + 2 cos 0.8: those nearer to each other may be of the same explanations.
const NEIGHBOR_TRACE: f64 = 2.393_413_418_694_33;
/// Maximum number of pattern dots that are remembered at a time.
const MAX_OPEN: usize = 6;
/// Matches this many nats behind the best for a dot, or behind leaving it out, do not count.
const NEGLIGIBLE: f64 = 8.0;
/// Ratio by which the variances are widened in the choice of possible matches: other rotations may favor them.
const REACH: f64 = 2.0;
/// Pattern dots farther than this from the visibility limit, in z, stay visible or hidden at all rotations about
/// an explanation.
const LIMIT_REACH: f64 = 0.35;

/// The normal distribution of rotations from which an explanation's nodes are taken.
#[derive(Debug, Clone, Copy)]
struct Sampled {
    /// Which explanation.
    of: usize,
    center: Matrix3<f64>,
    /// `L^T` of the rotation's information `L L^T`, camera frame, rad^-1.
    factor: Matrix3<f64>,
    /// ln of its density at the center over that of uniform rotations.
    ln_peak: f64,
}

impl Sampled {
    /// Density at a rotation over that of uniform rotations; 0 beyond [`NEIGHBOR_TRACE`].
    fn density(&self, rotation: &Matrix3<f64>) -> f64 {
        if rotation.dot(&self.center) < NEIGHBOR_TRACE {
            return 0.0;
        }
        let moved = Rotation3::from_matrix_unchecked(rotation * self.center.transpose());
        let x = self.factor * moved.scaled_axis() / WIDENING;
        (self.ln_peak - 0.5 * x.norm_squared()).exp()
    }
}

/// A possible match.
#[derive(Debug, Clone, Copy)]
struct MatchLink {
    dot: u16,
    pattern_dot: u16,
    /// The bit that remembers the pattern dot; 0 where no other dot can take it.
    bit: usize,
    /// Gain at the explanation's own rotation, with wider variances.
    gain: f64,
    /// The dot with the variance that the pattern dot's place adds.
    seen: PreparedDot,
}

/// A step of the sum: a dot.
#[derive(Debug, Clone, Copy)]
struct MatchStep {
    /// Its links.
    from: usize,
    to: usize,
    /// The pattern dots that no later dot can take, as bits to be forgotten.
    closes: usize,
    /// One more than the highest bit in use.
    width: usize,
}

/// Scratch memory of the sums.
#[derive(Debug, Default)]
pub(super) struct Matching {
    links: Vec<MatchLink>,
    /// In the order in which the dots are summed over.
    steps: Vec<MatchStep>,
    /// For each dot the range of its links.
    of_dot: Vec<[usize; 2]>,
    /// For each pattern dot the dots that may still take it, and its bit once one of them is summed over.
    takers: Vec<u16>,
    bits: Vec<usize>,
    open_dots: Vec<u16>,
    /// exp of each link's gain.
    weights: Vec<f64>,
    rotated: Vec<Vec3>,
    worth: Vec<f64>,
    /// Pattern dots that the rotation concerns, and what the others add.
    concerned: Vec<u16>,
    other_missed: f64,
    other_visible: f64,
    /// Sums by the bits and the number left out, before and after a step.
    before: Vec<f64>,
    after: Vec<f64>,
    /// Distributions of the explanations that are integrated.
    sampled: Vec<Sampled>,
    /// Those near the one in hand.
    neighbors: Vec<Sampled>,
    /// ln of the integrand's terms.
    own: Vec<f64>,
    all: Vec<f64>,
}

impl Matching {
    pub fn with_capacity_for(dots: usize, pattern: usize) -> Self {
        Self {
            links: Vec::with_capacity(4 * dots),
            steps: Vec::with_capacity(dots),
            of_dot: Vec::with_capacity(dots),
            takers: Vec::with_capacity(pattern),
            bits: Vec::with_capacity(pattern),
            open_dots: Vec::with_capacity(dots),
            weights: Vec::with_capacity(4 * dots),
            rotated: Vec::with_capacity(pattern),
            worth: Vec::with_capacity(pattern),
            concerned: Vec::with_capacity(pattern),
            other_missed: 0.0,
            other_visible: 0.0,
            before: Vec::with_capacity(dots << MAX_OPEN),
            after: Vec::with_capacity(dots << MAX_OPEN),
            sampled: Vec::with_capacity(MAX_FOUND),
            neighbors: Vec::with_capacity(MAX_FOUND),
            own: Vec::with_capacity(NODES),
            all: Vec::with_capacity(NODES),
        }
    }

    /// The weights at the explanation's own rotation, with Laplace's factor for the rotations around
    /// it.
    pub fn at_rotation(
        &mut self,
        view: &ComparedDots<'_>,
        of: &RefinedExplanation,
        assignment: &[u16],
    ) -> ExplanationWeights {
        self.link(view, &of.rotation, assignment);
        let (own, all) = self.sum(view, &of.rotation, assignment);
        let around = of.ln_volume + of.ln_prior;
        ExplanationWeights {
            ln_own: own + around,
            ln_all: all + around,
        }
    }

    /// Forgets the explanations to be integrated.
    pub fn clear_sampled(&mut self) {
        self.sampled.clear();
    }

    /// Has the explanation number `of` integrated, the ones with an information of the rotation that
    /// determines it.
    pub fn sample(&mut self, of: usize, rotation: &Matrix3<f64>, information: &Matrix3<f64>) {
        // H = L L^T: steps L^-T x with x normal have the covariance H^-1.
        let Some(factor) = information.cholesky() else {
            return;
        };
        let root_det: f64 = factor.l_dirty().diagonal().product();
        self.sampled.push(Sampled {
            of,
            center: *rotation,
            factor: factor.l().transpose(),
            // Uniform rotations have the density 1 / (8 pi^2).
            ln_peak: (2.0 * TAU * TAU).ln() + root_det.ln() - 1.5 * TAU.ln() - 3.0 * WIDENING.ln(),
        });
    }

    /// The weights of the explanation number `of`, integrated over the rotations about its own; `None`
    /// where it is not [sampled](Self::sample).
    ///
    /// Rotations that neighbors reach as well are shared with them by the densities `q` with which they
    /// are sampled (the balance heuristic: E. Veach and L. Guibas, SIGGRAPH 1995): its nodes have the
    /// weights `Z / sum_e q_e`, and no rotation counts twice.
    pub fn integrate(
        &mut self,
        view: &ComparedDots<'_>,
        of: usize,
        refined: &RefinedExplanation,
        assignment: &[u16],
    ) -> Option<ExplanationWeights> {
        let own_sampled = *self.sampled.iter().find(|s| s.of == of)?;
        self.neighbors.clear();
        let others = self.sampled.iter().filter(|s| s.of != of);
        let is_near = |s: &&Sampled| s.center.dot(&own_sampled.center) > NEIGHBOR_TRACE;
        self.neighbors.extend(others.filter(is_near));
        self.link(view, &refined.rotation, assignment);
        self.own.clear();
        self.all.clear();
        for node in NORMAL_NODES.iter() {
            let step = own_sampled
                .factor
                .solve_upper_triangular(&(node * WIDENING))?;
            let rotation = Rotation3::new(step).matrix() * refined.rotation;
            let (own, all) = self.sum(view, &rotation, assignment);
            let prior = view.prior.map_or(0.0, |p| p.ln_ratio(&rotation, None));
            let ln_density = own_sampled.ln_peak - 0.5 * node.norm_squared();
            let others: f64 = self.neighbors.iter().map(|s| s.density(&rotation)).sum();
            let ln_shared = (others * (-ln_density).exp()).ln_1p();
            self.own.push(own + prior - ln_density);
            self.all.push(all + prior - ln_density - ln_shared);
        }
        let ln_nodes = (NODES as f64).ln();
        Some(ExplanationWeights {
            ln_own: ln_sum(self.own.iter().copied()) - ln_nodes,
            ln_all: ln_sum(self.all.iter().copied()) - ln_nodes,
        })
    }

    /// Lists the possible matches about a rotation, the order in which they are summed over, and the
    /// pattern dots that the rotations about it concern.
    fn link(&mut self, view: &ComparedDots<'_>, rotation: &Matrix3<f64>, assignment: &[u16]) {
        self.rotated.clear();
        self.worth.clear();
        self.links.clear();
        self.of_dot.clear();
        self.takers.clear();
        self.takers.resize(view.pattern.len(), 0);
        for p in view.pattern {
            let q = rotation * p;
            self.worth.push(view.model.visibility(q.z).worth);
            self.rotated.push(q);
        }
        for (i, dot) in view.dots.iter().enumerate() {
            let from = self.links.len();
            let reach = 0.5 * GATE * GATE * REACH * dot.sigma_max * dot.sigma_max;
            let mut most = 0.0f64;
            for (j, q) in self.rotated.iter().enumerate() {
                let own = view.spread.get(j).map_or(1.0, |v| 1.0 + v * dot.radial);
                let is_own = usize::from(assignment[i]) == j;
                // The squared distance holds for directions on the same side.
                if dot.direction.dot(q) < (1.0 - reach * own).max(0.0) && !is_own {
                    continue;
                }
                let seen = widened(view.spread, j, dot);
                let kernel = view.model.ln_kernel(seen.distance_squared(q) / REACH);
                let gain = kernel.map(|k| seen.ln_peak + k + self.worth[j]);
                let gain = gain.unwrap_or(f64::NEG_INFINITY);
                most = most.max(gain);
                self.links.push(MatchLink {
                    dot: i as u16,
                    pattern_dot: j as u16,
                    bit: 0,
                    gain,
                    seen,
                });
            }
            let mut to = from;
            for k in from..self.links.len() {
                let link = self.links[k];
                if link.gain > most - NEGLIGIBLE || assignment[i] == link.pattern_dot {
                    self.takers[usize::from(link.pattern_dot)] += 1;
                    self.links[to] = link;
                    to += 1;
                }
            }
            self.links.truncate(to);
            self.of_dot.push([from, to]);
        }
        self.concern(view);
        self.plan();
    }

    /// Lists the pattern dots whose visibility or match the rotation decides; the others stay as they
    /// are.
    fn concern(&mut self, view: &ComparedDots<'_>) {
        self.concerned.clear();
        (self.other_missed, self.other_visible) = (0.0, 0.0);
        for (j, q) in self.rotated.iter().enumerate() {
            let is_near = (q.z - view.visibility_limit).abs() < LIMIT_REACH;
            if is_near || self.takers[j] > 0 {
                self.concerned.push(j as u16);
            } else {
                let at = view.model.visibility(q.z);
                self.other_missed += at.missed;
                self.other_visible += at.visible;
            }
        }
    }

    /// Orders the dots so that few pattern dots have to be remembered at a time, and gives these bits.
    fn plan(&mut self) {
        self.steps.clear();
        self.bits.clear();
        self.bits.resize(self.takers.len(), 0);
        self.open_dots.clear();
        self.open_dots.extend(0..self.of_dot.len() as u16);
        let mut in_use = 0usize;
        while let Some(next) = self.next_dot() {
            let dot = usize::from(self.open_dots.swap_remove(next));
            let [from, to] = self.of_dot[dot];
            let mut closes = 0;
            let before = in_use;
            for link in &mut self.links[from..to] {
                let j = usize::from(link.pattern_dot);
                self.takers[j] -= 1;
                if self.bits[j] == 0 && self.takers[j] > 0 {
                    let free = (!in_use).trailing_zeros();
                    if (free as usize) < MAX_OPEN {
                        self.bits[j] = 1 << free;
                        in_use |= self.bits[j];
                    }
                }
                link.bit = self.bits[j];
                if self.takers[j] == 0 {
                    closes |= self.bits[j];
                }
            }
            let width = usize::BITS - (before | in_use).leading_zeros();
            in_use &= !closes;
            self.steps.push(MatchStep {
                from,
                to,
                closes,
                width: width as usize,
            });
        }
    }

    /// The place among the open dots of the one that leaves the fewest pattern dots to be remembered.
    fn next_dot(&self) -> Option<usize> {
        let cost = |dot: u16| -> i32 {
            let [from, to] = self.of_dot[usize::from(dot)];
            let of_link = |link: &MatchLink| {
                let j = usize::from(link.pattern_dot);
                match (self.bits[j] != 0, self.takers[j]) {
                    (true, 1) => -1,
                    (false, 2..) => 1,
                    _ => 0,
                }
            };
            self.links[from..to].iter().map(of_link).sum()
        };
        let costs = self.open_dots.iter().map(|&dot| cost(dot)).enumerate();
        costs.min_by_key(|&(_, cost)| cost).map(|(place, _)| place)
    }

    /// Rotates the pattern; ln of the probability that all of it is missed.
    fn project(&mut self, view: &ComparedDots<'_>, rotation: &Matrix3<f64>) -> f64 {
        let (mut missed, mut visible) = (self.other_missed, self.other_visible);
        for &j in &self.concerned {
            let j = usize::from(j);
            let q = rotation * view.pattern[j];
            let at = view.model.visibility(q.z);
            self.rotated[j] = q;
            self.worth[j] = at.worth;
            missed += at.missed;
            visible += at.visible;
        }
        missed + view.model.ln_given(visible)
    }

    /// ln of the weights of the explanation's own assignment and of all assignments at a rotation.
    fn sum(
        &mut self,
        view: &ComparedDots<'_>,
        rotation: &Matrix3<f64>,
        assignment: &[u16],
    ) -> (f64, f64) {
        let penalty = self.project(view, rotation);
        let model = view.model;
        self.weights.clear();
        let mut own = 0.0;
        for link in &self.links {
            let j = usize::from(link.pattern_dot);
            let kernel = model.ln_kernel(link.seen.distance_squared(&self.rotated[j]));
            let gain = kernel.map_or(f64::NEG_INFINITY, |k| link.seen.ln_peak + k + self.worth[j]);
            self.weights.push(gain.exp());
            if assignment[usize::from(link.dot)] == link.pattern_dot {
                own += gain;
            }
        }
        let left_out = assignment.iter().filter(|&&j| j == UNASSIGNED).count();
        let own = penalty + own + model.false_count(left_out);
        (
            own,
            (penalty + self.sum_over_assignments(model).ln()).max(own),
        )
    }

    /// The sum over all assignments.
    fn sum_over_assignments(&mut self, model: &ViewTables) -> f64 {
        // All larger numbers left out have the same prior ratio.
        let counts = model.false_counts();
        let width = self.steps.iter().map(|s| s.width).max().unwrap_or(0);
        self.before.clear();
        self.before.resize(counts << width, 0.0);
        self.before[0] = 1.0;
        self.after.clear();
        self.after.resize(counts << width, 0.0);
        for step in &self.steps {
            let size = counts << step.width;
            for state in 0..size {
                let sum = self.before[state];
                if sum == 0.0 {
                    continue;
                }
                let (taken, left_out) = (state / counts, state % counts);
                self.after[taken * counts + (left_out + 1).min(counts - 1)] += sum;
                for k in step.from..step.to {
                    let bit = self.links[k].bit;
                    if taken & bit == 0 {
                        self.after[(taken | bit) * counts + left_out] += sum * self.weights[k];
                    }
                }
            }
            // What no later dot can take is forgotten.
            for state in 0..size {
                let taken = state / counts;
                if taken & step.closes != 0 {
                    let kept = (taken & !step.closes) * counts + state % counts;
                    let sum = std::mem::take(&mut self.after[state]);
                    self.after[kept] += sum;
                }
            }
            self.before[..size].fill(0.0);
            std::mem::swap(&mut self.before, &mut self.after);
        }
        let by_count = self.before[..counts].iter().enumerate();
        by_count.map(|(k, w)| w * model.false_count(k).exp()).sum()
    }
}

/// The nodes, of unit variance.
static NORMAL_NODES: LazyLock<[Vec3; NODES]> = LazyLock::new(normal_nodes);
