//! Cameras that other programs write in units or an order of their own, as OpenCV has them: MATLAB's and OpenSfM's.

use super::super::tree::{Value, plain};
use super::keys::SIDES;

/// Whether a camera is one of MATLAB's, which are known by their spelling.
fn is_matlab(camera: &Value) -> bool {
    let mut keys = camera.entries().iter().map(|(key, _)| key.as_str());
    keys.any(|key| key == "RadialDistortion")
}

fn is_opensfm(camera: &Value) -> bool {
    camera.get(&["projectiontype"]).is_some()
}

/// Whether a camera is one of these.
pub(super) fn is_foreign(camera: &Value) -> bool {
    is_matlab(camera) || is_opensfm(camera)
}

/// A camera in OpenCV's units; as it is where nothing is to be done.
pub(super) fn as_opencv(camera: &Value) -> std::result::Result<Value, String> {
    if is_opensfm(camera) {
        of_opensfm(camera)
    } else if is_matlab(camera) {
        of_matlab(camera)
    } else {
        Ok(camera.clone())
    }
}

fn canonical(four: [f64; 4], skew: f64, lens: &[f64], size: Option<[f64; 2]>) -> Value {
    let text = |x: f64| Value::Text(x.to_string());
    let list = |all: &[f64]| Value::List(all.iter().copied().map(text).collect());
    let [fx, fy, cx, cy] = four;
    let matrix = [fx, skew, cx, 0.0, fy, cy, 0.0, 0.0, 1.0];
    let mut entries = vec![
        ("camera_matrix".to_owned(), list(&matrix)),
        ("distortion".to_owned(), list(lens)),
    ];
    if let Some([width, height]) = size {
        entries.push(("width".to_owned(), text(width)));
        entries.push(("height".to_owned(), text(height)));
    }
    Value::Map(entries)
}

/// A camera of MATLAB's (`toStruct` of `cameraParameters` or `cameraIntrinsics`, as `jsonencode` writes it): pixels are counted from 1, an
/// image's size has its rows first, and `IntrinsicMatrix` is the transpose of `K`.
fn of_matlab(camera: &Value) -> std::result::Result<Value, String> {
    let numbers = |name: &str| camera.get(&[name]).and_then(Value::numbers);
    let k = numbers("k").or_else(|| {
        let k: [f64; 9] = numbers("intrinsicmatrix")?.try_into().ok()?;
        Some([0, 3, 6, 1, 4, 7, 2, 5, 8].map(|i| k[i]).to_vec())
    });
    let of_parts = || {
        let (focal, center) = (numbers("focallength")?, numbers("principalpoint")?);
        let skew = numbers("skew").map_or(0.0, |skew| skew[0]);
        let ([fx, fy], [cx, cy]) = (focal.try_into().ok()?, center.try_into().ok()?);
        Some(vec![fx, skew, cx, 0.0, fy, cy, 0.0, 0.0, 1.0])
    };
    let Some(&[fx, skew, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]) = k.or_else(of_parts).as_deref() else {
        return Err("expected MATLAB's K, or its FocalLength and PrincipalPoint".to_owned());
    };
    let radial = numbers("radialdistortion").unwrap_or_default();
    let tangential = match camera.get(&["tangentialdistortion"]) {
        None => vec![0.0; 2],
        Some(value) => value.numbers().unwrap_or_default(),
    };
    let expected = "expected 2 or 3 of RadialDistortion and 2 of TangentialDistortion";
    let (&[p1, p2], &[k1, k2, ref k3 @ ..]) = (&tangential[..], &radial[..]) else {
        return Err(expected.to_owned());
    };
    let k3 = match k3 {
        [] => 0.0,
        [k3] => *k3,
        _ => return Err(expected.to_owned()),
    };
    let size = numbers("imagesize").and_then(|size| Some([*size.get(1)?, *size.first()?]));
    Ok(canonical(
        [fx, fy, cx - 1.0, cy - 1.0],
        skew,
        &[k1, k2, p1, p2, k3],
        size,
    ))
}

/// A camera of OpenSfM's `camera_models.json`: lengths are over the longer side of the images, and the principal point is from their middle.
fn of_opensfm(camera: &Value) -> std::result::Result<Value, String> {
    let number = |names: &[&str]| camera.get(names).and_then(Value::number);
    let [width, height] = SIDES[0].map(number);
    let (Some(width), Some(height)) = (width, height) else {
        return Err("expected width and height, over which OpenSfM's lengths are".to_owned());
    };
    let kind = match camera.get(&["projectiontype"]) {
        Some(Value::Text(kind)) => plain(kind),
        _ => String::new(),
    };
    let lens: &[&str] = match kind.as_str() {
        "perspective" | "radial" | "simpleradial" => &["k1", "k2", "none", "none"],
        "brown" => &["k1", "k2", "p1", "p2", "k3"],
        "fisheye" | "fisheyeopencv" => &["k1", "k2", "k3", "k4"],
        _ => {
            return Err(format!(
                "expected OpenSfM's perspective, radial, brown, fisheye or fisheye_opencv, found {}",
                crate::files::csv::shown(&kind)
            ));
        }
    };
    let or_zero = |name: &str| match camera.get(&[name]) {
        None => Ok(0.0),
        Some(value) => value
            .number()
            .ok_or_else(|| format!("expected a number as {name}")),
    };
    let lens = lens
        .iter()
        .map(|k| or_zero(k))
        .collect::<std::result::Result<Vec<f64>, _>>()?;
    let longer = width.max(height);
    let focal = number(&["focal"]);
    let [fx, fy] = ["focalx", "focaly"].map(|name| number(&[name]).or(focal));
    let (Some(fx), Some(fy)) = (fx, fy) else {
        return Err("expected OpenSfM's focal, or focal_x and focal_y".to_owned());
    };
    let (x, y) = (or_zero("cx")?, or_zero("cy")?);
    let four = [
        longer * fx,
        longer * fy,
        longer * x + 0.5 * (width - 1.0),
        longer * y + 0.5 * (height - 1.0),
    ];
    let mut camera = canonical(four, 0.0, &lens, Some([width, height]));
    if let (Value::Map(entries), true) = (&mut camera, kind.starts_with("fisheye")) {
        entries.push(("model".to_owned(), Value::Text("fisheye".to_owned())));
    }
    Ok(camera)
}
