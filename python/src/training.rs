//! Samples, calibration, score and weights of the nets, for the training in `python/train`.

use numpy::ndarray::{Array2, Array3, Array4};
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArray3, PyArray4, PyReadonlyArray1};
use pyo3::prelude::*;
use spindoe::synth::training::{self, FrameSet, HeldOutSamples};
use spindoe::vision::dots::patch::SIZE;
use spindoe::vision::net::graph::{CELLS, Head, Step};
use spindoe::vision::net::weights::{ConvolutionNumbers, OutputCalibration, Weights, WeightsMeta};

use crate::errors::{OrRaise, value_error};
use crate::pattern::to_json;
use crate::work::{abandonable, interruptible};

/// A convolution's numbers, flat: kernels (outputs, inputs, rows, columns) and biases.
type FlatLayer<'py> = (PyReadonlyArray1<'py, f32>, PyReadonlyArray1<'py, f32>);

/// Patches and targets.
type NewSamples<'py> = (Bound<'py, PyArray4<f32>>, Bound<'py, PyArray4<f32>>);

/// A convolution's kernels and biases as new arrays.
type NewLayer<'py> = (Bound<'py, PyArray1<f32>>, Bound<'py, PyArray1<f32>>);

fn head(name: &str) -> PyResult<Head> {
    name.parse().or_raise()
}

fn layers(flat: &[FlatLayer<'_>]) -> Vec<ConvolutionNumbers> {
    flat.iter()
        .map(|(weight, bias)| ConvolutionNumbers {
            weight: weight.as_array().to_vec(),
            bias: bias.as_array().to_vec(),
        })
        .collect()
}

fn from_json<T: serde::de::DeserializeOwned>(name: &str, text: &str) -> PyResult<T> {
    serde_json::from_str(text).map_err(|e| value_error(name, e))
}

/// A net's layers and how they are joined, as JSON: `convolutions` are inputs, outputs, kernel and stride;
/// `steps` are `["convolve", convolution, of, relu]`, `["upsample", of]` and `["add", a, b]`, where value 0 is
/// the patch and each step makes the next.
#[pyfunction]
pub fn net_graph(net: &str) -> PyResult<String> {
    let graph = head(net)?.graph();
    let convolutions = graph.convolutions.iter();
    let convolutions = convolutions.map(|c| [c.inputs, c.outputs, c.kernel, c.stride]);
    let steps = graph.steps.iter().map(|step| match *step {
        Step::Convolve {
            convolution,
            of,
            relu,
        } => serde_json::json!(["convolve", convolution, of, relu]),
        Step::Upsample { of } => serde_json::json!(["upsample", of]),
        Step::Add { a, b } => serde_json::json!(["add", a, b]),
    });
    to_json(&serde_json::json!({
        "convolutions": convolutions.collect::<Vec<_>>(),
        "steps": steps.collect::<Vec<_>>(),
    }))
}

/// The samples of the training frames from `first` to before `last`: patches (n, 1, side, side) and targets
/// (n, targets, cells, cells).
#[pyfunction]
pub fn training_batch<'py>(
    py: Python<'py>,
    net: &str,
    seed: u64,
    first: u64,
    last: u64,
) -> PyResult<NewSamples<'py>> {
    let head = head(net)?;
    let batch = abandonable(py, move |_| training::batch(head, seed, first..last))?.or_raise()?;
    let targets = match head {
        Head::Dots | Head::DotsLarge => training::DOT_TARGETS.len(),
        Head::Outline => training::OUTLINE_TARGETS.len(),
    };
    let array = |values: Vec<f32>, channels: usize, side: usize| {
        Array4::from_shape_vec((batch.len, channels, side, side), values)
            .map_err(|e| value_error("batch", e))
    };
    Ok((
        array(batch.patches, 1, SIZE)?.into_pyarray(py),
        array(batch.targets, targets, CELLS)?.into_pyarray(py),
    ))
}

/// Samples that one frame gives in a training.
#[pyfunction]
pub fn samples_per_frame(net: &str) -> PyResult<usize> {
    Ok(training::samples_per_frame(head(net)?))
}

/// SHA-256 of the first samples of a training.
#[pyfunction]
pub fn world_sha256(py: Python<'_>, net: &str, seed: u64) -> PyResult<String> {
    let head = head(net)?;
    abandonable(py, move |_| training::world_sha256(head, seed))?.or_raise()
}

/// Samples that a net does not train on: those of the first frames of `set`, `validation`, `calibration` or `test`.
#[pyclass(frozen, module = "spindoe._native")]
pub struct TrainingSamples(HeldOutSamples);

#[pymethods]
impl TrainingSamples {
    #[new]
    fn new(py: Python<'_>, net: &str, seed: u64, set: &str, frames: u64) -> PyResult<Self> {
        let head = head(net)?;
        let set: FrameSet = set.parse().or_raise()?;
        let drawn = abandonable(py, move |_| HeldOutSamples::draw(head, seed, set, frames))?;
        Ok(Self(drawn.or_raise()?))
    }

    /// The patches, (n, side, side).
    fn patches<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<f32>>> {
        let patches = self.0.patches();
        let values = patches.iter().flat_map(|p| p.values()).copied().collect();
        let array = Array3::from_shape_vec((patches.len(), SIZE, SIZE), values);
        Ok(array
            .map_err(|e| value_error("patches", e))?
            .into_pyarray(py))
    }

    /// What the estimator's own code computes of the patches, (n, channels x cells x cells).
    fn cells<'py>(
        &self,
        py: Python<'py>,
        flat: Vec<FlatLayer<'py>>,
    ) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let layers = layers(&flat);
        let cells = interruptible(py, |_| self.0.cells(&layers))?.or_raise()?;
        let shape = (cells.len(), cells.first().map_or(0, Vec::len));
        let array = Array2::from_shape_vec(shape, cells.concat());
        Ok(array.map_err(|e| value_error("cells", e))?.into_pyarray(py))
    }

    /// The calibration of a net on these samples, as JSON.
    fn calibrate(&self, py: Python<'_>, flat: Vec<FlatLayer<'_>>) -> PyResult<String> {
        let layers = layers(&flat);
        to_json(&interruptible(py, |_| self.0.calibrate(&layers))?.or_raise()?)
    }

    /// The score of a net on these samples: a number to select the best net by, the score as JSON and in words.
    fn score(
        &self,
        py: Python<'_>,
        flat: Vec<FlatLayer<'_>>,
        calibration: &str,
    ) -> PyResult<(f64, String, String)> {
        let layers = layers(&flat);
        let calibration: OutputCalibration = from_json("calibration", calibration)?;
        let score = interruptible(py, |_| self.0.score(&layers, &calibration))?.or_raise()?;
        Ok((score.quality(), to_json(&score)?, score.to_string()))
    }
}

/// A net's weights with their metadata.
#[pyclass(frozen, module = "spindoe._native")]
pub struct NetWeights(Weights);

#[pymethods]
impl NetWeights {
    /// Weights with metadata as JSON; `rounded` to what 8 bits hold.
    #[new]
    fn new(flat: Vec<FlatLayer<'_>>, meta: &str, rounded: bool) -> PyResult<Self> {
        let meta: WeightsMeta = from_json("meta", meta)?;
        let layers = layers(&flat);
        let shapes = meta.head.convolutions();
        let fits = layers.len() == shapes.len()
            && std::iter::zip(&layers, shapes)
                .all(|(l, c)| l.weight.len() == c.weights() && l.bias.len() == c.outputs);
        if !fits {
            return Err(value_error("layers", "expected those of this net"));
        }
        let weights = Weights { layers, meta };
        Ok(Self(if rounded { weights.rounded() } else { weights }))
    }

    #[staticmethod]
    fn read(path: std::path::PathBuf) -> PyResult<Self> {
        Ok(Self(Weights::read(&path).or_raise()?))
    }

    fn write(&self, path: std::path::PathBuf) -> PyResult<()> {
        self.0.write(&path).or_raise()
    }

    /// The metadata, as JSON.
    fn meta(&self) -> PyResult<String> {
        to_json(&self.0.meta)
    }

    /// Each convolution's kernels and biases, flat.
    fn layers<'py>(&self, py: Python<'py>) -> Vec<NewLayer<'py>> {
        let array = |values: &[f32]| PyArray1::from_slice(py, values);
        let layers = self.0.layers.iter();
        layers.map(|l| (array(&l.weight), array(&l.bias))).collect()
    }
}
