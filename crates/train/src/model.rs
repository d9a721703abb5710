//! The net in burn, with gradients.
//!
//! burn's flex backend runs in this process on the CPU. The layers and their connections are those
//! of [`spindoe::vision::net::graph`]. `spindoe` runs the same net without burn, and a test
//! compares the outputs of both.

use burn::module::{Module, Param, ParamId};
use burn::nn::PaddingConfig2d;
use burn::nn::conv::{Conv2d, Conv2dConfig};
use burn::tensor::activation::relu;
use burn::tensor::module::interpolate;
use burn::tensor::ops::{InterpolateMode, InterpolateOptions};
use burn::tensor::{Device, Tensor, TensorData};
use rand::Rng;
use rand_distr::{Distribution, Normal};

use spindoe::vision::net::graph::{Channel, Head, Step};
use spindoe::vision::net::weights::Layer;
use spindoe::{Error, Result};

/// Log odds with which an untrained net expects a dot in a cell.
const FIRST_HEAT: f32 = -4.0;

/// The net.
#[derive(Module, Debug)]
pub struct Net {
    #[module(skip)]
    head: Head,
    convolutions: Vec<Conv2d>,
}

impl Net {
    /// A net with the given parameters.
    ///
    /// # Errors
    /// [`Error::Argument`] where they do not fit the graph.
    pub fn new(head: Head, layers: &[Layer], device: &Device) -> Result<Self> {
        let shapes = head.convolutions();
        let fits = layers.len() == shapes.len()
            && std::iter::zip(layers, shapes).all(|(layer, c)| {
                layer.weight.len() == c.weights() && layer.bias.len() == c.outputs
            });
        if !fits {
            return Err(Error::argument("weights", "expected those of this net"));
        }
        // Random identifiers, as by default, would make every checkpoint another file.
        let mut ids = (1..).map(ParamId::from);
        let convolutions = std::iter::zip(layers, shapes)
            .map(|(layer, c)| {
                let pad = c.kernel / 2;
                let mut built = Conv2dConfig::new([c.inputs, c.outputs], [c.kernel, c.kernel])
                    .with_stride([c.stride, c.stride])
                    .with_padding(PaddingConfig2d::Explicit(pad, pad, pad, pad))
                    .init(device);
                let shape = [c.outputs, c.inputs, c.kernel, c.kernel];
                let weight = TensorData::new(layer.weight.clone(), shape);
                let bias = TensorData::new(layer.bias.clone(), [c.outputs]);
                built.weight = Param::from_data(weight, device);
                let mut bias = Param::from_data(bias, device);
                std::iter::zip([&mut built.weight.id, &mut bias.id], &mut ids)
                    .for_each(|(id, number)| *id = number);
                built.bias = Some(bias);
                built
            })
            .collect();
        Ok(Self { head, convolutions })
    }

    /// Random initial parameters of a net (K. He et al., "Delving deep into rectifiers", ICCV
    /// 2015).
    ///
    /// # Errors
    /// None in fact: the deviations are positive.
    pub fn random_layers<R: Rng + ?Sized>(head: Head, rng: &mut R) -> Result<Vec<Layer>> {
        let shapes = head.convolutions();
        let last = shapes.len() - 1;
        let mut layers = Vec::new();
        for (i, c) in shapes.iter().enumerate() {
            let fan = (c.inputs * c.kernel * c.kernel) as f32;
            let gain = if i == last { 0.1 } else { 1.0 };
            let normal = Normal::new(0.0, gain * (2.0 / fan).sqrt())
                .map_err(|e| Error::Internal(e.to_string()))?;
            let weight = (0..c.weights()).map(|_| normal.sample(rng)).collect();
            let mut bias = vec![0.0; c.outputs];
            if i == last && head != Head::Outline {
                bias[Channel::Heat as usize] = FIRST_HEAT;
            }
            layers.push(Layer { weight, bias });
        }
        Ok(layers)
    }

    /// The current parameters.
    ///
    /// # Errors
    /// [`Error::Internal`] where burn holds others than 32-bit floats.
    pub fn layers(&self) -> Result<Vec<Layer>> {
        self.convolutions
            .iter()
            .map(|c| {
                let bias = match &c.bias {
                    Some(bias) => floats(bias.val())?,
                    None => Vec::new(),
                };
                let weight = floats(c.weight.val())?;
                Ok(Layer { weight, bias })
            })
            .collect()
    }

    /// Patches (n, 1, side, side) to cells (n, channels of the head, side / 2, side / 2).
    pub fn forward(&self, patches: Tensor<4>) -> Tensor<4> {
        let mut values = vec![patches];
        let steps = self.head.graph().steps;
        for step in steps {
            let next = match *step {
                Step::Convolve {
                    convolution,
                    of,
                    relu: rectified,
                } => {
                    let out = self.convolutions[convolution].forward(values[of].clone());
                    if rectified { relu(out) } else { out }
                }
                Step::Upsample { of } => {
                    let double = InterpolateOptions::new(InterpolateMode::Nearest)
                        .with_scale_factor([2.0, 2.0]);
                    interpolate(values[of].clone(), double)
                }
                Step::Add { a, b } => values[a].clone() + values[b].clone(),
            };
            values.push(next);
        }
        values.swap_remove(steps.len())
    }
}

/// A tensor's values, in order.
///
/// # Errors
/// [`Error::Internal`] where they are no 32-bit floats.
pub fn floats<const D: usize>(tensor: Tensor<D>) -> Result<Vec<f32>> {
    tensor
        .into_data()
        .try_into_vec::<f32>()
        .map_err(|e| Error::Internal(format!("a tensor's values: {e:?}")))
}
