//! The search over pairs of observed dots. It ends when the best explanation is settled, or when pairs bring no more
//! evidence.

use super::RobustRecognizer;
use super::hint::HintPrior;
use super::model::PreparedDot;
use super::pairs::frame;
use super::refine::{ComparedDots, RefinedExplanation, RoughRotation, UNASSIGNED};
use super::workspace::RobustWorkspace;
use crate::geometry::Rotation;
use crate::recognize::{ObservedDot, RecognizerRejection};

/// Nats by which the best explanation must lead every rival and "null" to end the search early.
const DOUBT: f64 = 9.0;
/// Hypotheses refined in a row without coming near the best before a pass ends.
const PATIENCE: usize = 4;
/// Nats that a refinement hardly ever adds to the screening's score, less [`DOUBT`].
const HOPELESS: f64 = 16.0;
/// Passes in a row that bring no evidence before the search ends, where most dots are explained. In `clutter` it takes 0.6 of the time that 64 pairs
/// take, with as many orientations right (99.07 and 87.60 % of 10 000 trials of seed 777 with 20 and 12 dots; 87.61 by all pairs) and
/// 0.1 % fewer views with every dot named.
const IDLE_PASSES: usize = 6;
/// Nats of evidence that count as some: a change of the sum by a hundredth.
const EVIDENCE: f64 = 0.01;
/// Nats by which the best explanation must exceed the bound of the unseen ones.
const UNSEEN: f64 = 4.0;
/// Fewer dots than this leave the choice among hypotheses to the hint.
const FEW: usize = 4;
/// Maximum number of passes over the mirrored view: a flipped axis affects every frame, so the
/// hardest frames need not show it.
const MIRROR_PASSES: usize = 6;

impl RobustRecognizer {
    /// Prepares the dots.
    pub(super) fn prepare(
        &self,
        dots: &[ObservedDot],
        ws: &mut RobustWorkspace,
    ) -> Result<(), RecognizerRejection> {
        for dot in dots {
            ws.dots.push(
                self.model
                    .prepare(dot)
                    .ok_or(RecognizerRejection::Degenerate)?,
            );
        }
        Ok(())
    }

    /// Tries the hint, then passes over pairs until the best explanation is settled.
    pub(super) fn search(
        &self,
        prior: Option<&HintPrior>,
        ws: &mut RobustWorkspace,
    ) -> Result<(), RecognizerRejection> {
        ws.pair_up();
        if ws.pairs.is_empty() {
            return Err(RecognizerRejection::Degenerate);
        }
        if let Some(prior) = prior {
            let start = RoughRotation {
                rotation: prior.rotation(),
                widening: prior.widening(&ws.dots),
            };
            self.refine(&start, Some(prior), f64::NEG_INFINITY, ws);
        }
        self.passes(self.config.passes, prior, None, ws);
        Ok(())
    }

    /// Searches the view with x reversed for what is not far behind the best explanation of the view itself; the result goes to
    /// `ws.mirrored`.
    pub(super) fn search_mirrored(&self, ws: &mut RobustWorkspace) {
        let rival = ws.found.best().map(|best| best.refined);
        ws.dots.iter_mut().for_each(PreparedDot::mirror);
        ws.pair_up();
        std::mem::swap(&mut ws.found, &mut ws.mirrored);
        let most = self.config.passes.min(MIRROR_PASSES);
        self.passes(most, None, rival.as_ref(), ws);
        let ahead = rival.map_or(f64::NEG_INFINITY, |rival| rival.ln_evidence);
        self.weigh(None, ahead, ws);
        std::mem::swap(&mut ws.found, &mut ws.mirrored);
        ws.dots.iter_mut().for_each(PreparedDot::mirror);
    }

    /// `rival`: an explanation of another view, beside which what is far behind it counts for nothing.
    fn passes(
        &self,
        most: usize,
        prior: Option<&HintPrior>,
        rival: Option<&RefinedExplanation>,
        ws: &mut RobustWorkspace,
    ) {
        // The best conceivable explanation matches every dot perfectly.
        let mut unseen: f64 = ws.dots.iter().map(|d| d.most).sum();
        let (mut left_out, mut idle) = (0, 0);
        let mut evidence = ws.found.ln_evidence();
        for _ in 0..most {
            let Some((pair, disjoint)) = ws.next_pair() else {
                return;
            };
            self.pass(pair, prior, rival, ws);
            let before = std::mem::replace(&mut evidence, ws.found.ln_evidence());
            idle = if evidence > before + EVIDENCE {
                0
            } else {
                idle + 1
            };
            if idle >= IDLE_PASSES && explains_most(ws) {
                return;
            }
            if disjoint {
                unseen -= ws.dots[pair[0]].most.min(ws.dots[pair[1]].most);
                left_out += 1;
            }
            // So many false dots may be more probable than under Poisson's distribution.
            let unseen = unseen + self.model.max_false_count(left_out);
            if self.settled(pair, unseen, ws) {
                return;
            }
        }
    }

    /// Aligns one observed pair with every similar pattern pair and refines the hypotheses near the
    /// best.
    fn pass(
        &self,
        [a, b]: [usize; 2],
        prior: Option<&HintPrior>,
        rival: Option<&RefinedExplanation>,
        ws: &mut RobustWorkspace,
    ) {
        let observed = frame(&ws.dots[a].direction, &ws.dots[b].direction);
        let rotation = |index: usize| {
            let pair = self.pairs.pair(index);
            let [p, q] = [pair.first, pair.second].map(|d| &self.dots[usize::from(d)]);
            observed * frame(p, q).transpose()
        };
        // Where the dots carry more information than the hint, evaluating it each time only takes
        // time.
        let bias = prior
            .filter(|_| ws.dots.len() < FEW)
            .map(|p| move |index: usize| p.ln_ratio(&rotation(index), None));
        let screened = ws
            .screen
            .run(&self.screen, &self.pairs, &ws.dots, (a, b), bias);
        if screened.is_none() {
            return;
        }
        let mut fruitless = 0;
        for k in 0..ws.screen.kept().len() {
            let best = likelier(ws.found.best().map(|e| &e.refined), rival).copied();
            let hypothesis = ws.screen.kept()[k];
            let behind =
                |r: &RefinedExplanation| r.ln_evidence - r.ln_volume - f64::from(hypothesis.score);
            if fruitless == PATIENCE || best.is_some_and(|b| behind(&b) > HOPELESS) {
                break;
            }
            let start = RoughRotation::of_pair(rotation(hypothesis.pair as usize));
            if ws.found.knows(&start.rotation) {
                continue;
            }
            let least = best.map_or(f64::NEG_INFINITY, |b| b.ln_evidence - DOUBT);
            let fruitful = self.refine(&start, prior, least, ws);
            fruitless = if fruitful { 0 } else { fruitless + 1 };
        }
    }

    /// Gives the best explanation the most likely rotation for its assignment.
    pub(super) fn polish_best(&self, ws: &mut RobustWorkspace) -> Option<()> {
        let best = *ws.found.best()?;
        let view = self.view(&ws.dots, None);
        let assignment = ws.found.assignment(&best);
        let rotation = ws.refiner.polish(&view, &best.refined.rotation, assignment);
        ws.found.turn(&best, rotation);
        Some(())
    }

    /// The view that this recognizer compares with its pattern.
    pub(super) fn view<'a>(
        &'a self,
        dots: &'a [PreparedDot],
        prior: Option<&'a HintPrior>,
    ) -> ComparedDots<'a> {
        ComparedDots {
            model: &self.model,
            pattern: &self.dots,
            dots,
            prior,
            spread: &self.spread,
            visibility_limit: self.config.view.visibility_limit,
        }
    }

    /// Refines a rotation that may be a few degrees off.
    pub(super) fn refine_from(&self, rotation: &Rotation, ws: &mut RobustWorkspace) {
        let start = RoughRotation::of_pair(*rotation.to_rotation_matrix().matrix());
        self.refine(&start, None, f64::NEG_INFINITY, ws);
    }

    /// Refines a rotation and stores the result; returns whether it is better than `least`.
    fn refine(
        &self,
        start: &RoughRotation,
        prior: Option<&HintPrior>,
        least: f64,
        ws: &mut RobustWorkspace,
    ) -> bool {
        let view = self.view(&ws.dots, prior);
        let Some(refined) = ws.refiner.refine(&view, start, least) else {
            return false;
        };
        ws.found.add(refined, ws.refiner.assignment());
        refined.ln_evidence > least
    }

    /// Whether the search may end after a pass over the pair. `unseen` bounds the log-likelihood
    /// ratio of the explanations that no pass has covered, without the share of rotations.
    fn settled(&self, [a, b]: [usize; 2], unseen: f64, ws: &RobustWorkspace) -> bool {
        let Some(best) = ws.found.best() else {
            return false;
        };
        let evidence = best.refined.ln_of_dots();
        if evidence > unseen + best.refined.ln_volume + UNSEEN {
            return true;
        }
        let assignment = ws.found.assignment(best);
        let explains_pair = assignment[a] != UNASSIGNED && assignment[b] != UNASSIGNED;
        // Of two poses with dots of their own only one explains this pair.
        explains_pair
            && explains_most(ws)
            && evidence - self.null.ln_evidence(ws.dots.len()) > DOUBT
            && best.refined.ln_evidence - ws.found.best_rival(best) > DOUBT
    }
}

/// The likelier of two explanations.
fn likelier<'a>(
    a: Option<&'a RefinedExplanation>,
    b: Option<&'a RefinedExplanation>,
) -> Option<&'a RefinedExplanation> {
    let both = a.into_iter().chain(b);
    both.max_by(|a, b| a.ln_evidence.total_cmp(&b.ln_evidence))
}

/// Whether the best explanation leaves out fewer dots than it names.
fn explains_most(ws: &RobustWorkspace) -> bool {
    ws.found.best().is_some_and(|best| {
        let assignment = ws.found.assignment(best);
        let matched = assignment.iter().filter(|&&j| j != UNASSIGNED).count();
        2 * matched > assignment.len()
    })
}
