//! Safe reading and writing of NumPy archives (`.npz`: a zip of `.npy` arrays).
//!
//! Writing: arrays are stored uncompressed with a fixed date, so the same arrays give the same
//! bytes. Reading: hostile files neither panic nor allocate without bound. A file that does not
//! load gives one error that names the array.

use std::fmt::Display;
use std::io::{Cursor, ErrorKind, Read, Write};

use npyz::{AutoSerialize, Deserialize, NpyHeader, Order, TypeRead, WriterBuilder};
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
pub(crate) struct NpzProblem {
    pub place: String,
    pub problem: String,
}

impl NpzProblem {
    pub fn at(place: impl Into<String>, problem: impl Into<String>) -> Self {
        Self {
            place: place.into(),
            problem: problem.into(),
        }
    }
}

pub(crate) type Checked<T> = std::result::Result<T, NpzProblem>;
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
        NpzProblem::at(
            "archive",
            format!("not a complete .npz file: {}", one_line(&e)),
        )
    })?;
    for name in archive.file_names_raw() {
        let name = String::from_utf8_lossy(name);
        let array = npyz::npz::array_name_from_file_name(&name);
        if !array.is_some_and(|a| arrays.contains(&a)) {
            let problem = format!("unexpected entry {name:?}; expected {}", arrays.join(", "));
            return Err(NpzProblem::at("archive", problem));
        }
    }
    Ok(archive)
}

/// The message of a null error on one line.
pub(crate) fn one_line(error: &dyn Display) -> String {
    let text = error.to_string();
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// Number of items that are decoded at once.
const BLOCK: usize = 6 << 10;

/// An array that is unpacked and decoded as it is read, in C order; only one in Fortran order is held
/// in memory.
pub(crate) struct ArrayReader<'a, T: Deserialize> {
    name: &'a str,
    shape: Vec<u64>,
    decoder: T::TypeReader,
    input: Box<dyn Read + 'a>,
    /// Number of items that are still to be decoded.
    left: u64,
    bytes: Vec<u8>,
    block: Vec<T>,
    /// Number of items of the block that were read.
    read: usize,
}

impl<'a, T: Deserialize + Copy> ArrayReader<'a, T> {
    /// Opens an array of plain numbers. `shape` is the expected shape, with `None` where any length is
    /// valid.
    pub fn open<'bytes: 'a>(
        archive: &'a mut Archive<'bytes>,
        name: &'a str,
        type_name: &str,
        shape: &[Option<u64>],
    ) -> Checked<Self> {
        let file = npyz::npz::file_name_from_array_name(name);
        let entry = archive
            .by_name(&file)
            .map_err(|e| NpzProblem::at(name, format!("cannot be read: {}", one_line(&e))))?;
        if entry.size() > MAX_ARRAY_BYTES {
            let problem = format!("larger than {} MiB", MAX_ARRAY_BYTES >> 20);
            return Err(NpzProblem::at(name, problem));
        }
        // An entry may be larger than it says.
        let mut input = entry.take(MAX_ARRAY_BYTES);
        let header = read_header(name, &mut input)?;
        let found = header.shape().to_vec();
        let fits = found.len() == shape.len()
            && std::iter::zip(&found, shape).all(|(have, want)| want.is_none_or(|w| w == *have));
        if !fits {
            let problem = format!("expected shape {}, found {found:?}", shape_text(shape));
            return Err(NpzProblem::at(name, problem));
        }
        let dtype = header.dtype();
        let decoder = T::reader(&dtype).map_err(|_| {
            let found = dtype.descr();
            NpzProblem::at(name, format!("expected type {type_name}, found {found}"))
        })?;
        let mut array = Self {
            name,
            shape: found,
            decoder,
            input: Box::new(input),
            left: header.len(),
            bytes: Vec::new(),
            block: Vec::new(),
            read: 0,
        };
        match (header.order(), array.shape.as_slice()) {
            (Order::C, _) | (_, [_]) => {}
            (Order::Fortran, &[rows, columns]) => {
                let stored = array.remaining()?;
                array.block = transpose(&stored, rows as usize, columns as usize);
                array.read = 0;
            }
            _ => {
                return Err(NpzProblem::at(
                    name,
                    "expected C order, found Fortran order",
                ));
            }
        }
        Ok(array)
    }

    /// Length of the first dimension.
    pub fn rows(&self) -> u64 {
        self.shape.first().copied().unwrap_or(1)
    }

    /// The next `N` items.
    pub fn next_row<const N: usize>(&mut self) -> Checked<[T; N]> {
        // A block holds whole rows of up to three items.
        const { assert!(BLOCK.is_multiple_of(N)) };
        if self.read == self.block.len() {
            self.decode()?;
        }
        let rest = self.block[self.read..].first_chunk::<N>();
        let items = *rest.ok_or_else(|| self.too_short())?;
        self.read += N;
        Ok(items)
    }

    /// All items that are left.
    fn remaining(&mut self) -> Checked<Vec<T>> {
        let mut all = self.block.split_off(self.read);
        while self.left > 0 {
            self.decode()?;
            all.extend_from_slice(&self.block);
        }
        self.read = self.block.len();
        Ok(all)
    }

    /// Decodes the next block.
    fn decode(&mut self) -> Checked<()> {
        let count = self.left.min(BLOCK as u64) as usize;
        self.left -= count as u64;
        self.bytes.resize(count * size_of::<T>(), 0);
        let failed = |e: std::io::Error, array: &Self| match e.kind() {
            ErrorKind::UnexpectedEof => array.too_short(),
            _ => cannot_be_unpacked(array.name, &e),
        };
        if let Err(e) = self.input.read_exact(&mut self.bytes) {
            return Err(failed(e, self));
        }
        let mut bytes = self.bytes.as_slice();
        self.block.clear();
        self.read = 0;
        for _ in 0..count {
            match self.decoder.read_one(&mut bytes) {
                Ok(item) => self.block.push(item),
                Err(e) => return Err(failed(e, self)),
            }
        }
        Ok(())
    }

    fn too_short(&self) -> NpzProblem {
        let problem = format!("ends before its shape {:?} is filled", self.shape);
        NpzProblem::at(self.name, problem)
    }

    /// Checks that nothing follows the array's items, and that its entry is not damaged.
    pub fn finish(mut self) -> Checked<()> {
        let rest = std::io::copy(&mut self.input, &mut std::io::sink())
            .map_err(|e| cannot_be_unpacked(self.name, &e))?;
        if rest > 0 {
            let problem = format!("{rest} bytes follow the array's end");
            return Err(NpzProblem::at(self.name, problem));
        }
        Ok(())
    }
}

/// An array's items in C order. `shape` is the expected shape, with `None` where any length is
/// valid.
pub(crate) fn read_array<T: Deserialize + Copy>(
    archive: &mut Archive<'_>,
    name: &str,
    type_name: &str,
    shape: &[Option<u64>],
) -> Checked<Vec<T>> {
    let mut array = ArrayReader::open(archive, name, type_name, shape)?;
    let items = array.remaining()?;
    array.finish()?;
    Ok(items)
}

/// Items of an array that counts as small, and small arrays of an archive, at most.
#[cfg(feature = "vision")]
const MAX_SMALL: u64 = 64;

/// The small arrays of numbers of any archive, flat, with their names; the others without their items.
#[cfg(feature = "vision")]
pub(crate) fn small_arrays(bytes: &[u8]) -> Checked<Vec<(String, Vec<f64>)>> {
    let mut archive = ZipArchive::new(Cursor::new(bytes)).map_err(|e| {
        let problem = format!("not a complete .npz file: {}", one_line(&e));
        NpzProblem::at("archive", problem)
    })?;
    let files = archive.file_names_raw().map(String::from_utf8_lossy);
    let names =
        files.filter_map(|file| npyz::npz::array_name_from_file_name(&file).map(str::to_owned));
    let names: Vec<String> = names.take(MAX_SMALL as usize).collect();
    let arrays = names.into_iter().map(|name| {
        let items = small::<f64>(&mut archive, &name)
            .or_else(|| small::<f32>(&mut archive, &name).map(wide))
            .or_else(|| small::<i32>(&mut archive, &name).map(wide))
            .or_else(|| {
                let whole = small::<i64>(&mut archive, &name)?;
                Some(whole.iter().map(|n| *n as f64).collect())
            })
            .or_else(|| {
                let truths = small::<bool>(&mut archive, &name)?;
                Some(wide(truths.into_iter().map(u8::from).collect()))
            });
        (name, items.unwrap_or_default())
    });
    Ok(arrays.collect())
}

/// The items of an array of this type that counts as small.
#[cfg(feature = "vision")]
fn small<T: Deserialize + Copy>(archive: &mut Archive<'_>, name: &str) -> Option<Vec<T>> {
    let shapes: [&[Option<u64>]; 3] = [&[], &[None], &[None, None]];
    shapes.into_iter().find_map(|shape| {
        let mut array = ArrayReader::<T>::open(archive, name, "numbers", shape).ok()?;
        let is_small = array.left + array.block.len() as u64 <= MAX_SMALL;
        is_small.then(|| array.remaining().ok()).flatten()
    })
}

#[cfg(feature = "vision")]
fn wide<T: Into<f64>>(items: Vec<T>) -> Vec<f64> {
    items.into_iter().map(Into::into).collect()
}

fn cannot_be_unpacked(name: &str, error: &std::io::Error) -> NpzProblem {
    NpzProblem::at(name, format!("cannot be unpacked: {}", one_line(error)))
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

/// Reads an array's header; rejects texts on which its parser could overflow a number or the stack.
fn read_header(name: &str, input: &mut impl Read) -> Checked<NpyHeader> {
    let reject = |problem: &str| NpzProblem::at(name, format!("not an array: {problem}"));
    let none = |_| reject("no NumPy header");
    // Magic (6 bytes), version (2), then the text's length in 2 bytes, or 4 from version 2 on.
    let mut header = vec![0; 10];
    input.read_exact(&mut header).map_err(none)?;
    let length = match header.as_slice() {
        [b'\x93', b'N', b'U', b'M', b'P', b'Y', 1, _, a, b] => {
            usize::from(u16::from_le_bytes([*a, *b]))
        }
        [b'\x93', b'N', b'U', b'M', b'P', b'Y', 2 | 3, _, a, b] => {
            let mut high = [0; 2];
            input.read_exact(&mut high).map_err(none)?;
            let length = u32::from_le_bytes([*a, *b, high[0], high[1]]);
            header.extend(high);
            length as usize
        }
        _ => return Err(reject("no NumPy header")),
    };
    if length > MAX_HEADER_BYTES {
        return Err(reject("header too long"));
    }
    let start = header.len();
    header.resize(start + length, 0);
    let text = &mut header[start..];
    input
        .read_exact(text)
        .map_err(|_| reject("ends within its header"))?;
    let digits = text.iter().filter(|c| c.is_ascii_digit()).count();
    let brackets = text.iter().filter(|c| b"([{".contains(c)).count();
    // A digit before a letter starts a hexadecimal or other number that the digit count misses.
    let odd_number = text
        .windows(2)
        .any(|w| w[0].is_ascii_digit() && w[1].is_ascii_alphabetic());
    if digits > MAX_HEADER_DIGITS || brackets > MAX_HEADER_BRACKETS || odd_number {
        return Err(reject("header is not that of a plain array"));
    }
    NpyHeader::from_reader(header.as_slice()).map_err(|e| reject(&one_line(&e)))
}
