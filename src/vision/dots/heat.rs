//! How likely each place of a ball shows a dot.

use crate::vision::net::graph::CELLS;

/// How likely each cell of a patch shows a dot: [`CELLS`] x [`CELLS`], rows from the top.
#[derive(Debug, Clone, PartialEq)]
pub struct Heat {
    values: [f32; CELLS * CELLS],
}

impl Default for Heat {
    /// No dot anywhere.
    fn default() -> Self {
        Self {
            values: [0.0; CELLS * CELLS],
        }
    }
}

impl Heat {
    /// The probabilities, row after row.
    pub(crate) fn values(&self) -> &[f32; CELLS * CELLS] {
        &self.values
    }

    /// Takes the probabilities, row after row.
    pub fn fill(&mut self, probabilities: impl Iterator<Item = f32>) {
        for (value, probability) in self.values.iter_mut().zip(probabilities) {
            *value = probability;
        }
    }
}
