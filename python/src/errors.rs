//! The library's errors as Python's: what other input or arguments fix is a `ValueError`, what the
//! system refuses an `OSError`, both with the command's one line.

use std::ffi::CString;
use std::io::ErrorKind;

use pyo3::exceptions::{
    PyFileExistsError, PyFileNotFoundError, PyIsADirectoryError, PyNotADirectoryError, PyOSError,
    PyPermissionError, PyRuntimeError, PyUserWarning, PyValueError,
};
use pyo3::prelude::*;
use spindoe::Error;
use spindoe::spin::SpinRejection;

/// The library's error as Python's.
pub fn to_python(error: Error) -> PyErr {
    let line = error.to_string();
    match error {
        Error::Read { source, .. } | Error::Write { source, .. } => of_system(source.kind(), line),
        Error::Internal(_) => PyRuntimeError::new_err(line),
        _ => PyValueError::new_err(line),
    }
}

fn of_system(kind: ErrorKind, line: String) -> PyErr {
    match kind {
        ErrorKind::NotFound => PyFileNotFoundError::new_err(line),
        ErrorKind::PermissionDenied => PyPermissionError::new_err(line),
        ErrorKind::IsADirectory => PyIsADirectoryError::new_err(line),
        ErrorKind::NotADirectory => PyNotADirectoryError::new_err(line),
        ErrorKind::AlreadyExists => PyFileExistsError::new_err(line),
        _ => PyOSError::new_err(line),
    }
}

/// A value outside its domain.
pub fn value_error(name: &str, problem: impl std::fmt::Display) -> PyErr {
    PyValueError::new_err(format!("{name}: {problem}"))
}

/// Warns, in the line that called the package.
pub fn warn(py: Python<'_>, words: &str) -> PyResult<()> {
    let words = CString::new(words).map_err(|_| value_error("warning", "has a zero in it"))?;
    PyErr::warn(py, &py.get_type::<PyUserWarning>(), &words, 2)
}

/// A rejection that says no more than "no spin", or the error of bad input.
pub fn spin_rejection(rejection: SpinRejection) -> PyResult<String> {
    match rejection {
        SpinRejection::TooFewFrames { .. } => Ok(rejection.to_string()),
        _ if rejection.is_no_spin() => Ok(rejection.to_string()),
        _ => Err(to_python(rejection.into())),
    }
}

/// Maps the library's results.
pub trait OrRaise<T> {
    /// The value, or Python's exception.
    fn or_raise(self) -> PyResult<T>;
}

impl<T> OrRaise<T> for spindoe::Result<T> {
    fn or_raise(self) -> PyResult<T> {
        self.map_err(to_python)
    }
}

/// What was found, or a sentence that says why nothing was.
#[derive(IntoPyObject)]
pub enum Answer<T> {
    Found(T),
    Rejected(String),
}
