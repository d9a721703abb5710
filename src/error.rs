//! The crate's one error type.
//!
//! Variants are grouped by what a caller can do about them: mend the input or the arguments
//! ([`Error::is_usage`] is true, the command exits with 2), or nothing (everything else, exit 1).
//! Every message is one line that names the file or argument, the place in it, and what was expected.

use std::path::{Path, PathBuf};

/// Result alias used throughout the crate.
pub type Result<T> = std::result::Result<T, Error>;

/// Everything that can go wrong in the library.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file's content is not what its format demands.
    #[error("{}: {place}: {problem}", path.display())]
    Input {
        /// The offending file.
        path: PathBuf,
        /// Line, field or array within the file.
        place: String,
        /// What is wrong and what was expected.
        problem: String,
    },
    /// An argument, parameter or set of values is outside its domain.
    #[error("{name}: {problem}")]
    Argument {
        /// The parameter's name.
        name: String,
        /// What is wrong and what was expected.
        problem: String,
    },
    /// A file or folder cannot be read.
    #[error("{}: cannot be read: {source}", path.display())]
    Read {
        /// The file or folder.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// A file or folder cannot be written.
    #[error("{}: cannot be written: {source}", path.display())]
    Write {
        /// The file or folder.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// A set of points does not determine a rotation.
    #[error("degenerate geometry: {0}")]
    Degenerate(String),
    /// Something failed that no input should be able to cause.
    #[error("internal failure: {0}")]
    Internal(String),
}

impl Error {
    /// A domain error of the parameter `name`.
    pub fn argument(name: impl Into<String>, problem: impl Into<String>) -> Self {
        Self::Argument {
            name: name.into(),
            problem: problem.into(),
        }
    }

    /// An error at `place` in the file `path`.
    pub fn input(
        path: impl AsRef<Path>,
        place: impl Into<String>,
        problem: impl Into<String>,
    ) -> Self {
        Self::Input {
            path: path.as_ref().to_path_buf(),
            place: place.into(),
            problem: problem.into(),
        }
    }

    /// A failure to read `path`.
    pub fn read(path: impl AsRef<Path>, source: std::io::Error) -> Self {
        Self::Read {
            path: path.as_ref().to_path_buf(),
            source,
        }
    }

    /// A failure to write `path`.
    pub fn write(path: impl AsRef<Path>, source: std::io::Error) -> Self {
        Self::Write {
            path: path.as_ref().to_path_buf(),
            source,
        }
    }

    /// Whether the user can mend this by other input or arguments (the command then exits with 2).
    pub fn is_usage(&self) -> bool {
        !matches!(self, Self::Internal(_))
    }
}
