//! The explanations of a view: the best one, and its rivals.

use super::Identification;

/// Maximum number of rivals: as many rotations as the icosahedron has.
pub(super) const MAX_RIVALS: usize = 59;
/// Minimum probability of a rival's pose: less is of no use.
pub(super) const MIN_RIVAL: f64 = 0.001;

/// The explanations of a view, each with its own probability. They differ in their rotation.
#[derive(Debug, Default)]
pub struct Explanations {
    best: Identification,
    /// The first `rivals` of these are the view's: their memory is reused.
    others: Vec<Identification>,
    rivals: usize,
}

impl Clone for Explanations {
    fn clone(&self) -> Self {
        Self {
            best: self.best.clone(),
            others: self.rivals().to_vec(),
            rivals: self.rivals,
        }
    }
}

impl PartialEq for Explanations {
    fn eq(&self, other: &Self) -> bool {
        self.best == other.best && self.rivals() == other.rivals()
    }
}

impl Explanations {
    /// The most probable explanation.
    pub fn best(&self) -> &Identification {
        &self.best
    }

    /// Other explanations, the most probable first: those with a probability of the pose from 0.001
    /// on, 59 at most (a pattern with the symmetry of the icosahedron has as many).
    pub fn rivals(&self) -> &[Identification] {
        &self.others[..self.rivals]
    }

    /// Memory for views of so many dots.
    pub(super) fn with_capacity_for(dots: usize) -> Self {
        let empty = || Identification {
            assignment: Vec::with_capacity(dots),
            ..Identification::default()
        };
        Self {
            best: empty(),
            others: (0..MAX_RIVALS).map(|_| empty()).collect(),
            rivals: 0,
        }
    }

    /// Begins a view; its best explanation is to be written here.
    pub(super) fn begin(&mut self) -> &mut Identification {
        self.rivals = 0;
        &mut self.best
    }

    /// Where the next rival is to be written.
    pub(super) fn next_rival(&mut self) -> &mut Identification {
        if self.rivals == self.others.len() {
            self.others.push(Identification::default());
        }
        self.rivals += 1;
        &mut self.others[self.rivals - 1]
    }
}
