//! One convolution on the CPU.
//!
//! Values lie pixel by pixel with their channels together, framed by [`BORDER`] pixels of zeros. A
//! row of the kernel then meets one run of consecutive numbers of the input, and no edge needs a
//! case of its own. For a block of neighboring pixels and [`LANES`] or more output channels, the
//! sums stay in registers while the kernel passes over them: each number of the input is multiplied
//! with a vector of weights, one output channel a lane.
//!
//! The code is compiled for every SIMD level that `fearless_simd` knows and chosen at run time.
//! Sums are fused (FMA) where the processor can, so results differ between processors by rounding.

use fearless_simd::prelude::*;
use fearless_simd::{Simd, f32x8};

use super::graph::{Convolution, Graph, Head, Step, ValueShape};
use super::weights::ConvolutionNumbers;
use crate::vision::dots::patch;

/// Output channels in a vector.
const LANES: usize = 8;
/// Pixels of zeros about a value: the reach of the largest kernel.
const BORDER: usize = 2;
/// Pixels of a block where one vector holds all output channels, and where several do: every output's side is a
/// multiple.
const PIXELS: [usize; 2] = [8, 4];

/// What the kernels below take for granted, checked when the crate is compiled.
const _: () = {
    check(&Head::Dots.graph());
    check(&Head::DotsLarge.graph());
    check(&Head::Outline.graph());
};

const fn check(graph: &Graph) {
    let mut k = 0;
    while k < graph.steps.len() {
        if let Step::Convolve {
            convolution, of, ..
        } = graph.steps[k]
        {
            let c = graph.convolutions[convolution];
            assert!(c.kernel % 2 == 1 && c.kernel / 2 <= BORDER);
            assert!(depth(graph.shape(of, patch::SIZE).channels) == c.inputs);
            // The last pass ends with the pixel: it would write into the next one.
            assert!(depth(c.outputs).is_multiple_of(vectors(c.outputs) * LANES));
            let block = PIXELS[if vectors(c.outputs) == 1 { 0 } else { 1 }];
            assert!(graph.shape(k + 1, patch::SIZE).side.is_multiple_of(block));
        }
        k += 1;
    }
}

/// Vectors of output channels that one pass computes: four for several pixels would not fit into 16 registers.
const fn vectors(outputs: usize) -> usize {
    let all = outputs.div_ceil(LANES);
    if all <= 3 {
        all
    } else if all.is_multiple_of(3) {
        3
    } else {
        2
    }
}

/// Numbers stored for a pixel of that many channels.
const fn depth(channels: usize) -> usize {
    if channels == 1 {
        1
    } else {
        channels.next_multiple_of(LANES)
    }
}

/// A value: pixel by pixel, channels together, with its border.
#[derive(Debug, Clone)]
pub(crate) struct FeatureMap {
    side: usize,
    depth: usize,
    numbers: Vec<f32>,
}

impl FeatureMap {
    /// Zeros of that shape.
    pub fn new(shape: ValueShape) -> Self {
        let (side, depth) = (shape.side, depth(shape.channels));
        let width = side + 2 * BORDER;
        Self {
            side,
            depth,
            numbers: vec![0.0; width * width * depth],
        }
    }

    /// Numbers from one row to the next.
    fn row_stride(&self) -> usize {
        (self.side + 2 * BORDER) * self.depth
    }

    /// Where a pixel's channels begin.
    fn index(&self, row: usize, column: usize) -> usize {
        (row + BORDER) * self.row_stride() + (column + BORDER) * self.depth
    }

    /// Fills the one channel of a map, row after row.
    pub fn set_gray(&mut self, values: &[f32]) {
        debug_assert_eq!(self.depth, 1);
        for (row, values) in values.chunks_exact(self.side).enumerate() {
            let at = self.index(row, 0);
            self.numbers[at..at + self.side].copy_from_slice(values);
        }
    }

    /// The first channels, one after the other, each row after row, without border.
    pub fn write_planes(&self, planes: &mut [f32]) {
        let area = self.side * self.side;
        for (channel, plane) in planes.chunks_exact_mut(area).enumerate() {
            for (row, out) in plane.chunks_exact_mut(self.side).enumerate() {
                let pixels = self.numbers[self.index(row, 0)..].chunks_exact(self.depth);
                for (out, pixel) in out.iter_mut().zip(pixels) {
                    *out = pixel[channel];
                }
            }
        }
    }

    /// Twice the size of `of`, each pixel repeated.
    pub fn upsample(&mut self, of: &Self) {
        for row in 0..self.side {
            for column in 0..self.side {
                let (to, from) = (self.index(row, column), of.index(row / 2, column / 2));
                self.numbers[to..to + self.depth]
                    .copy_from_slice(&of.numbers[from..from + of.depth]);
            }
        }
    }

    /// The sum of two maps.
    pub fn add(&mut self, a: &Self, b: &Self) {
        for ((sum, a), b) in self.numbers.iter_mut().zip(&a.numbers).zip(&b.numbers) {
            *sum = a + b;
        }
    }
}

/// A convolution with its weights in the order in which they are used.
#[derive(Debug, Clone)]
pub(crate) struct PackedConvolution {
    shape: Convolution,
    /// Vectors of output channels that one pass computes.
    vectors: usize,
    /// Passes; kernel rows; kernel columns and inputs; output channels of the pass.
    weights: Vec<f32>,
    /// One number an output channel, padded with zeros to whole passes.
    bias: Vec<f32>,
}

impl PackedConvolution {
    /// Packs a layer that has as many numbers as the convolution asks for.
    pub fn new(shape: Convolution, layer: &ConvolutionNumbers) -> Self {
        let Convolution {
            inputs,
            outputs,
            kernel,
            ..
        } = shape;
        let vectors = vectors(outputs);
        let width = vectors * LANES;
        let mut weights = vec![0.0; depth(outputs) * inputs * kernel * kernel];
        let mut bias = vec![0.0; depth(outputs)];
        bias[..outputs].copy_from_slice(&layer.bias);
        let taps = kernel * kernel;
        for (output, of_output) in layer.weight.chunks_exact(inputs * taps).enumerate() {
            let (pass, lane) = (output / width, output % width);
            for (input, of_input) in of_output.chunks_exact(taps).enumerate() {
                for (tap, &weight) in of_input.iter().enumerate() {
                    weights[((pass * taps + tap) * inputs + input) * width + lane] = weight;
                }
            }
        }
        Self {
            shape,
            vectors,
            weights,
            bias,
        }
    }

    /// Computes `out` from `input`, with `max(0, x)` at the end where asked for.
    #[inline(always)]
    pub fn run<S: Simd>(&self, simd: S, relu: bool, input: &FeatureMap, out: &mut FeatureMap) {
        // As many sums as 16 registers hold beside the weights, and enough to hide an addition's
        // latency.
        simd.vectorize(
            #[inline(always)]
            || match self.vectors {
                1 => self.run_blocks::<S, 1, { PIXELS[0] }>(simd, relu, input, out),
                2 => self.run_blocks::<S, 2, { PIXELS[1] }>(simd, relu, input, out),
                _ => self.run_blocks::<S, 3, { PIXELS[1] }>(simd, relu, input, out),
            },
        );
    }

    /// Blocks of `P` pixels in a row and `V` vectors of output channels.
    #[inline(always)]
    fn run_blocks<S: Simd, const V: usize, const P: usize>(
        &self,
        simd: S,
        relu: bool,
        input: &FeatureMap,
        out: &mut FeatureMap,
    ) {
        let Convolution { kernel, stride, .. } = self.shape;
        let run = kernel * input.depth;
        let reach = kernel / 2;
        let (row_stride, step) = (input.row_stride(), stride * input.depth);
        let floor = f32x8::splat(simd, if relu { 0.0 } else { f32::NEG_INFINITY });
        let passes = self.weights.chunks_exact(kernel * run * V * LANES);
        for (pass, (weights, bias)) in passes.zip(self.bias.chunks_exact(V * LANES)).enumerate() {
            let bias: [f32x8<S>; V] =
                std::array::from_fn(|v| f32x8::from_slice(simd, &bias[v * LANES..][..LANES]));
            for row in 0..out.side {
                for column in (0..out.side).step_by(P) {
                    let mut sums = [bias; P];
                    let corner = input.index(row * stride, column * stride)
                        - reach * (row_stride + input.depth);
                    for (k, weights) in weights.chunks_exact(run * V * LANES).enumerate() {
                        let start = corner + k * row_stride;
                        let runs: [&[f32]; P] =
                            std::array::from_fn(|p| &input.numbers[start + p * step..][..run]);
                        for (i, weights) in weights.chunks_exact(V * LANES).enumerate() {
                            let weights: [f32x8<S>; V] = std::array::from_fn(|v| {
                                f32x8::from_slice(simd, &weights[v * LANES..][..LANES])
                            });
                            for p in 0..P {
                                let number = f32x8::splat(simd, runs[p][i]);
                                for v in 0..V {
                                    sums[p][v] = number.mul_add(weights[v], sums[p][v]);
                                }
                            }
                        }
                    }
                    let start = out.index(row, column) + pass * V * LANES;
                    for (p, sums) in sums.iter().enumerate() {
                        for (v, sum) in sums.iter().enumerate() {
                            let to = start + p * out.depth + v * LANES;
                            sum.max(floor).store_slice(&mut out.numbers[to..to + LANES]);
                        }
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use fearless_simd::{Level, dispatch};
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    fn numbers(count: usize, rng: &mut ChaCha8Rng) -> Vec<f32> {
        (0..count).map(|_| rng.random_range(-1.0..1.0)).collect()
    }

    /// The definition, in double precision.
    fn slow(
        c: Convolution,
        layer: &ConvolutionNumbers,
        input: &[f32],
        side: usize,
        relu: bool,
    ) -> Vec<f64> {
        let to = side / c.stride;
        let pad = (c.kernel / 2) as isize;
        let mut out = Vec::new();
        for o in 0..c.outputs {
            for row in 0..to {
                for column in 0..to {
                    let mut sum = f64::from(layer.bias[o]);
                    for i in 0..c.inputs {
                        for y in 0..c.kernel {
                            for x in 0..c.kernel {
                                let v = (row * c.stride + y) as isize - pad;
                                let u = (column * c.stride + x) as isize - pad;
                                let inside = 0..side as isize;
                                if inside.contains(&u) && inside.contains(&v) {
                                    let at = (i * side + v as usize) * side + u as usize;
                                    let w = ((o * c.inputs + i) * c.kernel + y) * c.kernel + x;
                                    sum += f64::from(input[at]) * f64::from(layer.weight[w]);
                                }
                            }
                        }
                    }
                    out.push(if relu { sum.max(0.0) } else { sum });
                }
            }
        }
        out
    }

    #[test]
    fn every_convolution_follows_its_definition_on_every_level() {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let mut levels = vec![Level::new(), Level::baseline()];
        #[cfg(target_arch = "x86_64")]
        levels.extend(Level::new().as_avx2().map(|simd| simd.level()));
        let all = Head::ALL.map(Head::convolutions).concat();
        for (k, c) in all.into_iter().enumerate() {
            let (side, relu) = (16, k % 2 == 0);
            let layer = ConvolutionNumbers {
                weight: numbers(c.weights(), &mut rng),
                bias: numbers(c.outputs, &mut rng),
            };
            let planes = numbers(c.inputs * side * side, &mut rng);
            let channels = c.inputs;
            let mut input = FeatureMap::new(ValueShape { channels, side });
            for (i, plane) in planes.chunks_exact(side * side).enumerate() {
                for (at, &value) in plane.iter().enumerate() {
                    let index = input.index(at / side, at % side);
                    input.numbers[index + i] = value;
                }
            }
            let expected = slow(c, &layer, &planes, side, relu);
            let packed = PackedConvolution::new(c, &layer);
            for &level in &levels {
                let mut out = FeatureMap::new(ValueShape {
                    channels: c.outputs,
                    side: side / c.stride,
                });
                dispatch!(level, simd => packed.run(simd, relu, &input, &mut out));
                let mut found = vec![0.0; expected.len()];
                out.write_planes(&mut found);
                for (found, expected) in found.iter().zip(&expected) {
                    let off = (f64::from(*found) - expected).abs();
                    // Single precision: the error of a sum grows with its length.
                    let limit = 1e-7 * (c.inputs * c.kernel * c.kernel) as f64;
                    assert!(off < limit.max(2e-5), "{k} {level:?}: {found} {expected}");
                }
            }
        }
    }
}
