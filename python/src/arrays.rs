//! Arrays in and out, with errors that name the argument and the shape that was expected.

use nalgebra::{Matrix2, Matrix3};
use numpy::ndarray::{Array1, Array2, Array3, ArrayViewD, Axis};
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArray3, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::prelude::*;
use spindoe::geometry::{from_wxyz, to_wxyz};
use spindoe::{Rotation, Vec3};

use crate::errors::value_error;

/// An array of numbers.
pub type Numbers<'py> = PyReadonlyArrayDyn<'py, f64>;

/// Maximum deviation of a quaternion's length from 1.
const QUATERNION_TOLERANCE: f64 = 2e-3;

/// A shape in words; `None` is any number.
fn words(shape: &[Option<usize>]) -> String {
    let sides: Vec<String> = shape
        .iter()
        .map(|side| side.map_or("n".to_owned(), |n| n.to_string()))
        .collect();
    format!(
        "({}{})",
        sides.join(", "),
        if sides.len() == 1 { "," } else { "" }
    )
}

/// Checks a shape.
pub fn require_sides(name: &str, array: &Numbers<'_>, shape: &[Option<usize>]) -> PyResult<()> {
    let found = array.shape();
    let fits = found.len() == shape.len()
        && found
            .iter()
            .zip(shape)
            .all(|(n, wanted)| wanted.is_none_or(|w| w == *n));
    if !fits {
        let problem = format!("expected shape {}, found {found:?}", words(shape));
        return Err(value_error(name, problem));
    }
    Ok(())
}

/// Checks a shape and that all numbers are finite.
pub fn require_shape(name: &str, array: &Numbers<'_>, shape: &[Option<usize>]) -> PyResult<()> {
    require_sides(name, array, shape)?;
    match array.as_array().iter().position(|x| !x.is_finite()) {
        None => Ok(()),
        Some(at) => {
            let per_row: usize = array.shape().iter().skip(1).product();
            let row = at / per_row.max(1);
            Err(value_error(
                name,
                format!("row {row}: expected finite numbers"),
            ))
        }
    }
}

/// The number of orientations with times: of `n` times there are `(n, 4)` quaternions, rows of NaN among them.
pub fn require_orientations(
    name: &str,
    times_s: &Numbers<'_>,
    quaternions: &Numbers<'_>,
) -> PyResult<usize> {
    require_shape("times_s", times_s, &[None])?;
    let count = times_s.shape()[0];
    if quaternions.shape() != [count, 4] {
        let problem = format!(
            "expected shape ({count}, 4), found {:?}",
            quaternions.shape()
        );
        return Err(value_error(name, problem));
    }
    Ok(count)
}

/// Rows of three numbers.
pub fn vectors(name: &str, array: &Numbers<'_>) -> PyResult<Vec<Vec3>> {
    require_shape(name, array, &[None, Some(3)])?;
    let view = array.as_array();
    Ok(view
        .rows()
        .into_iter()
        .map(|r| Vec3::new(r[0], r[1], r[2]))
        .collect())
}

/// A 3 x 3 matrix.
pub fn matrix3(name: &str, array: &Numbers<'_>) -> PyResult<Matrix3<f64>> {
    require_shape(name, array, &[Some(3), Some(3)])?;
    let view = array.as_array();
    Ok(Matrix3::from_fn(|i, j| view[[i, j]]))
}

/// The block `k` of an array of square blocks.
pub fn block2(view: &ArrayViewD<'_, f64>, k: usize) -> Matrix2<f64> {
    let block = view.index_axis(Axis(0), k);
    Matrix2::from_fn(|i, j| block[[i, j]])
}

/// The block `k` of an array of square blocks.
pub fn block3(view: &ArrayViewD<'_, f64>, k: usize) -> Matrix3<f64> {
    let block = view.index_axis(Axis(0), k);
    Matrix3::from_fn(|i, j| block[[i, j]])
}

/// A rotation of a quaternion, scalar first.
pub fn rotation(name: &str, wxyz: [f64; 4]) -> PyResult<Rotation> {
    from_wxyz(wxyz, QUATERNION_TOLERANCE).map_err(|length| {
        value_error(
            name,
            format!("expected a unit quaternion, found one of length {length:.6}"),
        )
    })
}

/// A rotation as an array `w, x, y, z`.
pub fn quaternion<'py>(py: Python<'py>, rotation: &Rotation) -> Bound<'py, PyArray1<f64>> {
    PyArray1::from_slice(py, &to_wxyz(rotation))
}

/// A vector as an array.
pub fn vector<'py>(py: Python<'py>, v: &Vec3) -> Bound<'py, PyArray1<f64>> {
    PyArray1::from_slice(py, v.as_slice())
}

/// A matrix as an array.
pub fn square<'py>(py: Python<'py>, m: &Matrix3<f64>) -> Bound<'py, PyArray2<f64>> {
    Array2::from_shape_fn((3, 3), |(i, j)| m[(i, j)]).into_pyarray(py)
}

/// Vectors as rows.
pub fn rows<'py>(py: Python<'py>, vectors: &[Vec3]) -> Bound<'py, PyArray2<f64>> {
    Array2::from_shape_fn((vectors.len(), 3), |(i, j)| vectors[i][j]).into_pyarray(py)
}

/// Triples as rows.
pub fn triples<'py>(py: Python<'py>, of: &[[f64; 3]]) -> Bound<'py, PyArray2<f64>> {
    Array2::from_shape_fn((of.len(), 3), |(i, j)| of[i][j]).into_pyarray(py)
}

/// 3 x 3 matrices as blocks.
pub fn blocks3<'py>(py: Python<'py>, of: &[Matrix3<f64>]) -> Bound<'py, PyArray3<f64>> {
    Array3::from_shape_fn((of.len(), 3, 3), |(k, i, j)| of[k][(i, j)]).into_pyarray(py)
}

/// The pattern's dot of each observed one; -1 for a false one.
pub fn assignment<'py>(py: Python<'py>, of: &[Option<u16>]) -> Bound<'py, PyArray1<i64>> {
    of.iter()
        .map(|dot| dot.map_or(-1, i64::from))
        .collect::<Array1<i64>>()
        .into_pyarray(py)
}
