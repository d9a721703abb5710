//! Safe reading and writing of NumPy archives (`.npz`: a zip of `.npy` arrays).
//!
//! Writing: arrays are stored uncompressed with a fixed date, so the same arrays give the same
//! bytes. Reading: hostile files neither panic nor allocate without bound. A file that does not
//! load gives one error that names the array.

use std::fmt::Display;
use std::io::{Cursor, Read, Write};

use npyz::{AutoSerialize, Deserialize, NpyFile, Order, WriterBuilder};
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, DateTime, ZipArchive, ZipWriter};

/// Maximum unpacked size of an array: five times the features of the largest pattern.
const MAX_ARRAY_BYTES: u64 = 32 << 20;
/// Maximum length of a header text; NumPy writes 118 bytes.
const MAX_HEADER_BYTES: usize = 1024;
/// Maximum number of digits in a header text: the product of all its numbers then fits 64 bits.
const MAX_HEADER_DIGITS: usize = 18;
/// Maximum number of opening brackets in a header text, which bounds the parser's recursion.
const MAX_HEADER_BRACKETS: usize = 8;

/// Where in the archive something is wrong, and what.
pub(crate) struct Problem {
    pub place: String,
    pub problem: String,
}

impl Problem {
    pub fn at(place: impl Into<String>, problem: impl Into<String>) -> Self {
        Self {
            place: place.into(),
            problem: problem.into(),
        }
    }
}

pub(crate) type Checked<T> = std::result::Result<T, Problem>;
pub(crate) type Archive<'a> = ZipArchive<Cursor<&'a [u8]>>;

/// Appends one array, as NumPy's `savez` does: any reader can read it.
pub(crate) fn add_array<T: AutoSerialize>(
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

/// Opens the archive and checks that it holds the arrays named and nothing else.
pub(crate) fn open<'a>(bytes: &'a [u8], arrays: &[&str]) -> Checked<Archive<'a>> {
    let archive = ZipArchive::new(Cursor::new(bytes)).map_err(|e| {
        Problem::at(
            "archive",
            format!("not a complete .npz file: {}", one_line(&e)),
        )
    })?;
    for name in archive.file_names_raw() {
        let name = String::from_utf8_lossy(name);
        let array = npyz::npz::array_name_from_file_name(&name);
        if !array.is_some_and(|a| arrays.contains(&a)) {
            let problem = format!("unexpected entry {name:?}; expected {}", arrays.join(", "));
            return Err(Problem::at("archive", problem));
        }
    }
    Ok(archive)
}

/// The message of a null error on one line.
pub(crate) fn one_line(error: &dyn Display) -> String {
    let text = error.to_string();
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// An array's items in C order. `shape` is the expected shape, with `None` where any length is
/// valid.
pub(crate) fn read_array<T: Deserialize + Clone>(
    archive: &mut Archive<'_>,
    name: &str,
    type_name: &str,
    shape: &[Option<u64>],
) -> Checked<Vec<T>> {
    let bytes = read_entry(archive, name)?;
    check_header_text(name, &bytes)?;
    let mut rest = bytes.as_slice();
    let damaged = |e: std::io::Error| Problem::at(name, format!("not an array: {}", one_line(&e)));
    let npy = NpyFile::new(&mut rest).map_err(damaged)?;
    let (found, order) = (npy.shape().to_vec(), npy.order());
    let fits = found.len() == shape.len()
        && std::iter::zip(&found, shape).all(|(have, want)| want.is_none_or(|w| w == *have));
    if !fits {
        let problem = format!("expected shape {}, found {found:?}", shape_text(shape));
        return Err(Problem::at(name, problem));
    }
    if order == Order::Fortran && found.len() > 2 {
        return Err(Problem::at(name, "expected C order, found Fortran order"));
    }
    let dtype = npy.dtype().descr();
    let items = npy
        .data::<T>()
        .map_err(|_| Problem::at(name, format!("expected type {type_name}, found {dtype}")))?;
    let items = items
        .collect::<std::io::Result<Vec<T>>>()
        .map_err(|_| Problem::at(name, format!("ends before its shape {found:?} is filled")))?;
    if !rest.is_empty() {
        let problem = format!("{} bytes follow the array's end", rest.len());
        return Err(Problem::at(name, problem));
    }
    match (order, found.as_slice()) {
        (Order::Fortran, [rows, columns]) => {
            Ok(transpose(&items, *rows as usize, *columns as usize))
        }
        _ => Ok(items),
    }
}

/// A shape as Python writes it, any length as `rows`.
fn shape_text(shape: &[Option<u64>]) -> String {
    let lengths: Vec<String> = shape
        .iter()
        .map(|l| l.map_or("rows".to_owned(), |l| l.to_string()))
        .collect();
    match lengths.as_slice() {
        [one] => format!("({one},)"),
        more => format!("({})", more.join(", ")),
    }
}

/// Column-major items in row-major order.
fn transpose<T: Clone>(items: &[T], rows: usize, columns: usize) -> Vec<T> {
    (0..rows)
        .flat_map(|r| (0..columns).map(move |c| items[c * rows + r].clone()))
        .collect()
}

/// An entry's unpacked bytes, at most [`MAX_ARRAY_BYTES`] of them.
fn read_entry(archive: &mut Archive<'_>, name: &str) -> Checked<Vec<u8>> {
    let file = npyz::npz::file_name_from_array_name(name);
    let entry = archive
        .by_name(&file)
        .map_err(|e| Problem::at(name, format!("cannot be read: {}", one_line(&e))))?;
    let mut bytes = Vec::new();
    // One byte more than allowed distinguishes "too long" from "just fits".
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

/// Rejects header texts on which the array parser could overflow a number or the stack.
fn check_header_text(name: &str, npy: &[u8]) -> Checked<()> {
    let reject = |problem: &str| Err(Problem::at(name, format!("not an array: {problem}")));
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
        _ => return reject("no NumPy header"),
    };
    if length > MAX_HEADER_BYTES {
        return reject("header too long");
    }
    let start = if npy[6] == 1 { 10 } else { 12 };
    let Some(text) = npy.get(start..start + length) else {
        return reject("ends within its header");
    };
    let digits = text.iter().filter(|c| c.is_ascii_digit()).count();
    let brackets = text.iter().filter(|c| b"([{".contains(c)).count();
    // A digit before a letter starts a hexadecimal or other number that the digit count misses.
    let odd_number = text
        .windows(2)
        .any(|w| w[0].is_ascii_digit() && w[1].is_ascii_alphabetic());
    if digits > MAX_HEADER_DIGITS || brackets > MAX_HEADER_BRACKETS || odd_number {
        return reject("header is not that of a plain array");
    }
    Ok(())
}
