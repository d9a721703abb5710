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
    #[error("{}: {place}: {problem}", shown(path))]
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
    #[error("{}: cannot be read: {source}", shown(path))]
    Read {
        /// The file or folder.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// A file or folder cannot be written.
    #[error("{}: cannot be written: {source}", shown(path))]
    Write {
        /// The file or folder.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// The work is done, but none of the input could be answered.
    #[error("{}: {reason}", shown(path))]
    NoAnswer {
        /// The input.
        path: PathBuf,
        /// Why not.
        reason: String,
    },
    /// A set of points does not determine a rotation.
    #[error("degenerate geometry: {0}")]
    Degenerate(String),
    /// The system grants too little memory for the work.
    #[error("too little memory: {0}")]
    Memory(String),
    /// Who waited for the work ended it.
    #[error("stopped before its end")]
    Stopped,
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
                    | ErrorKind::InvalidFilename
                    | ErrorKind::UnexpectedEof
                    | ErrorKind::AlreadyExists
            ),
            Self::NoAnswer { .. } | Self::Memory(_) | Self::Stopped | Self::Internal(_) => false,
        }
    }
}

/// A path in a message, as [`on_one_line`] shows it.
fn shown(path: &Path) -> String {
    let text = escaped(path.display().to_string());
    match is_path(&text) {
        true => text,
        false => cut(&text, MAX_VALUE_CHARS),
    }
}

/// Whether a file may have this path: no name in it is too long.
fn is_path(text: &str) -> bool {
    let mut names = text.split(['/', '\\']);
    names.all(|name| name.chars().count() <= MAX_NAME_CHARS)
}

/// The first `most` characters, with "..." where there are more.
fn cut(text: &str, most: usize) -> String {
    match text.char_indices().nth(most) {
        Some((end, _)) => format!("{}...", &text[..end]),
        None => text.to_owned(),
    }
}

/// The text with its control characters escaped.
fn escaped(text: String) -> String {
    if !text.contains(char::is_control) {
        return text;
    }
    let escaped = |c: char| match c.is_control() {
        true => c.escape_default().to_string(),
        false => c.to_string(),
    };
    text.chars().map(escaped).collect()
}

/// Most characters of a value that a message repeats.
const MAX_VALUE_CHARS: usize = 60;
/// Most characters of a file's name: the limit of file systems.
const MAX_NAME_CHARS: usize = 255;
/// Most characters of what a message says is wrong: three lines of a terminal and a half.
const MAX_CHARS: usize = 320;

/// The text as a message shows it: control characters are escaped; values of more than
/// [`MAX_VALUE_CHARS`] characters, which are words or quoted, end after them with "...".
pub(crate) fn on_one_line(text: String) -> String {
    let text = escaped(text);
    if text.len() <= MAX_VALUE_CHARS {
        return text;
    }
    let mut shown = String::with_capacity(text.len().min(MAX_CHARS));
    let mut rest = text.as_str();
    let mut most_left = MAX_CHARS;
    while let Some(first) = rest.chars().next() {
        let value = &rest[..value_end(rest, first)];
        rest = &rest[value.len()..];
        let is_quoted = matches!(first, '"' | '\'');
        let is_path = !is_quoted && value.contains(['/', '\\']) && is_path(value);
        let most = if is_path {
            most_left
        } else {
            most_left.min(MAX_VALUE_CHARS)
        };
        let shortened = cut(value, most);
        shown.push_str(&shortened);
        if is_quoted && shortened != value && value.ends_with(first) {
            shown.push(first);
        }
        most_left = most_left.saturating_sub(value.chars().count().min(most));
        if most_left == 0 {
            if !rest.is_empty() && !shown.ends_with("...") {
                shown.push_str("...");
            }
            break;
        }
    }
    shown
}

/// Where the quoted text, the word or the space at the beginning of `text` ends.
fn value_end(text: &str, first: char) -> usize {
    if first.is_whitespace() {
        return first.len_utf8();
    }
    if matches!(first, '"' | '\'') {
        let mut is_escape = false;
        for (at, c) in text.char_indices().skip(1) {
            if c == first && !is_escape {
                return at + c.len_utf8();
            }
            is_escape = c == '\\' && !is_escape;
        }
    }
    text.find(char::is_whitespace).unwrap_or(text.len())
}

/// A number with its noun, which agrees with it.
#[cfg(feature = "vision")]
pub(crate) fn counted(count: usize, noun: &str) -> String {
    let ending = if count == 1 { "" } else { "s" };
    format!("{count} {noun}{ending}")
}

/// The verb of so many.
#[cfg(feature = "vision")]
pub(crate) fn are(count: usize) -> &'static str {
    if count == 1 { "is" } else { "are" }
}

/// Dots by their numbers: `dot 3`, or `dots 3, 7`.
#[cfg(feature = "vision")]
pub(crate) fn dots(numbers: &[usize]) -> String {
    let ending = if numbers.len() == 1 { "" } else { "s" };
    let words: Vec<String> = numbers.iter().map(usize::to_string).collect();
    format!("dot{ending} {}", words.join(", "))
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_are_short_lines() {
        let long = "9".repeat(10_000);
        let cut = format!("{}...", &long[..MAX_VALUE_CHARS]);
        for (problem, expected) in [
            (
                format!("expected 1, found {long}"),
                format!("p: expected 1, found {cut}"),
            ),
            (format!("found {:?}, not 1", "a b ".repeat(999)), {
                let kept = "a b ".repeat(15);
                format!("p: found \"{}...\", not 1", &kept[..MAX_VALUE_CHARS - 1])
            }),
            ("a\tb".to_owned(), "p: a\\tb".to_owned()),
            (
                format!("is in /{}", "long/".repeat(20)),
                format!("p: is in /{}", "long/".repeat(20)),
            ),
        ] {
            assert_eq!(Error::argument("p", problem).to_string(), expected);
        }
        let whole = format!("no \"end, {}", "word ".repeat(30));
        assert_eq!(on_one_line(whole.clone()), whole);
        assert!(on_one_line("word ".repeat(9999)).len() <= MAX_CHARS + 3);
        let error = Error::input("tab\t.csv", "line 1", "expected x");
        assert_eq!(error.to_string(), "tab\\t.csv: line 1: expected x");
    }
}
