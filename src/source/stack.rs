//! The pages of a TIFF file, each a picture: cameras and ImageJ store clips so.
//!
//! Pages form a chain: the header says where the first one's directory lies, each directory where the next does (Adobe, "TIFF revision
//! 6.0", 1992; BigTIFF with longer numbers). A page is decoded as the first one of a file whose header leads to it. Reduced copies of other
//! pages are left out.

use std::path::Path;

use crate::error::{Error, Result};
use crate::image::Picture;

/// Pages of a file, at most: more than two hours at 10 a second. It also ends a chain that leads back.
const MAX_PAGES: usize = 100_000;
/// The tag of what a page is, and the bit of a reduced copy.
const SUBFILE_TYPE: u64 = 254;
const IS_REDUCED: u64 = 1;

/// How numbers are written.
#[derive(Clone, Copy)]
struct NumberLayout {
    is_little: bool,
    is_big_tiff: bool,
}

impl NumberLayout {
    fn of(bytes: &[u8]) -> Option<Self> {
        let (is_little, is_big_tiff) = match bytes.first_chunk()? {
            b"II*\0" => (true, false),
            b"MM\0*" => (false, false),
            b"II+\0" => (true, true),
            b"MM\0+" => (false, true),
            _ => return None,
        };
        Some(Self {
            is_little,
            is_big_tiff,
        })
    }

    fn number(self, bytes: &[u8], at: u64, length: usize) -> Option<u64> {
        let at = usize::try_from(at).ok()?;
        let bytes = bytes.get(at..at.checked_add(length)?)?;
        let shifted = |sum: u64, byte: &u8| sum << 8 | u64::from(*byte);
        Some(match self.is_little {
            true => bytes.iter().rev().fold(0, shifted),
            false => bytes.iter().fold(0, shifted),
        })
    }

    /// Where the header says that the first directory lies, and in how many bytes.
    fn header(self) -> (usize, usize) {
        if self.is_big_tiff { (8, 8) } else { (4, 4) }
    }

    /// Whether the page of this directory is a picture of its own, and where the next one lies; 0 for none.
    fn directory(self, bytes: &[u8], at: u64) -> Option<(bool, u64)> {
        let (count_length, entry, value, offset) = match self.is_big_tiff {
            true => (8, 20, 12, 8),
            false => (2, 12, 8, 4),
        };
        let count = self.number(bytes, at, count_length)?;
        let first = at.checked_add(count_length as u64)?;
        let next = first.checked_add(count.checked_mul(entry)?)?;
        let mut is_own = true;
        for k in 0..count.min(1000) {
            let entry = first + k * entry;
            if self.number(bytes, entry, 2)? == SUBFILE_TYPE {
                is_own = self.number(bytes, entry + value, 4)? & IS_REDUCED == 0;
            }
        }
        Some((is_own, self.number(bytes, next, offset)?))
    }
}

/// Whether a file that starts so is a TIFF file.
pub(super) fn is_tiff(start: &[u8]) -> bool {
    NumberLayout::of(start).is_some()
}

/// The directories of a TIFF file's pictures; of one for another file, and for one that is damaged.
pub(super) fn pages(bytes: &[u8]) -> Vec<u64> {
    let mut pages = Vec::new();
    let Some(layout) = NumberLayout::of(bytes) else {
        return pages;
    };
    let (at, length) = layout.header();
    let mut next = layout.number(bytes, at as u64, length).unwrap_or(0);
    while next != 0 && pages.len() < MAX_PAGES {
        let Some((is_own, after)) = layout.directory(bytes, next) else {
            break;
        };
        if is_own {
            pages.push(next);
        }
        next = after;
    }
    pages
}

/// The picture of the page whose directory lies at `page`, in a file's bytes whose header is changed.
///
/// # Errors
/// As [`Picture::decode`].
pub(super) fn read_page(
    path: &Path,
    bytes: &mut [u8],
    page: u64,
    max_pixels: u64,
) -> Result<Picture> {
    let layout = NumberLayout::of(bytes);
    let header = layout.and_then(|layout| {
        let (at, length) = layout.header();
        Some((layout, bytes.get_mut(at..at + length)?))
    });
    let Some((layout, header)) = header else {
        return Err(Error::input(path, "image", "expected a TIFF file"));
    };
    let length = header.len();
    match layout.is_little {
        true => header.copy_from_slice(&page.to_le_bytes()[..length]),
        false => header.copy_from_slice(&page.to_be_bytes()[8 - length..]),
    }
    Picture::decode(path, bytes, max_pixels)
}
