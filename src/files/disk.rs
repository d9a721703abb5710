//! Atomic file writes: a temporary file in the target's folder, then a rename.

use std::fs;
use std::io::{BufReader, Write};
use std::path::{Path, PathBuf};

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

/// Creates `dir` and checks that files can be written there, before long work begins.
///
/// # Errors
/// [`Error::Write`] on an I/O failure.
pub fn create_writable_dir(dir: &Path) -> Result<()> {
    create_dir(dir)?;
    tempfile::Builder::new()
        .prefix(".spindoe-")
        .tempfile_in(dir)
        .map_err(|e| Error::write(dir, e))?;
    Ok(())
}

/// Rejects a folder that already holds `what`, as one of `files` shows: two must not mix in one.
/// `advice` ends the message.
///
/// # Errors
/// [`Error::Argument`] of the parameter `out`.
pub(crate) fn reject_taken(dir: &Path, files: &[&str], what: &str, advice: &str) -> Result<()> {
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
    path: PathBuf,
    file: Target,
}

enum Target {
    Aside(tempfile::NamedTempFile),
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
        let is_special = fs::metadata(path).is_ok_and(|m| !m.is_file() && !m.is_dir());
        let file = if is_special {
            Target::Direct(fs::OpenOptions::new().write(true).open(path).map_err(io)?)
        } else {
            let dir = match path.parent() {
                Some(p) if !p.as_os_str().is_empty() => p,
                _ => Path::new("."),
            };
            Target::Aside(builder().prefix(".spindoe-").tempfile_in(dir).map_err(io)?)
        };
        Ok(Self {
            path: path.to_path_buf(),
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
            aside.persist(&self.path).map_err(|e| io(e.error))?;
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

/// Reads a whole file.
///
/// # Errors
/// [`Error::Read`] on an I/O failure.
pub fn read_bytes(path: &Path) -> Result<Vec<u8>> {
    fs::read(path).map_err(|e| Error::read(path, e))
}

/// Opens a file to be read piece by piece.
///
/// # Errors
/// [`Error::Read`] on an I/O failure.
pub fn open(path: &Path) -> Result<BufReader<fs::File>> {
    let file = fs::File::open(path).map_err(|e| Error::read(path, e))?;
    Ok(BufReader::with_capacity(READ_BYTES, file))
}
