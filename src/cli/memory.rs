//! Work that the system grants too little memory for is refused before it begins, for all commands in one place.
//!
//! Rust ends a process whose memory is refused without a word that can be caught. What the system says beforehand
//! is the limit of the address space (`ulimit -v`, on Linux); a machine whose memory is used up ends the process
//! in its own way.

use crate::error::{Error, Result};

/// What a command needs of the address space.
#[derive(Clone, Copy)]
struct Need {
    /// MiB, whatever the number of threads.
    base: u64,
    /// Heaps for each thread that is asked for, and beside them. A stream of frames has workers beside the pool's, one that
    /// reads, and one that writes.
    heaps: (u64, u64),
}

/// Address space of a thread, MiB: a heap of 64, and its stack. Heaps take theirs before the work does: where there is no room for
/// them the work may be done without, and where there is, no room may be left for it. With two threads `estimate` runs within
/// 100 and 200 MiB, and fails at 300.
const THREAD_MIB: u64 = 66;
/// Heaps for each core at most, as the GNU C library has it.
const MAX_HEAPS: u64 = 8;
/// Meshes, pictures, races. A design of 8 dots with two threads: from 150 to 300 MiB.
const DESIGN: Need = Need {
    base: 256,
    heaps: (1, 0),
};
/// Clips of some megapixels: with one, two, four and eight threads they fail at 300, 500 and 900 MiB, and nowhere from 300, 350, 600 and 1100
/// on.
const CLIP: Need = Need {
    base: 128,
    heaps: (2, 3),
};
/// Dots of frames: with eight threads they fail at 624, and run within 800.
const DOTS: Need = Need {
    base: 64,
    heaps: (2, 3),
};
/// Trials, a stencil, a few images: a stencil fails at 60 MiB with two threads, and runs within 80.
const SMALL: Need = Need {
    base: 96,
    heaps: (1, 0),
};
/// What one thread does: 40 MiB are enough.
const LITTLE: Need = Need {
    base: 64,
    heaps: (0, 0),
};

impl Need {
    fn of(command: &str) -> Self {
        match command {
            "design" | "merge" | "advise" => DESIGN,
            "calibrate" | "estimate" | "live" => CLIP,
            "identify" => DOTS,
            "stencil" | "validate" | "synth" => SMALL,
            _ => LITTLE,
        }
    }

    fn mib(self, threads: u64) -> u64 {
        let (each, beside) = self.heaps;
        self.base + THREAD_MIB * (each * threads + beside).min(MAX_HEAPS * cores())
    }
}

/// The limit of the process' address space, MiB; `None` where there is none or the system does not say.
fn address_space_mib() -> Option<u64> {
    let limits = std::fs::read_to_string("/proc/self/limits").ok()?;
    let line = limits
        .lines()
        .find_map(|line| line.strip_prefix("Max address space"))?;
    let bytes: u64 = line.split_whitespace().next()?.parse().ok()?;
    Some(bytes >> 20)
}

/// The threads that there will be: to ask for their number would make them.
fn threads() -> u64 {
    let given = std::env::var("RAYON_NUM_THREADS").ok();
    let given = given.and_then(|text| text.parse().ok()).filter(|n| *n > 0);
    given.unwrap_or_else(cores)
}

fn cores() -> u64 {
    std::thread::available_parallelism().map_or(1, |n| n.get() as u64)
}

/// Rejects a limit that a command does not fit in.
///
/// # Errors
/// [`Error::Memory`] with the limit and what is needed.
pub(super) fn check(command: &str) -> Result<()> {
    let Some(granted) = address_space_mib() else {
        return Ok(());
    };
    let need = Need::of(command);
    let is_threaded = need.heaps.0 > 0;
    let threads = if is_threaded { threads() } else { 1 };
    let (needed, alone) = (need.mib(threads), need.mib(1));
    if granted >= needed {
        return Ok(());
    }
    let on = match is_threaded {
        true => format!(" on {threads} threads"),
        false => String::new(),
    };
    let or = match threads > 1 {
        true => format!("; RAYON_NUM_THREADS=1 needs {alone} MiB"),
        false => String::new(),
    };
    Err(Error::Memory(format!(
        "{command}{on} needs {needed} MiB of address space, the limit is {granted} MiB (ulimit -v{or})"
    )))
}
