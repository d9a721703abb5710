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

/// SHA-256 of bytes, hexadecimal.
pub fn sha256_hex(bytes: &[u8]) -> String {
    use sha2::{Digest, Sha256};
    Sha256::digest(bytes)
        .iter()
        .map(|byte| format!("{byte:02x}"))
        .collect()
}
