//! The search over pairs of observed dots, and the memory it works in.

use super::RobustRecognizer;
use super::hint::Prior;
use super::marginal::Naming;
use super::matching::Matching;
use super::model::Dot;
use super::pairs::{PatternPairs, frame};
use super::posterior::{Found, NullHypothesis};
use super::refine::{Refined, Refiner, Start, UNASSIGNED, View};
use super::screen::Screen;
use crate::geometry::Rotation;
use crate::recognize::{Explanations, ObservedDot, RecognizerRejection};

/// Pairs nearer to parallel or opposite than this sine leave the rotation too uncertain to start
/// from.
const MIN_SINE: f64 = 0.15;
/// Nats by which the best explanation must lead every rival and "null" to end the search early.
const DOUBT: f64 = 9.0;
/// Hypotheses refined in a row without coming near the best before a pass ends.
const PATIENCE: usize = 4;
/// Nats that a refinement hardly ever adds to the screening's score, less [`DOUBT`].
const HOPELESS: f64 = 16.0;
/// Nats by which the best explanation must exceed the bound of the unseen ones.
const UNSEEN: f64 = 4.0;
/// Fewer dots than this leave the choice among hypotheses to the hint.
const FEW: usize = 4;
/// Maximum number of passes over the mirrored view: a flipped axis affects every frame, so the
/// hardest frames need not show it.
const MIRROR_PASSES: usize = 6;
/// Observed dots for which a new workspace has the capacity; more of them make it grow.
const CAPACITY: usize = 64;

/// Scratch memory of [`RobustRecognizer`].
#[derive(Debug, Default)]
pub struct RobustWorkspace {
    pub(super) dots: Vec<Dot>,
    pairs: Vec<ObservedPair>,
    used: Vec<bool>,
    screen: Screen,
    pub(super) refiner: Refiner,
    pub(super) naming: Naming,
    pub(super) matching: Matching,
    pub(super) found: Found,
    pub(super) mirrored: Found,
    pub(super) explanations: Explanations,
    /// The null hypothesis of this view, where it is not the recognizer's.
    pub(super) null: Option<NullHypothesis>,
}

/// A pair of observed dots.
#[derive(Debug, Clone, Copy)]
struct ObservedPair {
    /// Conditioning of the rotation by this pair.
    quality: f64,
    dots: [u16; 2],
}

impl RobustWorkspace {
    /// The explanations of the last view that was explained with this workspace.
    pub fn explanations(&self) -> &Explanations {
        &self.explanations
    }

    pub(super) fn with_capacity_for(pairs: &PatternPairs, pattern: usize) -> Self {
        Self {
            dots: Vec::with_capacity(CAPACITY),
            pairs: Vec::with_capacity(CAPACITY * CAPACITY / 2),
            used: Vec::with_capacity(CAPACITY),
            screen: Screen::with_capacity_for(CAPACITY, pairs.row()),
            refiner: Refiner::with_capacity_for(CAPACITY, pattern),
            naming: Naming::with_capacity_for(CAPACITY),
            matching: Matching::with_capacity_for(CAPACITY, pattern),
            found: Found::with_capacity_for(CAPACITY),
            mirrored: Found::with_capacity_for(CAPACITY),
            explanations: Explanations::with_capacity_for(CAPACITY),
            null: None,
        }
    }

    pub(super) fn clear(&mut self, dots: usize) {
        self.dots.clear();
        self.found.clear(dots);
        self.mirrored.clear(dots);
        self.null = None;
    }

    /// Lists all usable pairs.
    fn pair_up(&mut self) {
        self.pairs.clear();
        for (i, a) in self.dots.iter().enumerate() {
            for (j, b) in self.dots[..i].iter().enumerate() {
                let sine2 = 1.0 - a.direction.dot(&b.direction).powi(2);
                if sine2 > MIN_SINE * MIN_SINE {
                    self.pairs.push(ObservedPair {
                        quality: sine2 / (a.sigma_max + b.sigma_max).powi(2),
                        dots: [i as u16, j as u16],
                    });
                }
            }
        }
        self.used.clear();
        self.used.resize(self.dots.len(), false);
    }

    /// Takes the best remaining pair, disjoint from earlier ones while there is one; returns
    /// whether there was a pair.
    fn next_pair(&mut self) -> Option<([usize; 2], bool)> {
        let best = |disjoint: bool| {
            self.pairs
                .iter()
                .enumerate()
                .filter(|(_, p)| !disjoint || p.dots.iter().all(|&d| !self.used[usize::from(d)]))
                .max_by(|a, b| a.1.quality.total_cmp(&b.1.quality))
                .map(|(k, _)| k)
        };
        let (k, disjoint) = match best(true) {
            Some(k) => (k, true),
            None => (best(false)?, false),
        };
        let pair = self.pairs.swap_remove(k).dots.map(usize::from);
        if disjoint {
            pair.into_iter().for_each(|d| self.used[d] = true);
        }
        Some((pair, disjoint))
    }
}

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
        prior: Option<&Prior>,
        ws: &mut RobustWorkspace,
    ) -> Result<(), RecognizerRejection> {
        ws.pair_up();
        if ws.pairs.is_empty() {
            return Err(RecognizerRejection::Degenerate);
        }
        if let Some(prior) = prior {
            let start = Start {
                rotation: prior.rotation(),
                widening: prior.widening(&ws.dots),
            };
            self.refine(&start, Some(prior), f64::NEG_INFINITY, ws);
        }
        self.passes(self.config.passes, prior, ws);
        Ok(())
    }

    /// Searches the view with x reversed; the result goes to `ws.mirrored`.
    pub(super) fn search_mirrored(&self, ws: &mut RobustWorkspace) {
        ws.dots.iter_mut().for_each(Dot::mirror);
        ws.pair_up();
        std::mem::swap(&mut ws.found, &mut ws.mirrored);
        self.passes(self.config.passes.min(MIRROR_PASSES), None, ws);
        self.weigh(None, ws);
        std::mem::swap(&mut ws.found, &mut ws.mirrored);
        ws.dots.iter_mut().for_each(Dot::mirror);
    }

    fn passes(&self, most: usize, prior: Option<&Prior>, ws: &mut RobustWorkspace) {
        // The best conceivable explanation matches every dot perfectly.
        let mut unseen: f64 = ws.dots.iter().map(|d| d.most).sum();
        let mut left_out = 0;
        for _ in 0..most {
            let Some((pair, disjoint)) = ws.next_pair() else {
                return;
            };
            self.pass(pair, prior, ws);
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
    fn pass(&self, [a, b]: [usize; 2], prior: Option<&Prior>, ws: &mut RobustWorkspace) {
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
            let best = ws.found.best().map(|e| e.refined);
            let hypothesis = ws.screen.kept()[k];
            let behind = |r: &Refined| r.ln_evidence - r.ln_volume - f64::from(hypothesis.score);
            if fruitless == PATIENCE || best.is_some_and(|b| behind(&b) > HOPELESS) {
                break;
            }
            let start = Start::of_pair(rotation(hypothesis.pair as usize));
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
    pub(super) fn view<'a>(&'a self, dots: &'a [Dot], prior: Option<&'a Prior>) -> View<'a> {
        View {
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
        let start = Start::of_pair(*rotation.to_rotation_matrix().matrix());
        self.refine(&start, None, f64::NEG_INFINITY, ws);
    }

    /// Refines a rotation and stores the result; returns whether it is better than `least`.
    fn refine(
        &self,
        start: &Start,
        prior: Option<&Prior>,
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
        explains_pair
            && evidence - self.null.ln_evidence(ws.dots.len()) > DOUBT
            && best.refined.ln_evidence - ws.found.best_rival(best) > DOUBT
    }
}
