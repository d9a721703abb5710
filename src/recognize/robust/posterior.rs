//! The explanations found, and their posterior probabilities against each other and the null
//! hypothesis.
//!
//! One explanation is kept for each rotation. Nearby rotations share their assignments except for a
//! few dots, and [`RefinedExplanation::ln_alternatives`] sums those up. Under the null hypothesis a view has
//! as many dots as a view of the pattern has on average (Poisson), uniform on the visible cap.

use nalgebra::Matrix3;

use super::refine::RefinedExplanation;
use crate::recognize::ORIENTATION_FAILURE_RAD;
use crate::view::ViewModel;

/// Rotations nearer than this (radians) are one explanation.
const ONE_ROTATION: f64 = 0.12;
/// A start nearer to an explanation than this (radians) would lead there again.
const KNOWN_ROTATION: f64 = 0.08;
/// Maximum number of explanations remembered; the least probable goes first.
pub(super) const MAX_FOUND: usize = 128;

/// Everything found in one view.
#[derive(Debug, Default)]
pub(super) struct FoundInView {
    explanations: Vec<Explanation>,
    /// Assignments, `dots` numbers each.
    assignments: Vec<u16>,
    dots: usize,
}

/// An explanation, with its position among the assignments.
#[derive(Debug, Clone, Copy)]
pub(super) struct Explanation {
    pub refined: RefinedExplanation,
    slot: usize,
}

/// The weights of an explanation.
#[derive(Debug, Clone, Copy)]
pub(super) struct ExplanationWeights {
    /// ln of the evidence of its own assignment, against "all dots are false".
    pub ln_own: f64,
    /// ln of the evidence of all assignments. Rotations that are also another explanation's are shared
    /// between them, so that it may be less than that of its own assignment.
    pub ln_all: f64,
}

impl ExplanationWeights {
    fn is_known(&self) -> bool {
        self.ln_own.is_finite() && self.ln_all.is_finite()
    }
}

/// The hypotheses against which the explanations stand: something else, or the mirrored pattern.
#[derive(Debug, Clone, Copy)]
pub(super) struct NullHypothesis {
    /// ln of the prior odds of something else, and of the mirrored pattern, against the pattern.
    ln_odds: f64,
    ln_mirrored_odds: f64,
    ln_ratio: f64,
    excess: f64,
}

/// Probabilities of the best explanation.
#[derive(Debug, Clone, Copy)]
pub(super) struct Confidence {
    /// Of its assignment.
    pub identity: f64,
    /// Of a rotation within [`ORIENTATION_FAILURE_RAD`] of its own, for any assignment.
    pub pose: f64,
}

impl NullHypothesis {
    pub fn new(view: &ViewModel, pattern_dots: usize) -> Self {
        let false_dots = view.false_dots.mean();
        let mean = view.mean_dots(pattern_dots);
        let own_share = 1.0 - view.foreign_share - view.mirrored_share;
        Self {
            ln_odds: (view.foreign_share / own_share).ln(),
            ln_mirrored_odds: (view.mirrored_share / own_share).ln(),
            ln_ratio: (mean / false_dots).ln(),
            excess: mean - false_dots,
        }
    }

    /// Log-evidence of the null hypothesis with so many dots, against "all dots are false".
    pub fn ln_evidence(&self, dots: usize) -> f64 {
        dots as f64 * self.ln_ratio - self.excess
    }

    /// ln of the prior odds of the mirrored pattern.
    pub fn ln_mirrored_odds(&self) -> f64 {
        self.ln_mirrored_odds
    }

    /// The same for a view whose log-evidence, against "all dots are false", is known.
    pub fn of_view(&self, ln_evidence: f64) -> Self {
        Self {
            ln_ratio: 0.0,
            excess: -ln_evidence,
            ..*self
        }
    }

    /// The same against a mirrored view, which is itself unlikely.
    pub fn of_mirrored(&self) -> Self {
        Self {
            ln_odds: self.ln_odds - self.ln_mirrored_odds,
            ln_mirrored_odds: -self.ln_mirrored_odds,
            ..*self
        }
    }

    /// The same with the prior odds.
    fn ln_weight(&self, dots: usize) -> f64 {
        self.ln_evidence(dots) + self.ln_odds
    }
}

impl FoundInView {
    pub fn with_capacity_for(dots: usize) -> Self {
        Self {
            explanations: Vec::with_capacity(MAX_FOUND),
            assignments: Vec::with_capacity(dots * MAX_FOUND),
            dots: 0,
        }
    }

    pub fn clear(&mut self, dots: usize) {
        self.explanations.clear();
        self.assignments.clear();
        self.dots = dots;
    }

    /// Remembers an explanation, unless a better one has the same rotation.
    pub fn add(&mut self, refined: RefinedExplanation, assignment: &[u16]) {
        let near = 1.0 + 2.0 * ONE_ROTATION.cos();
        let same = |e: &Explanation| overlap(&e.refined.rotation, &refined.rotation) > near;
        let known = self.explanations.iter().position(same).or_else(|| {
            let full = self.explanations.len() == MAX_FOUND;
            full.then(|| self.least()).flatten()
        });
        match known {
            Some(k) => {
                let known = &mut self.explanations[k];
                if known.refined.ln_evidence < refined.ln_evidence {
                    known.refined = refined;
                    self.assignments[known.slot..][..self.dots].copy_from_slice(assignment);
                }
            }
            None => {
                let slot = self.assignments.len();
                self.assignments.extend_from_slice(assignment);
                self.explanations.push(Explanation { refined, slot });
            }
        }
    }

    fn least(&self) -> Option<usize> {
        let evidence = |k: &usize| self.explanations[*k].refined.ln_evidence;
        (0..self.explanations.len()).min_by(|a, b| evidence(a).total_cmp(&evidence(b)))
    }

    /// The explanation of this rank, 0 the best.
    pub fn ranked(&self, rank: usize) -> Option<&Explanation> {
        let evidence = |e: &Explanation| e.refined.ln_evidence;
        let ahead = |e: &Explanation| {
            self.explanations
                .iter()
                .filter(|o| {
                    evidence(o) > evidence(e) || (evidence(o) == evidence(e) && o.slot < e.slot)
                })
                .count()
        };
        self.explanations.iter().find(|e| ahead(e) == rank)
    }

    pub fn best(&self) -> Option<&Explanation> {
        self.explanations
            .iter()
            .max_by(|a, b| a.refined.ln_evidence.total_cmp(&b.refined.ln_evidence))
    }

    /// Replaces the weights of every explanation not below a log-evidence by what `of` makes of its
    /// number, itself and its assignment.
    pub fn weigh(
        &mut self,
        least: f64,
        mut of: impl FnMut(usize, &RefinedExplanation, &[u16]) -> Option<ExplanationWeights>,
    ) {
        for (number, explanation) in self.explanations.iter_mut().enumerate() {
            let refined = &mut explanation.refined;
            let assignment = &self.assignments[explanation.slot..][..self.dots];
            if refined.ln_evidence < least {
                continue;
            }
            let weights = of(number, refined, assignment);
            // A matched dot may lie just beyond what the kernel reaches: no weight is known then.
            if let Some(weights) = weights.filter(ExplanationWeights::is_known) {
                refined.ln_volume += weights.ln_own - refined.ln_evidence;
                refined.ln_evidence = weights.ln_own;
                refined.ln_alternatives = weights.ln_all - weights.ln_own;
            }
        }
    }

    /// All explanations, in no order.
    pub fn explanations(&self) -> &[Explanation] {
        &self.explanations
    }

    /// Replaces the log-evidence of every explanation by what `of` makes of it and its assignment.
    pub fn reweigh(&mut self, of: impl Fn(&Explanation, &[u16]) -> f64) {
        for explanation in &mut self.explanations {
            let assignment = &self.assignments[explanation.slot..][..self.dots];
            explanation.refined.ln_evidence = of(explanation, assignment);
        }
    }

    /// Replaces an explanation's rotation.
    pub fn turn(&mut self, of: &Explanation, rotation: Matrix3<f64>) {
        let same = self.explanations.iter_mut().find(|e| e.slot == of.slot);
        if let Some(explanation) = same {
            explanation.refined.rotation = rotation;
        }
    }

    /// Replaces an explanation, whose dots were named anew; of several that now have the same
    /// rotation the most likely is kept. Returns whether this one is.
    pub fn rename(
        &mut self,
        of: &Explanation,
        refined: RefinedExplanation,
        assignment: &[u16],
    ) -> bool {
        let near = 1.0 + 2.0 * ONE_ROTATION.cos();
        let same = |e: &Explanation| {
            e.slot != of.slot && overlap(&e.refined.rotation, &refined.rotation) > near
        };
        let ahead = |e: &Explanation| e.refined.ln_evidence > refined.ln_evidence;
        if self.explanations.iter().any(|e| same(e) && ahead(e)) {
            self.explanations.retain(|e| e.slot != of.slot);
            return false;
        }
        self.explanations.retain(|e| !same(e));
        self.assignments[of.slot..][..self.dots].copy_from_slice(assignment);
        let renamed = self.explanations.iter_mut().find(|e| e.slot == of.slot);
        if let Some(explanation) = renamed {
            explanation.refined = refined;
        }
        true
    }

    pub fn assignment(&self, explanation: &Explanation) -> &[u16] {
        &self.assignments[explanation.slot..][..self.dots]
    }

    /// Log-evidence of the best explanation but this one; minus infinity if there is none.
    pub fn best_rival(&self, of: &Explanation) -> f64 {
        self.explanations
            .iter()
            .filter(|e| e.slot != of.slot)
            .map(|e| e.refined.ln_evidence)
            .fold(f64::NEG_INFINITY, f64::max)
    }

    /// ln of the evidence of all explanations together; minus infinity for none.
    pub fn ln_evidence(&self) -> f64 {
        let Some(best) = self.best() else {
            return f64::NEG_INFINITY;
        };
        let origin = best.refined.ln_evidence;
        let all = self
            .explanations
            .iter()
            .map(|e| (e.refined.ln_evidence + e.refined.ln_alternatives - origin).exp());
        origin + all.sum::<f64>().ln()
    }

    /// Whether some explanation has nearly this rotation.
    pub fn knows(&self, rotation: &Matrix3<f64>) -> bool {
        let near = 1.0 + 2.0 * KNOWN_ROTATION.cos();
        self.explanations
            .iter()
            .any(|e| overlap(&e.refined.rotation, rotation) > near)
    }

    /// The posterior probabilities of an explanation among all that were found, the null
    /// hypothesis, and `ln_others`.
    pub fn confidence(
        &self,
        of: &Explanation,
        null: &NullHypothesis,
        ln_others: f64,
    ) -> Confidence {
        let origin = of.refined.ln_evidence;
        let weight =
            |e: &Explanation| (e.refined.ln_evidence + e.refined.ln_alternatives - origin).exp();
        let all: f64 = self.explanations.iter().map(weight).sum();
        let all = all + (null.ln_weight(self.dots) - origin).exp() + (ln_others - origin).exp();
        let same_pose = |e: &&Explanation| is_same_pose(&e.refined.rotation, &of.refined.rotation);
        let pose: f64 = self.explanations.iter().filter(same_pose).map(weight).sum();
        Confidence {
            // Of the rotations that it shares with others it has its part only.
            identity: (1.0 / all).min(pose / all),
            pose: pose / all,
        }
    }
}

/// Whether either rotation is right if the other one is.
fn is_same_pose(a: &Matrix3<f64>, b: &Matrix3<f64>) -> bool {
    overlap(a, b) > 1.0 + 2.0 * ORIENTATION_FAILURE_RAD.cos()
}

/// Trace of `A^T B`: 1 + 2 cos of the angle between the rotations.
fn overlap(a: &Matrix3<f64>, b: &Matrix3<f64>) -> f64 {
    a.dot(b)
}

#[cfg(test)]
mod tests {
    use nalgebra::Rotation3;

    use super::*;

    /// An explanation of two dots, turned by so much about z.
    fn explanation(ln_evidence: f64, ln_alternatives: f64, turn: f64) -> RefinedExplanation {
        RefinedExplanation {
            rotation: *Rotation3::from_axis_angle(&nalgebra::Vector3::z_axis(), turn).matrix(),
            ln_evidence,
            ln_volume: -3.0,
            ln_prior: 0.0,
            ln_alternatives,
        }
    }

    #[test]
    fn the_evidence_is_that_of_all_explanations_with_their_alternatives() {
        let mut found = FoundInView::with_capacity_for(2);
        found.clear(2);
        assert_eq!(found.ln_evidence(), f64::NEG_INFINITY);
        found.add(explanation(5.0, 3f64.ln(), 0.0), &[0, 1]);
        assert!((found.ln_evidence() - (5.0 + 3f64.ln())).abs() < 1e-12);
        found.add(explanation(4.0, 0.0, 1.5), &[1, 0]);
        let expected = (3.0 * 5f64.exp() + 4f64.exp()).ln();
        assert!((found.ln_evidence() - expected).abs() < 1e-12);
    }
}
