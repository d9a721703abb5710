//! Writing files whole or not at all: written aside in the target's folder, then renamed.

use std::fs;
use std::io::Write;
use std::path::Path;

use crate::error::{Error, Result};

/// Creates `dir` and its parents.
///
/// # Errors
/// [`Error::Write`] where the system refuses.
pub fn create_dir(dir: &Path) -> Result<()> {
    fs::create_dir_all(dir).map_err(|e| Error::write(dir, e))
}

/// Creates `dir` and makes sure that files can be written there, before long work is begun for it.
///
/// # Errors
/// [`Error::Write`] where the system refuses.
pub fn create_writable_dir(dir: &Path) -> Result<()> {
    create_dir(dir)?;
    tempfile::Builder::new()
        .prefix(".spindoe-")
        .tempfile_in(dir)
        .map_err(|e| Error::write(dir, e))?;
    Ok(())
}

/// Writes what `fill` produces to `path`; the file appears whole or not at all.
///
/// # Errors
/// [`Error::Write`] where the system refuses, or the error of `fill`.
pub fn write_atomic(
    path: &Path,
    fill: impl FnOnce(&mut fs::File) -> std::io::Result<()>,
) -> Result<()> {
    let dir = match path.parent() {
        Some(p) if !p.as_os_str().is_empty() => p,
        _ => Path::new("."),
    };
    let io = |e| Error::write(path, e);
    let mut aside = builder().prefix(".spindoe-").tempfile_in(dir).map_err(io)?;
    fill(aside.as_file_mut()).map_err(io)?;
    aside.as_file_mut().flush().map_err(io)?;
    aside.persist(path).map_err(|e| io(e.error))?;
    Ok(())
}

/// The permissions of an ordinary new file (temporary files are private by default); the user's
/// umask still applies.
#[cfg(unix)]
fn builder() -> tempfile::Builder<'static, 'static> {
    use std::os::unix::fs::PermissionsExt;
    let mut builder = tempfile::Builder::new();
    builder.permissions(fs::Permissions::from_mode(0o666));
    builder
}

#[cfg(not(unix))]
fn builder() -> tempfile::Builder<'static, 'static> {
    tempfile::Builder::new()
}

/// The line, counted from 1, on which a CSV record begins; `fallback` where its position is unknown. The
/// reader's own count is one short after a line that ends in `\r\n`.
pub(crate) fn line_of(bytes: &[u8], position: Option<&csv::Position>, fallback: u64) -> u64 {
    let Some(position) = position else {
        return fallback;
    };
    let mut at = (position.byte() as usize).min(bytes.len());
    while matches!(bytes.get(at), Some(b'\r' | b'\n')) {
        at += 1;
    }
    1 + bytes[..at].iter().filter(|&&b| b == b'\n').count() as u64
}

/// Writes bytes to `path`, whole or not at all.
///
/// # Errors
/// [`Error::Write`] where the system refuses.
pub fn write_bytes(path: &Path, bytes: &[u8]) -> Result<()> {
    write_atomic(path, |f| f.write_all(bytes))
}

/// Removes a file that need not be there.
///
/// # Errors
/// [`Error::Write`] where the system refuses.
pub fn remove_if_present(path: &Path) -> Result<()> {
    match fs::remove_file(path) {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => Err(Error::write(path, e)),
        _ => Ok(()),
    }
}

/// Reads a whole file.
///
/// # Errors
/// [`Error::Read`] where the system refuses.
pub fn read_bytes(path: &Path) -> Result<Vec<u8>> {
    fs::read(path).map_err(|e| Error::read(path, e))
}
