//! Fuzz targets: one for each reader. `readers.rs` is shared with the ordinary test that replays the
//! corpus.

pub mod readers;

/// Reads `bytes` as a fuzz target of this name does.
///
/// # Panics
/// Where the reader breaks its promise, and for a target that does not exist.
pub fn run(target: &str, bytes: &[u8]) {
    let reader = readers::READERS.iter().find(|r| r.0 == target);
    let (_, read) = reader.expect("a target's name");
    readers::check(*read, bytes);
}
