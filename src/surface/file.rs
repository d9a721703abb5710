//! The file of a painted ball: a NumPy archive.
//!
//! `values` f32 (n,): the paint at n places, the logarithm of the brightness less its mean about each; `views` f32 (n,): how many frames show it, 0
//! where it is not known; `meta` u8 (k,): UTF-8 JSON with `format_version` 1 and `kind` "painted ball". The places are the golden-angle
//! spiral [`spiral_directions`](crate::geometry::spiral_directions) in the order of the arrays.

use std::io::Cursor;
use std::path::Path;

use zip::ZipWriter;

use super::surface_map::{PLACES, PlaceGrid, SurfaceMap};
use crate::error::{Error, Result};
use crate::npz::{Archive, Checked, NpzProblem, add_array, one_line, open, read_array};

/// The arrays of the file.
const ARRAYS: [&str; 3] = ["values", "views", "meta"];
/// What the metadata say.
const KIND: &str = "painted ball";
const FORMAT_VERSION: u64 = 1;
/// No value is farther from 0.
const FARTHEST: f32 = 10.0;

impl SurfaceMap {
    /// The file's bytes.
    ///
    /// # Errors
    /// [`Error::Internal`] where the archive cannot be made.
    pub fn to_npz(&self) -> Result<Vec<u8>> {
        let meta =
            serde_json::json!({ "format_version": FORMAT_VERSION, "kind": KIND }).to_string();
        let n = PLACES as u64;
        let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
        add_array(&mut zip, "values", &[n], self.values.iter().copied())
            .and_then(|()| add_array(&mut zip, "views", &[n], self.weights.iter().copied()))
            .and_then(|()| add_array(&mut zip, "meta", &[meta.len() as u64], meta.bytes()))
            .map_err(|e| Error::Internal(format!("the surface cannot be packed: {e}")))?;
        let packed = zip
            .finish()
            .map_err(|e| Error::Internal(format!("the surface cannot be packed: {e}")))?;
        Ok(packed.into_inner())
    }

    /// The surface of a file's bytes; `path` names it in errors.
    ///
    /// # Errors
    /// [`Error::Input`] naming the array and what was expected.
    pub fn from_npz(path: &Path, bytes: &[u8]) -> Result<Self> {
        parse(bytes).map_err(|p| Error::input(path, p.place, p.problem))
    }

    /// Reads a file.
    ///
    /// # Errors
    /// [`Error::Read`]; [`Error::Input`] naming the array and what was expected.
    #[cfg(feature = "native")]
    pub fn read_npz(path: &Path) -> Result<Self> {
        Self::from_npz(path, &crate::files::read_bytes(path)?)
    }

    /// The surface of a file; `None` where it is a file of another kind, or cannot be read.
    ///
    /// # Errors
    /// [`Error::Input`] where it says that it is a surface, and its arrays are damaged.
    #[cfg(feature = "native")]
    pub fn read_if_one(path: &Path) -> Result<Option<Self>> {
        let Ok(bytes) = crate::files::read_bytes(path) else {
            return Ok(None);
        };
        let Ok(mut archive) = surface_archive(&bytes) else {
            return Ok(None);
        };
        let surface = arrays(&mut archive);
        surface
            .map(Some)
            .map_err(|p| Error::input(path, p.place, p.problem))
    }

    /// Writes a file atomically.
    ///
    /// # Errors
    /// [`Error::Write`].
    #[cfg(feature = "native")]
    pub fn write_npz(&self, path: &Path) -> Result<()> {
        crate::files::write_bytes(path, &self.to_npz()?)
    }
}

fn parse(bytes: &[u8]) -> Checked<SurfaceMap> {
    arrays(&mut surface_archive(bytes)?)
}

/// An archive whose metadata say that it is a surface.
fn surface_archive(bytes: &[u8]) -> Checked<Archive<'_>> {
    let mut archive = open(bytes, &ARRAYS)?;
    let meta: Vec<u8> = read_array(&mut archive, "meta", "u8", &[None])?;
    let meta: serde_json::Value =
        serde_json::from_slice(&meta).map_err(|e| NpzProblem::at("meta", one_line(&e)))?;
    if meta["kind"] != KIND || meta["format_version"] != FORMAT_VERSION {
        let expected = format!("expected a {KIND} of format_version {FORMAT_VERSION}");
        return Err(NpzProblem::at("meta", expected));
    }
    Ok(archive)
}

fn arrays(archive: &mut Archive<'_>) -> Checked<SurfaceMap> {
    let shape = [Some(PLACES as u64)];
    let values: Vec<f32> = read_array(archive, "values", "f32", &shape)?;
    let views: Vec<f32> = read_array(archive, "views", "f32", &shape)?;
    // Not `>`: it would let a NaN pass.
    let is_value = |v: &f32| v.abs() <= FARTHEST;
    if !values.iter().all(is_value) {
        let problem = format!("expected numbers from -{FARTHEST} to {FARTHEST}");
        return Err(NpzProblem::at("values", problem));
    }
    if !views.iter().all(|v| *v >= 0.0 && v.is_finite()) {
        return Err(NpzProblem::at(
            "views",
            "expected finite numbers of 0 or more",
        ));
    }
    let mut surface = SurfaceMap::unknown();
    (surface.values, surface.weights) = (values, views);
    surface.slope(&PlaceGrid::default());
    Ok(surface)
}
