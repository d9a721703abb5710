//! A ball as a NumPy archive (`.npz`: a zip of `.npy` arrays), with its hash table for those who
//! use one.
//!
//! Arrays: `dots` f64 (n, 3); `features` f64 (m, 3); `bases` u16 (m, 2); `feature_dots` u16 (m,);
//! `meta` u8 (k,), UTF-8 JSON of [`TableMeta`]. A ball whose dots were measured has format version
//! 2 and a sixth array: `dot_covariances` f64 (n, 3, 3), rad^2, in the pattern's frame. Rows of
//! `features`, `bases` and `feature_dots` are in the order of [`PairRule::features`]; they follow from
//! the dots, so they are made when the file is written, and only compared when it is read. A written
//! ball reads back bit for bit, and the same ball gives the same bytes.
//!
//! A file that loads is complete and consistent: the version is known, every array has its type
//! and shape, numbers are finite, dots are distinct unit vectors, the metadata's digest is that of
//! the dots, and the features are those that its pair rule requires. An array may be in C or
//! Fortran order, little or big endian. A file that does not load gives one error that names the
//! array. Hostile files neither panic nor allocate without bound.

use std::fmt::Display;
use std::io::Cursor;
use std::path::Path;

use nalgebra::Matrix3;
use zip::ZipWriter;

use super::Ball;
use super::features::PairRule;
use super::record::{CalibrationRecord, ObjectiveRecord, PaperConfig};
use crate::error::{Error, Result};
#[cfg(feature = "native")]
use crate::files;
use crate::geometry::Vec3;
use crate::npz::{
    Archive, ArrayReader, Checked, NpzProblem, add_array, one_line, open, read_array,
};
use crate::pattern::{DesignRecord, KeepOut, LENGTH_ROUNDING, MAX_DOTS, MIN_DOTS, Pattern};
#[cfg(feature = "native")]
use crate::pattern::{shipped_design, shipped_designs};

/// Version of the file format of a ball whose dots are where the pattern has them.
pub const FORMAT_VERSION: u32 = 1;
/// Version of the file format of a ball whose dots were measured: it has their covariances,
/// which readers of the first version do not know.
pub const CALIBRATED_VERSION: u32 = 2;

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

/// A file's metadata (the array `meta`, as JSON).
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct TableMeta {
    /// Version of the file format, [`FORMAT_VERSION`] or [`CALIBRATED_VERSION`].
    pub format_version: u32,
    /// [`Pattern::sha256`] of the dots.
    pub pattern_sha256: String,
    /// The recognizer's parameters; files of version 0.1 spell the key `recogniser`.
    #[serde(alias = "recogniser")]
    pub recognizer: PaperConfig,
    /// The rule that selected the table's pairs.
    pub pair_rule: PairRule,
    /// The objective's value, where the pattern was optimized.
    #[serde(default)]
    pub objective: Option<ObjectiveRecord>,
    /// The validation result that the table shipped with.
    #[serde(default)]
    pub validation: Option<serde_json::Value>,
    /// How the dots were measured, in a file of [`CALIBRATED_VERSION`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub calibration: Option<CalibrationRecord>,
    /// The pattern's zones without dots.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub keep_out: Vec<KeepOut>,
    /// What the pattern was designed for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub design: Option<DesignRecord>,
}

impl Ball {
    /// The metadata of the ball's file.
    pub fn meta(&self) -> TableMeta {
        let calibration = self.calibration().cloned();
        TableMeta {
            format_version: match calibration {
                None => FORMAT_VERSION,
                Some(_) => CALIBRATED_VERSION,
            },
            pattern_sha256: self.pattern().sha256(),
            recognizer: *self.recognizer(),
            pair_rule: *self.pair_rule(),
            objective: self.objective().cloned(),
            validation: self.validation().cloned(),
            calibration,
            keep_out: self.pattern().keep_out().to_vec(),
            design: self.design().cloned(),
        }
    }

    /// Writes the ball with its hash table as `.npz` atomically.
    ///
    /// # Errors
    /// [`Error::Write`] on an I/O failure; else as [`Ball::to_npz`].
    #[cfg(feature = "native")]
    pub fn write_npz(&self, path: &Path) -> Result<()> {
        files::write_bytes(path, &self.to_npz()?)
    }

    /// The bytes of the `.npz` file.
    ///
    /// # Errors
    /// [`Error::Argument`] where the pair rule leaves out every pair of the dots;
    /// [`Error::Internal`] where the arrays cannot be packed.
    pub fn to_npz(&self) -> Result<Vec<u8>> {
        let internal =
            |e: &dyn Display| Error::Internal(format!("the hash table cannot be packed: {e}"));
        let meta = serde_json::to_vec(&self.meta()).map_err(|e| internal(&e))?;
        let dots = self.pattern().dots();
        let (n, m) = (dots.len() as u64, self.pair_rule().count(dots)? as u64);
        let features = || self.pair_rule().features(dots);
        let values = features().flat_map(|f| f.value);
        let bases = features().flat_map(|f| [f.basis.first, f.basis.second]);
        let thirds = features().map(|f| f.dot);
        let coordinates = dots.iter().flat_map(|d| [d.x, d.y, d.z]);
        let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
        add_array(&mut zip, "dots", &[n, 3], coordinates)
            .and_then(|()| add_array(&mut zip, "features", &[m, 3], values))
            .and_then(|()| add_array(&mut zip, "bases", &[m, 2], bases))
            .and_then(|()| add_array(&mut zip, "feature_dots", &[m], thirds))
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

    /// Writes the pattern as CSV atomically, and beside it its zones and what it was designed for
    /// ([`sidecar_path`](crate::pattern::sidecar_path)).
    ///
    /// # Errors
    /// [`Error::Write`].
    #[cfg(feature = "native")]
    pub fn write_csv(&self, path: &Path) -> Result<()> {
        self.pattern().write_with(path, self.design())
    }

    /// Reads a ball and checks its file for completeness (see the module's head).
    ///
    /// # Errors
    /// [`Error::Read`] on an I/O failure; [`Error::Input`] naming the array and what is wrong
    /// with it.
    #[cfg(feature = "native")]
    pub fn read_npz(path: &Path) -> Result<Self> {
        Self::from_npz(path, &files::read_at_most(path, files::MAX_ARCHIVE_BYTES)?)
    }

    /// Reads a ball from its `.npz`, from a pattern's CSV with what stands beside it, or from a folder
    /// that holds either as `table.npz` or `pattern.csv`, as those of designs and calibrations do. Where there is neither, the
    /// name of a [shipped design](crate::pattern::shipped_designs) will do.
    ///
    /// # Errors
    /// As [`Ball::read_npz`] and [`Pattern::read_csv`].
    #[cfg(feature = "native")]
    pub fn read(path: &Path) -> Result<Self> {
        let files = ["table.npz", "pattern.csv"].map(|name| path.join(name));
        if let Some(file) = files.iter().find(|file| file.exists()) {
            return Self::read(file);
        }
        let is_folder = path.is_dir();
        if (is_folder || !path.exists())
            && let Some(shipped) = path.to_str().and_then(shipped_design)
        {
            let shipped = shipped?;
            return Self::new(shipped.pattern).with_design(shipped.design);
        }
        if is_folder {
            let problem = "expected one with table.npz or pattern.csv";
            return Err(Error::input(path, "folder", problem));
        }
        let is_word = path.extension().is_none() && path.components().count() == 1;
        if is_word && !path.exists() {
            let names: Vec<String> = shipped_designs()?
                .into_iter()
                .map(|shipped| shipped.name)
                .collect();
            let problem = format!(
                "expected a file, a folder, or a shipped design: {}",
                names.join(", ")
            );
            return Err(Error::input(path, "pattern", problem));
        }
        let bytes = files::read_at_most(path, files::MAX_ARCHIVE_BYTES)?;
        // A NumPy archive starts with "PK", as every ZIP does.
        if bytes.starts_with(b"PK") || path.extension().is_some_and(|e| e == "npz") {
            return Self::from_npz(path, &bytes);
        }
        let (pattern, design) = Pattern::from_csv(path, &bytes)?.with_sidecar_of(path)?;
        Self::new(pattern).with_design(design)
    }

    /// As [`Ball::read_npz`], from the file's bytes; `path` only names the file in errors.
    ///
    /// # Errors
    /// [`Error::Input`] naming the array and what is wrong with it.
    pub fn from_npz(path: &Path, bytes: &[u8]) -> Result<Self> {
        Self::parse(bytes)
            .map_err(|NpzProblem { place, problem }| Error::input(path, place, problem))
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
            return Err(NpzProblem::at("meta", problem));
        }
        check_features(&archive, pattern.dots(), &meta.pair_rule)?;
        let covariances = read_covariances(&mut archive, &meta, pattern.len())?;
        let at = |place: &'static str| move |e: Error| NpzProblem::at(place, e.to_string());
        let pattern = pattern.with_keep_out(meta.keep_out).map_err(at("meta"))?;
        let mut ball = Self::new(pattern)
            .with_pair_rule(meta.pair_rule)
            .and_then(|ball| ball.with_recognizer(meta.recognizer))
            .and_then(|ball| ball.with_design(meta.design))
            .map_err(at("meta"))?;
        if let (Some(covariances), Some(record)) = (covariances, meta.calibration) {
            ball = ball
                .with_calibration(covariances, record)
                .map_err(at(COVARIANCES))?;
        }
        ball.set_objective(meta.objective);
        ball.set_validation(meta.validation);
        Ok(ball)
    }
}

fn read_meta(archive: &mut Archive<'_>) -> Checked<TableMeta> {
    let bytes: Vec<u8> = read_array(archive, "meta", "u8", &[None])?;
    let reject = |problem: String| NpzProblem::at("meta", problem);
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
        return Err(NpzProblem::at("meta", problem));
    }
    if !is_calibrated {
        let prefix = COVARIANCES.as_bytes();
        if archive
            .file_names_raw()
            .any(|name| name.starts_with(prefix))
        {
            let problem = format!("expected in format_version {CALIBRATED_VERSION} only");
            return Err(NpzProblem::at(COVARIANCES, problem));
        }
        return Ok(None);
    }
    let shape = [Some(dots as u64), Some(3), Some(3)];
    let flat: Vec<f64> = read_array(archive, COVARIANCES, "f64", &shape)?;
    let matrices = flat.chunks_exact(9).map(Matrix3::from_row_slice);
    Ok(Some(matrices.collect()))
}

fn read_dots(archive: &mut Archive<'_>) -> Checked<Pattern> {
    let reject = |problem: String| NpzProblem::at("dots", problem);
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

/// Checks that the rows are the features that the pair rule requires for the dots, while they are
/// unpacked.
fn check_features(archive: &Archive<'_>, dots: &[Vec3], rule: &PairRule) -> Checked<()> {
    let rows = rule
        .count(dots)
        .map_err(|e| NpzProblem::at("features", e.to_string()))?;
    // One for each of the arrays that are read side by side.
    let mut archives = [(); 3].map(|()| archive.clone());
    let [first, second, third] = &mut archives;
    let mut features: ArrayReader<'_, f64> =
        ArrayReader::open(first, "features", "f64", &[None, Some(3)])?;
    let mut bases: ArrayReader<'_, u16> =
        ArrayReader::open(second, "bases", "u16", &[None, Some(2)])?;
    let mut thirds: ArrayReader<'_, u16> =
        ArrayReader::open(third, "feature_dots", "u16", &[None])?;
    for (array, found) in [
        ("features", features.rows()),
        ("bases", bases.rows()),
        ("feature_dots", thirds.rows()),
    ] {
        if found != rows as u64 {
            let problem = format!("the dots and the pair rule give {rows} rows, found {found}");
            return Err(NpzProblem::at(array, problem));
        }
    }
    let same_dot = |array: &str, row: usize, found: u16, want: u16| match found {
        _ if found == want => Ok(()),
        _ if usize::from(found) >= dots.len() => {
            let problem = format!(
                "row {row}: dot {found} does not exist, there are {}",
                dots.len()
            );
            Err(NpzProblem::at(array, problem))
        }
        _ => {
            let problem = format!("row {row}: expected dot {want}, found {found}");
            Err(NpzProblem::at(array, problem))
        }
    };
    for (row, want) in rule.features(dots).enumerate() {
        let [first, second] = bases.next_row()?;
        same_dot("bases", row, first, want.basis.first)?;
        same_dot("bases", row, second, want.basis.second)?;
        let [third] = thirds.next_row()?;
        same_dot("feature_dots", row, third, want.dot)?;
        let (found, want) = (Vec3::from(features.next_row()?), Vec3::from(want.value));
        // Not `>`: it would let a NaN pass.
        let is_same = (found - want).norm() <= FEATURE_TOLERANCE * (1.0 + want.norm());
        if !is_same {
            let (want, found) = (want.as_slice(), found.as_slice());
            let problem = format!("row {row}: the dots give {want:?}, found {found:?}");
            return Err(NpzProblem::at("features", problem));
        }
    }
    features.finish()?;
    bases.finish()?;
    thirds.finish()
}
