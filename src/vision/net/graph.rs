//! The net's layers and how they are joined: the one description that running, training and export share.
//!
//! An hourglass with two skips. Resolution falls to an eighth of the patch's, where one value sees the whole ball and can
//! tell a logo from dots, and comes back to a half, where a dot is some three cells wide. A
//! multiplication with its addition counts as two operations.

use crate::vision::patch;

/// Cells along a side of the net's output.
pub const CELLS: usize = patch::SIZE / 2;
/// Values of a cell: see [`Channel`].
pub const CHANNELS: usize = 6;

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
    /// ln `a` of the factor `L = [[a, 0], [b, c]]`, with which `|L e|^2` is the error's squared Mahalanobis length.
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

const fn convolution(inputs: usize, outputs: usize, kernel: usize, stride: usize) -> Convolution {
    Convolution {
        inputs,
        outputs,
        kernel,
        stride,
    }
}

/// All convolutions, in order of use.
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
        rectify: bool,
    },
    /// Twice the size, each value repeated.
    Enlarge {
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
        rectify: true,
    }
}

const fn linear(convolution: usize, of: usize) -> Step {
    Step::Convolve {
        convolution,
        of,
        rectify: false,
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
    Step::Enlarge { of: 8 },
    Step::Add { a: 5, b: 9 },
    convolve(8, 10),
    linear(9, 11),
    Step::Enlarge { of: 12 },
    Step::Add { a: 2, b: 13 },
    convolve(10, 14),
    linear(11, 15),
];

/// Floating-point operations of the convolutions for a square input of the given side.
pub fn operations(side: usize) -> usize {
    let mut sides = vec![side];
    let mut total = 0;
    for step in STEPS {
        let next = match step {
            Step::Convolve {
                convolution, of, ..
            } => {
                let c = CONVOLUTIONS[convolution];
                let next = sides[of].div_ceil(c.stride);
                total += 2 * next * next * c.kernel * c.kernel * c.inputs * c.outputs;
                next
            }
            Step::Enlarge { of } => 2 * sides[of],
            Step::Add { a, .. } => sides[a],
        };
        sides.push(next);
    }
    total
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_fit_together() {
        let mut shapes = vec![(1, patch::SIZE)];
        for step in STEPS {
            let shape = match step {
                Step::Convolve {
                    convolution, of, ..
                } => {
                    let c = CONVOLUTIONS[convolution];
                    assert_eq!(shapes[of].0, c.inputs);
                    (c.outputs, shapes[of].1 / c.stride)
                }
                Step::Enlarge { of } => (shapes[of].0, 2 * shapes[of].1),
                Step::Add { a, b } => {
                    assert_eq!(shapes[a], shapes[b]);
                    shapes[a]
                }
            };
            shapes.push(shape);
        }
        assert_eq!(shapes.last(), Some(&(CHANNELS, CELLS)));
    }

    #[test]
    fn a_crop_of_60_pixels_costs_at_most_25_million_operations() {
        // 11.28 million multiplications at 64, counted by hand layer by layer.
        assert_eq!(operations(64), 2 * 11_272_192);
        assert!(operations(60) <= 25_000_000);
    }
}
