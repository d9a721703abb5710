//! The nets' layers and how they are joined: the one description that inference, training and
//! export share ([`Graph`]).
//!
//! All are hourglasses with skips. Resolution falls to an eighth of the patch's, in the large net to a sixteenth,
//! where one value sees the whole ball and can distinguish a logo from dots. It comes back to a half, where a dot
//! is some three cells wide. A multiplication with its addition counts as two operations.

use crate::vision::dots::patch;

/// Cells along a side of the net's output.
pub const CELLS: usize = patch::SIZE / 2;
/// Values of a cell of the dots' net: see [`Channel`].
pub const CHANNELS: usize = 6;
/// Values of a cell of the outline's net: see [`OutlineChannel`].
pub const OUTLINE_CHANNELS: usize = 2;

/// What a net is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Head {
    /// Dots on a ball whose outline is known.
    #[default]
    Dots,
    /// The same, for the frames that [`Head::Dots`] leaves in doubt: finds more dots in six times the time.
    #[serde(rename = "dots-large")]
    DotsLarge,
    /// The outline of a ball whose place is known roughly.
    Outline,
}

impl Head {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Dots, Self::DotsLarge, Self::Outline];

    /// Values of a cell.
    pub const fn channels(self) -> usize {
        match self {
            Self::Dots | Self::DotsLarge => CHANNELS,
            Self::Outline => OUTLINE_CHANNELS,
        }
    }

    /// The net's layers.
    pub const fn graph(self) -> Graph {
        match self {
            Self::Dots => Graph {
                convolutions: &DOTS_CONVOLUTIONS,
                steps: &SMALL_STEPS,
            },
            Self::DotsLarge => Graph {
                convolutions: &LARGE_CONVOLUTIONS,
                steps: &LARGE_STEPS,
            },
            Self::Outline => Graph {
                convolutions: &OUTLINE_CONVOLUTIONS,
                steps: &SMALL_STEPS,
            },
        }
    }

    /// All convolutions, in order of use.
    pub const fn convolutions(self) -> &'static [Convolution] {
        self.graph().convolutions
    }

    /// The name in files and on the command line.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Dots => "dots",
            Self::DotsLarge => "dots-large",
            Self::Outline => "outline",
        }
    }
}

impl std::str::FromStr for Head {
    type Err = crate::error::Error;

    fn from_str(name: &str) -> crate::error::Result<Self> {
        crate::error::by_name(&Self::ALL, Self::as_str, "head", name)
    }
}

/// What the values of a cell of the outline's net say.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(usize)]
pub enum OutlineChannel {
    /// The cell's signed distance from the outline, outwards, in [`crate::vision::outline::net::UNIT`].
    Distance,
    /// ln of the inverse of its standard deviation, in the same unit.
    LnPrecision,
}

/// What a cell's values say.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(usize)]
pub enum Channel {
    /// Log odds of a dot at this cell, before calibration.
    Heat,
    /// The dot's column minus the cell's, in the patch's values.
    Column,
    /// The dot's row minus the cell's, in the patch's values.
    Row,
    /// ln `a` of the factor `L = [[a, 0], [b, c]]`; `|L e|^2` is the error's squared Mahalanobis
    /// length.
    LnA,
    /// `b` of that factor.
    B,
    /// ln `c` of that factor.
    LnC,
}

/// A convolution; its padding keeps the size (divided by the stride).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Convolution {
    /// Channels in.
    pub inputs: usize,
    /// Channels out.
    pub outputs: usize,
    /// Side of the kernel, odd.
    pub kernel: usize,
    /// Step between outputs.
    pub stride: usize,
}

impl Convolution {
    /// Number of weights, without the biases.
    pub const fn weights(&self) -> usize {
        self.outputs * self.inputs * self.kernel * self.kernel
    }
}

const fn convolution(inputs: usize, outputs: usize, kernel: usize, stride: usize) -> Convolution {
    Convolution {
        inputs,
        outputs,
        kernel,
        stride,
    }
}

/// The layers of a net.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Graph {
    /// In order of use.
    pub convolutions: &'static [Convolution],
    /// The last one's result is the net's output.
    pub steps: &'static [Step],
}

const fn small(channels: usize) -> [Convolution; 12] {
    [
        convolution(1, 16, 5, 2),
        convolution(16, 16, 3, 1),
        convolution(16, 24, 3, 2),
        convolution(24, 24, 3, 1),
        convolution(24, 24, 3, 1),
        convolution(24, 32, 3, 2),
        convolution(32, 32, 3, 1),
        convolution(32, 24, 1, 1),
        convolution(24, 24, 3, 1),
        convolution(24, 16, 1, 1),
        convolution(16, 16, 3, 1),
        convolution(16, channels, 1, 1),
    ]
}

const DOTS_CONVOLUTIONS: [Convolution; 12] = small(CHANNELS);
const OUTLINE_CONVOLUTIONS: [Convolution; 12] = small(OUTLINE_CHANNELS);

const LARGE_CONVOLUTIONS: [Convolution; 16] = [
    convolution(1, 32, 5, 2),
    convolution(32, 32, 3, 1),
    convolution(32, 64, 3, 2),
    convolution(64, 64, 3, 1),
    convolution(64, 64, 3, 1),
    convolution(64, 96, 3, 2),
    convolution(96, 96, 3, 1),
    convolution(96, 96, 3, 1),
    convolution(96, 96, 3, 2),
    convolution(96, 96, 3, 1),
    convolution(96, 96, 1, 1),
    convolution(96, 64, 1, 1),
    convolution(64, 64, 3, 1),
    convolution(64, 32, 1, 1),
    convolution(32, 32, 3, 1),
    convolution(32, CHANNELS, 1, 1),
];

/// One operation. Values are numbered: 0 is the patch, `k + 1` the result of step `k`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Step {
    /// A convolution of a value, with `max(0, x)` after it or not.
    Convolve {
        /// Index in [`Graph::convolutions`].
        convolution: usize,
        /// The value.
        of: usize,
        /// Whether negative results become 0.
        relu: bool,
    },
    /// Twice the size, each value repeated (nearest neighbor).
    Upsample {
        /// The value.
        of: usize,
    },
    /// The sum of two values.
    Add {
        /// The one.
        a: usize,
        /// The other.
        b: usize,
    },
}

const fn convolve(convolution: usize, of: usize) -> Step {
    Step::Convolve {
        convolution,
        of,
        relu: true,
    }
}

const fn linear(convolution: usize, of: usize) -> Step {
    Step::Convolve {
        convolution,
        of,
        relu: false,
    }
}

const SMALL_STEPS: [Step; 16] = [
    convolve(0, 0),
    convolve(1, 1), // 2: half size
    convolve(2, 2),
    convolve(3, 3),
    convolve(4, 4), // 5: a quarter
    convolve(5, 5),
    convolve(6, 6), // 7: an eighth
    linear(7, 7),
    Step::Upsample { of: 8 },
    Step::Add { a: 5, b: 9 },
    convolve(8, 10),
    linear(9, 11),
    Step::Upsample { of: 12 },
    Step::Add { a: 2, b: 13 },
    convolve(10, 14),
    linear(11, 15),
];

const LARGE_STEPS: [Step; 22] = [
    convolve(0, 0),
    convolve(1, 1), // 2: half size
    convolve(2, 2),
    convolve(3, 3),
    convolve(4, 4), // 5: a quarter
    convolve(5, 5),
    convolve(6, 6),
    convolve(7, 7), // 8: an eighth
    convolve(8, 8),
    convolve(9, 9), // 10: a sixteenth
    linear(10, 10),
    Step::Upsample { of: 11 },
    Step::Add { a: 8, b: 12 },
    linear(11, 13),
    Step::Upsample { of: 14 },
    Step::Add { a: 5, b: 15 },
    convolve(12, 16),
    linear(13, 17),
    Step::Upsample { of: 18 },
    Step::Add { a: 2, b: 19 },
    convolve(14, 20),
    linear(15, 21),
];

/// Channels and side of a square value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ValueShape {
    /// Channels.
    pub channels: usize,
    /// Rows, and columns.
    pub side: usize,
}

/// Values of a net, at most: the patch and every step's result.
const MAX_VALUES: usize = 24;

impl Graph {
    /// The shapes of all values for a patch of the given side; the first `steps.len() + 1` count.
    const fn all_shapes(&self, side: usize) -> [ValueShape; MAX_VALUES] {
        let mut shapes = [ValueShape { channels: 1, side }; MAX_VALUES];
        let mut k = 0;
        while k < self.steps.len() {
            shapes[k + 1] = self.result(k, &shapes);
            k += 1;
        }
        shapes
    }

    /// The shape of what step `k` gives.
    const fn result(&self, k: usize, shapes: &[ValueShape]) -> ValueShape {
        match self.steps[k] {
            Step::Convolve {
                convolution, of, ..
            } => ValueShape {
                channels: self.convolutions[convolution].outputs,
                side: shapes[of]
                    .side
                    .div_ceil(self.convolutions[convolution].stride),
            },
            Step::Upsample { of } => ValueShape {
                channels: shapes[of].channels,
                side: 2 * shapes[of].side,
            },
            Step::Add { a, .. } => shapes[a],
        }
    }

    /// The shape of value `i` for a patch of the given side: the patch is value 0, the result of step `k` value
    /// `k + 1`.
    pub const fn shape(&self, i: usize, side: usize) -> ValueShape {
        self.all_shapes(side)[i]
    }

    /// The shapes of all values for a patch of the given side.
    pub fn shapes(&self, side: usize) -> Vec<ValueShape> {
        self.all_shapes(side)[..=self.steps.len()].to_vec()
    }

    /// Floating-point operations of the convolutions for a square input of the given side.
    pub fn operations(&self, side: usize) -> usize {
        let shapes = self.shapes(side);
        std::iter::zip(self.steps, &shapes[1..])
            .map(|(step, out)| match step {
                Step::Convolve { convolution, .. } => {
                    2 * out.side * out.side * self.convolutions[*convolution].weights()
                }
                Step::Upsample { .. } | Step::Add { .. } => 0,
            })
            .sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_fit_together() {
        for head in Head::ALL {
            let graph = head.graph();
            let shapes = graph.shapes(patch::SIZE);
            for (k, step) in graph.steps.iter().enumerate() {
                match *step {
                    Step::Convolve {
                        convolution, of, ..
                    } => {
                        assert!(of <= k);
                        assert_eq!(shapes[of].channels, graph.convolutions[convolution].inputs);
                    }
                    Step::Upsample { of } => assert!(of <= k),
                    Step::Add { a, b } => {
                        assert!(a <= k && b <= k);
                        assert_eq!(shapes[a], shapes[b]);
                    }
                }
            }
            let cells = ValueShape {
                channels: head.channels(),
                side: CELLS,
            };
            assert_eq!(shapes.last(), Some(&cells));
        }
    }

    /// Multiplications counted by hand, layer by layer.
    #[test]
    fn a_patch_costs_what_its_layers_say() {
        let operations = |head: Head| head.graph().operations(64);
        assert_eq!(operations(Head::Dots), 2 * 11_272_192);
        assert!(Head::Dots.graph().operations(60) <= 25_000_000);
        // Four channels less, 16 inputs each, in 32 x 32 cells.
        let fewer = 4 * 16 * 1024;
        assert_eq!(operations(Head::Outline), 2 * (11_272_192 - fewer));
        let half = 1024 * (25 * 32 + 2 * 9 * 32 * 32 + 32 * 6);
        let quarter = 256 * (9 * 32 * 64 + 3 * 9 * 64 * 64 + 64 * 32);
        let eighth = 64 * (9 * 64 * 96 + 2 * 9 * 96 * 96 + 96 * 64);
        let sixteenth = 16 * (2 * 9 * 96 * 96 + 96 * 96);
        assert_eq!(
            operations(Head::DotsLarge),
            2 * (half + quarter + eighth + sixteenth)
        );
    }
}
