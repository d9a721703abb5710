//! The data of a search: patterns with their values, the search's stages, and its milestones.

use serde::{Deserialize, Serialize};

use crate::error::Result;
use crate::geometry::Vec3;
use crate::pattern::Pattern;
use crate::stats::Proportion;

/// A pattern in the search.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Candidate {
    /// The start it came from, counted over all rounds.
    pub start: usize,
    /// The objective's value at the start.
    pub value_before: f64,
    /// The objective's value now.
    pub value: f64,
    /// The cost now: objective and bound.
    pub cost: f64,
    /// The constraint that it violates, if any; such a candidate is never chosen.
    pub missed: Option<String>,
    /// Whether its orientation bound misses the goal; such a candidate ranks behind all others.
    pub short_of_goal: bool,
    /// Identity rate over all trials so far, if it was tried.
    pub identity: Option<Proportion>,
    /// The dots.
    pub dots: Vec<[f64; 3]>,
}

impl Candidate {
    /// The pattern.
    ///
    /// # Errors
    /// [`crate::Error::Argument`] where the dots are none (only in a tampered checkpoint).
    pub fn pattern(&self) -> Result<Pattern> {
        Pattern::new(self.dots.iter().map(|d| Vec3::from(*d)).collect())
    }

    fn rate(&self) -> f64 {
        self.identity.map_or(-1.0, |p| p.rate)
    }
}

/// The current stage of a search.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Stage {
    /// A few steps from every start of the round.
    Scout,
    /// The best quarter, until convergence.
    Climb,
    /// Monte Carlo trials of the round's best.
    Try,
    /// The best of all rounds, with more and more trials.
    Halve,
}

/// The best pattern at a point in time.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Milestone {
    /// Seconds since the search began, over all its runs.
    pub elapsed_s: f64,
    /// Rounds of the search completed.
    pub rounds: usize,
    /// The identity rate of the best candidate, always on the same trials, which select nothing.
    pub identity: Proportion,
}

/// Candidates that reach the goal first, then the best rate; ties by cost, then by start.
pub(super) fn sort_by_rate(candidates: &mut [Candidate]) {
    candidates.sort_by(|a, b| {
        a.short_of_goal
            .cmp(&b.short_of_goal)
            .then(b.rate().total_cmp(&a.rate()))
            .then(a.cost.total_cmp(&b.cost))
            .then(a.start.cmp(&b.start))
    });
}
