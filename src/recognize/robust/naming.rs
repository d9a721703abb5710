//! Changes of an assignment: what [`marginal`](super::marginal) tries.

use super::refine::UNASSIGNED;

/// Scratch memory of the naming.
#[derive(Debug, Default)]
pub(super) struct Naming {
    /// The best assignment so far, the one that is tried, and the best of those tried.
    pub chosen: Vec<u16>,
    pub tried: Vec<u16>,
    pub better: Vec<u16>,
    /// Possible matches: observed dot and pattern dot.
    pub links: Vec<[u16; 2]>,
    /// For each dot the sum over its changes.
    pub alternatives: Vec<f64>,
}

impl Naming {
    pub fn with_capacity_for(dots: usize) -> Self {
        Self {
            chosen: Vec::with_capacity(dots),
            tried: Vec::with_capacity(dots),
            better: Vec::with_capacity(dots),
            links: Vec::with_capacity(4 * dots),
            alternatives: Vec::with_capacity(dots),
        }
    }

    /// Gives `dot` the pattern dot `to`, whose holder gets what `dot` leaves if that is one of its
    /// links, or else nothing. Returns the holder where the two exchange their pattern dots.
    pub fn change(&mut self, dot: usize, to: u16) -> Option<usize> {
        self.tried.clone_from(&self.chosen);
        let left = std::mem::replace(&mut self.tried[dot], to);
        let holder = self.chosen.iter().position(|&j| j == to && j != UNASSIGNED);
        let holder = holder?;
        let fits = left != UNASSIGNED && self.links.contains(&[holder as u16, left]);
        self.tried[holder] = if fits { left } else { UNASSIGNED };
        fits.then_some(holder)
    }
}
