//! The pictures of a folder.

use std::path::{Path, PathBuf};

use spindoe::image::{DEFAULT_MAX_PIXELS, Picture, RgbImage};
use spindoe::vision::{Intrinsics, Lens, Pixel};
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

/// A pinhole's picture as a lens shows it.
///
/// # Errors
/// [`Error::Internal`] for a picture without pixels; none in fact.
pub fn seen_through(image: &RgbImage, pinhole: &Intrinsics, k: &Intrinsics) -> Result<RgbImage> {
    if k.lens == Lens::Ideal {
        return Ok(image.clone());
    }
    let mut values = Vec::with_capacity(image.values().len());
    for v in 0..image.height() {
        for u in 0..image.width() {
            let ray = k.ray(Pixel {
                u: u as f64,
                v: v as f64,
            });
            let at = ray.map(|ray| pinhole.project(&ray));
            values.push(at.map_or([0.0; 3], |at| image.sample(at.u, at.v)));
        }
    }
    RgbImage::new(image.width(), image.height(), values)
}
