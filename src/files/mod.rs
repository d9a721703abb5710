//! Files: written atomically (a temporary file in the target's folder, then a rename), and CSV
//! tables read row by row.

#[cfg(feature = "native")]
mod aside;
pub(crate) mod csv;
#[cfg(feature = "native")]
mod disk;

#[cfg(feature = "native")]
pub use aside::Replacement;
#[cfg(feature = "cli")]
pub(crate) use aside::remove_all_asides;
#[cfg(feature = "cli")]
pub(crate) use disk::check_writable_dir;
#[cfg(feature = "native")]
pub(crate) use disk::reject_taken;
#[cfg(feature = "native")]
pub use disk::{
    FolderLock, MAX_ARCHIVE_BYTES, MAX_FILE_BYTES, MAX_TEXT_BYTES, OutputFile, check_writable,
    create_dir, create_writable_dir, open, read_at_most, read_bytes, remove_any, remove_if_present,
    write_atomic, write_bytes,
};
#[cfg(feature = "vision")]
pub(crate) use disk::{MAX_ROWS, read_rest};

/// Whole numbers in frames' names are times in nanoseconds (SpinDOE's convention), unless they step by less than this in the median: such
/// number the frames. The published frames step by 2.6 million.
const MIN_STEP_NS: u64 = 10_000;

/// The nanoseconds of a name that is a whole number.
pub(crate) fn nanoseconds(name: &str) -> Option<u64> {
    let is_whole = !name.is_empty() && name.bytes().all(|b| b.is_ascii_digit());
    name.parse().ok().filter(|_| is_whole)
}

/// The median of the steps between such numbers, where it is so small that they number the frames.
pub(crate) fn frame_number_step(mut steps_ns: Vec<u64>) -> Option<u64> {
    let middle = steps_ns.len() / 2;
    if steps_ns.is_empty() {
        return None;
    }
    let (_, median, _) = steps_ns.select_nth_unstable(middle);
    Some(*median).filter(|step| *step < MIN_STEP_NS)
}

/// SHA-256 of bytes, hexadecimal.
pub fn sha256_hex(bytes: &[u8]) -> String {
    use sha2::{Digest, Sha256};
    Sha256::digest(bytes)
        .iter()
        .map(|byte| format!("{byte:02x}"))
        .collect()
}
