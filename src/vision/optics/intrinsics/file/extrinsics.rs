//! Where the cameras of a file stand to each other: which keys say what. [`Rig`](crate::vision::optics::rig::Rig) has the conventions.

use std::path::Path;

use nalgebra::Matrix3;

use super::super::tree::{Value, plain};
use super::rig::cameras;
use super::{CameraCalibration, keys_of, listed};
use crate::error::{Error, Result};
use crate::geometry::{Rotation, Vec3};
use crate::vision::optics::rig::{Extrinsics, RigCamera, rotation_of, rotation_of_xyzw};

/// Keys of a rotation that leads to the camera, and of the translation that goes with it.
const ROTATION: [&str; 5] = ["r", "rotationmatrix", "rvec", "rot", "rotation"];
const TRANSLATION: [&str; 5] = ["t", "translationvector", "tvec", "trans", "translation"];
/// Kalibr's transform from the camera before.
const FROM_BEFORE: [&str; 1] = ["tcncnm1"];
/// What is added to a camera's times, and Kalibr's for an IMU, which is added likewise.
const CLOCK: [&str; 1] = ["clockoffsets"];
const CLOCK_TO_IMU: [&str; 1] = ["timeshiftcamimu"];

/// How a file says where a camera stands.
enum Stated {
    /// From the frame of the camera before it.
    FromBefore(Extrinsics),
    /// From a frame that all cameras have in common.
    FromCommon(Extrinsics),
    /// Where it is in such a frame.
    InCommon(Extrinsics),
}

/// Reads the fields of a file.
struct Fields<'a> {
    path: &'a Path,
    /// Meters in one unit of the file.
    unit_m: f64,
}

impl Fields<'_> {
    fn refused<T>(&self, field: &str, problem: impl Into<String>) -> Result<T> {
        Err(Error::input(self.path, field.to_owned(), problem.into()))
    }

    fn translation(&self, field: &str, value: &Value) -> Result<Vec3> {
        let numbers = by_names(value, ["x", "y", "z"]).or_else(|| value.numbers());
        match numbers.as_deref() {
            Some([x, y, z]) if [x, y, z].iter().all(|n| n.is_finite()) => {
                Ok(Vec3::new(*x, *y, *z) * self.unit_m)
            }
            _ => self.refused(field, "expected three finite numbers"),
        }
    }

    /// A matrix of nine numbers by rows, or a rotation vector of three.
    fn rotation(&self, field: &str, value: &Value) -> Result<Rotation> {
        let rotation = match value.numbers().as_deref() {
            Some([x, y, z]) if [x, y, z].iter().all(|n| n.is_finite()) => {
                Ok(Rotation::from_scaled_axis(Vec3::new(*x, *y, *z)))
            }
            Some(numbers) if numbers.len() == 9 => rotation_of(&Matrix3::from_row_slice(numbers)),
            _ => Err("expected a rotation: 9 numbers by rows, or a rotation vector of 3".into()),
        };
        rotation.or_else(|problem: String| self.refused(field, problem))
    }

    /// A transform of 16 numbers by rows.
    fn matrix(&self, field: &str, value: &Value) -> Result<Extrinsics> {
        let numbers = value.numbers().filter(|n| n.len() == 16);
        let Some(m) = numbers.filter(|m| m[12..] == [0.0, 0.0, 0.0, 1.0]) else {
            return self.refused(field, "expected 4 x 4 numbers by rows, the last 0 0 0 1");
        };
        let turn = Matrix3::new(m[0], m[1], m[2], m[4], m[5], m[6], m[8], m[9], m[10]);
        let rotation = rotation_of(&turn).or_else(|problem| self.refused(field, problem))?;
        let translation_m = Vec3::new(m[3], m[7], m[11]) * self.unit_m;
        match translation_m.iter().all(|x| x.is_finite()) {
            true => Ok(Extrinsics {
                rotation,
                translation_m,
            }),
            false => self.refused(field, "expected finite numbers"),
        }
    }

    /// A translation and a quaternion x, y, z, w.
    fn transform(&self, field: &str, value: &Value) -> Result<Extrinsics> {
        let part = |name: &str| match value.get(&[name]) {
            Some(part) => Ok((format!("{field}.{name}"), part)),
            None => self.refused(
                &format!("{field}.{name}"),
                "expected translation x, y, z and rotation x, y, z, w, found none",
            ),
        };
        let (at, translation) = part("translation")?;
        let translation_m = self.translation(&at, translation)?;
        let (at, rotation) = part("rotation")?;
        let numbers = by_names(rotation, ["x", "y", "z", "w"]).or_else(|| rotation.numbers());
        let rotation = match numbers.as_deref() {
            Some([x, y, z, w]) => rotation_of_xyzw([*x, *y, *z, *w]),
            _ => Err("expected a quaternion x, y, z, w".into()),
        };
        Ok(Extrinsics {
            rotation: rotation.or_else(|problem| self.refused(&at, problem))?,
            translation_m,
        })
    }

    /// Rotation and translation of one level, where both are there: a rotation alone is that of a rectified image.
    fn both(&self, at: &str, level: &Value) -> Result<Option<Extrinsics>> {
        let entry = |names: &[&str]| {
            let mut entries = level.entries().iter();
            entries.find(|(key, _)| names.contains(&plain(key).as_str()))
        };
        let (Some((r, rotation)), Some((t, translation))) = (entry(&ROTATION), entry(&TRANSLATION))
        else {
            return Ok(None);
        };
        Ok(Some(Extrinsics {
            rotation: self.rotation(&format!("{at}{r}"), rotation)?,
            translation_m: self.translation(&format!("{at}{t}"), translation)?,
        }))
    }

    /// What a camera's own level says.
    fn stated(&self, name: &str, camera: &Value) -> Result<Option<Stated>> {
        if let Some(value) = camera.get(&FROM_BEFORE) {
            let field = format!("{name}.T_cn_cnm1");
            return Ok(Some(Stated::FromBefore(self.matrix(&field, value)?)));
        }
        if let Some(value) = camera.get(&["transform"]) {
            let field = format!("{name}.transform");
            return Ok(Some(Stated::InCommon(self.transform(&field, value)?)));
        }
        let own = self.both(&format!("{name}."), camera)?;
        Ok(own.map(Stated::FromCommon))
    }

    fn clock(&self, name: &str, camera: &Value, names: &[&str]) -> Result<Option<f64>> {
        let Some(value) = camera.get(names) else {
            return Ok(None);
        };
        match value.number().filter(|s| s.is_finite()) {
            Some(seconds) => Ok(Some(seconds)),
            None => self.refused(
                &format!("{name}.{}", names[0]),
                "expected a finite number of seconds",
            ),
        }
    }
}

/// Numbers of a mapping by their names; `None` where one is missing or none.
fn by_names<const N: usize>(value: &Value, names: [&str; N]) -> Option<Vec<f64>> {
    let number = |name: &&str| value.get(&[*name])?.number();
    names.iter().map(number).collect()
}

/// The cameras of a rig's file, each with its extrinsics from one frame or another.
pub(super) fn rig(path: &Path, tree: &Value) -> Result<Vec<RigCamera>> {
    let mut fields = Fields { path, unit_m: 1.0 };
    if let Some(Value::Text(unit)) = tree.get(&["units", "unit"]) {
        fields.unit_m = match plain(unit).as_str() {
            "m" | "meter" | "meters" => 1.0,
            "mm" | "millimeter" | "millimeters" => 1e-3,
            "cm" | "centimeter" | "centimeters" => 1e-2,
            _ => return fields.refused("units", "expected m, cm or mm"),
        };
    }
    let named = named_cameras(path, tree)?;
    if named.len() < 2 {
        let problem = format!(
            "expected two cameras or more with R and T, T_cn_cnm1 or a transform, found {}; keys found: {}",
            named.len(),
            listed(&keys_of(tree))
        );
        return fields.refused("cameras", problem);
    }
    let flat = fields.both("", tree)?;
    let mut placed = Vec::with_capacity(named.len());
    let mut before = Extrinsics::default();
    let mut to_imu = None;
    for (k, (name, camera, calibration)) in named.into_iter().enumerate() {
        let stated = match (k, fields.stated(&name, &camera)?) {
            // stereoCalibrate's: from the first camera to the second.
            (1, None) => flat.map(Stated::FromCommon),
            (0, None) => Some(Stated::FromCommon(Extrinsics::default())),
            (_, stated) => stated,
        };
        let extrinsics = match stated {
            Some(Stated::FromBefore(step)) => before.then(&step),
            Some(Stated::FromCommon(from_common)) => from_common,
            Some(Stated::InCommon(place)) => place.inverse(),
            None => {
                let problem = "expected where this camera stands: R and T (OpenCV's sample writes them to extrinsics.yml: put both \
                               files into one), T_cn_cnm1 or transform";
                return fields.refused(&name, problem);
            }
        };
        before = extrinsics;
        let shift = fields.clock(&name, &camera, &CLOCK_TO_IMU)?;
        to_imu = to_imu.or(shift);
        let by_imu = shift.zip(to_imu).map_or(0.0, |(own, first)| own - first);
        let clock_offset_s = fields.clock(&name, &camera, &CLOCK)?.unwrap_or(by_imu);
        placed.push(RigCamera {
            name,
            calibration,
            extrinsics,
            clock_offset_s,
        });
    }
    Ok(placed)
}

/// A camera of a file: its name, its level, its intrinsics.
type Named = (String, Value, CameraCalibration);

/// The cameras of a file, those with their intrinsics in another file among them.
fn named_cameras(path: &Path, tree: &Value) -> Result<Vec<Named>> {
    let own = cameras(tree);
    let mut named = Vec::new();
    let is_elsewhere = |value: &Value| value.get(&["calibration"]).is_some();
    if !tree.entries().iter().any(|(_, value)| is_elsewhere(value)) {
        for (name, camera) in own {
            let calibration = CameraCalibration::of_camera(path, &camera)?;
            named.push((name, camera, calibration));
        }
        return Ok(named);
    }
    for (name, level) in tree.entries() {
        if let Some(Value::Text(file)) = level.get(&["calibration"]) {
            let folder = path.parent().unwrap_or(Path::new(""));
            let calibration = CameraCalibration::read(&folder.join(file))?;
            named.push((name.clone(), level.clone(), calibration));
        } else if let Some((_, camera)) = own.iter().find(|(own, _)| own == name) {
            let calibration = CameraCalibration::of_camera(path, camera)?;
            named.push((name.clone(), camera.clone(), calibration));
        }
    }
    Ok(named)
}
