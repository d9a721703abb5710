//! The pictures of a folder.

use std::path::{Path, PathBuf};

use spindoe::image::{DEFAULT_MAX_PIXELS, Picture, RgbImage};
use spindoe::{Error, Result};

/// All files of a folder that are pictures, by name.
///
/// # Errors
/// [`Error`] for a folder that cannot be read.
pub fn pictures(folder: &Path) -> Result<Vec<RgbImage>> {
    let entries = std::fs::read_dir(folder).map_err(|e| Error::read(folder, e))?;
    let mut files: Vec<PathBuf> = entries.filter_map(|e| Some(e.ok()?.path())).collect();
    files.sort();
    let read = |path: &PathBuf| Picture::read(path, DEFAULT_MAX_PIXELS).ok();
    let pictures = files.iter().filter_map(read);
    pictures.map(|p| Ok(p.to_rgb()?.into_owned())).collect()
}
