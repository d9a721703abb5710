//! The nets' layers and how they are joined: the one description that inference, training and
//! export share. The net of the dots and that of the outline differ in their last convolution only
//! ([`Head`]).
//!
//! An hourglass with two skips. Resolution falls to an eighth of the patch's, where one value sees
//! the whole ball and can distinguish a logo from dots. It comes back to a half, where a dot is
//! some three cells wide. A multiplication with its addition counts as two operations.

use crate::vision::patch;

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
    /// The outline of a ball whose place is known roughly.
    Outline,
}

impl Head {
    /// Values of a cell.
    pub const fn channels(self) -> usize {
        match self {
            Self::Dots => CHANNELS,
            Self::Outline => OUTLINE_CHANNELS,
        }
    }

    /// All convolutions, in order of use.
    pub const fn convolutions(self) -> [Convolution; CONVOLUTIONS.len()] {
        let mut all = CONVOLUTIONS;
        all[CONVOLUTIONS.len() - 1].outputs = self.channels();
        all
    }

    /// The name in files and on the command line.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Dots => "dots",
            Self::Outline => "outline",
        }
    }
}

impl std::str::FromStr for Head {
    type Err = crate::error::Error;

    fn from_str(name: &str) -> crate::error::Result<Self> {
        crate::error::by_name(&[Self::Dots, Self::Outline], Self::as_str, "head", name)
    }
}

/// What the values of a cell of the outline's net say.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(usize)]
pub enum OutlineChannel {
    /// The cell's signed distance from the outline, outwards, in [`super::outline::UNIT`].
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

/// All convolutions of the dots' net, in order of use.
pub const CONVOLUTIONS: [Convolution; 12] = [
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
    convolution(16, CHANNELS, 1, 1),
];

/// One operation. Values are numbered: 0 is the patch, `k + 1` the result of step `k`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Step {
    /// A convolution of a value, with `max(0, x)` after it or not.
    Convolve {
        /// Index in [`CONVOLUTIONS`].
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

/// All steps; the last one's result is the net's output.
pub const STEPS: [Step; 16] = [
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

/// Number of values: the patch and every step's result.
pub const VALUES: usize = STEPS.len() + 1;

/// Channels and side of a square value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shape {
    /// Channels.
    pub channels: usize,
    /// Rows, and columns.
    pub side: usize,
}

/// The shapes of all values for a patch of the given side.
pub const fn shapes(side: usize) -> [Shape; VALUES] {
    let mut shapes = [Shape { channels: 1, side }; VALUES];
    let mut k = 0;
    while k < STEPS.len() {
        shapes[k + 1] = match STEPS[k] {
            Step::Convolve {
                convolution, of, ..
            } => Shape {
                channels: CONVOLUTIONS[convolution].outputs,
                side: shapes[of].side.div_ceil(CONVOLUTIONS[convolution].stride),
            },
            Step::Upsample { of } => Shape {
                channels: shapes[of].channels,
                side: 2 * shapes[of].side,
            },
            Step::Add { a, .. } => shapes[a],
        };
        k += 1;
    }
    shapes
}

/// Floating-point operations of the convolutions for a square input of the given side.
pub fn operations(side: usize) -> usize {
    let shapes = shapes(side);
    std::iter::zip(STEPS, &shapes[1..])
        .map(|(step, out)| match step {
            Step::Convolve { convolution, .. } => {
                2 * out.side * out.side * CONVOLUTIONS[convolution].weights()
            }
            Step::Upsample { .. } | Step::Add { .. } => 0,
        })
        .sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_fit_together() {
        let shapes = shapes(patch::SIZE);
        for (k, step) in STEPS.into_iter().enumerate() {
            match step {
                Step::Convolve {
                    convolution, of, ..
                } => {
                    assert!(of <= k);
                    assert_eq!(shapes[of].channels, CONVOLUTIONS[convolution].inputs);
                }
                Step::Upsample { of } => assert!(of <= k),
                Step::Add { a, b } => {
                    assert!(a <= k && b <= k);
                    assert_eq!(shapes[a], shapes[b]);
                }
            }
        }
        let cells = Shape {
            channels: CHANNELS,
            side: CELLS,
        };
        assert_eq!(shapes.last(), Some(&cells));
    }

    #[test]
    fn a_crop_of_60_pixels_costs_at_most_25_million_operations() {
        // 11.27 million multiplications at 64, counted by hand layer by layer.
        assert_eq!(operations(64), 2 * 11_272_192);
        assert!(operations(60) <= 25_000_000);
    }
}
