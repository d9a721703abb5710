//! The command `spindoe`, so that installing the package installs it.

use std::ffi::OsString;

use pyo3::prelude::*;

/// Runs the command with these arguments, the first of which is the program's name, and returns its
/// exit code.
#[pyfunction]
pub fn command(py: Python<'_>, arguments: Vec<OsString>) -> u8 {
    py.detach(|| spindoe::cli::main_with(arguments))
}
