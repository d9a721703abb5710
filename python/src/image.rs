//! Camera images in NumPy's memory, read where they lie.

use std::path::PathBuf;

use numpy::ndarray::{Array3, ArrayViewD};
use numpy::{IntoPyArray, PyArray3, PyReadonlyArrayDyn, PyUntypedArray, PyUntypedArrayMethods};
use pyo3::prelude::*;
use spindoe::image::{
    DEFAULT_MAX_PIXELS, ImageView, Picture, RawImage, RawPixel, RawSamples, RgbImage,
};

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

/// The order of the channels, by name.
pub fn raw_pixel(color: &str) -> PyResult<RawPixel> {
    color.parse().map_err(|_| {
        let problem = format!("expected gray, rgb or bgr, found {color:?}");
        value_error("color", problem)
    })
}

/// An array of pixels, held for as long as it is read.
pub enum Pixels<'py> {
    Eight(PyReadonlyArrayDyn<'py, u8>),
    Sixteen(PyReadonlyArrayDyn<'py, u16>),
}

/// The pixels themselves: they may be read without the interpreter's lock.
pub struct Samples<'a> {
    values: Values<'a>,
    pixel: RawPixel,
}

enum Values<'a> {
    Eight(ArrayViewD<'a, u8>),
    Sixteen(ArrayViewD<'a, u16>),
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
    pub fn samples(&self, name: &str, pixel: RawPixel) -> PyResult<Samples<'_>> {
        let shape = match self {
            Self::Eight(array) => array.shape(),
            Self::Sixteen(array) => array.shape(),
        };
        let expected = match pixel {
            RawPixel::Gray => "(height, width) for gray",
            RawPixel::Rgb | RawPixel::Bgr => "(height, width, 3) for rgb or bgr",
        };
        let fits = match (pixel, shape) {
            (RawPixel::Gray, [height, width]) => height * width > 0,
            (RawPixel::Rgb | RawPixel::Bgr, [height, width, 3]) => height * width > 0,
            _ => false,
        };
        if !fits {
            let problem = format!("expected shape {expected}, each at least 1, found {shape:?}");
            return Err(value_error(name, problem));
        }
        if shape[0] as u64 * shape[1] as u64 > DEFAULT_MAX_PIXELS {
            return Err(value_error(
                name,
                format!("expected at most {DEFAULT_MAX_PIXELS} pixels"),
            ));
        }
        let values = match self {
            Self::Eight(array) => Values::Eight(array.as_array()),
            Self::Sixteen(array) => Values::Sixteen(array.as_array()),
        };
        Ok(Samples { values, pixel })
    }
}

/// The pixels of an image in memory of its own: they outlive the array, for work that is abandoned.
#[derive(Default)]
pub struct Copied {
    eight: Vec<u8>,
    sixteen: Vec<u16>,
    size: [usize; 2],
    pixel: Option<RawPixel>,
}

impl Copied {
    /// The library's view of them.
    pub fn view(&self) -> spindoe::Result<ImageView<'_>> {
        let [width, height] = self.size;
        let pixel = self.pixel.unwrap_or(RawPixel::Gray);
        let image = match self.sixteen.is_empty() {
            true => RawImage::new(width, height, pixel, &self.eight[..]),
            false => RawImage::new(width, height, pixel, &self.sixteen[..]),
        };
        image.map(ImageView::Raw)
    }
}

impl Copied {
    /// The library's picture of them.
    pub fn into_picture(self) -> spindoe::Result<Picture> {
        let [width, height] = self.size;
        let pixel = self.pixel.unwrap_or(RawPixel::Gray);
        if self.sixteen.is_empty() {
            return Ok(Picture::Bytes {
                width,
                height,
                pixel,
                values: self.eight,
            });
        }
        let image = RawImage::new(width, height, pixel, &self.sixteen[..])?;
        Ok(match pixel {
            RawPixel::Gray => Picture::Gray(image.to_gray()),
            RawPixel::Rgb | RawPixel::Bgr => Picture::Color(image.to_rgb()),
        })
    }
}

/// Memory for samples that do not lie one after another.
#[derive(Default)]
pub struct Buffers {
    eight: Vec<u8>,
    sixteen: Vec<u16>,
}

impl Samples<'_> {
    /// How many pixels there are.
    pub fn pixels(&self) -> usize {
        let shape = match &self.values {
            Values::Eight(view) => view.shape(),
            Values::Sixteen(view) => view.shape(),
        };
        shape[..2].iter().product()
    }

    /// Copies the pixels.
    pub fn copy_to(&self, copied: &mut Copied) {
        copied.pixel = Some(self.pixel);
        copied.eight.clear();
        copied.sixteen.clear();
        let shape = match &self.values {
            Values::Eight(view) => {
                copy(view, &mut copied.eight);
                view.shape()
            }
            Values::Sixteen(view) => {
                copy(view, &mut copied.sixteen);
                view.shape()
            }
        };
        copied.size = [shape[1], shape[0]];
    }

    /// The library's view of these pixels: where they lie, or a copy of samples that have gaps between them.
    pub fn view<'b>(&'b self, buffers: &'b mut Buffers) -> spindoe::Result<ImageView<'b>> {
        let image = match &self.values {
            Values::Eight(view) => raw(view, self.pixel, &mut buffers.eight),
            Values::Sixteen(view) => raw(view, self.pixel, &mut buffers.sixteen),
        };
        image.map(ImageView::Raw)
    }
}

fn copy<T: Copy>(view: &ArrayViewD<'_, T>, to: &mut Vec<T>) {
    for row in view.outer_iter() {
        match row.as_slice() {
            Some(row) => to.extend_from_slice(row),
            None => to.extend(row.iter().copied()),
        }
    }
}

fn raw<'b, T: Copy>(
    view: &'b ArrayViewD<'_, T>,
    pixel: RawPixel,
    buffer: &'b mut Vec<T>,
) -> spindoe::Result<RawImage<'b>>
where
    RawSamples<'b>: From<&'b [T]>,
{
    let (height, width) = (view.shape()[0], view.shape()[1]);
    let samples: &[T] = match view.as_slice() {
        Some(all) => all,
        None => {
            buffer.clear();
            copy(view, buffer);
            buffer
        }
    };
    RawImage::new(width, height, pixel, samples)
}
