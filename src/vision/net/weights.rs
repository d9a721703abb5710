//! The net's weights and their metadata, as a NumPy archive.
//!
//! Arrays: `convolution_00_weight` f32 (outputs, inputs, kernel, kernel), `convolution_00_bias` f32
//! (outputs,), and so on in the order of [`Head::convolutions`]; `meta` u8 (k,), UTF-8 JSON of
//! [`WeightsMeta`]. Of a net that is [rounded](WeightsMeta::is_rounded) the weights are i8, in units of
//! `convolution_00_scale` f32 (outputs,): a quarter of the bytes.

use std::io::Cursor;
use std::path::Path;

use serde::{Deserialize, Serialize};
use zip::ZipWriter;

use super::graph::Head;
use crate::error::{Error, Result};
use crate::files;
use crate::npz::{Checked, NpzProblem, add_array, one_line, open, read_array};

/// Version of the format.
pub const FORMAT_VERSION: u32 = 1;

/// The weights that come with this crate: models/README.md says how they were made.
static DOTS: &[u8] = include_bytes!("../../../models/dots.npz");
static DOTS_LARGE: &[u8] = include_bytes!("../../../models/dots-large.npz");
static OUTLINE: &[u8] = include_bytes!("../../../models/outline.npz");

/// The file of a net's shipped weights and its bytes.
fn shipped(head: Head) -> (&'static str, &'static [u8]) {
    match head {
        Head::Dots => ("models/dots.npz", DOTS),
        Head::DotsLarge => ("models/dots-large.npz", DOTS_LARGE),
        Head::Outline => ("models/outline.npz", OUTLINE),
    }
}

/// One convolution's numbers.
#[derive(Debug, Clone, PartialEq)]
pub struct ConvolutionNumbers {
    /// Kernels: outputs x inputs x rows x columns.
    pub weight: Vec<f32>,
    /// One number an output.
    pub bias: Vec<f32>,
}

/// How raw outputs become probabilities and covariances, fitted on frames not trained on.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct OutputCalibration {
    /// Probability of a dot = logistic(`slope` heat + `offset`).
    pub slope: f64,
    /// See `slope`.
    pub offset: f64,
    /// Factor on the net's covariances.
    pub covariance_factor: f64,
}

impl OutputCalibration {
    /// The probability of a dot where the net gives this heat.
    pub fn probability(&self, heat: f64) -> f64 {
        1.0 / (1.0 + (-self.slope * heat - self.offset).exp())
    }

    /// Checks that probabilities and covariances can come of it.
    fn check(&self) -> Checked<()> {
        for (name, value, inside, expected) in [
            (
                "slope",
                self.slope,
                self.slope > 0.0 && self.slope <= 1e3,
                "more than 0 and at most 1000",
            ),
            (
                "offset",
                self.offset,
                self.offset.abs() <= 1e3,
                "-1000 to 1000",
            ),
            (
                "covariance_factor",
                self.covariance_factor,
                (1e-4..=1e4).contains(&self.covariance_factor),
                "0.0001 to 10000",
            ),
        ] {
            if !inside {
                let problem = format!("calibration.{name}: expected {expected}, found {value}");
                return Err(NpzProblem::at("meta", problem));
            }
        }
        Ok(())
    }
}

impl Default for OutputCalibration {
    fn default() -> Self {
        Self {
            slope: 1.0,
            offset: 0.0,
            covariance_factor: 1.0,
        }
    }
}

/// The metadata of a set of weights.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct WeightsMeta {
    /// Of this format.
    pub format_version: u32,
    /// What the net is for; that of the dots where it is not said.
    #[serde(default)]
    pub head: Head,
    /// How to read the outputs.
    pub calibration: OutputCalibration,
    /// The command that made the weights.
    pub command: String,
    /// Frames seen in training.
    pub frames: u64,
    /// SHA-256 of the first samples that its training drew, hexadecimal: the synthetic world it was trained
    /// in. Empty in nets of before.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub world_sha256: String,
    /// Whether each output's weights are whole multiples, up to 63, of a power of two ([`Weights::rounded`]).
    #[serde(default)]
    pub is_rounded: bool,
}

/// The largest multiple of a scale to which weights are rounded.
const LEVELS: f32 = 63.0;

/// The power of two whose multiples, up to [`LEVELS`], hold the weights of an output.
fn scale_of(weights: &[f32]) -> f32 {
    let most = weights.iter().fold(0f32, |most, w| most.max(w.abs()));
    if most > 0.0 {
        (most / LEVELS).log2().ceil().exp2()
    } else {
        1.0
    }
}

/// A trained net.
#[derive(Debug, Clone, PartialEq)]
pub struct Weights {
    /// In the order of [`Head::convolutions`].
    pub layers: Vec<ConvolutionNumbers>,
    /// Their metadata.
    pub meta: WeightsMeta,
}

impl Weights {
    /// The weights that come with this crate.
    ///
    /// # Errors
    /// [`Error::Internal`] where this crate was built with damaged weights.
    pub fn built_in(head: Head) -> Result<Self> {
        let (name, bytes) = shipped(head);
        Self::from_npz(Path::new(name), bytes)
            .map_err(|e| Error::Internal(format!("the built-in weights: {e}")))
    }

    /// Reads weights from a file.
    ///
    /// # Errors
    /// [`Error::Read`] where the system refuses; [`Error::Input`] naming the array and what is
    /// wrong with it.
    pub fn read(path: &Path) -> Result<Self> {
        Self::from_npz(path, &files::read_at_most(path, files::MAX_ARCHIVE_BYTES)?)
    }

    /// As [`Weights::read`], from the file's bytes; `path` only names the file in errors.
    ///
    /// # Errors
    /// [`Error::Input`] naming the array and what is wrong with it.
    pub fn from_npz(path: &Path, bytes: &[u8]) -> Result<Self> {
        Self::parse(bytes)
            .map_err(|NpzProblem { place, problem }| Error::input(path, place, problem))
    }

    fn parse(bytes: &[u8]) -> Checked<Self> {
        let layers = Head::ALL.iter().map(|head| head.convolutions().len());
        let names: Vec<String> = (0..layers.max().unwrap_or(0))
            .flat_map(|i| [weight_name(i), bias_name(i), scale_name(i)])
            .chain(["meta".to_owned()])
            .collect();
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        let mut archive = open(bytes, &names)?;
        let meta: Vec<u8> = read_array(&mut archive, "meta", "u8", &[None])?;
        let meta: WeightsMeta = serde_json::from_slice(&meta)
            .map_err(|e| NpzProblem::at("meta", format!("not as expected: {}", one_line(&e))))?;
        if meta.format_version != FORMAT_VERSION {
            let found = meta.format_version;
            let problem = format!("expected format_version {FORMAT_VERSION}, found {found}");
            return Err(NpzProblem::at("meta", problem));
        }
        meta.calibration.check()?;
        let each = if meta.is_rounded { 3 } else { 2 };
        let expected = each * meta.head.convolutions().len() + 1;
        if archive.len() != expected {
            let problem = format!("expected {expected} arrays, found {}", archive.len());
            return Err(NpzProblem::at("archive", problem));
        }
        let mut layers = Vec::new();
        for (i, c) in meta.head.convolutions().iter().enumerate() {
            let shape = [c.outputs, c.inputs, c.kernel, c.kernel].map(|n| Some(n as u64));
            let mut read = |name: String, shape: &[Option<u64>]| -> Checked<Vec<f32>> {
                let values: Vec<f32> = read_array(&mut archive, &name, "f32", shape)?;
                if values.iter().all(|x| x.is_finite()) {
                    Ok(values)
                } else {
                    Err(NpzProblem::at(name, "expected finite numbers"))
                }
            };
            let bias = read(bias_name(i), &shape[..1])?;
            let weight = if meta.is_rounded {
                let scales = read(scale_name(i), &shape[..1])?;
                let steps: Vec<i8> = read_array(&mut archive, &weight_name(i), "i8", &shape)?;
                let outputs = steps.chunks_exact(c.weights() / c.outputs).zip(scales);
                let weights = outputs
                    .flat_map(|(steps, scale)| steps.iter().map(move |s| f32::from(*s) * scale));
                weights.collect()
            } else {
                read(weight_name(i), &shape)?
            };
            layers.push(ConvolutionNumbers { weight, bias });
        }
        Ok(Self { layers, meta })
    }

    /// The same, with each output's weights rounded to multiples of a power of two that 8 bits hold. Rounding again
    /// changes nothing.
    pub fn rounded(mut self) -> Self {
        let shapes = self.meta.head.convolutions();
        for (layer, c) in self.layers.iter_mut().zip(shapes) {
            for weights in layer.weight.chunks_exact_mut(c.weights() / c.outputs) {
                let scale = scale_of(weights);
                for weight in weights {
                    *weight = (*weight / scale).round() * scale;
                }
            }
        }
        self.meta.is_rounded = true;
        self
    }

    /// The bytes of the `.npz` file.
    ///
    /// # Errors
    /// [`Error::Internal`] where the arrays cannot be packed.
    pub fn to_npz(&self) -> Result<Vec<u8>> {
        let internal = |e: &dyn std::fmt::Display| {
            Error::Internal(format!("the weights cannot be packed: {e}"))
        };
        let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
        for (i, (c, layer)) in
            std::iter::zip(self.meta.head.convolutions(), &self.layers).enumerate()
        {
            let shape = [c.outputs, c.inputs, c.kernel, c.kernel].map(|n| n as u64);
            self.add_weights(&mut zip, i, &shape, layer)
                .and_then(|()| {
                    let bias = layer.bias.iter().copied();
                    add_array(&mut zip, &bias_name(i), &shape[..1], bias)
                })
                .map_err(|e| internal(&e))?;
        }
        let meta = serde_json::to_vec(&self.meta).map_err(|e| internal(&e))?;
        add_array(&mut zip, "meta", &[meta.len() as u64], meta.iter().copied())
            .map_err(|e| internal(&e))?;
        Ok(zip.finish().map_err(|e| internal(&e))?.into_inner())
    }

    fn add_weights(
        &self,
        zip: &mut ZipWriter<Cursor<Vec<u8>>>,
        i: usize,
        shape: &[u64],
        layer: &ConvolutionNumbers,
    ) -> std::io::Result<()> {
        if !self.meta.is_rounded {
            return add_array(zip, &weight_name(i), shape, layer.weight.iter().copied());
        }
        let outputs = || {
            layer
                .weight
                .chunks(shape[1..].iter().product::<u64>() as usize)
        };
        let steps = outputs().flat_map(|weights| {
            let scale = scale_of(weights);
            weights.iter().map(move |w| (w / scale).round() as i8)
        });
        add_array(zip, &weight_name(i), shape, steps)?;
        add_array(zip, &scale_name(i), &shape[..1], outputs().map(scale_of))
    }

    /// Writes the weights atomically.
    ///
    /// # Errors
    /// [`Error::Write`] where the system refuses.
    pub fn write(&self, path: &Path) -> Result<()> {
        files::write_bytes(path, &self.to_npz()?)
    }
}

fn weight_name(i: usize) -> String {
    format!("convolution_{i:02}_weight")
}

fn scale_name(i: usize) -> String {
    format!("convolution_{i:02}_scale")
}

fn bias_name(i: usize) -> String {
    format!("convolution_{i:02}_bias")
}
