//! Camera images in NumPy's memory, read where they lie.

use std::path::PathBuf;

use numpy::ndarray::{Array3, ArrayView2, ArrayView3, ArrayViewD, Ix2, Ix3};
use numpy::{IntoPyArray, PyArray3, PyReadonlyArrayDyn, PyUntypedArray, PyUntypedArrayMethods};
use pyo3::prelude::*;
use spindoe::image::{DEFAULT_MAX_PIXELS, GrayImage, ImageView, RgbImage, luma};

use crate::errors::{OrRaise, value_error};

/// An image file as an array (height, width, 3), rgb: of `bytes`, where there are any, else of the path. 16 bits hold what
/// files of 8 and of 16 bits have without rounding.
#[pyfunction]
pub fn read_image<'py>(
    py: Python<'py>,
    path: PathBuf,
    bytes: Option<&[u8]>,
) -> PyResult<Bound<'py, PyArray3<u16>>> {
    let read = || match bytes {
        Some(bytes) => RgbImage::decode(&path, bytes),
        None => RgbImage::read(&path),
    };
    let image = py.detach(read).or_raise()?;
    let (width, values) = (image.width(), image.values());
    let at =
        |(v, u, c): (usize, usize, usize)| (values[v * width + u][c] * 65_535.0).round() as u16;
    Ok(Array3::from_shape_fn((image.height(), width, 3), at).into_pyarray(py))
}

/// The order of the channels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Channels {
    Gray,
    Rgb,
    Bgr,
}

impl Channels {
    /// By name.
    pub fn named(name: &str) -> PyResult<Self> {
        match name {
            "gray" => Ok(Self::Gray),
            "rgb" => Ok(Self::Rgb),
            "bgr" => Ok(Self::Bgr),
            other => {
                let problem = format!("expected gray, rgb or bgr, found {other:?}");
                Err(value_error("color", problem))
            }
        }
    }
}

/// An array of pixels, held for as long as it is read.
pub enum Pixels<'py> {
    Eight(PyReadonlyArrayDyn<'py, u8>),
    Sixteen(PyReadonlyArrayDyn<'py, u16>),
}

/// The pixels themselves: they may be read without the interpreter's lock.
pub enum Samples<'a> {
    Gray8(ArrayView2<'a, u8>),
    Gray16(ArrayView2<'a, u16>),
    Color8(ArrayView3<'a, u8>, Channels),
    Color16(ArrayView3<'a, u16>, Channels),
}

impl<'py> Pixels<'py> {
    /// Checks the type of the numbers.
    pub fn new(name: &str, array: &Bound<'py, PyAny>) -> PyResult<Self> {
        if let Ok(eight) = array.extract() {
            return Ok(Self::Eight(eight));
        }
        if let Ok(sixteen) = array.extract() {
            return Ok(Self::Sixteen(sixteen));
        }
        let found = match array.cast::<PyUntypedArray>() {
            Ok(other) => other.dtype().to_string(),
            Err(_) => array.get_type().to_string(),
        };
        let problem = format!("expected an array of uint8 or uint16, found {found}");
        Err(value_error(name, problem))
    }

    /// Checks the shape.
    pub fn samples(&self, name: &str, channels: Channels) -> PyResult<Samples<'_>> {
        let shape = match self {
            Self::Eight(array) => array.shape(),
            Self::Sixteen(array) => array.shape(),
        };
        let expected = match channels {
            Channels::Gray => "(height, width) for gray",
            Channels::Rgb | Channels::Bgr => "(height, width, 3) for rgb or bgr",
        };
        let wrong = || {
            let problem = format!("expected shape {expected}, each at least 1, found {shape:?}");
            value_error(name, problem)
        };
        let fits = match (channels, shape) {
            (Channels::Gray, [height, width]) => height * width > 0,
            (Channels::Rgb | Channels::Bgr, [height, width, 3]) => height * width > 0,
            _ => false,
        };
        if !fits {
            return Err(wrong());
        }
        if shape[0] as u64 * shape[1] as u64 > DEFAULT_MAX_PIXELS {
            return Err(value_error(
                name,
                format!("expected at most {DEFAULT_MAX_PIXELS} pixels"),
            ));
        }
        Ok(match (self, channels) {
            (Self::Eight(a), Channels::Gray) => Samples::Gray8(flat(a.as_array(), wrong)?),
            (Self::Sixteen(a), Channels::Gray) => Samples::Gray16(flat(a.as_array(), wrong)?),
            (Self::Eight(a), order) => Samples::Color8(deep(a.as_array(), wrong)?, order),
            (Self::Sixteen(a), order) => Samples::Color16(deep(a.as_array(), wrong)?, order),
        })
    }
}

fn flat<T>(view: ArrayViewD<'_, T>, wrong: impl Fn() -> PyErr) -> PyResult<ArrayView2<'_, T>> {
    view.into_dimensionality::<Ix2>().map_err(|_| wrong())
}

fn deep<T>(view: ArrayViewD<'_, T>, wrong: impl Fn() -> PyErr) -> PyResult<ArrayView3<'_, T>> {
    view.into_dimensionality::<Ix3>().map_err(|_| wrong())
}

/// The library's images, whose memory is reused.
#[derive(Default)]
pub struct Buffers {
    gray: GrayImage,
    color: RgbImage,
}

/// A value of a pixel, 0 to 1, as image files are decoded.
trait Sample: Copy {
    fn unit(self) -> f32;
}

impl Sample for u8 {
    fn unit(self) -> f32 {
        f32::from(self) / 255.0
    }
}

impl Sample for u16 {
    fn unit(self) -> f32 {
        f32::from(self) / 65_535.0
    }
}

impl Samples<'_> {
    /// The library's image of these pixels: read once from where they lie, contiguous or not.
    pub fn read<'b>(&self, buffers: &'b mut Buffers) -> ImageView<'b> {
        match self {
            Self::Gray8(view) => gray(view, &mut buffers.gray),
            Self::Gray16(view) => gray(view, &mut buffers.gray),
            Self::Color8(view, order) => color(view, *order, &mut buffers.color),
            Self::Color16(view, order) => color(view, *order, &mut buffers.color),
        }
    }
}

fn gray<'b, T: Sample>(view: &ArrayView2<'_, T>, into: &'b mut GrayImage) -> ImageView<'b> {
    let (height, width) = view.dim();
    // The luma of equal channels differs from their value by rounding; files are read this way.
    let value = |sample: T| luma([sample.unit(); 3]);
    match view.as_slice() {
        Some(row) => into.fill_with(width, height, |u, v| value(row[v * width + u])),
        None => into.fill_with(width, height, |u, v| value(view[[v, u]])),
    }
    ImageView::Gray(into)
}

fn color<'b, T: Sample>(
    view: &ArrayView3<'_, T>,
    order: Channels,
    into: &'b mut RgbImage,
) -> ImageView<'b> {
    let (height, width, _) = view.dim();
    let [red, green, blue] = match order {
        Channels::Bgr => [2, 1, 0],
        Channels::Gray | Channels::Rgb => [0, 1, 2],
    };
    match view.as_slice() {
        Some(all) => into.fill_with(width, height, |u, v| {
            let pixel = &all[3 * (v * width + u)..][..3];
            [pixel[red].unit(), pixel[green].unit(), pixel[blue].unit()]
        }),
        None => into.fill_with(width, height, |u, v| {
            [red, green, blue].map(|c| view[[v, u, c]].unit())
        }),
    }
    ImageView::Color(into)
}
