//! Atomic file writes: a temporary file in the target's folder, brought to the disk, then a rename.
//! A link is followed: its target is replaced, and the link stays.

use std::fs;
use std::io::{BufReader, Read, Write};
use std::path::{Path, PathBuf};

use super::aside::{AsideFile, settle};
use crate::error::{Error, Result};

/// Bytes per read.
const READ_BYTES: usize = 1 << 16;

/// Creates `dir` and its parents.
///
/// # Errors
/// [`Error::Write`] on an I/O failure.
pub fn create_dir(dir: &Path) -> Result<()> {
    fs::create_dir_all(dir).map_err(|e| Error::write(dir, e))
}

/// Checks that `path` can be written, before long work begins; nothing is left there.
///
/// # Errors
/// [`Error::Write`] on an I/O failure.
pub fn check_writable(path: &Path) -> Result<()> {
    match fs::metadata(path).is_ok_and(|m| !m.is_file() && !m.is_dir()) {
        // A pipe that is opened and closed again has ended for its reader.
        true => Ok(()),
        false => OutputFile::create(path).map(drop),
    }
}

/// Creates `dir` and checks that files can be written there, before long work begins.
///
/// # Errors
/// [`Error::Write`] on an I/O failure.
pub fn create_writable_dir(dir: &Path) -> Result<()> {
    create_dir(dir)?;
    AsideFile::new(dir).map_err(|e| Error::write(dir, e))?;
    Ok(())
}

/// Checks that `dir` can be made and written to, and leaves nothing of it.
///
/// # Errors
/// As [`create_writable_dir`].
#[cfg(feature = "cli")]
pub(crate) fn check_writable_dir(dir: &Path) -> Result<()> {
    let absent = |d: &&Path| !d.as_os_str().is_empty() && !d.exists();
    let made: Vec<&Path> = dir.ancestors().take_while(absent).collect();
    let checked = create_writable_dir(dir);
    for dir in made {
        // What another run has put there meanwhile stays.
        let _ = fs::remove_dir(dir);
    }
    checked
}

/// Rejects a folder that already holds `what`, as one of `files` shows: two must not mix in one.
/// `advice` ends the message.
///
/// # Errors
/// [`Error::Argument`] of the parameter `out`.
pub(crate) fn reject_taken(dir: &Path, files: &[&str], what: &str, advice: &str) -> Result<()> {
    settle(dir);
    match files.iter().find(|name| dir.join(name).exists()) {
        None => Ok(()),
        Some(name) => {
            let dir = dir.display();
            let problem = format!("{dir} holds {what} already ({name}); {advice}");
            Err(Error::argument("out", problem))
        }
    }
}

/// Writes the output of `fill` to `path`; the file appears complete or not at all.
///
/// # Errors
/// [`Error::Write`] on an I/O failure, or the error of `fill`.
pub fn write_atomic(
    path: &Path,
    fill: impl FnOnce(&mut fs::File) -> std::io::Result<()>,
) -> Result<()> {
    let mut output = OutputFile::create(path)?;
    fill(output.file.as_file_mut()).map_err(|e| Error::write(path, e))?;
    output.finish()
}

/// A file that is written piece by piece and appears complete, at [`OutputFile::finish`], or not at
/// all. A target that is no regular file (a pipe, a terminal, `/dev/stdout`) gets the bytes
/// directly.
pub struct OutputFile {
    /// As named by the user.
    path: PathBuf,
    /// What appears at the end, behind all links.
    target: PathBuf,
    file: Target,
}

/// Maximum number of links in a row that are followed.
const MAX_LINKS: usize = 40;

/// The file behind a chain of links; it need not exist.
fn behind_links(path: &Path) -> std::io::Result<PathBuf> {
    let mut target = path.to_path_buf();
    for _ in 0..MAX_LINKS {
        match fs::read_link(&target) {
            // Relative to the link's own folder.
            Ok(next) => target = folder(&target).join(next),
            Err(_) => return Ok(target),
        }
    }
    Err(std::io::Error::new(
        std::io::ErrorKind::InvalidInput,
        "too many links in a row",
    ))
}

/// The folder of a file.
fn folder(path: &Path) -> &Path {
    match path.parent() {
        Some(p) if !p.as_os_str().is_empty() => p,
        _ => Path::new("."),
    }
}

enum Target {
    Aside(AsideFile),
    Direct(fs::File),
}

impl Target {
    fn as_file_mut(&mut self) -> &mut fs::File {
        match self {
            Self::Aside(aside) => aside.as_file_mut(),
            Self::Direct(file) => file,
        }
    }
}

impl OutputFile {
    /// Begins the file `path`.
    ///
    /// # Errors
    /// [`Error::Write`] on an I/O failure.
    pub fn create(path: &Path) -> Result<Self> {
        let io = |e| Error::write(path, e);
        let target = behind_links(path).map_err(io)?;
        if fs::metadata(&target).is_ok_and(|m| m.is_dir()) {
            return Err(io(std::io::ErrorKind::IsADirectory.into()));
        }
        let is_special = fs::metadata(path).is_ok_and(|m| !m.is_file() && !m.is_dir());
        let file = if is_special {
            Target::Direct(fs::OpenOptions::new().write(true).open(path).map_err(io)?)
        } else {
            Target::Aside(AsideFile::new(folder(&target)).map_err(io)?)
        };
        Ok(Self {
            path: path.to_path_buf(),
            target,
            file,
        })
    }

    /// Ends the file, which exists under its name from here on.
    ///
    /// # Errors
    /// [`Error::Write`] on an I/O failure.
    pub fn finish(mut self) -> Result<()> {
        let io = |e| Error::write(&self.path, e);
        self.file.as_file_mut().flush().map_err(io)?;
        if let Target::Aside(aside) = self.file {
            aside.persist(&self.target).map_err(io)?;
        }
        Ok(())
    }
}

impl Write for OutputFile {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.file.as_file_mut().write(bytes)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.file.as_file_mut().flush()
    }
}

/// A folder that one process at a time works in. The lock ends with the process, however that ends.
#[derive(Debug)]
pub struct FolderLock {
    _file: fs::File,
}

/// The lock's file.
const LOCK: &str = ".spindoe.lock";

impl FolderLock {
    /// Creates `dir` and takes its lock.
    ///
    /// # Errors
    /// [`Error::Argument`] of the parameter `out` where another process has it; [`Error::Write`] on
    /// an I/O failure.
    pub fn take(dir: &Path) -> Result<Self> {
        create_writable_dir(dir)?;
        let path = dir.join(LOCK);
        let file = fs::OpenOptions::new()
            .create(true)
            .truncate(false)
            .write(true)
            .open(&path)
            .map_err(|e| Error::write(&path, e))?;
        match file.try_lock() {
            Ok(()) => Ok(Self { _file: file }),
            Err(fs::TryLockError::WouldBlock) => {
                let dir = dir.display();
                let problem = format!("another run works in {dir}: choose another folder");
                Err(Error::argument("out", problem))
            }
            // A file system without locks keeps nobody out.
            Err(fs::TryLockError::Error(e)) if e.kind() == std::io::ErrorKind::Unsupported => {
                Ok(Self { _file: file })
            }
            Err(fs::TryLockError::Error(e)) => Err(Error::write(&path, e)),
        }
    }
}

/// Removes a file, or a folder with all that is in it, if it exists.
///
/// # Errors
/// [`Error::Write`] on an I/O failure.
pub fn remove_any(path: &Path) -> Result<()> {
    match fs::symlink_metadata(path) {
        Ok(found) if found.is_dir() => fs::remove_dir_all(path).map_err(|e| Error::write(path, e)),
        _ => remove_if_present(path),
    }
}

/// Writes bytes to `path` atomically.
///
/// # Errors
/// [`Error::Write`] on an I/O failure.
pub fn write_bytes(path: &Path, bytes: &[u8]) -> Result<()> {
    write_atomic(path, |f| f.write_all(bytes))
}

/// Removes a file if it exists.
///
/// # Errors
/// [`Error::Write`] on an I/O failure.
pub fn remove_if_present(path: &Path) -> Result<()> {
    match fs::remove_file(path) {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => Err(Error::write(path, e)),
        _ => Ok(()),
    }
}

/// Maximum size of a file that a person writes: a pattern, a camera, a configuration. A pattern of
/// 64 dots has 4 kB.
pub const MAX_TEXT_BYTES: u64 = 1 << 20;
/// Maximum size of an archive of arrays: a table, a net's weights. A table of 64 dots has 7.5 MB, the
/// largest net that is shipped 0.6 MB.
pub const MAX_ARCHIVE_BYTES: u64 = 16 << 20;
/// Maximum size of any other file that is read whole: a checkpoint, a report, a mesh. The checkpoint of a
/// thousand merged shards of 64 dots has 48 MB, a half of a stencil 1 MB.
pub const MAX_FILE_BYTES: u64 = 64 << 20;
/// Maximum number of rows of a table that is held whole: 50 minutes at 350 frames a second.
#[cfg(feature = "vision")]
pub(crate) const MAX_ROWS: usize = 1 << 20;

/// Reads a whole file of at most [`MAX_FILE_BYTES`].
///
/// # Errors
/// As [`read_at_most`].
pub fn read_bytes(path: &Path) -> Result<Vec<u8>> {
    read_at_most(path, MAX_FILE_BYTES)
}

/// Reads a whole file of at most `max_bytes`. Of a device or a pipe without an end no more is read.
///
/// # Errors
/// [`Error::Read`] on an I/O failure; [`Error::Input`] where the file is longer.
pub fn read_at_most(path: &Path, max_bytes: u64) -> Result<Vec<u8>> {
    let file = fs::File::open(path).map_err(|e| Error::read(path, e))?;
    let size = file.metadata().map_or(0, |m| m.len());
    let mut bytes = Vec::with_capacity(size.min(max_bytes) as usize + 1);
    read_rest(path, file, max_bytes, &mut bytes)?;
    Ok(bytes)
}

/// Appends all that is left of `input`, at most `max_bytes`, to `bytes`; `path` names it in errors.
pub(crate) fn read_rest(
    path: &Path,
    input: impl Read,
    max_bytes: u64,
    bytes: &mut Vec<u8>,
) -> Result<()> {
    // One byte more than allowed distinguishes "too long" from "just fits".
    let read = input.take(max_bytes.saturating_add(1)).read_to_end(bytes);
    if read.map_err(|e| Error::read(path, e))? as u64 > max_bytes {
        let most = match max_bytes >> 20 {
            0 => format!("{max_bytes} bytes"),
            mebibytes => format!("{mebibytes} MiB"),
        };
        let problem = format!("expected at most {most}, found more");
        return Err(Error::input(path, "file", problem));
    }
    Ok(())
}

/// Opens a file to be read piece by piece.
///
/// # Errors
/// [`Error::Read`] on an I/O failure.
pub fn open(path: &Path) -> Result<BufReader<fs::File>> {
    let file = fs::File::open(path).map_err(|e| Error::read(path, e))?;
    Ok(BufReader::with_capacity(READ_BYTES, file))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_an_endless_input_no_more_is_read_than_fits() {
        let path = Path::new("endless");
        let mut bytes = Vec::new();
        let error = read_rest(path, std::io::repeat(7), 1 << 20, &mut bytes).expect_err("too long");
        assert_eq!(
            error.to_string(),
            "endless: file: expected at most 1 MiB, found more"
        );
        assert!(error.is_usage() && bytes.len() == (1 << 20) + 1);
        bytes.clear();
        assert!(read_rest(path, std::io::repeat(7).take(10), 10, &mut bytes).is_ok());
        assert_eq!(bytes, [7; 10]);
    }
}
