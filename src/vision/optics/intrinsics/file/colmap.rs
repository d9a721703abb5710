//! COLMAP's `cameras.txt`, a line a camera.

use super::super::tree::Value;

/// The cameras of COLMAP's `cameras.txt`, each under its number: `ID MODEL WIDTH HEIGHT PARAMETERS`, whose pixels' centers lie at halves;
/// `None` for another file.
pub(super) fn of_colmap(text: &str) -> Option<std::result::Result<Value, String>> {
    let lines = text
        .lines()
        .map(str::trim)
        .filter(|line| !line.is_empty() && !line.starts_with('#'));
    let rows: Vec<Vec<&str>> = lines
        .map(|line| line.split_whitespace().collect())
        .collect();
    let is_row = |row: &Vec<&str>| {
        row.len() > 4
            && row[0].bytes().all(|b| b.is_ascii_digit())
            && row[1].bytes().all(|b| b.is_ascii_uppercase() || b == b'_')
            && row[2..].iter().all(|n| n.parse::<f64>().is_ok())
    };
    if rows.is_empty() || !rows.iter().all(is_row) {
        return None;
    }
    let cameras = rows
        .iter()
        .map(|row| colmap_camera(row).map(|camera| (row[0].to_owned(), camera)));
    Some(
        cameras
            .collect::<std::result::Result<Vec<_>, _>>()
            .map(Value::Map),
    )
}

fn colmap_camera(row: &[&str]) -> std::result::Result<Value, String> {
    // Where the four numbers stand among the parameters, and where OpenCV's coefficients do.
    let (focal, lens): ([usize; 4], &[usize]) = match row[1] {
        "SIMPLE_PINHOLE" => ([0, 0, 1, 2], &[]),
        "PINHOLE" => ([0, 1, 2, 3], &[]),
        "SIMPLE_RADIAL" | "SIMPLE_RADIAL_FISHEYE" => ([0, 0, 1, 2], &[3]),
        "RADIAL" | "RADIAL_FISHEYE" => ([0, 0, 1, 2], &[3, 4]),
        "OPENCV" | "OPENCV_FISHEYE" => ([0, 1, 2, 3], &[4, 5, 6, 7]),
        "FULL_OPENCV" => ([0, 1, 2, 3], &[4, 5, 6, 7, 8, 9, 10, 11]),
        other => {
            return Err(format!(
                "expected a PINHOLE, RADIAL or OPENCV camera, found {other}"
            ));
        }
    };
    let parameters = &row[4..];
    let expected = focal.iter().chain(lens).max().map_or(0, |last| last + 1);
    if parameters.len() != expected {
        return Err(format!(
            "expected {expected} parameters of {}, found {}",
            row[1],
            parameters.len()
        ));
    }
    let number = |k: usize| parameters[k].parse::<f64>().unwrap_or(f64::NAN);
    let text = |x: f64| Value::Text(x.to_string());
    let is_fisheye = row[1].ends_with("FISHEYE");
    let mut coefficients: Vec<f64> = lens.iter().map(|k| number(*k)).collect();
    if is_fisheye || !coefficients.is_empty() {
        coefficients.resize(coefficients.len().max(4), 0.0);
    }
    let [fx, fy, cx, cy] = focal.map(number);
    Ok(Value::Map(vec![
        (
            "intrinsics".to_owned(),
            Value::List([fx, fy, cx - 0.5, cy - 0.5].map(text).to_vec()),
        ),
        (
            "distortion".to_owned(),
            Value::List(coefficients.into_iter().map(text).collect()),
        ),
        (
            "model".to_owned(),
            Value::Text(if is_fisheye { "fisheye" } else { "opencv" }.to_owned()),
        ),
        ("width".to_owned(), Value::Text(row[2].to_owned())),
        ("height".to_owned(), Value::Text(row[3].to_owned())),
    ]))
}
