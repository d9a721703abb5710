//! The records below a header, by the columns' names.

use std::io::BufRead;
use std::path::Path;

use super::{CsvFormat, CsvRow, MAX_SHOWN, Rows, shown};
use crate::error::{Error, Result};

/// A header's columns: all that a reader knows; the file must have those from the first `required`
/// on.
#[derive(Debug)]
pub(crate) struct Columns<const N: usize> {
    /// The columns' names.
    pub names: [&'static str; N],
    /// Which of them a file must have.
    pub required: std::ops::Range<usize>,
}

/// The records below a header, by the names of its columns; unknown columns are skipped.
pub(crate) struct Table<R, const N: usize> {
    rows: Rows<R>,
    columns: &'static Columns<N>,
    places: [Option<usize>; N],
    width: usize,
    header_line: u64,
}

impl<R: BufRead, const N: usize> Table<R, N> {
    /// Reads the header of `input`; `path` names it in errors.
    ///
    /// # Errors
    /// [`Error::Read`], or [`Error::Input`] where a column is missing or occurs twice.
    pub fn new(path: &Path, mut input: R, columns: &'static Columns<N>) -> Result<Self> {
        let expected = columns.names[columns.required.clone()].join(",");
        // Another kind of file may have no lines.
        let start = input.fill_buf().map_err(|e| Error::read(path, e))?;
        let start = String::from_utf8_lossy(&start[..start.len().min(4 * MAX_SHOWN)]);
        if let Some(kind) = other_kind(&start) {
            let problem = format!("expected a header with {expected}, found {kind}");
            return Err(Error::input(path, "line 1", problem));
        }
        let mut rows = Rows::new(path, input, CsvFormat::default());
        let Some(header) = rows.next_row()? else {
            let problem = format!("expected a header with {expected}, found nothing");
            return Err(Error::input(path, "line 1", problem));
        };
        let places = columns
            .names
            .map(|name| header.fields().position(|h| h == name));
        let (width, header_line) = (header.len(), header.line());
        for name in columns.names {
            if header.fields().filter(|h| *h == name).count() > 1 {
                return Err(header.error(format!("column {name} occurs more than once")));
            }
        }
        if let Some(i) = columns.required.clone().find(|&i| places[i].is_none()) {
            let found = match kind(&header.shown()) {
                Some(kind) => kind.to_owned(),
                None => format!("\"{}\"", header.shown()),
            };
            let name = columns.names[i];
            let problem = format!("expected a header with {name} ({expected}), found {found}");
            return Err(header.error(problem));
        }
        Ok(Self {
            rows,
            columns,
            places,
            width,
            header_line,
        })
    }

    /// An error on the header's line.
    pub fn header_error(&self, problem: impl Into<String>) -> Error {
        Error::input(self.path(), format!("line {}", self.header_line), problem)
    }

    /// Whether the file has a column.
    pub fn has(&self, column: usize) -> bool {
        self.places[column].is_some()
    }

    /// The file that errors name.
    pub fn path(&self) -> &Path {
        self.rows.path()
    }

    /// The next record; `None` at the end.
    ///
    /// # Errors
    /// As [`Rows::next_row`], and [`Error::Input`] where a record is not as long as the header.
    pub fn next_row(&mut self) -> Result<Option<TableRow<'_, N>>> {
        let Some(row) = self.rows.next_row()? else {
            return Ok(None);
        };
        if row.len() != self.width {
            let (expected, found) = (self.width, row.len());
            let problem = format!("expected {expected} fields as in the header, found {found}");
            return Err(row.error(problem));
        }
        Ok(Some(TableRow {
            row,
            names: &self.columns.names,
            places: &self.places,
        }))
    }
}

/// A record of a table.
pub(crate) struct TableRow<'a, const N: usize> {
    row: CsvRow<'a>,
    names: &'a [&'static str; N],
    places: &'a [Option<usize>; N],
}

/// A field's value, or what is wrong with it.
pub(crate) type Field<T> = std::result::Result<T, String>;

impl<'a, const N: usize> TableRow<'a, N> {
    /// The line on which it begins, counted from 1.
    pub fn line(&self) -> u64 {
        self.row.line()
    }

    /// A column's text; `None` where it is empty or the file does not have it.
    pub fn text(&self, column: usize) -> Option<&'a str> {
        let place = self.places[column]?;
        self.row.get(place).filter(|f| !f.is_empty())
    }

    /// A finite number, where there is one.
    pub fn number(&self, column: usize) -> Field<Option<f64>> {
        self.parsed(column, "a finite number", |x: &f64| x.is_finite())
    }

    /// A whole number, where there is one.
    pub fn count(&self, column: usize) -> Field<Option<usize>> {
        self.parsed(column, "a whole number", |_| true)
    }

    fn parsed<T: std::str::FromStr>(
        &self,
        column: usize,
        expected: &str,
        holds: impl Fn(&T) -> bool,
    ) -> Field<Option<T>> {
        let Some(text) = self.text(column) else {
            return Ok(None);
        };
        match text.parse().ok().filter(holds) {
            Some(value) => Ok(Some(value)),
            None => {
                let name = self.names[column];
                Err(format!(
                    "{name}: expected {expected}, found \"{}\"",
                    shown(text)
                ))
            }
        }
    }

    /// An error on the record's line.
    pub fn error(&self, problem: impl Into<String>) -> Error {
        self.row.error(problem)
    }
}

/// What a file is that begins so, where that is no table.
fn other_kind(start: &str) -> Option<&'static str> {
    Some(match start.trim_start() {
        json if json.starts_with('{') && json.contains("pattern_sha256") => {
            "JSON, such as the truth of a synthetic clip: its orientations.csv stands beside it"
        }
        json if json.starts_with(['{', '[']) => "JSON",
        archive if archive.starts_with("PK\u{3}\u{4}") => "a NumPy archive, such as a table",
        image if image.starts_with("\u{fffd}PNG") || image.contains("JFIF") => {
            "an image: `estimate` makes orientations of it"
        }
        _ => return None,
    })
}

/// What a table is whose first line is this, where it is another one of ours.
fn kind(first_line: &str) -> Option<&'static str> {
    let fields: Vec<&str> = first_line.split(',').map(str::trim).collect();
    let has = |names: &[&str]| names.iter().all(|name| fields.contains(name));
    if fields.len() == 3 && fields.iter().all(|field| field.parse::<f64>().is_ok()) {
        return Some("a pattern's dots");
    }
    let known: [(&[&str], &str); 5] = [
        (&["qw", "qx", "qy", "qz"], "orientations"),
        (
            &["frame", "x", "y", "z"],
            "observed dots: `identify` makes orientations of them",
        ),
        (&["frame", "u", "v", "radius"], "outlines of frames"),
        (&["from_s", "to_s"], "stretches of a spin"),
        (&["time_s", "wx", "wy", "wz"], "a spin over time"),
    ];
    let found = known.into_iter().find(|(names, _)| has(names));
    found.map(|(_, words)| words)
}
