//! The hash table as a NumPy archive (`.npz`: a zip of `.npy` arrays).
//!
//! Arrays: `dots` f64 (n, 3); `features` f64 (m, 3); `bases` u16 (m, 2); `feature_dots` u16 (m,);
//! `meta` u8 (k,), UTF-8 JSON of [`TableMeta`]. Rows of the last three stand in the order of
//! [`PairRule::features`](super::PairRule::features). What is written reads back bit for bit, and the
//! same table gives the same bytes.
//!
//! A table that loads is whole: the version is known, every array has its type and shape, numbers are
//! finite, dots are distinct unit vectors, the metadata's digest is that of the dots, and the features
//! are those that its pair rule demands of the dots. Row order and byte order of an array (C or
//! Fortran, little or big endian) are free. Nothing else is promised of a file that does not load but
//! one error that names the array; hostile files neither panic nor allocate without bound.

use std::fmt::Display;
use std::io::{Cursor, Read, Write};
use std::path::Path;

use npyz::{AutoSerialize, Deserialize, NpyFile, Order, WriterBuilder};
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, DateTime, ZipArchive, ZipWriter};

use super::features::Basis;
use super::table::{Arrays, FORMAT_VERSION, HashTable, TableMeta};
use crate::error::{Error, Result};
use crate::files;
use crate::geometry::Vec3;
use crate::pattern::{LENGTH_ROUNDING, MAX_DOTS, MIN_DOTS, Pattern};

/// Largest unpacked array read: five times the features of the largest pattern.
const MAX_ARRAY_BYTES: u64 = 32 << 20;
/// Longest header text read; NumPy writes 118 bytes.
const MAX_HEADER_BYTES: usize = 1024;
/// Most digits in a header text: then the product of all its numbers fits 64 bits.
const MAX_HEADER_DIGITS: usize = 18;
/// Most opening brackets in a header text, which bounds the parser's recursion.
const MAX_HEADER_BRACKETS: usize = 8;
/// Largest relative difference between a stored feature and the one computed from the dots: it
/// leaves room for other writers' rounding, which a basis near the pair rule's limit amplifies.
const FEATURE_TOLERANCE: f64 = 1e-9;

const ARRAYS: [&str; 5] = ["dots", "features", "bases", "feature_dots", "meta"];

impl HashTable {
    /// Writes the table as `.npz`, whole or not at all.
    ///
    /// # Errors
    /// [`Error::Write`] where the system refuses; [`Error::Internal`] where the arrays cannot be packed.
    pub fn write_npz(&self, path: &Path) -> Result<()> {
        files::write_bytes(path, &self.to_npz()?)
    }

    /// The bytes of the `.npz` file.
    ///
    /// # Errors
    /// [`Error::Internal`] where the arrays cannot be packed.
    pub fn to_npz(&self) -> Result<Vec<u8>> {
        let internal =
            |e: &dyn Display| Error::Internal(format!("the hash table cannot be packed: {e}"));
        let meta = serde_json::to_vec(self.meta()).map_err(|e| internal(&e))?;
        let (n, m) = (self.pattern().len() as u64, self.features().len() as u64);
        let dots = self.pattern().dots().iter().flat_map(|d| [d.x, d.y, d.z]);
        let features = self.features().iter().flatten().copied();
        let bases = self.bases().iter().flat_map(|b| [b.first, b.second]);
        let feature_dots = self.feature_dots().iter().copied();
        let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
        add_array(&mut zip, "dots", &[n, 3], dots)
            .and_then(|()| add_array(&mut zip, "features", &[m, 3], features))
            .and_then(|()| add_array(&mut zip, "bases", &[m, 2], bases))
            .and_then(|()| add_array(&mut zip, "feature_dots", &[m], feature_dots))
            .and_then(|()| {
                let length = meta.len() as u64;
                add_array(&mut zip, "meta", &[length], meta.iter().copied())
            })
            .map_err(|e| internal(&e))?;
        Ok(zip.finish().map_err(|e| internal(&e))?.into_inner())
    }

    /// Reads a table and checks that it is whole (see the module's head).
    ///
    /// # Errors
    /// [`Error::Read`] where the system refuses; [`Error::Input`] naming the array and what is wrong
    /// with it.
    pub fn read_npz(path: &Path) -> Result<Self> {
        Self::from_npz(path, &files::read_bytes(path)?)
    }

    /// As [`HashTable::read_npz`], from the file's bytes; `path` only names the file in errors.
    ///
    /// # Errors
    /// [`Error::Input`] naming the array and what is wrong with it.
    pub fn from_npz(path: &Path, bytes: &[u8]) -> Result<Self> {
        Self::parse(bytes).map_err(|Problem { place, problem }| Error::input(path, place, problem))
    }

    fn parse(bytes: &[u8]) -> Checked<Self> {
        let mut archive = open(bytes)?;
        let meta = read_meta(&mut archive)?;
        let pattern = read_dots(&mut archive)?;
        let found = pattern.sha256();
        if meta.pattern_sha256 != found {
            let problem = format!(
                "pattern_sha256 is {:?}, but the dots have {found}",
                meta.pattern_sha256
            );
            return Err(Problem::at("meta", problem));
        }
        let arrays = read_columns(&mut archive)?;
        check_features(&pattern, &arrays, &meta)?;
        Self::assemble(pattern, arrays, meta).map_err(|e| Problem::at("features", e.to_string()))
    }
}

/// Where in the archive something is wrong, and what.
struct Problem {
    place: &'static str,
    problem: String,
}

impl Problem {
    fn at(place: &'static str, problem: impl Into<String>) -> Self {
        let problem = problem.into();
        Self { place, problem }
    }
}

type Checked<T> = std::result::Result<T, Problem>;
type Archive<'a> = ZipArchive<Cursor<&'a [u8]>>;

/// Appends one array. Stored, not packed, and with a fixed date, as NumPy's `savez` does: any reader
/// can read it, and the same table gives the same bytes.
fn add_array<T: AutoSerialize>(
    zip: &mut ZipWriter<Cursor<Vec<u8>>>,
    name: &str,
    shape: &[u64],
    items: impl Iterator<Item = T>,
) -> std::io::Result<()> {
    let options = SimpleFileOptions::default()
        .compression_method(CompressionMethod::Stored)
        .last_modified_time(DateTime::default());
    zip.start_file(npyz::npz::file_name_from_array_name(name), options)?;
    let mut npy = Vec::new();
    let mut writer = npyz::WriteOptions::new()
        .default_dtype()
        .shape(shape)
        .writer(&mut npy)
        .begin_nd()?;
    writer.extend(items)?;
    writer.finish()?;
    zip.write_all(&npy)
}

/// Opens the archive and checks that it holds our arrays and nothing else.
fn open(bytes: &[u8]) -> Checked<Archive<'_>> {
    let archive = ZipArchive::new(Cursor::new(bytes)).map_err(|e| {
        Problem::at(
            "archive",
            format!("not a whole .npz file: {}", one_line(&e)),
        )
    })?;
    for name in archive.file_names_raw() {
        let name = String::from_utf8_lossy(name);
        let array = npyz::npz::array_name_from_file_name(&name);
        if !array.is_some_and(|a| ARRAYS.contains(&a)) {
            let problem = format!("unexpected entry {name:?}; expected {}", ARRAYS.join(", "));
            return Err(Problem::at("archive", problem));
        }
    }
    Ok(archive)
}

/// The message of a foreign error on one line.
fn one_line(error: &dyn Display) -> String {
    let text = error.to_string();
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// An array's items in C order, and its number of rows; `columns` is `None` for one dimension.
fn read_array<T: Deserialize + Clone>(
    archive: &mut Archive<'_>,
    name: &'static str,
    type_name: &str,
    columns: Option<u64>,
) -> Checked<Vec<T>> {
    let bytes = read_entry(archive, name)?;
    check_header_text(name, &bytes)?;
    let mut rest = bytes.as_slice();
    let damaged = |e: std::io::Error| Problem::at(name, format!("not an array: {}", one_line(&e)));
    let npy = NpyFile::new(&mut rest).map_err(damaged)?;
    let (shape, order) = (npy.shape().to_vec(), npy.order());
    let expected = columns.map_or("(rows,)".to_owned(), |c| format!("(rows, {c})"));
    let rows = match (shape.as_slice(), columns) {
        ([rows], None) => *rows,
        ([rows, found], Some(c)) if *found == c => *rows,
        _ => {
            let problem = format!("expected shape {expected}, found {shape:?}");
            return Err(Problem::at(name, problem));
        }
    };
    let dtype = npy.dtype().descr();
    let items = npy
        .data::<T>()
        .map_err(|_| Problem::at(name, format!("expected type {type_name}, found {dtype}")))?;
    let items = items
        .collect::<std::io::Result<Vec<T>>>()
        .map_err(|_| Problem::at(name, format!("ends before its shape {shape:?} is filled")))?;
    if !rest.is_empty() {
        let problem = format!("{} bytes follow the array's end", rest.len());
        return Err(Problem::at(name, problem));
    }
    match (order, columns) {
        (Order::Fortran, Some(c)) => Ok(transpose(&items, rows as usize, c as usize)),
        _ => Ok(items),
    }
}

/// Column-major items in row-major order.
fn transpose<T: Clone>(items: &[T], rows: usize, columns: usize) -> Vec<T> {
    (0..rows)
        .flat_map(|r| (0..columns).map(move |c| items[c * rows + r].clone()))
        .collect()
}

/// An entry's unpacked bytes, at most [`MAX_ARRAY_BYTES`] of them.
fn read_entry(archive: &mut Archive<'_>, name: &'static str) -> Checked<Vec<u8>> {
    let file = npyz::npz::file_name_from_array_name(name);
    let entry = archive
        .by_name(&file)
        .map_err(|e| Problem::at(name, format!("cannot be read: {}", one_line(&e))))?;
    let mut bytes = Vec::new();
    // One byte more than allowed tells "too long" from "just fits".
    entry
        .take(MAX_ARRAY_BYTES + 1)
        .read_to_end(&mut bytes)
        .map_err(|e| Problem::at(name, format!("cannot be unpacked: {}", one_line(&e))))?;
    if bytes.len() as u64 > MAX_ARRAY_BYTES {
        let problem = format!("larger than {} MiB", MAX_ARRAY_BYTES >> 20);
        return Err(Problem::at(name, problem));
    }
    Ok(bytes)
}

/// Refuses header texts on which the array parser could overflow a number or the stack.
fn check_header_text(name: &'static str, npy: &[u8]) -> Checked<()> {
    let refuse = |problem: &str| Err(Problem::at(name, format!("not an array: {problem}")));
    // Magic (6 bytes), version (2), then the text's length in 2 bytes, or 4 from version 2 on.
    let length = match npy {
        [b'\x93', b'N', b'U', b'M', b'P', b'Y', 1, _, a, b, ..] => {
            usize::from(u16::from_le_bytes([*a, *b]))
        }
        [
            b'\x93',
            b'N',
            b'U',
            b'M',
            b'P',
            b'Y',
            2 | 3,
            _,
            a,
            b,
            c,
            d,
            ..,
        ] => u32::from_le_bytes([*a, *b, *c, *d]) as usize,
        _ => return refuse("no NumPy header"),
    };
    if length > MAX_HEADER_BYTES {
        return refuse("header too long");
    }
    let start = if npy[6] == 1 { 10 } else { 12 };
    let Some(text) = npy.get(start..start + length) else {
        return refuse("ends within its header");
    };
    let digits = text.iter().filter(|c| c.is_ascii_digit()).count();
    let brackets = text.iter().filter(|c| b"([{".contains(c)).count();
    // A digit before a letter starts a hexadecimal or other number that the digit count misses.
    let odd_number = text
        .windows(2)
        .any(|w| w[0].is_ascii_digit() && w[1].is_ascii_alphabetic());
    if digits > MAX_HEADER_DIGITS || brackets > MAX_HEADER_BRACKETS || odd_number {
        return refuse("header is not that of a plain array");
    }
    Ok(())
}

fn read_meta(archive: &mut Archive<'_>) -> Checked<TableMeta> {
    let bytes: Vec<u8> = read_array(archive, "meta", "u8", None)?;
    let refuse = |problem: String| Problem::at("meta", problem);
    let json: serde_json::Value = serde_json::from_slice(&bytes)
        .map_err(|e| refuse(format!("not JSON: {}", one_line(&e))))?;
    // The version first: a later format may have other fields.
    let version = json.get("format_version").and_then(|v| v.as_u64());
    if version != Some(u64::from(FORMAT_VERSION)) {
        let found = version.map_or("none".to_owned(), |v| v.to_string());
        return Err(refuse(format!(
            "expected format_version {FORMAT_VERSION}, found {found}"
        )));
    }
    let meta: TableMeta = serde_json::from_value(json).map_err(|e| refuse(one_line(&e)))?;
    meta.pair_rule.check().map_err(|e| refuse(e.to_string()))?;
    meta.recogniser.check().map_err(|e| refuse(e.to_string()))?;
    Ok(meta)
}

fn read_dots(archive: &mut Archive<'_>) -> Checked<Pattern> {
    let refuse = |problem: String| Problem::at("dots", problem);
    let flat: Vec<f64> = read_array(archive, "dots", "f64", Some(3))?;
    let dots: Vec<Vec3> = flat.chunks_exact(3).map(Vec3::from_column_slice).collect();
    if !(MIN_DOTS..=MAX_DOTS).contains(&dots.len()) {
        let problem = format!(
            "expected {MIN_DOTS} to {MAX_DOTS} dots, found {}",
            dots.len()
        );
        return Err(refuse(problem));
    }
    for (i, dot) in dots.iter().enumerate() {
        let length = dot.norm();
        // Not `>`: it would let a NaN pass.
        let is_unit = (length - 1.0).abs() <= LENGTH_ROUNDING;
        if !is_unit {
            let problem =
                format!("dot {i}: expected a unit vector to rounding, found length {length}");
            return Err(refuse(problem));
        }
    }
    Pattern::new(dots).map_err(|e| refuse(e.to_string()))
}

fn read_columns(archive: &mut Archive<'_>) -> Checked<Arrays> {
    let features: Vec<f64> = read_array(archive, "features", "f64", Some(3))?;
    let bases: Vec<u16> = read_array(archive, "bases", "u16", Some(2))?;
    let feature_dots: Vec<u16> = read_array(archive, "feature_dots", "u16", None)?;
    let features: Vec<[f64; 3]> = features
        .chunks_exact(3)
        .map(|c| [c[0], c[1], c[2]])
        .collect();
    if let Some(row) = features
        .iter()
        .position(|f| f.iter().any(|x| !x.is_finite()))
    {
        let problem = format!(
            "row {row}: expected finite numbers, found {:?}",
            features[row]
        );
        return Err(Problem::at("features", problem));
    }
    Ok(Arrays {
        features,
        bases: bases
            .chunks_exact(2)
            .map(|c| Basis {
                first: c[0],
                second: c[1],
            })
            .collect(),
        feature_dots,
    })
}

/// Checks index ranges, and that the rows are those which the pair rule demands of the dots.
fn check_features(pattern: &Pattern, arrays: &Arrays, meta: &TableMeta) -> Checked<()> {
    let n = pattern.len();
    let outside = |dot: u16| usize::from(dot) >= n;
    let range = |array, row, dot| {
        let problem = format!("row {row}: dot {dot} does not exist, there are {n}");
        Err(Problem::at(array, problem))
    };
    for (row, basis) in arrays.bases.iter().enumerate() {
        if let Some(dot) = [basis.first, basis.second]
            .into_iter()
            .find(|d| outside(*d))
        {
            return range("bases", row, dot);
        }
    }
    if let Some(row) = arrays.feature_dots.iter().position(|d| outside(*d)) {
        return range("feature_dots", row, arrays.feature_dots[row]);
    }
    let expected: Vec<_> = meta.pair_rule.features(pattern.dots()).collect();
    let lengths = [
        ("features", arrays.features.len()),
        ("bases", arrays.bases.len()),
        ("feature_dots", arrays.feature_dots.len()),
    ];
    for (array, found) in lengths {
        if found != expected.len() {
            let problem = format!(
                "the dots and the pair rule give {} rows, found {found}",
                expected.len()
            );
            return Err(Problem::at(array, problem));
        }
    }
    for (row, want) in expected.iter().enumerate() {
        if arrays.bases[row] != want.basis {
            let (found, want) = (arrays.bases[row], want.basis);
            let problem = format!(
                "row {row}: expected ({}, {}), found ({}, {})",
                want.first, want.second, found.first, found.second
            );
            return Err(Problem::at("bases", problem));
        }
        if arrays.feature_dots[row] != want.dot {
            let (found, want) = (arrays.feature_dots[row], want.dot);
            let problem = format!("row {row}: expected dot {want}, found {found}");
            return Err(Problem::at("feature_dots", problem));
        }
        let (found, want) = (Vec3::from(arrays.features[row]), Vec3::from(want.value));
        if (found - want).norm() > FEATURE_TOLERANCE * (1.0 + want.norm()) {
            let problem = format!(
                "row {row}: the dots give {:?}, found {:?}",
                want.as_slice(),
                found.as_slice()
            );
            return Err(Problem::at("features", problem));
        }
    }
    Ok(())
}
