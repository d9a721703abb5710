//! Explanations weighed over unknown conditions, and their dots named under them.
//!
//! The search assumes the conditions expected. Where these are uncertain, a dot that they call
//! false may be real under others that are nearly as likely: a dot just inside the limb where the
//! visibility limit is not known, or one far off where the noise is not known. The assignments of
//! the best explanations are therefore improved by changes of one dot or of two that share a pattern
//! dot, until none raises the evidence over all conditions
//! ([`ConditionsPosterior::ln_marginal`]). Every change is judged at the rotation fitted to it. What
//! the last changes tried would have given are the alternatives:
//!
//! ```text
//! ln_alternatives = sum_dots ln(1 + sum_{changes of the dot} exp(ln p(changed) - ln p(chosen)))
//! ```
//!
//! What it does not guarantee: that no change of several dots at once would be better.

use super::RobustRecognizer;
use super::model::{PreparedDot, SEARCH_WEIGHT};
use super::naming::Naming;
use super::posterior::Explanation;
use super::refine::{
    ComparedDots, ExplanationRefiner, MIN_MATCHED, RefinedExplanation, UNASSIGNED, ln_volume,
    widened,
};
use super::workspace::RobustWorkspace;
use crate::recognize::learn::{
    ConditionsPosterior, Displacement, FrameEvidence, LnLikelihood, information,
};

/// Nats behind the best explanation from which on others say nothing of the conditions.
const NEGLIGIBLE: f64 = 20.0;
/// Nats behind the best explanation up to which others are integrated over their rotations: those beyond have less
/// than a thousandth of the say.
const INTEGRATED: f64 = 7.0;
/// Nats behind the best explanation up to which dots are named anew: a few dots may make up for
/// them.
const NAMED_WITHIN: f64 = 8.0;
/// Fewer dots than these keep the names of the search: with so many conditions open nearly any three or four
/// can be named.
const MIN_NAMED: usize = 5;
/// Maximum number of explanations whose dots are named anew.
const MAX_NAMED: usize = 12;
/// Changes of one assignment; a frame needs one or two.
const MAX_CHANGES: usize = 12;
/// Standard deviations within which a dot may be a pattern dot's.
const REACH: f64 = 5.0;
/// Nats that a change must gain.
const LEAST_GAIN: f64 = 1e-6;

/// An assignment's fit, and its log-evidence over all conditions.
#[derive(Debug, Clone, Copy)]
struct Weighed {
    fit: RefinedExplanation,
    ln_evidence: f64,
}

impl RobustRecognizer {
    /// What the explanations of the last view of `ws` say of the conditions, written into `out`;
    /// nothing where there are none.
    pub fn conditions_evidence(
        &self,
        conditions: &ConditionsPosterior,
        ws: &RobustWorkspace,
        out: &mut FrameEvidence,
    ) {
        out.explanations.clear();
        let n = ws.dots.len();
        out.ln_null = conditions.ln_null(n, self.dots.len());
        // Both are against "all dots are false".
        out.ln_mirrored = ws.mirrored.ln_evidence() + self.model.ln_all_false(n);
        let Some(best) = ws.found.best() else {
            return;
        };
        for explanation in ws.found.explanations() {
            let refined = &explanation.refined;
            if refined.ln_evidence < best.refined.ln_evidence - NEGLIGIBLE {
                continue;
            }
            let assignment = ws.found.assignment(explanation);
            let is_likely = refined.ln_evidence > best.refined.ln_evidence - INTEGRATED;
            let mut likelihood = match is_likely && conditions.frames() > 0 {
                true => self.integrated(
                    conditions,
                    refined,
                    assignment,
                    &ws.dots,
                    &mut out.displacements,
                ),
                false => self.ln_likelihood(conditions, refined, assignment, &ws.dots),
            };
            likelihood.constant += refined.ln_alternatives;
            out.explanations.push(likelihood);
        }
    }

    /// An explanation's likelihood under every condition, the noise integrated over the rotations about its own.
    fn integrated(
        &self,
        conditions: &ConditionsPosterior,
        fit: &RefinedExplanation,
        assignment: &[u16],
        dots: &[PreparedDot],
        displacements: &mut Vec<Displacement>,
    ) -> LnLikelihood {
        displacements.clear();
        for (dot, &j) in dots
            .iter()
            .zip(assignment)
            .filter(|(_, j)| **j != UNASSIGNED)
        {
            let j = usize::from(j);
            let (q, dot) = (fit.rotation * self.dots[j], widened(&self.spread, j, dot));
            let [a, b] = dot.axes.map(|u| u.dot(&q));
            let depth = (1.0 - dot.direction.dot(&q)) * dot.radial.sqrt();
            let by = dot.axes.map(|u| q.cross(&u));
            displacements.push(Displacement::new([a, b, depth], by));
        }
        // Where the search has integrated, its factor holds for the noise expected only.
        let known = information(displacements);
        let fit = RefinedExplanation {
            ln_volume: ln_volume(&known),
            ..*fit
        };
        let mut likelihood = self.ln_likelihood(conditions, &fit, assignment, dots);
        let scale = self.model.noise_scale();
        conditions.integrate_noise(scale, displacements, &known, &mut likelihood);
        likelihood
    }

    /// An explanation's likelihood under every condition.
    fn ln_likelihood(
        &self,
        conditions: &ConditionsPosterior,
        fit: &RefinedExplanation,
        assignment: &[u16],
        dots: &[PreparedDot],
    ) -> LnLikelihood {
        let matched = || {
            dots.iter()
                .zip(assignment)
                .filter(|(_, j)| **j != UNASSIGNED)
        };
        let peaks: f64 = matched()
            .map(|(dot, &j)| {
                let seen = widened(&self.spread, usize::from(j), dot);
                self.model.ln_gaussian_peak(&seen)
            })
            .sum();
        let constant = fit.ln_volume + fit.ln_prior + peaks;
        let mut tally = conditions.tally(constant, self.model.noise_scale());
        for (j, dot) in self.dots.iter().enumerate() {
            let q = fit.rotation * dot;
            match matched().find(|(_, k)| usize::from(**k) == j) {
                Some((seen, _)) => {
                    let seen = widened(&self.spread, j, seen);
                    tally.matched(q.z, seen.distance_squared(&q).sqrt());
                }
                None => tally.missed(q.z),
            }
        }
        tally.finish(dots.len() - matched().count())
    }

    /// Log-evidence of an assignment over all conditions, against "all dots are false".
    fn ln_marginal(
        &self,
        conditions: &ConditionsPosterior,
        fit: &RefinedExplanation,
        assignment: &[u16],
        dots: &[PreparedDot],
    ) -> f64 {
        let likelihood = self.ln_likelihood(conditions, fit, assignment, dots);
        conditions.ln_marginal(&likelihood) - self.model.ln_all_false(dots.len())
    }

    /// Weighs the explanations by their evidence over all conditions, and names the dots of the
    /// best by it.
    pub(super) fn marginalize(&self, conditions: &ConditionsPosterior, ws: &mut RobustWorkspace) {
        let Some(best) = ws.found.best() else {
            return;
        };
        let least = best.refined.ln_evidence - NEGLIGIBLE;
        let dots = &ws.dots;
        let marginal = |e: &Explanation, assignment: &[u16]| {
            self.ln_marginal(conditions, &e.refined, assignment, dots)
        };
        // What is negligible stays behind by as much.
        let shift = marginal(best, ws.found.assignment(best)) - best.refined.ln_evidence;
        ws.found
            .reweigh(|e, assignment| match e.refined.ln_evidence {
                ln_evidence if ln_evidence < least => ln_evidence + shift,
                _ => marginal(e, assignment),
            });
        let ln_null = conditions.ln_null(ws.dots.len(), self.dots.len());
        let all_false = self.model.ln_all_false(ws.dots.len());
        ws.null = Some(self.null.of_view(ln_null - all_false));
        if ws.dots.len() >= MIN_NAMED {
            self.name_best(conditions, ws);
        }
    }

    /// Names the dots of the best explanations anew.
    fn name_best(&self, conditions: &ConditionsPosterior, ws: &mut RobustWorkspace) {
        let Some(best) = ws.found.best() else {
            return;
        };
        let least = best.refined.ln_evidence - NAMED_WITHIN;
        // Those up to `rank` are named, whatever their order has become.
        let mut rank = 0;
        for _ in 0..MAX_NAMED {
            let Some(&explanation) = ws.found.ranked(rank) else {
                return;
            };
            if explanation.refined.ln_evidence < least {
                return;
            }
            ws.naming.chosen.clear();
            let assignment = ws.found.assignment(&explanation);
            ws.naming.chosen.extend_from_slice(assignment);
            let named = self.name(conditions, &explanation.refined, ws);
            if ws.found.rename(&explanation, named, &ws.naming.chosen) {
                rank += 1;
            }
        }
    }

    /// Improves the assignment in `ws.naming` while that raises the evidence; the explanation that
    /// it becomes.
    fn name(
        &self,
        conditions: &ConditionsPosterior,
        refined: &RefinedExplanation,
        ws: &mut RobustWorkspace,
    ) -> RefinedExplanation {
        let RobustWorkspace {
            dots,
            refiner,
            naming,
            ..
        } = ws;
        let view = self.view(dots, None);
        self.link(refined, dots, naming);
        let mut now = Weighed {
            fit: *refined,
            ln_evidence: refined.ln_evidence,
        };
        for _ in 0..MAX_CHANGES {
            let better = self.try_changes(conditions, &view, &now, refiner, naming);
            let Some(better) = better else {
                break;
            };
            now = better;
            naming.chosen.clone_from(&naming.better);
        }
        RefinedExplanation {
            ln_evidence: now.ln_evidence,
            ln_alternatives: naming.alternatives.iter().map(|sum| sum.ln_1p()).sum(),
            ..now.fit
        }
    }

    /// Lists the matches within reach.
    fn link(&self, refined: &RefinedExplanation, dots: &[PreparedDot], naming: &mut Naming) {
        naming.links.clear();
        for (j, p) in self.dots.iter().enumerate() {
            let q = refined.rotation * p;
            for (i, dot) in dots.iter().enumerate() {
                // The squared distance holds for directions on the same side.
                let near = dot.direction.dot(&q) > 0.0;
                let seen = widened(&self.spread, j, dot);
                if near && seen.distance_squared(&q) < REACH * REACH {
                    naming.links.push([i as u16, j as u16]);
                }
            }
        }
    }

    /// Tries every change of the chosen assignment; the best one if it gains, left in
    /// `naming.better`.
    fn try_changes(
        &self,
        conditions: &ConditionsPosterior,
        view: &ComparedDots<'_>,
        now: &Weighed,
        refiner: &mut ExplanationRefiner,
        naming: &mut Naming,
    ) -> Option<Weighed> {
        naming.alternatives.clear();
        naming.alternatives.resize(view.dots.len(), 0.0);
        let mut best: Option<Weighed> = None;
        let leaves = naming.chosen.len();
        for k in 0..leaves + naming.links.len() {
            let (dot, to) = match k.checked_sub(leaves) {
                None => (k, UNASSIGNED),
                Some(link) => {
                    let [dot, to] = naming.links[link];
                    (usize::from(dot), to)
                }
            };
            if naming.chosen[dot] == to {
                continue;
            }
            let exchanged = naming.change(dot, to);
            let fitted = self.fit_and_weigh(conditions, view, &now.fit, refiner, &naming.tried);
            let Some(weighed) = fitted else {
                continue;
            };
            // The other dot of an exchange tries the same.
            if exchanged.is_none_or(|other| dot < other) {
                naming.alternatives[dot] += (weighed.ln_evidence - now.ln_evidence).exp();
            }
            let least = best.map_or(now.ln_evidence + LEAST_GAIN, |b| b.ln_evidence);
            if weighed.ln_evidence > least {
                naming.better.clone_from(&naming.tried);
                best = Some(weighed);
            }
        }
        best
    }

    /// Fits an assignment and weighs it; `None` where it does not determine a rotation.
    fn fit_and_weigh(
        &self,
        conditions: &ConditionsPosterior,
        view: &ComparedDots<'_>,
        from: &RefinedExplanation,
        refiner: &mut ExplanationRefiner,
        assignment: &[u16],
    ) -> Option<Weighed> {
        let matched = assignment.iter().filter(|&&j| j != UNASSIGNED).count();
        if matched < MIN_MATCHED {
            return None;
        }
        let (information, rotation) =
            refiner.fit(view, &from.rotation, assignment, SEARCH_WEIGHT)?;
        let fit = RefinedExplanation {
            rotation,
            ln_volume: ln_volume(&information),
            ..*from
        };
        Some(Weighed {
            ln_evidence: self.ln_marginal(conditions, &fit, assignment, view.dots),
            fit,
        })
    }
}
