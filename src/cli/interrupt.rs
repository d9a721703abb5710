//! What SIGINT (Ctrl-C), SIGTERM and SIGHUP do: temporary files are removed, and the process ends. A
//! command that can end its work in order is asked to at the first signal; the second says what is kept on disk.
//!
//! On Linux, a signal that was ignored when the process began stays so: `nohup` keeps a command
//! running.

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use super::output::clear_bar;
use crate::error::{Error, Result};
use crate::files;

/// The flag that the first signal sets, once a command has asked for it.
static STOP: OnceLock<Arc<AtomicBool>> = OnceLock::new();
/// What the first signal is answered with.
static ANSWER: Mutex<&str> = Mutex::new("");
/// What the process is ended with, once this file is there.
static KEPT: Mutex<Option<(PathBuf, String)>> = Mutex::new(None);
/// Whether signals are caught.
static CAUGHT: OnceLock<std::result::Result<(), String>> = OnceLock::new();

/// The signal of Ctrl-C.
#[cfg(unix)]
const SIGINT: i32 = signal_hook::consts::SIGINT;
#[cfg(not(unix))]
const SIGINT: i32 = 2;

/// Catches signals from here on. Where that fails, they end the process as ever.
pub(super) fn catch() {
    CAUGHT.get_or_init(|| listen().map_err(|e| e.to_string()));
}

/// A flag that the first signal sets, which is answered with these words at once; the second ends the process.
pub(super) fn stop_on_interrupt(answer: &'static str) -> Result<Arc<AtomicBool>> {
    catch();
    if let Some(Err(e)) = CAUGHT.get() {
        return Err(Error::Internal(format!("Ctrl-C cannot be caught: {e}")));
    }
    *ANSWER.lock().unwrap_or_else(PoisonError::into_inner) = answer;
    let stop = STOP.get_or_init(Arc::default);
    // In a process that runs several commands, the last one's signal is past.
    stop.store(false, Ordering::Relaxed);
    Ok(Arc::clone(stop))
}

/// What a signal that ends the process says where `file` is there by then: that it is kept, and what to do with it.
pub(super) fn keeps(file: PathBuf, words: String) {
    *KEPT.lock().unwrap_or_else(PoisonError::into_inner) = Some((file, words));
}

#[cfg(unix)]
fn listen() -> std::io::Result<()> {
    use signal_hook::consts::{SIGHUP, SIGTERM};
    let ignored = ignored();
    let caught = [SIGINT, SIGTERM, SIGHUP].into_iter();
    let caught = caught.filter(|signal| ignored >> (signal - 1) & 1 == 0);
    let mut signals = signal_hook::iterator::Signals::new(caught)?;
    let listen = move || signals.forever().for_each(interrupted);
    let thread = std::thread::Builder::new().name("signals".to_owned());
    thread.spawn(listen).map(drop)
}

/// The signals that the process ignores, bit n - 1 for signal n; none where the system does not say.
#[cfg(unix)]
fn ignored() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok())
        .unwrap_or(0)
}

#[cfg(not(unix))]
fn listen() -> std::result::Result<(), ctrlc::Error> {
    ctrlc::set_handler(|| interrupted(SIGINT))
}

/// Asks the command to stop, or ends the process with the exit code that shells give to the signal.
fn interrupted(signal: i32) {
    let is_asked = STOP
        .get()
        .is_some_and(|stop| !stop.swap(true, Ordering::Relaxed));
    if is_asked {
        let answer = *ANSWER.lock().unwrap_or_else(PoisonError::into_inner);
        errln!("{}spindoe: {answer}", clear_bar(signal == SIGINT));
    } else {
        files::remove_all_asides();
        let kept = KEPT.lock().unwrap_or_else(PoisonError::into_inner);
        let clear = clear_bar(signal == SIGINT);
        match kept.as_ref().filter(|(file, _)| file.exists()) {
            Some((_, words)) => errln!("{clear}spindoe: {words}"),
            // No bar stays on the terminal.
            None if !clear.is_empty() => errln!("{clear}spindoe: stopped"),
            None => {}
        }
        std::process::exit(128 + signal);
    }
}
