//! Files of several cameras: each under its name, or the two of a stereo rig side by side.

use super::super::tree::{Value, plain};
use super::foreign;
use super::keys::{DISTORTION, FOCAL, MATRIX, MODEL, PARAMETERS, SIDES, SIZES, bare};

/// What the models of lenses have in their names.
const LENS_WORDS: [&str; 11] = [
    "fisheye",
    "equi",
    "plumb",
    "radtan",
    "pinhole",
    "opencv",
    "brown",
    "kb",
    "kannala",
    "perspective",
    "rational",
];

/// Whether a mapping describes a camera.
fn is_camera(value: &Value) -> bool {
    let is_matrix = |(key, value): &(String, Value)| {
        let numbers = || value.numbers().map_or(0, |n| n.len());
        MATRIX.contains(&bare(key).as_str()) && matches!(numbers(), 4 | 9)
    };
    let has_focal = |entries: &[(String, Value)]| {
        entries
            .iter()
            .any(|(key, _)| FOCAL[0].contains(&bare(key).as_str()))
    };
    let mut groups = value
        .entries()
        .iter()
        .filter(|(key, _)| PARAMETERS.contains(&bare(key).as_str()));
    foreign::is_foreign(value)
        || value.entries().iter().any(is_matrix)
        || has_focal(value.entries())
        || groups.any(|(_, group)| has_focal(group.entries()))
}

/// The cameras of a file, with their names; that of a file of one is empty.
pub(super) fn cameras(tree: &Value) -> Vec<(String, Value)> {
    if is_camera(tree) {
        return vec![(String::new(), tree.clone())];
    }
    let rig = of_rig(tree);
    if !rig.is_empty() {
        return rig;
    }
    let own = tree.entries().iter().filter(|(_, value)| is_camera(value));
    own.map(|(key, value)| (key.clone(), within(tree, key, value)))
        .collect()
}

/// A camera within a file, with what stands beside it of its images and its model.
fn within(tree: &Value, key: &str, camera: &Value) -> Value {
    let mut entries = camera.entries().to_vec();
    let beside = tree.entries().iter().filter(|(key, _)| is_shared(key));
    entries.extend(beside.cloned());
    entries.extend(lens_beside(tree, key, camera));
    if plain(key).contains("fisheye") && !entries.iter().any(names_lens) {
        entries.push(("model".to_owned(), Value::Text("fisheye".to_owned())));
    }
    Value::Map(entries)
}

/// Whether an entry names a model of a lens: other models are of products, other distortions are numbers.
fn names_lens((key, value): &(String, Value)) -> bool {
    let Value::Text(word) = value else {
        return false;
    };
    let (bare, word) = (bare(key), plain(word));
    let is_key_of_lens = ["dist", "fisheye"].iter().any(|part| bare.contains(part));
    let is_word_of_lens = LENS_WORDS.iter().any(|part| word.contains(part));
    MODEL.contains(&bare.as_str()) && (is_key_of_lens && bare != "distortion" || is_word_of_lens)
}

/// What stands in a section of its own of a ZED camera's lens, `[LEFT_DISTO]` beside `[LEFT_CAM_HD]`.
fn lens_beside(tree: &Value, key: &str, camera: &Value) -> Vec<(String, Value)> {
    let key = plain(key);
    let side = ["left", "right"].into_iter();
    let side = side
        .filter(|side| key.starts_with(&format!("{side}cam")))
        .find(|_| camera.get(&["k1"]).is_none());
    let section = side.and_then(|side| tree.get(&[&format!("{side}disto")]));
    section.map_or(Vec::new(), |section| section.entries().to_vec())
}

/// Whether a key says of images or a model what may hold for several cameras.
fn is_shared(key: &str) -> bool {
    let bare = bare(key);
    let is_side = || SIDES.iter().flatten().any(|n| n.contains(&bare.as_str()));
    let is_model = || bare != "distortion" && MODEL.contains(&bare.as_str());
    SIZES.contains(&plain(key).as_str()) || is_side() || is_model()
}

/// The cameras of a flat file of two: `M1, D1, M2, D2`, `K_left, dist_left`, `Camera1.fx`.
fn of_rig(tree: &Value) -> Vec<(String, Value)> {
    let sides = [("left", ["1", "left", "l"]), ("right", ["2", "right", "r"])];
    let cameras = sides.into_iter().filter_map(|(name, marks)| {
        let own = |key: &str| -> Option<String> {
            let key = plain(
                key.strip_prefix("Camera1.")
                    .filter(|_| name == "left")
                    .or_else(|| key.strip_prefix("Camera2.").filter(|_| name == "right"))
                    .unwrap_or(key),
            );
            let of_mark = |mark: &&str| {
                let rest = key
                    .strip_suffix(*mark)
                    .or_else(|| key.strip_prefix(*mark))?;
                let is_known = MATRIX.contains(&rest) || DISTORTION.contains(&rest);
                is_known.then(|| rest.to_owned())
            };
            marks.iter().find_map(of_mark)
        };
        let prefix = if name == "left" {
            "Camera1."
        } else {
            "Camera2."
        };
        let entries = tree.entries().iter().filter_map(|(key, value)| {
            let flat = key.strip_prefix(prefix).map(str::to_owned);
            let shared = || is_shared(key).then(|| key.clone());
            Some((flat.or_else(|| own(key)).or_else(shared)?, value.clone()))
        });
        let mut entries: Vec<(String, Value)> = entries.collect();
        // ZED's coefficients of a fisheye.
        if let Some(lens) = tree.get(&[&format!("d{name}fe")]) {
            entries.push(("D".to_owned(), lens.clone()));
            entries.push(("model".to_owned(), Value::Text("fisheye".to_owned())));
        }
        let camera = Value::Map(entries);
        is_camera(&camera).then(|| (name.to_owned(), camera))
    });
    cameras.collect()
}
