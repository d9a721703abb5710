//! What is written beside its place until it is whole: temporary files and folders.
//!
//! Their names begin with [`PREFIX`], and a lock says that their maker is alive. They are removed
//! when they are dropped, by [`remove_all_asides`] when a signal ends the process, and by
//! [`settle`], in the next run that writes to the same folder, where neither took place: a kill or
//! a loss of power. A folder that was whole by then is moved into its place instead.
//!
//! A file system without locks keeps what a killed run left.

use std::collections::BTreeSet;
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::{LazyLock, Mutex, MutexGuard};

use crate::error::{Error, Result};

/// How the names of temporary files and folders begin.
const PREFIX: &str = ".spindoe-";
/// In a temporary folder: the file whose lock its maker holds.
const ALIVE: &str = ".alive";
/// In a temporary folder that is whole: the names that have no place beside it, one a line.
const WHOLE: &str = ".whole";

/// The temporary files and folders of this process. Locked while one of them is made or brought to its
/// place, which a signal so waits for, and from the signal on.
static MADE: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());
/// The folders that were settled.
static SETTLED: LazyLock<Mutex<BTreeSet<PathBuf>>> = LazyLock::new(Mutex::default);

/// A set of paths, whatever befell the thread that used it last.
fn locked(paths: &Mutex<BTreeSet<PathBuf>>) -> MutexGuard<'_, BTreeSet<PathBuf>> {
    paths
        .lock()
        .unwrap_or_else(|poisoned| poisoned.into_inner())
}

/// Removes the temporary files and folders of this process. From here on none can be brought to its
/// place: the process must end.
#[cfg(feature = "cli")]
pub(crate) fn remove_all_asides() {
    let made = locked(&MADE);
    for path in made.iter() {
        // What cannot be removed is left to the next run.
        let _ = super::remove_any(path);
    }
    std::mem::forget(made);
}

/// Takes the lock that says that a maker is alive; `false` where another process has it or may have.
fn take(file: &fs::File) -> bool {
    file.try_lock().is_ok()
}

/// Removes what killed runs left in a folder, and ends the moves that they had begun; once for each
/// folder. What cannot be removed stays.
pub(super) fn settle(dir: &Path) {
    if !locked(&SETTLED).insert(dir.to_path_buf()) {
        return;
    }
    for entry in fs::read_dir(dir).into_iter().flatten().flatten() {
        let Ok(kind) = entry.file_type() else {
            continue;
        };
        if !entry.file_name().to_string_lossy().starts_with(PREFIX) {
            continue;
        }
        let path = entry.path();
        if kind.is_file() {
            let found = fs::OpenOptions::new().write(true).open(&path);
            if found.is_ok_and(|file| take(&file)) {
                let _ = fs::remove_file(&path);
            }
        } else if kind.is_dir() {
            settle_folder(dir, &path);
        }
    }
}

/// Moves a folder that is whole into its place; removes another one.
fn settle_folder(dir: &Path, path: &Path) {
    let alive = fs::OpenOptions::new().write(true).open(path.join(ALIVE));
    match alive {
        Ok(file) if take(&file) => {}
        // Killed between the folder and the file in it.
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => {}
        _ => return,
    }
    if let Ok(removed) = fs::read_to_string(path.join(WHOLE))
        && moves(dir, path, removed.lines(), "")
            .and_then(|moves| moves.iter().try_for_each(Move::make))
            .is_err()
    {
        return;
    }
    let _ = fs::remove_dir_all(path);
}

/// A step of a set of files to its place.
#[derive(Debug)]
enum Move {
    /// What is replaced goes.
    Remove(PathBuf),
    /// What is new comes, from the first path to the second.
    Bring(PathBuf, PathBuf),
}

impl Move {
    fn make(&self) -> Result<()> {
        match self {
            Self::Remove(path) => super::remove_any(path),
            Self::Bring(from, to) => {
                // A folder is no file that a rename replaces.
                if from.is_dir() {
                    super::remove_any(to)?;
                }
                fs::rename(from, to).map_err(|e| Error::write(to, e))
            }
        }
    }
}

/// The steps that remove the files `removed` of `dir` and move those of `from` in; `last` appears when all others
/// are there.
fn moves<'a>(
    dir: &Path,
    from: &Path,
    removed: impl Iterator<Item = &'a str>,
    last: &str,
) -> Result<Vec<Move>> {
    let mut names = names(from)?;
    names.sort_by_key(|name| (name == last, name.clone()));
    let remove = removed.map(|name| Move::Remove(dir.join(name)));
    let bring = names
        .iter()
        .map(|name| Move::Bring(from.join(name), dir.join(name)));
    Ok(remove.chain(bring).collect())
}

/// The names in a temporary folder, without those that are its own.
fn names(from: &Path) -> Result<Vec<String>> {
    let io = |e| Error::read(from, e);
    let mut names = Vec::new();
    for entry in fs::read_dir(from).map_err(io)? {
        let name = entry.map_err(io)?.file_name();
        // Names are ours, and text.
        let name = name.to_string_lossy().into_owned();
        if name != ALIVE && name != WHOLE {
            names.push(name);
        }
    }
    Ok(names)
}

/// The entry of a temporary file or folder in [`MADE`], which ends when it is dropped.
#[derive(Debug)]
struct MadeFolder(PathBuf);

impl Drop for MadeFolder {
    fn drop(&mut self) {
        locked(&MADE).remove(&self.0);
    }
}

/// How often a temporary file is made anew whose lock another process took to remove it.
const ATTEMPTS: usize = 8;

/// Makes something, as often as another process takes its lock first.
fn made<T>(
    mut make: impl FnMut() -> std::io::Result<T>,
    is_ours: impl Fn(&T) -> bool,
) -> std::io::Result<T> {
    for _ in 1..ATTEMPTS {
        let made = make()?;
        if is_ours(&made) {
            return Ok(made);
        }
    }
    make()
}

/// A temporary file in the folder of its target.
#[derive(Debug)]
pub(super) struct AsideFile {
    // Dropped in this order: the file is gone when it is forgotten.
    file: tempfile::NamedTempFile,
    made: MadeFolder,
}

impl AsideFile {
    /// A new file in `dir`.
    pub fn new(dir: &Path) -> std::io::Result<Self> {
        settle(dir);
        let mut all = locked(&MADE);
        let file = made(
            || builder().prefix(PREFIX).tempfile_in(dir),
            // A file system without locks answers neither way; the file is used.
            |file| !would_block(file.as_file()) && file.path().exists(),
        )?;
        let made = MadeFolder(file.path().to_path_buf());
        all.insert(made.0.clone());
        Ok(Self { file, made })
    }

    /// The file itself.
    pub fn as_file_mut(&mut self) -> &mut fs::File {
        self.file.as_file_mut()
    }

    /// Brings the file to its place.
    pub fn persist(self, target: &Path) -> std::io::Result<()> {
        // A rename that reaches the disk before the content would leave an empty file.
        self.file.as_file().sync_all()?;
        let mut all = locked(&MADE);
        self.file.persist(target).map_err(|e| e.error)?;
        all.remove(&self.made.0);
        Ok(())
    }
}

/// Takes the lock; whether another process has it.
fn would_block(file: &fs::File) -> bool {
    matches!(file.try_lock(), Err(fs::TryLockError::WouldBlock))
}

/// A set of files that replaces another one in a folder: written in a temporary folder within it,
/// then moved. At no time do files of both sets stand beside each other. Dropped before
/// [`Replacement::publish`], it leaves the folder as it was.
#[derive(Debug)]
pub struct Replacement {
    // Dropped in this order: an open file may keep its folder from being removed.
    _alive: fs::File,
    folder: tempfile::TempDir,
    _made: MadeFolder,
    dir: TargetFolder,
}

/// The folder of a set of files; one that was made for it is removed where it stays empty.
#[derive(Debug)]
struct TargetFolder {
    path: PathBuf,
    is_new: bool,
}

impl Drop for TargetFolder {
    fn drop(&mut self) {
        if self.is_new {
            // Fails for one that is not empty.
            let _ = fs::remove_dir(&self.path);
        }
    }
}

impl Replacement {
    /// Begins a set of files for `dir`, which is made if it does not exist.
    ///
    /// # Errors
    /// [`Error::Write`] on an I/O failure.
    pub fn begin(dir: &Path) -> Result<Self> {
        let target = TargetFolder {
            path: dir.to_path_buf(),
            is_new: !dir.exists(),
        };
        super::create_dir(dir)?;
        settle(dir);
        let make = || {
            let folder = tempfile::Builder::new().prefix(PREFIX).tempdir_in(dir)?;
            let alive = fs::File::create(folder.path().join(ALIVE))?;
            Ok((folder, alive))
        };
        let mut all = locked(&MADE);
        let (folder, alive) = made(make, |(folder, alive)| {
            !would_block(alive) && folder.path().join(ALIVE).exists()
        })
        .map_err(|e| Error::write(dir, e))?;
        let made = MadeFolder(folder.path().to_path_buf());
        all.insert(made.0.clone());
        Ok(Self {
            dir: target,
            _alive: alive,
            _made: made,
            folder,
        })
    }

    /// Where the files are written.
    pub fn path(&self) -> &Path {
        self.folder.path()
    }

    /// Moves the files into the folder, in place of those of the same names and of `removed`. All that
    /// are replaced are gone before the first new one is there. `last` appears when all others are there.
    ///
    /// A signal waits for the end of the moves; those that a kill interrupts are ended by the next run
    /// that writes to the folder.
    ///
    /// # Errors
    /// [`Error::Read`] and [`Error::Write`] on an I/O failure.
    pub fn publish(self, removed: &[&str], last: &str) -> Result<()> {
        let _signals_wait = locked(&MADE);
        self.whole(removed, last)?.iter().try_for_each(Move::make)?;
        sync_dir(&self.dir.path)
    }

    /// Says on the disk that the set is whole; the steps that bring it to its place.
    fn whole(&self, removed: &[&str], last: &str) -> Result<Vec<Move>> {
        let from = self.folder.path();
        let names = names(from)?;
        let alone = removed.iter().filter(|r| !names.iter().any(|n| n == *r));
        let alone: Vec<&str> = alone.copied().collect();
        let mut gone: Vec<&str> = names.iter().map(String::as_str).collect();
        gone.extend(&alone);
        // The last to appear is the first to go.
        gone.sort_by_key(|name| (*name != last, *name));
        let whole = from.join(WHOLE);
        write_synced(&whole, alone.join("\n").as_bytes()).map_err(|e| Error::write(&whole, e))?;
        moves(&self.dir.path, from, gone.into_iter(), last)
    }
}

/// Writes a file and brings it to the disk.
fn write_synced(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    let mut file = fs::File::create(path)?;
    file.write_all(bytes)?;
    file.sync_all()
}

/// Brings renames within a folder to the disk.
fn sync_dir(dir: &Path) -> Result<()> {
    #[cfg(unix)]
    fs::File::open(dir)
        .and_then(|d| d.sync_all())
        .map_err(|e| Error::write(dir, e))?;
    #[cfg(not(unix))]
    let _ = dir;
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

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    /// What a folder shows, names and contents, without what is hidden.
    fn shown(dir: &Path) -> Vec<(String, String)> {
        let entries = fs::read_dir(dir).unwrap().map(|e| e.unwrap().path());
        let name = |path: &Path| path.file_name().unwrap().to_string_lossy().into_owned();
        let seen = entries.filter(|path| !name(path).starts_with('.'));
        let mut seen: Vec<_> = seen
            .map(|path| {
                let inner = if path.is_dir() {
                    path.join("part")
                } else {
                    path.clone()
                };
                (name(&path), fs::read_to_string(inner).unwrap())
            })
            .collect();
        seen.sort();
        seen
    }

    /// A kill after each of the moves: the next run has all of the new set, and until then no file of it stands beside one of the old.
    #[test]
    fn a_kill_between_any_two_moves_leaves_a_set_that_can_be_ended() {
        let old = ["a", "first", "gone"].map(|n| (n.to_owned(), "old".to_owned()));
        let new = ["a", "b", "first", "folder"].map(|n| (n.to_owned(), "new".to_owned()));
        for kept in 0.. {
            let folder = tempfile::tempdir().unwrap();
            let dir = folder.path();
            for (name, text) in &old {
                fs::write(dir.join(name), text).unwrap();
            }
            let set = Replacement::begin(dir).unwrap();
            for (name, text) in &new {
                match name.as_str() {
                    "folder" => {
                        fs::create_dir(set.path().join(name)).unwrap();
                        fs::write(set.path().join(name).join("part"), text).unwrap();
                    }
                    _ => fs::write(set.path().join(name), text).unwrap(),
                }
            }
            let steps = set.whole(&["gone"], "first").unwrap();
            for step in steps.iter().take(kept) {
                step.make().unwrap();
                let seen = shown(dir);
                assert!(
                    seen.iter().all(|s| old.contains(s)) || seen.iter().all(|s| new.contains(s)),
                    "{kept}: {seen:?}"
                );
                let has_last = seen.iter().any(|(name, _)| name == "first");
                assert!(!has_last || seen == new || seen == old, "{kept}: {seen:?}");
            }
            // Nothing of it is dropped in a kill, but its lock ends.
            let Replacement {
                _alive,
                folder: aside,
                _made,
                dir: target,
            } = set;
            drop(_alive);
            let aside = aside.keep();
            std::mem::forget(target);
            settle_folder(dir, &aside);
            assert_eq!(shown(dir), new, "{kept}");
            assert!(!aside.exists());
            if kept > steps.len() {
                break;
            }
        }
    }
}
