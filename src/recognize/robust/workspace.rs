//! The memory that a recognition works in, with the observed dots and their pairs.

use super::matching::Matching;
use super::model::PreparedDot;
use super::naming::Naming;
use super::pairs::PatternPairs;
use super::posterior::{FoundInView, NullHypothesis};
use super::refine::ExplanationRefiner;
use super::screen::Screen;
use crate::recognize::Explanations;

/// Pairs nearer to parallel or opposite than this sine leave the rotation too uncertain to start
/// from.
const MIN_SINE: f64 = 0.15;
/// Observed dots for which a new workspace has the capacity; more of them make it grow.
const CAPACITY: usize = 64;

/// Scratch memory of [`RobustRecognizer`](super::RobustRecognizer).
#[derive(Debug, Default)]
pub struct RobustWorkspace {
    pub(super) dots: Vec<PreparedDot>,
    pub(super) pairs: Vec<ObservedPair>,
    used: Vec<bool>,
    pub(super) screen: Screen,
    pub(super) refiner: ExplanationRefiner,
    pub(super) naming: Naming,
    pub(super) matching: Matching,
    pub(super) found: FoundInView,
    pub(super) mirrored: FoundInView,
    pub(super) explanations: Explanations,
    /// The null hypothesis of this view, where it is not the recognizer's.
    pub(super) null: Option<NullHypothesis>,
}

/// A pair of observed dots.
#[derive(Debug, Clone, Copy)]
pub(super) struct ObservedPair {
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
            refiner: ExplanationRefiner::with_capacity_for(CAPACITY, pattern),
            naming: Naming::with_capacity_for(CAPACITY),
            matching: Matching::with_capacity_for(CAPACITY, pattern),
            found: FoundInView::with_capacity_for(CAPACITY),
            mirrored: FoundInView::with_capacity_for(CAPACITY),
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
    pub(super) fn pair_up(&mut self) {
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
    pub(super) fn next_pair(&mut self) -> Option<([usize; 2], bool)> {
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
