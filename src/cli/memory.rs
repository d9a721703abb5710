//! Work that the system grants too little memory for is refused before it begins.
//!
//! Rust ends a process whose memory is refused without a word that can be caught. What the system says beforehand
//! is the limit of the address space (`ulimit -v`, on Linux); a machine whose memory is used up ends the process
//! in its own way.

use crate::error::{Error, Result};

/// Address space of a design, MiB: that of its meshes and pictures, and of each thread's stack and heap.
/// Measured with two threads: from 150 to 300.
const BASE_MIB: u64 = 256;
const THREAD_MIB: u64 = 66;

/// The limit of the process' address space, MiB; `None` where there is none or the system does not say.
fn address_space_mib() -> Option<u64> {
    let limits = std::fs::read_to_string("/proc/self/limits").ok()?;
    let line = limits
        .lines()
        .find_map(|line| line.strip_prefix("Max address space"))?;
    let bytes: u64 = line.split_whitespace().next()?.parse().ok()?;
    Some(bytes >> 20)
}

/// Rejects a limit that a design does not fit in.
///
/// # Errors
/// [`Error::Memory`] with the limit and what is needed.
pub(super) fn check_for_design() -> Result<()> {
    let threads = rayon::current_num_threads() as u64;
    let needed = BASE_MIB + THREAD_MIB * threads;
    match address_space_mib() {
        Some(granted) if granted < needed => Err(Error::Memory(format!(
            "a design on {threads} threads needs {needed} MiB of address space, the limit is {granted} MiB \
             (ulimit -v; RAYON_NUM_THREADS=1 needs {} MiB)",
            BASE_MIB + THREAD_MIB
        ))),
        _ => Ok(()),
    }
}
