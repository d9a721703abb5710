//! The hash table as a NumPy archive (`.npz`: a zip of `.npy` arrays).
//!
//! Arrays: `dots` f64 (n, 3); `features` f64 (m, 3); `bases` u16 (m, 2); `feature_dots` u16 (m,);
//! `meta` u8 (k,), UTF-8 JSON of [`TableMeta`]. A table whose dots were measured on a ball has
//! format version 2 and a sixth array: `dot_covariances` f64 (n, 3, 3), rad^2, in the pattern's frame. Rows of the last three are in the order of
//! [`PairRule::features`](super::PairRule::features). A written table reads back bit for bit, and
//! the same table gives the same bytes.
//!
//! A table that loads is complete and consistent: the version is known, every array has its type
//! and shape, numbers are finite, dots are distinct unit vectors, the metadata's digest is that of
//! the dots, and the features are those that its pair rule requires. An array may be in C or
//! Fortran order, little or big endian. A file that does not load gives one error that names the
//! array. Hostile files neither panic nor allocate without bound.

use std::fmt::Display;
use std::io::Cursor;
use std::path::Path;

use nalgebra::Matrix3;
use zip::ZipWriter;

use super::features::Basis;
use super::table::{Arrays, CALIBRATED_VERSION, FORMAT_VERSION, HashTable, TableMeta};
use crate::error::{Error, Result};
#[cfg(feature = "native")]
use crate::files;
use crate::geometry::Vec3;
use crate::npz::{Archive, Checked, Problem, add_array, one_line, open, read_array};
use crate::pattern::{LENGTH_ROUNDING, MAX_DOTS, MIN_DOTS, Pattern};

/// Maximum relative difference between a stored feature and the one computed from the dots. It
/// allows for other writers' rounding, which a basis near the pair rule's limit amplifies.
const FEATURE_TOLERANCE: f64 = 1e-9;

const COVARIANCES: &str = "dot_covariances";
const ARRAYS: [&str; 6] = [
    "dots",
    "features",
    "bases",
    "feature_dots",
    COVARIANCES,
    "meta",
];

impl HashTable {
    /// Writes the table as `.npz` atomically.
    ///
    /// # Errors
    /// [`Error::Write`] on an I/O failure; [`Error::Internal`] where the arrays cannot be packed.
    #[cfg(feature = "native")]
    pub fn write_npz(&self, path: &Path) -> Result<()> {
        files::write_bytes(path, &self.to_npz()?)
    }

    /// The bytes of the `.npz` file.
    ///
    /// # Errors
    /// [`Error::Internal`] where the arrays cannot be packed.
    pub fn to_npz(&self) -> Result<Vec<u8>> {
        let internal =
            |e: &dyn Display| Error::Internal(format!("the hash table cannot be packed: {e}"));
        let meta = serde_json::to_vec(self.meta()).map_err(|e| internal(&e))?;
        let (n, m) = (self.pattern().len() as u64, self.features().len() as u64);
        let dots = self.pattern().dots().iter().flat_map(|d| [d.x, d.y, d.z]);
        let features = self.features().iter().flatten().copied();
        let bases = self.bases().iter().flat_map(|b| [b.first, b.second]);
        let feature_dots = self.feature_dots().iter().copied();
        let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
        add_array(&mut zip, "dots", &[n, 3], dots)
            .and_then(|()| add_array(&mut zip, "features", &[m, 3], features))
            .and_then(|()| add_array(&mut zip, "bases", &[m, 2], bases))
            .and_then(|()| add_array(&mut zip, "feature_dots", &[m], feature_dots))
            .and_then(|()| match self.dot_covariances() {
                // Symmetric: row by row or column by column is the same.
                Some(all) => add_array(
                    &mut zip,
                    COVARIANCES,
                    &[n, 3, 3],
                    all.iter().flatten().copied(),
                ),
                None => Ok(()),
            })
            .and_then(|()| {
                let length = meta.len() as u64;
                add_array(&mut zip, "meta", &[length], meta.iter().copied())
            })
            .map_err(|e| internal(&e))?;
        Ok(zip.finish().map_err(|e| internal(&e))?.into_inner())
    }

    /// Reads a table and checks it for completeness (see the module's head).
    ///
    /// # Errors
    /// [`Error::Read`] on an I/O failure; [`Error::Input`] naming the array and what is wrong
    /// with it.
    #[cfg(feature = "native")]
    pub fn read_npz(path: &Path) -> Result<Self> {
        Self::from_npz(path, &files::read_bytes(path)?)
    }

    /// As [`HashTable::read_npz`], from the file's bytes; `path` only names the file in errors.
    ///
    /// # Errors
    /// [`Error::Input`] naming the array and what is wrong with it.
    pub fn from_npz(path: &Path, bytes: &[u8]) -> Result<Self> {
        Self::parse(bytes).map_err(|Problem { place, problem }| Error::input(path, place, problem))
    }

    fn parse(bytes: &[u8]) -> Checked<Self> {
        let mut archive = open(bytes, &ARRAYS)?;
        let meta = read_meta(&mut archive)?;
        let pattern = read_dots(&mut archive)?;
        let found = pattern.sha256();
        if meta.pattern_sha256 != found {
            let problem = format!(
                "pattern_sha256 is {:?}, but the dots have {found}",
                meta.pattern_sha256
            );
            return Err(Problem::at("meta", problem));
        }
        let pattern = pattern
            .with_keep_out(meta.keep_out.clone())
            .map_err(|e| Problem::at("meta", e.to_string()))?;
        let arrays = read_columns(&mut archive)?;
        check_features(&pattern, &arrays, &meta)?;
        let covariances = read_covariances(&mut archive, &meta, pattern.len())?;
        let record = meta.calibration.clone();
        let table = Self::assemble(pattern, arrays, meta)
            .map_err(|e| Problem::at("features", e.to_string()))?;
        match (covariances, record) {
            (Some(covariances), Some(record)) => table
                .with_calibration(covariances, record)
                .map_err(|e| Problem::at(COVARIANCES, e.to_string())),
            _ => Ok(table),
        }
    }
}

fn read_meta(archive: &mut Archive<'_>) -> Checked<TableMeta> {
    let bytes: Vec<u8> = read_array(archive, "meta", "u8", &[None])?;
    let reject = |problem: String| Problem::at("meta", problem);
    let json: serde_json::Value = serde_json::from_slice(&bytes)
        .map_err(|e| reject(format!("not JSON: {}", one_line(&e))))?;
    // The version first: a later format may have other fields.
    let version = json.get("format_version").and_then(|v| v.as_u64());
    if !version.is_some_and(|v| {
        [FORMAT_VERSION, CALIBRATED_VERSION]
            .map(u64::from)
            .contains(&v)
    }) {
        let found = version.map_or("none".to_owned(), |v| v.to_string());
        return Err(reject(format!(
            "expected format_version {FORMAT_VERSION} or {CALIBRATED_VERSION}, found {found}"
        )));
    }
    let meta: TableMeta = serde_json::from_value(json).map_err(|e| reject(one_line(&e)))?;
    meta.pair_rule.check().map_err(|e| reject(e.to_string()))?;
    meta.recognizer.check().map_err(|e| reject(e.to_string()))?;
    Ok(meta)
}

/// The covariances of a calibrated table; `None` in one that is not.
fn read_covariances(
    archive: &mut Archive<'_>,
    meta: &TableMeta,
    dots: usize,
) -> Checked<Option<Vec<Matrix3<f64>>>> {
    let is_calibrated = meta.format_version == CALIBRATED_VERSION;
    if is_calibrated != meta.calibration.is_some() {
        let problem = format!(
            "expected a calibration in format_version {CALIBRATED_VERSION} and in no other, found version {}",
            meta.format_version
        );
        return Err(Problem::at("meta", problem));
    }
    if !is_calibrated {
        let prefix = COVARIANCES.as_bytes();
        if archive
            .file_names_raw()
            .any(|name| name.starts_with(prefix))
        {
            let problem = format!("expected in format_version {CALIBRATED_VERSION} only");
            return Err(Problem::at(COVARIANCES, problem));
        }
        return Ok(None);
    }
    let shape = [Some(dots as u64), Some(3), Some(3)];
    let flat: Vec<f64> = read_array(archive, COVARIANCES, "f64", &shape)?;
    let matrices = flat.chunks_exact(9).map(Matrix3::from_row_slice);
    Ok(Some(matrices.collect()))
}

fn read_dots(archive: &mut Archive<'_>) -> Checked<Pattern> {
    let reject = |problem: String| Problem::at("dots", problem);
    let flat: Vec<f64> = read_array(archive, "dots", "f64", &[None, Some(3)])?;
    let dots: Vec<Vec3> = flat.chunks_exact(3).map(Vec3::from_column_slice).collect();
    if !(MIN_DOTS..=MAX_DOTS).contains(&dots.len()) {
        let problem = format!(
            "expected {MIN_DOTS} to {MAX_DOTS} dots, found {}",
            dots.len()
        );
        return Err(reject(problem));
    }
    for (i, dot) in dots.iter().enumerate() {
        let length = dot.norm();
        // Not `>`: it would let a NaN pass.
        let is_unit = (length - 1.0).abs() <= LENGTH_ROUNDING;
        if !is_unit {
            let problem =
                format!("dot {i}: expected a unit vector to rounding, found length {length}");
            return Err(reject(problem));
        }
    }
    Pattern::new(dots).map_err(|e| reject(e.to_string()))
}

fn read_columns(archive: &mut Archive<'_>) -> Checked<Arrays> {
    let features: Vec<f64> = read_array(archive, "features", "f64", &[None, Some(3)])?;
    let bases: Vec<u16> = read_array(archive, "bases", "u16", &[None, Some(2)])?;
    let feature_dots: Vec<u16> = read_array(archive, "feature_dots", "u16", &[None])?;
    let features: Vec<[f64; 3]> = features
        .chunks_exact(3)
        .map(|c| [c[0], c[1], c[2]])
        .collect();
    if let Some(row) = features
        .iter()
        .position(|f| f.iter().any(|x| !x.is_finite()))
    {
        let problem = format!(
            "row {row}: expected finite numbers, found {:?}",
            features[row]
        );
        return Err(Problem::at("features", problem));
    }
    Ok(Arrays {
        features,
        bases: bases
            .chunks_exact(2)
            .map(|c| Basis {
                first: c[0],
                second: c[1],
            })
            .collect(),
        feature_dots,
    })
}

/// Checks index ranges, and that the rows are those that the pair rule requires for the dots.
fn check_features(pattern: &Pattern, arrays: &Arrays, meta: &TableMeta) -> Checked<()> {
    let n = pattern.len();
    let outside = |dot: u16| usize::from(dot) >= n;
    let range = |array: &str, row, dot| {
        let problem = format!("row {row}: dot {dot} does not exist, there are {n}");
        Err(Problem::at(array, problem))
    };
    for (row, basis) in arrays.bases.iter().enumerate() {
        if let Some(dot) = [basis.first, basis.second]
            .into_iter()
            .find(|d| outside(*d))
        {
            return range("bases", row, dot);
        }
    }
    if let Some(row) = arrays.feature_dots.iter().position(|d| outside(*d)) {
        return range("feature_dots", row, arrays.feature_dots[row]);
    }
    let expected: Vec<_> = meta.pair_rule.features(pattern.dots()).collect();
    let lengths = [
        ("features", arrays.features.len()),
        ("bases", arrays.bases.len()),
        ("feature_dots", arrays.feature_dots.len()),
    ];
    for (array, found) in lengths {
        if found != expected.len() {
            let problem = format!(
                "the dots and the pair rule give {} rows, found {found}",
                expected.len()
            );
            return Err(Problem::at(array, problem));
        }
    }
    for (row, want) in expected.iter().enumerate() {
        if arrays.bases[row] != want.basis {
            let (found, want) = (arrays.bases[row], want.basis);
            let problem = format!(
                "row {row}: expected ({}, {}), found ({}, {})",
                want.first, want.second, found.first, found.second
            );
            return Err(Problem::at("bases", problem));
        }
        if arrays.feature_dots[row] != want.dot {
            let (found, want) = (arrays.feature_dots[row], want.dot);
            let problem = format!("row {row}: expected dot {want}, found {found}");
            return Err(Problem::at("feature_dots", problem));
        }
        let (found, want) = (Vec3::from(arrays.features[row]), Vec3::from(want.value));
        if (found - want).norm() > FEATURE_TOLERANCE * (1.0 + want.norm()) {
            let problem = format!(
                "row {row}: the dots give {:?}, found {:?}",
                want.as_slice(),
                found.as_slice()
            );
            return Err(Problem::at("features", problem));
        }
    }
    Ok(())
}
