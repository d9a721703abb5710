//! The net on the CPU: one patch at a time, on the calling thread, without allocating.
//!
//! [`Network`] holds the weights and is shared; [`Activations`] holds all intermediate values, one
//! set a thread. Nothing can fail once both exist.

use fearless_simd::{Level, Simd, dispatch};

use super::convolution::{FeatureMap, PackedConvolution};
use super::graph::{CELLS, Head, Step};
use super::weights::ConvolutionNumbers;
use crate::error::{Error, Result};
use crate::vision::dots::patch::{Patch, SIZE};

/// The net's weights, ready to run.
#[derive(Debug, Clone)]
pub struct Network {
    level: Level,
    head: Head,
    convolutions: Vec<PackedConvolution>,
}

/// All intermediate values of a net and its cells.
#[derive(Debug, Clone)]
pub struct Activations {
    head: Head,
    values: Vec<FeatureMap>,
    cells: Vec<f32>,
}

impl Activations {
    /// Those of a net for this.
    pub fn new(head: Head) -> Self {
        let shapes = head.graph().shapes(SIZE);
        Self {
            head,
            values: shapes.into_iter().map(FeatureMap::new).collect(),
            cells: vec![0.0; head.channels() * CELLS * CELLS],
        }
    }
}

impl Network {
    /// A net of the given numbers, in the order of [`Head::convolutions`]. The fastest instructions
    /// that this processor has are chosen here.
    ///
    /// # Errors
    /// [`Error::Argument`] where the numbers do not fit the graph.
    pub fn new(head: Head, layers: &[ConvolutionNumbers]) -> Result<Self> {
        let shapes = head.convolutions();
        let fits = layers.len() == shapes.len()
            && std::iter::zip(layers, shapes).all(|(layer, c)| {
                layer.weight.len() == c.weights() && layer.bias.len() == c.outputs
            });
        if !fits {
            return Err(Error::argument("weights", "expected those of this net"));
        }
        let convolutions = std::iter::zip(shapes, layers)
            .map(|(c, layer)| PackedConvolution::new(*c, layer))
            .collect();
        Ok(Self {
            level: Level::new(),
            head,
            convolutions,
        })
    }

    /// What the net is for.
    pub fn head(&self) -> Head {
        self.head
    }

    /// The cells of a patch: channels x [`CELLS`] x [`CELLS`]. `activations` of a net for something else
    /// are made anew.
    pub fn forward<'a>(&self, patch: &Patch, activations: &'a mut Activations) -> &'a [f32] {
        if activations.head != self.head {
            *activations = Activations::new(self.head);
        }
        let Activations { values, cells, .. } = activations;
        values[0].set_gray(patch.values());
        dispatch!(self.level, simd => self.run(simd, values));
        values[self.head.graph().steps.len()].write_planes(cells);
        cells
    }

    #[inline(always)]
    fn run<S: Simd>(&self, simd: S, values: &mut [FeatureMap]) {
        for (k, step) in self.head.graph().steps.iter().enumerate() {
            let (before, after) = values.split_at_mut(k + 1);
            let out = &mut after[0];
            match *step {
                Step::Convolve {
                    convolution,
                    of,
                    relu,
                } => self.convolutions[convolution].run(simd, relu, &before[of], out),
                Step::Upsample { of } => out.upsample(&before[of]),
                Step::Add { a, b } => out.add(&before[a], &before[b]),
            }
        }
    }
}
