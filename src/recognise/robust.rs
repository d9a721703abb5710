//! The robust recogniser: the rotation that the whole set of dots supports best.
//!
//! # Model
//! Under the rotation `R` pattern dot `j` appears at `q_j = R p_j`. It is detected with probability
//! `d(q_j) = P_d * Phi((z_j - z_min) / w)`, displaced by Gaussian noise with the covariance that comes
//! with the observed dot. False dots are a Poisson process of `lambda` dots on the visible cap, of
//! density `rho = lambda / (2 pi (1 - z_min))` per steradian. For an assignment `A` of observed to
//! pattern dots the log-likelihood ratio against "all dots are false" is
//!
//! ```text
//! S(R, A) = sum_matched ln( d_j N(o_i; q_j, C_i) / rho ) + sum_unmatched ln(1 - d_j)
//! ```
//!
//! and the evidence of `A` is `S` at its best rotation plus Laplace's factor for the rotations around
//! it, `(2 pi)^(3/2) / (8 pi^2 sqrt(det H))`, with `H` the information matrix and a uniform prior.
//!
//! # Search
//! Every pair of observed dots, the best conditioned first, is laid on every ordered pair of pattern
//! dots of similar angle. Each such rotation is scored with widened noise; the best few are refined by
//! Gauss-Newton on their inliers and scored again. A complete pass over one pair has seen every
//! explanation in which both of its dots are real; the search stops when the best explanation so far is
//! beyond doubt. The confidence is the best explanation's share of the evidence of all that were seen
//! and of "these are not the pattern's dots".
//!
//! What it does not do: prove that no better explanation exists. See the validation for how often the
//! best one found is the right one.

use nalgebra::{Matrix3, UnitQuaternion};

use super::{DotUncertainty, Identification, ObservedDot, Outcome, Recogniser, Refusal};
use crate::error::{Error, Result};
use crate::geometry::{Rotation, Vec3, tangent_frame};
use crate::pattern::Pattern;

/// What the recogniser expects of the images.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct RobustConfig {
    /// Least z of a dot that can be seen.
    pub visibility_limit: f64,
    /// Probability that a dot well inside the visible cap is detected.
    pub detection_probability: f64,
    /// Expected number of false dots in a view.
    pub expected_false_dots: f64,
    /// Prior probability that a view does not show the pattern at all.
    pub foreign_prior: f64,
    /// Explanations refined for each pair of observed dots.
    pub refined: usize,
}

impl Default for RobustConfig {
    /// z > 0 visible, 90 % detected, half a false dot a view, one view in a hundred of something else.
    fn default() -> Self {
        Self {
            visibility_limit: 0.0,
            detection_probability: 0.9,
            expected_false_dots: 0.5,
            foreign_prior: 0.01,
            refined: 6,
        }
    }
}

impl RobustConfig {
    /// Checks the domains of all parameters.
    ///
    /// # Errors
    /// [`Error::Argument`] naming the parameter.
    pub fn check(&self) -> Result<()> {
        let open_unit = |x: f64| x > 0.0 && x < 1.0;
        let fail = |name: &str, what: &str| Err(Error::argument(name, format!("expected {what}")));
        if !(-1.0..1.0).contains(&self.visibility_limit) {
            return fail("visibility_limit", "a z in [-1, 1)");
        }
        if !open_unit(self.detection_probability) {
            return fail("detection_probability", "a probability in (0, 1)");
        }
        if !(self.expected_false_dots > 0.0 && self.expected_false_dots.is_finite()) {
            return fail("expected_false_dots", "a positive number");
        }
        if !open_unit(self.foreign_prior) {
            return fail("foreign_prior", "a probability in (0, 1)");
        }
        if self.refined == 0 {
            return fail("refined", "at least 1");
        }
        Ok(())
    }
}

/// Width, in z, over which a dot fades from visible to hidden at the limit.
const VISIBILITY_SOFTNESS: f64 = 0.03;
/// Variance ratio of the screening score: a rotation from two noisy dots carries their error to the others.
const SCREEN_VARIANCE: f64 = 2.5;
/// A dot further than this many standard deviations from a pattern dot is not it.
const GATE_SIGMAS: f64 = 7.0;
/// Share and widening of the core's second, wider Gaussian: hands and detectors err with heavier tails
/// than one Gaussian has, and a dot a little off is still that dot.
const TAIL_SHARE: f64 = 0.1;
const TAIL_WIDENING: f64 = 2.0;
/// Pairs nearer to parallel or opposite than this sine leave the rotation too uncertain to start from.
const MIN_PAIR_SINE: f64 = 0.15;
/// Nats by which the best explanation must lead the next, and "foreign", to end the search early.
const DOUBT_NATS: f64 = 14.0;
/// Steps of re-assignment and Gauss-Newton; they settle in two or three.
const REFINE_STEPS: usize = 6;
const UNASSIGNED: u16 = u16::MAX;

/// An ordered pair of pattern dots, in the order of its cosine.
#[derive(Debug, Clone, Copy)]
struct PatternPair {
    cosine: f64,
    first: u16,
    second: u16,
}

/// An observed dot, prepared: the precision of its displacement as a 3x3 matrix of the tangent plane.
#[derive(Debug, Clone, Copy)]
struct Prepared {
    direction: Vec3,
    precision: Matrix3<f64>,
    /// ln of the Gaussian's peak over the false-dot density.
    ln_peak: f64,
    /// Largest standard deviation, radians.
    sigma_max: f64,
}

/// An explanation: a rotation with its assignment and log-evidence.
#[derive(Debug, Clone)]
struct Explanation {
    rotation: Matrix3<f64>,
    assignment: Vec<u16>,
    ln_evidence: f64,
}

/// Scratch memory of [`RobustRecogniser`].
#[derive(Debug, Default)]
pub struct RobustWorkspace {
    prepared: Vec<Prepared>,
    pairs: Vec<(f64, u16, u16)>,
    rotated: Vec<Vec3>,
    ln_detected: Vec<f64>,
    ln_missed: Vec<f64>,
    links: Vec<(f64, u16, u16)>,
    assignment: Vec<u16>,
    taken: Vec<bool>,
    screened: Vec<(f64, Matrix3<f64>)>,
    found: Vec<Explanation>,
}

/// The default recogniser. See the module's documentation.
#[derive(Debug, Clone)]
pub struct RobustRecogniser {
    dots: Vec<Vec3>,
    pairs: Vec<PatternPair>,
    config: RobustConfig,
}

impl RobustRecogniser {
    /// Prepares the recogniser for a pattern.
    ///
    /// # Errors
    /// [`Error::Argument`] for a parameter outside its domain.
    pub fn new(pattern: &Pattern, config: RobustConfig) -> Result<Self> {
        config.check()?;
        let dots = pattern.dots().to_vec();
        let mut pairs = Vec::with_capacity(dots.len() * dots.len());
        for (i, a) in dots.iter().enumerate() {
            for (j, b) in dots.iter().enumerate() {
                if i != j && a.cross(b).norm() > 0.5 * MIN_PAIR_SINE {
                    pairs.push(PatternPair {
                        cosine: a.dot(b),
                        first: i as u16,
                        second: j as u16,
                    });
                }
            }
        }
        pairs.sort_by(|p, q| p.cosine.total_cmp(&q.cosine));
        Ok(Self {
            dots,
            pairs,
            config,
        })
    }

    /// The parameters in use.
    pub fn config(&self) -> &RobustConfig {
        &self.config
    }

    fn prepare(&self, dots: &[ObservedDot], ws: &mut RobustWorkspace) {
        let c = &self.config;
        let rho = c.expected_false_dots
            / (std::f64::consts::TAU * (1.0 - c.visibility_limit.max(-0.999)));
        ws.prepared.clear();
        for dot in dots {
            let o = dot.direction;
            let (precision, det, sigma_max) = match dot.uncertainty {
                DotUncertainty::Isotropic { sigma_rad } => {
                    let s2 = sigma_rad * sigma_rad;
                    (Matrix3::identity() / s2, s2 * s2, sigma_rad)
                }
                DotUncertainty::Tangent { covariance } => {
                    let [e1, e2] = tangent_frame(&o);
                    let det = covariance.determinant();
                    let p = covariance
                        .try_inverse()
                        .unwrap_or_else(nalgebra::Matrix2::identity);
                    let m = e1 * e1.transpose() * p[(0, 0)]
                        + (e1 * e2.transpose() + e2 * e1.transpose()) * p[(0, 1)]
                        + e2 * e2.transpose() * p[(1, 1)];
                    let half_trace = 0.5 * covariance.trace();
                    let largest = half_trace + (half_trace * half_trace - det).max(0.0).sqrt();
                    (m, det, largest.sqrt())
                }
            };
            ws.prepared.push(Prepared {
                direction: o,
                precision,
                ln_peak: -(std::f64::consts::TAU * det.sqrt() * rho).ln(),
                sigma_max,
            });
        }
        ws.pairs.clear();
        for i in 0..dots.len() {
            for j in 0..i {
                let (a, b) = (&ws.prepared[i], &ws.prepared[j]);
                let sine = a.direction.cross(&b.direction).norm();
                if sine > MIN_PAIR_SINE {
                    ws.pairs
                        .push((sine / (a.sigma_max + b.sigma_max), i as u16, j as u16));
                }
            }
        }
        ws.pairs.sort_by(|p, q| q.0.total_cmp(&p.0));
    }

    /// Rotates the pattern and works out what each dot's detection or absence is worth.
    fn project(&self, rotation: &Matrix3<f64>, ws: &mut RobustWorkspace) {
        ws.rotated.clear();
        ws.ln_detected.clear();
        ws.ln_missed.clear();
        for p in &self.dots {
            let q = rotation * p;
            let t = (q.z - self.config.visibility_limit) / VISIBILITY_SOFTNESS;
            // The logistic curve stands in for Phi: the same shape, and cheap.
            let visible = 1.0 / (1.0 + (-1.7 * t.clamp(-12.0, 12.0)).exp());
            let detected = self.config.detection_probability * visible;
            ws.rotated.push(q);
            ws.ln_detected.push(detected.ln());
            ws.ln_missed.push((1.0 - detected).ln());
        }
    }

    /// Assigns observed to pattern dots, best link first, and returns the log-likelihood ratio `S`.
    fn assign(&self, variance_ratio: f64, ws: &mut RobustWorkspace) -> f64 {
        let n = ws.prepared.len();
        ws.assignment.clear();
        ws.assignment.resize(n, UNASSIGNED);
        ws.links.clear();
        let widened = variance_ratio.ln();
        let ln_tail = (TAIL_SHARE / TAIL_WIDENING.powi(2)).ln();
        for (i, o) in ws.prepared.iter().enumerate() {
            let reach = (GATE_SIGMAS * o.sigma_max).powi(2) * variance_ratio;
            for (j, q) in ws.rotated.iter().enumerate() {
                let delta = q - o.direction;
                if delta.norm_squared() > reach {
                    continue;
                }
                let d2 = delta.dot(&(o.precision * delta)) / variance_ratio;
                let core = (-0.5 * d2).max(ln_tail - 0.5 * d2 / TAIL_WIDENING.powi(2));
                let gain = o.ln_peak - widened + core + ws.ln_detected[j] - ws.ln_missed[j];
                if gain > 0.0 {
                    ws.links.push((gain, i as u16, j as u16));
                }
            }
        }
        ws.links.sort_unstable_by(|a, b| b.0.total_cmp(&a.0));
        ws.taken.clear();
        ws.taken.resize(self.dots.len(), false);
        let mut score: f64 = ws.ln_missed.iter().sum();
        for &(gain, i, j) in &ws.links {
            if ws.assignment[i as usize] == UNASSIGNED && !ws.taken[j as usize] {
                ws.assignment[i as usize] = j;
                ws.taken[j as usize] = true;
                score += gain;
            }
        }
        score
    }

    /// One Gauss-Newton step on the assigned dots: the information matrix and the rotated estimate.
    fn step(
        &self,
        rotation: &Matrix3<f64>,
        ws: &RobustWorkspace,
    ) -> Option<(Matrix3<f64>, Matrix3<f64>)> {
        let mut information = Matrix3::zeros();
        let mut gradient = Vec3::zeros();
        for (o, &j) in ws.prepared.iter().zip(&ws.assignment) {
            if j == UNASSIGNED {
                continue;
            }
            let q = rotation * self.dots[j as usize];
            // A small rotation w moves q by w x q = -[q]x w.
            let jacobian = -q.cross_matrix();
            let jt_m = jacobian.transpose() * o.precision;
            information += jt_m * jacobian;
            gradient += jt_m * (o.direction - q);
        }
        let w = information.cholesky()?.solve(&gradient);
        let moved = UnitQuaternion::from_scaled_axis(w).to_rotation_matrix();
        Some((information, moved.matrix() * rotation))
    }

    /// Refines a rotation on its inliers; the explanation's log-evidence, or `None` if fewer than two
    /// dots support it.
    fn refine(&self, start: Matrix3<f64>, ws: &mut RobustWorkspace) -> Option<Explanation> {
        let mut rotation = start;
        let mut previous: [u16; 2] = [0, 0];
        let mut best: Option<(f64, Matrix3<f64>, Matrix3<f64>)> = None;
        for k in 0..REFINE_STEPS {
            self.project(&rotation, ws);
            // Widen on the first pass only: the start is rougher than the dots.
            let ratio = if k == 0 { SCREEN_VARIANCE } else { 1.0 };
            let score = self.assign(ratio, ws);
            if ws.assignment.iter().filter(|&&j| j != UNASSIGNED).count() < 2 {
                return None;
            }
            let signature = signature(&ws.assignment);
            let (information, moved) = self.step(&rotation, ws)?;
            let settled = k > 1 && signature == previous;
            if k > 0 {
                best = Some((score, information, rotation));
            }
            if settled {
                break;
            }
            previous = signature;
            rotation = moved;
        }
        let (score, information, rotation) = best?;
        let det = information.determinant();
        if det <= 0.0 {
            return None;
        }
        let ln_volume = 1.5 * std::f64::consts::TAU.ln()
            - 0.5 * det.ln()
            - (8.0 * std::f64::consts::PI.powi(2)).ln();
        Some(Explanation {
            rotation,
            assignment: ws.assignment.clone(),
            ln_evidence: score + ln_volume.min(0.0),
        })
    }

    /// Lays one observed pair on every similar pattern pair and refines the best rotations found.
    fn try_pair(&self, a: u16, b: u16, ws: &mut RobustWorkspace) {
        let (oa, ob) = (ws.prepared[a as usize], ws.prepared[b as usize]);
        let observed = oa.direction.dot(&ob.direction).clamp(-1.0, 1.0).acos();
        let reach = 3.5 * oa.sigma_max.hypot(ob.sigma_max);
        let low = (observed + reach).min(std::f64::consts::PI).cos();
        let high = (observed - reach).max(0.0).cos();
        let from = self.pairs.partition_point(|p| p.cosine < low);
        let frame_o = frame(&oa.direction, &ob.direction);
        ws.screened.clear();
        for pair in self.pairs[from..].iter().take_while(|p| p.cosine <= high) {
            let (pa, pb) = (
                &self.dots[pair.first as usize],
                &self.dots[pair.second as usize],
            );
            let rotation = frame_o * frame(pa, pb).transpose();
            self.project(&rotation, ws);
            let score = self.assign(SCREEN_VARIANCE, ws);
            keep_best(&mut ws.screened, self.config.refined, score, rotation);
        }
        for k in 0..ws.screened.len() {
            let start = ws.screened[k].1;
            if let Some(found) = self.refine(start, ws) {
                match ws
                    .found
                    .iter_mut()
                    .find(|e| e.assignment == found.assignment)
                {
                    Some(same) if same.ln_evidence >= found.ln_evidence => {}
                    Some(same) => *same = found,
                    None => ws.found.push(found),
                }
            }
        }
    }

    /// Whether the best explanation is beyond doubt after a complete pass over the pair (a, b).
    fn beyond_doubt(&self, a: u16, b: u16, ws: &RobustWorkspace) -> bool {
        let Some(best) = best_of(&ws.found) else {
            return false;
        };
        let explains_pair =
            best.assignment[a as usize] != UNASSIGNED && best.assignment[b as usize] != UNASSIGNED;
        let matched = best.assignment.iter().filter(|&&j| j != UNASSIGNED).count();
        let lead = ws
            .found
            .iter()
            .filter(|e| e.assignment != best.assignment)
            .map(|e| best.ln_evidence - e.ln_evidence)
            .fold(best.ln_evidence, f64::min);
        explains_pair && matched >= 5 && lead > DOUBT_NATS
    }

    fn answer(&self, ws: &RobustWorkspace) -> Outcome {
        let Some(best) = best_of(&ws.found) else {
            return Outcome::Unidentified(Refusal::NoHypothesis);
        };
        let foreign = (self.config.foreign_prior / (1.0 - self.config.foreign_prior)).ln();
        let rivals: f64 = ws
            .found
            .iter()
            .map(|e| (e.ln_evidence - best.ln_evidence).exp())
            .sum();
        let confidence = 1.0 / (rivals + (foreign - best.ln_evidence).exp());
        let mut squared = 0.0;
        let mut matched = 0usize;
        for (o, &j) in ws.prepared.iter().zip(&best.assignment) {
            if j != UNASSIGNED {
                let q = best.rotation * self.dots[j as usize];
                squared += crate::geometry::angle_between(&q, &o.direction).powi(2);
                matched += 1;
            }
        }
        Outcome::Identified(Identification {
            rotation: Rotation::from_rotation_matrix(&nalgebra::Rotation3::from_matrix_unchecked(
                best.rotation,
            )),
            assignment: best
                .assignment
                .iter()
                .map(|&j| (j != UNASSIGNED).then_some(j))
                .collect(),
            residual_rad: (squared / matched.max(1) as f64).sqrt(),
            confidence,
        })
    }
}

impl Recogniser for RobustRecogniser {
    type Workspace = RobustWorkspace;

    fn workspace(&self) -> RobustWorkspace {
        RobustWorkspace::default()
    }

    fn min_dots(&self) -> usize {
        3
    }

    fn identify(&self, dots: &[ObservedDot], ws: &mut RobustWorkspace) -> Outcome {
        if dots.len() < self.min_dots() {
            return Outcome::Unidentified(Refusal::TooFewDots {
                found: dots.len(),
                needed: self.min_dots(),
            });
        }
        self.prepare(dots, ws);
        ws.found.clear();
        if ws.pairs.is_empty() {
            return Outcome::Unidentified(Refusal::Degenerate);
        }
        for k in 0..ws.pairs.len() {
            let (_, a, b) = ws.pairs[k];
            self.try_pair(a, b, ws);
            if self.beyond_doubt(a, b, ws) {
                break;
            }
        }
        self.answer(ws)
    }
}

/// Right-handed orthonormal frame of two directions, balanced between them, as columns.
fn frame(a: &Vec3, b: &Vec3) -> Matrix3<f64> {
    let x = (a + b).normalize();
    let z = a.cross(b).normalize();
    Matrix3::from_columns(&[x, z.cross(&x), z])
}

fn best_of(found: &[Explanation]) -> Option<&Explanation> {
    found
        .iter()
        .max_by(|a, b| a.ln_evidence.total_cmp(&b.ln_evidence))
}

/// A fingerprint of an assignment, to see whether it changed.
fn signature(assignment: &[u16]) -> [u16; 2] {
    assignment.iter().fold([7, 1], |[a, b], &j| {
        [
            a.wrapping_mul(31).wrapping_add(j),
            b.wrapping_mul(17).wrapping_add(a ^ j),
        ]
    })
}

/// Keeps the `most` best-scored rotations, best first.
fn keep_best(kept: &mut Vec<(f64, Matrix3<f64>)>, most: usize, score: f64, rotation: Matrix3<f64>) {
    if kept.len() == most && kept.last().is_some_and(|l| l.0 >= score) {
        return;
    }
    let at = kept.partition_point(|k| k.0 >= score);
    if kept.len() == most {
        kept.pop();
    }
    kept.insert(at, (score, rotation));
}
