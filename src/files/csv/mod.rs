//! CSV tables, read row by row: the one reader behind every table of this crate.
//!
//! [`Rows`] yields the records of a file, [`Table`] those below a header, by the columns' names.
//! Fields are separated by a comma (or the separator of [`CsvFormat`]), may be quoted with `"`, and
//! are trimmed of white space. Blank lines are skipped, and so are lines that start with `#` where
//! the format has comments. Lines end in `\n` or `\r\n`; a byte-order mark at the start is ignored.
//!
//! Guarantees: time grows linearly with the bytes read, memory is bounded by the longest record
//! ([`MAX_RECORD_BYTES`]), no byte is requested beyond the current record, and errors are one line
//! that names the line on which the record begins, as an editor counts. An incomplete record is
//! never yielded, unless the file ends in it. Duplicate rows and values outside a domain are the
//! caller's concern.

mod table;

use std::io::{BufRead, ErrorKind};
use std::path::{Path, PathBuf};

use csv_core::ReadRecordResult;

pub(crate) use self::table::{Columns, Field, Table, TableRow};
use crate::error::{Error, Result};

/// Maximum length of a record. An unclosed quotation mark would otherwise consume the whole file.
pub(crate) const MAX_RECORD_BYTES: usize = 1 << 16;
/// Maximum length of the comments and blank lines between two records.
const MAX_SKIPPED_BYTES: usize = 1 << 20;
/// Maximum number of characters of a file's text in an error.
const MAX_SHOWN: usize = 60;
const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";

/// How a file separates its fields.
#[derive(Debug, Clone, Copy)]
pub(crate) struct CsvFormat {
    /// Between two fields.
    pub delimiter: u8,
    /// Whether lines that start with `#` are comments.
    pub comments: bool,
}

impl Default for CsvFormat {
    fn default() -> Self {
        Self {
            delimiter: b',',
            comments: true,
        }
    }
}

/// The records of a file.
pub(crate) struct Rows<R> {
    input: R,
    path: PathBuf,
    format: CsvFormat,
    parser: csv_core::Reader,
    /// Line ends seen so far.
    newlines: u64,
    at_start: bool,
    /// The record's fields, concatenated, and the end of each.
    bytes: Vec<u8>,
    ends: Vec<usize>,
}

impl<R: BufRead> Rows<R> {
    /// The records of `input`; `path` names it in errors.
    pub fn new(path: &Path, input: R, format: CsvFormat) -> Self {
        Self {
            input,
            path: path.to_path_buf(),
            format,
            parser: csv_core::ReaderBuilder::new()
                .delimiter(format.delimiter)
                .build(),
            newlines: 0,
            at_start: true,
            bytes: vec![0; 256],
            ends: vec![0; 16],
        }
    }

    /// The file that errors name.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The next record; `None` at the end.
    ///
    /// # Errors
    /// [`Error::Read`] on an I/O failure, [`Error::Input`] for a record that is too long or
    /// not UTF-8.
    pub fn next_row(&mut self) -> Result<Option<CsvRow<'_>>> {
        if !self.skip_to_record()? {
            return Ok(None);
        }
        let line = self.newlines + 1;
        let Some((length, fields)) = self.read_record(line)? else {
            return Ok(None);
        };
        let row = CsvRow {
            path: &self.path,
            line,
            delimiter: self.format.delimiter,
            text: text(&self.bytes[..length], &self.ends[..fields])
                .map_err(|problem| Error::input(&self.path, format!("line {line}"), problem))?,
            ends: &self.ends[..fields],
        };
        Ok(Some(row))
    }

    /// Skips blank lines and comments; returns whether a record follows.
    fn skip_to_record(&mut self) -> Result<bool> {
        let (mut in_comment, mut skipped) = (false, 0);
        loop {
            if skipped > MAX_SKIPPED_BYTES {
                let problem = format!(
                    "expected a row within {MAX_SKIPPED_BYTES} bytes of comments and blank lines"
                );
                let place = format!("line {}", self.newlines + 1);
                return Err(Error::input(&self.path, place, problem));
            }
            let buffer = fill(&mut self.input, &self.path)?;
            if buffer.is_empty() {
                return Ok(false);
            }
            let mut at = 0;
            if self.at_start && buffer.starts_with(BYTE_ORDER_MARK) {
                at = BYTE_ORDER_MARK.len();
            }
            self.at_start = false;
            let mut found = false;
            while let Some(&byte) = buffer.get(at) {
                match byte {
                    b'\n' => {
                        self.newlines += 1;
                        in_comment = false;
                    }
                    b'\r' => {}
                    _ if in_comment => {}
                    b'#' if self.format.comments => in_comment = true,
                    _ => {
                        found = true;
                        break;
                    }
                }
                at += 1;
            }
            self.input.consume(at);
            skipped += at;
            if found {
                return Ok(true);
            }
        }
    }

    /// Reads a record into the buffers: its length in bytes and in fields.
    fn read_record(&mut self, line: u64) -> Result<Option<(usize, usize)>> {
        let (mut length, mut fields) = (0, 0);
        loop {
            let buffer = fill(&mut self.input, &self.path)?;
            let (result, read, written, ended) = self.parser.read_record(
                buffer,
                &mut self.bytes[length..],
                &mut self.ends[fields..],
            );
            self.newlines += buffer[..read].iter().filter(|b| **b == b'\n').count() as u64;
            self.input.consume(read);
            length += written;
            fields += ended;
            match result {
                ReadRecordResult::Record => return Ok(Some((length, fields))),
                ReadRecordResult::End => return Ok(None),
                ReadRecordResult::InputEmpty => {}
                // The parser needs one free byte even where it writes none.
                ReadRecordResult::OutputFull if length > MAX_RECORD_BYTES => {
                    let problem = format!(
                        "expected a row of at most {MAX_RECORD_BYTES} bytes: is a quotation mark left open?"
                    );
                    return Err(Error::input(&self.path, format!("line {line}"), problem));
                }
                ReadRecordResult::OutputFull => self.bytes.resize(2 * self.bytes.len(), 0),
                ReadRecordResult::OutputEndsFull if fields > MAX_RECORD_BYTES => {
                    let problem = format!("expected at most {MAX_RECORD_BYTES} fields");
                    return Err(Error::input(&self.path, format!("line {line}"), problem));
                }
                ReadRecordResult::OutputEndsFull => self.ends.resize(2 * self.ends.len(), 0),
            }
        }
    }
}

/// The buffered bytes, after a blocking read where there are none; empty at the end.
fn fill<'a, R: BufRead>(input: &'a mut R, path: &Path) -> Result<&'a [u8]> {
    // The loop only repeats what a signal interrupted; the second call returns what the first
    // filled.
    loop {
        match input.fill_buf() {
            Ok(_) => break,
            Err(e) if e.kind() == ErrorKind::Interrupted => {}
            Err(e) => return Err(Error::read(path, e)),
        }
    }
    input.fill_buf().map_err(|e| Error::read(path, e))
}

/// The fields as text: each of them is UTF-8, not only all of them together.
fn text<'a>(bytes: &'a [u8], ends: &[usize]) -> std::result::Result<&'a str, String> {
    let whole = std::str::from_utf8(bytes).ok();
    match whole.filter(|w| bytes.is_ascii() || ends.iter().all(|&e| w.is_char_boundary(e))) {
        Some(text) => Ok(text),
        None => {
            let starts = std::iter::once(0).chain(ends.iter().copied());
            let is_wrong =
                |(start, &end): (usize, &usize)| std::str::from_utf8(&bytes[start..end]).is_err();
            let field = starts.zip(ends).position(is_wrong).unwrap_or(0) + 1;
            Err(format!("expected UTF-8 text, field {field} is none"))
        }
    }
}

/// A record.
pub(crate) struct CsvRow<'a> {
    path: &'a Path,
    line: u64,
    delimiter: u8,
    text: &'a str,
    ends: &'a [usize],
}

impl<'a> CsvRow<'a> {
    /// The line on which it begins, counted from 1.
    pub fn line(&self) -> u64 {
        self.line
    }

    /// Number of fields.
    pub fn len(&self) -> usize {
        self.ends.len()
    }

    /// A field without the white space around it.
    pub fn get(&self, field: usize) -> Option<&'a str> {
        let end = *self.ends.get(field)?;
        let start = field.checked_sub(1).map_or(0, |before| self.ends[before]);
        self.text.get(start..end).map(str::trim)
    }

    /// All fields, in order.
    pub fn fields(&self) -> impl Iterator<Item = &'a str> {
        (0..self.len()).map(|i| self.get(i).unwrap_or_default())
    }

    /// `N` finite numbers and nothing else.
    #[cfg(feature = "native")]
    pub fn numbers<const N: usize>(&self) -> Option<[f64; N]> {
        let mut found = [0.0; N];
        if self.len() != N {
            return None;
        }
        for (number, field) in found.iter_mut().zip(self.fields()) {
            *number = field.parse().ok().filter(|x: &f64| x.is_finite())?;
        }
        Some(found)
    }

    /// The record as an error shows it.
    pub fn shown(&self) -> String {
        let separator = char::from(self.delimiter).to_string();
        // No more fields than the error shows.
        let fields: Vec<&str> = self.fields().take(MAX_SHOWN).collect();
        shown(&fields.join(&separator))
    }

    /// An error on the record's line.
    pub fn error(&self, problem: impl Into<String>) -> Error {
        Error::input(self.path, format!("line {}", self.line), problem)
    }
}

/// A file's text as an error shows it: on one line, shortened where it is long.
pub(crate) fn shown(text: &str) -> String {
    let mut line: String = text
        .chars()
        .take(MAX_SHOWN)
        .flat_map(|c| {
            let escaped = c.is_control().then(|| c.escape_default());
            let plain = escaped.is_none().then_some(c);
            escaped.into_iter().flatten().chain(plain)
        })
        .collect();
    if text.chars().nth(MAX_SHOWN).is_some() {
        line.push_str("...");
    }
    line
}

/// A field of text as written: quoted where CSV requires it.
pub(crate) fn quoted(text: &str) -> std::borrow::Cow<'_, str> {
    if text.contains([',', '"', '\n', '\r', '#']) || text.trim() != text {
        format!("\"{}\"", text.replace('"', "\"\"")).into()
    } else {
        text.into()
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::io::{BufReader, Read};

    /// Yields at most `n` bytes per call, as a pipe may.
    struct Trickle<'a>(&'a [u8], usize);

    impl Read for Trickle<'_> {
        fn read(&mut self, to: &mut [u8]) -> std::io::Result<usize> {
            let n = self.1.min(to.len()).min(self.0.len());
            to[..n].copy_from_slice(&self.0[..n]);
            self.0 = &self.0[n..];
            Ok(n)
        }
    }

    fn read(text: &[u8], chunk: usize) -> Vec<(u64, Vec<String>)> {
        let input = BufReader::with_capacity(chunk.max(3), Trickle(text, chunk));
        let mut rows = Rows::new(Path::new("t.csv"), input, CsvFormat::default());
        let mut found = Vec::new();
        while let Some(row) = rows.next_row().unwrap() {
            found.push((row.line(), row.fields().map(str::to_owned).collect()));
        }
        found
    }

    /// The simple reference reader, character by character, for text in which quotation marks
    /// enclose whole fields.
    fn naive(text: &str) -> Vec<(u64, Vec<String>)> {
        let (mut found, mut line) = (Vec::new(), 1);
        let mut rest = text;
        while !rest.is_empty() {
            if rest.starts_with(['\n', '\r', '#']) {
                let end = rest.find('\n').map_or(rest.len(), |i| i + 1);
                line += u64::from(rest[..end].ends_with('\n'));
                rest = &rest[end..];
                continue;
            }
            let (begin, mut fields, mut field, mut inside) =
                (line, Vec::new(), String::new(), false);
            let mut characters = rest.char_indices().peekable();
            let mut end = rest.len();
            while let Some((i, c)) = characters.next() {
                line += u64::from(c == '\n');
                match c {
                    '"' if inside && characters.peek().is_some_and(|n| n.1 == '"') => {
                        characters.next();
                        field.push('"');
                    }
                    '"' => inside = !inside,
                    ',' if !inside => fields.push(std::mem::take(&mut field)),
                    '\r' if !inside => {}
                    '\n' if !inside => {
                        end = i + 1;
                        break;
                    }
                    c => field.push(c),
                }
            }
            fields.push(field);
            found.push((begin, fields.iter().map(|f| f.trim().to_owned()).collect()));
            rest = &rest[end..];
        }
        found
    }

    fn field() -> impl Strategy<Value = String> {
        prop_oneof![
            "[a-z0-9 é.-]{0,6}".prop_map(|f| f),
            "([a-z,\n\r# ]|\"\"){0,6}".prop_map(|f| format!("\"{f}\"")),
        ]
    }

    fn line() -> impl Strategy<Value = String> {
        let record = prop::collection::vec(field(), 1..5)
            .prop_map(|f| f.join(","))
            .prop_filter("an empty line is no record", |r| !r.is_empty());
        prop_oneof![4 => record, 1 => Just(String::new()), 1 => "#[a-z,\"]{0,5}"]
    }

    proptest! {
        #[test]
        fn reads_what_the_obvious_reader_reads(
            lines in prop::collection::vec((line(), any::<bool>()), 0..12),
            ends in any::<bool>(),
            chunk in 1usize..40,
        ) {
            let mut text: String = lines
                .iter()
                .map(|(l, windows)| format!("{l}{}", if *windows { "\r\n" } else { "\n" }))
                .collect();
            if !ends {
                text.truncate(text.trim_end_matches(['\r', '\n']).len());
            }
            prop_assert_eq!(read(text.as_bytes(), chunk), naive(&text), "{:?}", text);
        }

        #[test]
        fn any_bytes_are_read_or_rejected_in_one_line(
            bytes in prop::collection::vec(prop_oneof![any::<u8>(), Just(b'"'), Just(b'\n')], 0..200),
        ) {
            static COLUMNS: Columns<2> = Columns { names: ["a", "b"], required: 0..2 };
            let mut text = b"a,b\r\n\r\n".to_vec();
            text.extend(&bytes);
            let mut table = Table::new(Path::new("t"), text.as_slice(), &COLUMNS).unwrap();
            loop {
                match table.next_row() {
                    Ok(None) => break,
                    Ok(Some(row)) => {
                        if let Err(problem) = row.number(0) {
                            prop_assert!(!problem.chars().any(char::is_control));
                        }
                    }
                    Err(e) => {
                        prop_assert!(e.is_usage());
                        prop_assert!(!e.to_string().chars().any(char::is_control));
                    }
                }
            }
        }
    }

    #[test]
    fn lines_are_those_of_an_editor() {
        let text = b"\xef\xbb\xbf# head\r\na,b\r\n\r\n\r\n\"two\nlines\",2\r\n# note\r\nc,d\ne,f";
        let lines: Vec<u64> = read(text, 1000).iter().map(|r| r.0).collect();
        assert_eq!(lines, [2, 5, 8, 9]);
    }

    #[test]
    fn fields_are_checked_one_by_one() {
        // Two halves of one character, either side of a comma.
        let mut rows = Rows::new(Path::new("t"), &b"\xc3,\xa9\n"[..], CsvFormat::default());
        let error = rows.next_row().err().unwrap().to_string();
        assert_eq!(error, "t: line 1: expected UTF-8 text, field 1 is none");
    }

    #[test]
    fn a_quotation_mark_left_open_does_not_swallow_the_file() {
        let mut text = b"a,b\n1,\"".to_vec();
        text.resize(100 * MAX_RECORD_BYTES, b'\n');
        let mut input = text.as_slice();
        let mut rows = Rows::new(Path::new("t"), &mut input, CsvFormat::default());
        rows.next_row().unwrap();
        let error = rows.next_row().err().unwrap().to_string();
        assert!(
            error.starts_with("t: line 2: expected a row of at most"),
            "{error}"
        );
        assert!(rows.bytes.len() <= 4 * MAX_RECORD_BYTES);
    }

    #[test]
    fn long_and_strange_text_is_shown_on_one_line() {
        assert_eq!(shown("a\nb\u{1b}é"), "a\\nb\\u{1b}é");
        assert_eq!(shown(&"x".repeat(1000)).len(), MAX_SHOWN + 3);
    }
}
