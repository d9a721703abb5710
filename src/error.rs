//! The crate's one error type.
//!
//! Variants are grouped by what a caller can do about them. Other input or arguments fix some
//! ([`Error::is_usage`] is true, the command exits with 2). The caller can fix nothing about the
//! others (exit 1). [`Error::NoAnswer`] is separate: the work succeeded and found no answer (exit
//! 3). Every message is one line that names the file or argument, the place in it, and what was
//! expected.

use std::borrow::Cow;
use std::path::{Path, PathBuf};

/// Result alias used throughout the crate.
pub type Result<T> = std::result::Result<T, Error>;

/// Everything that can go wrong in the library.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file's content does not match its format.
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
    #[error("{parameter}: {problem}")]
    Argument {
        /// The parameter.
        parameter: Parameter,
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
    /// The work is done, but none of the input could be answered.
    #[error("{}: {reason}", path.display())]
    NoAnswer {
        /// The input.
        path: PathBuf,
        /// Why not.
        reason: String,
    },
    /// A set of points does not determine a rotation.
    #[error("degenerate geometry: {0}")]
    Degenerate(String),
    /// Something failed that no input should be able to cause.
    #[error("internal failure: {0}")]
    Internal(String),
}

impl Error {
    /// A domain error of `parameter`.
    pub fn argument(parameter: impl Into<Parameter>, problem: impl Into<String>) -> Self {
        Self::Argument {
            parameter: parameter.into(),
            problem: on_one_line(problem.into()),
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
            place: on_one_line(place.into()),
            problem: on_one_line(problem.into()),
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

    /// Whether other input or arguments fix this (the command then exits with 2). What the system
    /// rejects, such as a full disk or a missing permission, and what should not happen are not
    /// (1).
    pub fn is_usage(&self) -> bool {
        use std::io::ErrorKind;
        match self {
            Self::Input { .. } | Self::Argument { .. } | Self::Degenerate(_) => true,
            // A path that does not exist, or is not what it should be, is an argument.
            Self::Read { source, .. } | Self::Write { source, .. } => matches!(
                source.kind(),
                ErrorKind::NotFound
                    | ErrorKind::IsADirectory
                    | ErrorKind::NotADirectory
                    | ErrorKind::InvalidData
                    | ErrorKind::InvalidInput
                    | ErrorKind::UnexpectedEof
                    | ErrorKind::AlreadyExists
            ),
            Self::NoAnswer { .. } | Self::Internal(_) => false,
        }
    }
}

/// The text with its control characters escaped: what a message quotes may hold any.
fn on_one_line(text: String) -> String {
    if !text.contains(char::is_control) {
        return text;
    }
    let escaped = |c: char| match c.is_control() {
        true => c.escape_default().to_string(),
        false => c.to_string(),
    };
    text.chars().map(escaped).collect()
}

/// The parameter that an [`Error::Argument`] is about, named as the library names it: the field or
/// argument in snake case with its unit, such as `min_separation_rad`. The command maps it to its
/// flag.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Parameter(Cow<'static, str>);

impl Parameter {
    /// The name.
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl From<&'static str> for Parameter {
    fn from(name: &'static str) -> Self {
        Self(Cow::Borrowed(name))
    }
}

impl From<String> for Parameter {
    fn from(name: String) -> Self {
        Self(Cow::Owned(name))
    }
}

impl std::fmt::Display for Parameter {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.pad(&self.0)
    }
}

/// Checks `value` against its domain.
///
/// # Errors
/// [`Error::Argument`] that names the parameter, what was `expected`, and the value found.
pub(crate) fn require(
    inside: bool,
    parameter: &'static str,
    expected: &str,
    value: impl std::fmt::Display,
) -> Result<()> {
    if inside {
        Ok(())
    } else {
        let problem = format!("expected {expected}, found {value}");
        Err(Error::argument(parameter, problem))
    }
}

/// The one of `all` whose name, by `as_str`, is `name`.
///
/// # Errors
/// [`Error::Argument`] that names the parameter and lists the names.
pub(crate) fn by_name<T: Copy>(
    all: &[T],
    as_str: fn(T) -> &'static str,
    parameter: &'static str,
    name: &str,
) -> Result<T> {
    let found = all.iter().copied().find(|&value| as_str(value) == name);
    found.ok_or_else(|| {
        let known: Vec<&str> = all.iter().map(|&value| as_str(value)).collect();
        let problem = format!("expected one of {}, found {name:?}", known.join(", "));
        Error::argument(parameter, problem)
    })
}
