//! Which room of `src` may import which. The drawing is that of the crate's first page; an arrow that is not in it fails.

use std::collections::BTreeSet;
use std::path::Path;

/// A room (a folder or a file of `src`) and the rooms that it may import. The longest name that fits a path is its room.
/// A name stands for the rooms within, too. Everyone may import the `error`s, and the command all that there is.
const DRAWING: &[(&str, &str)] = &[
    ("error", ""),
    ("concurrency", ""),
    ("pipeline", ""),
    ("stats", ""),
    ("fit", "stats"),
    ("geometry", ""),
    ("files", ""),
    ("npz", ""),
    ("pattern", "files geometry"),
    ("ball", "files geometry npz pattern"),
    ("view", "geometry"),
    (
        "recognize",
        "ball concurrency files geometry pattern pipeline view",
    ),
    (
        "validate",
        "ball concurrency geometry pattern recognize stats view",
    ),
    ("stencil", "ball concurrency files geometry pattern"),
    (
        "design",
        "ball concurrency files geometry pattern recognize stats stencil validate view",
    ),
    ("spin", "concurrency files geometry stats"),
    ("mark", "design geometry pattern stencil"),
    ("image", "files"),
    ("source", "files image"),
    ("vision/optics", "files fit geometry image npz view"),
    ("vision/outline/circle", "fit image stats vision/optics"),
    ("vision/dots/patch", "image vision/optics"),
    ("vision/net", "files npz vision/dots/patch"),
    (
        "vision/dots",
        "fit geometry image stats vision/dots/patch vision/net vision/optics",
    ),
    ("vision/pose/trust", "vision/optics"),
    (
        "vision/frame",
        "concurrency geometry image recognize view vision/dots vision/optics vision/outline/circle vision/pose/trust",
    ),
    (
        "vision/outline",
        "fit geometry image stats vision/dots vision/frame vision/net vision/optics vision/outline/circle",
    ),
    (
        "vision/pose",
        "fit geometry image pattern recognize stats view vision/dots vision/frame vision/net vision/optics vision/outline \
         vision/pose/trust",
    ),
    (
        "vision/estimator",
        "ball geometry image pattern recognize view vision/dots vision/frame vision/optics vision/outline vision/pose",
    ),
    ("vision", ""),
    (
        "surface",
        "concurrency files fit geometry image npz stats vision",
    ),
    (
        "clip",
        "concurrency files fit geometry image pattern pipeline recognize source spin stats surface view vision",
    ),
    (
        "calibrate",
        "ball clip concurrency fit geometry image pattern recognize spin stats surface view vision",
    ),
    (
        "synth",
        "clip concurrency design files geometry image pattern vision",
    ),
    (
        "camera",
        "clip concurrency design geometry image pattern spin stats stencil synth validate vision",
    ),
    (
        "plot",
        "calibrate concurrency files geometry image pattern stencil vision",
    ),
    ("dataset", "clip files geometry plot spin vision"),
    (
        "report",
        "ball calibrate camera clip concurrency design files geometry mark pattern plot recognize spin stats stencil \
         surface validate view vision",
    ),
];

/// Arrows that the code still has against the drawing: importing room, imported room. None may be added, and one that is
/// gone leaves this list.
const WRONG_YET: &[(&str, &str)] = &[
    // The stages of a pose are methods of the estimator yet.
    ("vision/pose", "vision/estimator"),
];

/// The room that a path of modules lies in.
fn room(path: &[String]) -> Option<&'static str> {
    let path = path.join("/") + "/";
    let rooms = DRAWING.iter().map(|(room, _)| *room);
    let within = rooms.filter(|room| path.starts_with(&format!("{room}/")));
    within.max_by_key(|room| room.len())
}

/// The paths of a `use` tree, or of a path in an expression, that `text` begins with.
fn paths(prefix: &[String], text: &str, found: &mut Vec<Vec<String>>) -> usize {
    let name = |c: char| c.is_alphanumeric() || c == '_';
    let begins = text.trim_start();
    let mut at = text.len() - begins.len();
    if let Some(tree) = begins.strip_prefix('{') {
        at += 1;
        let mut rest = tree;
        while !rest.is_empty() && !rest.trim_start().starts_with('}') {
            let read = paths(prefix, rest, found).max(1);
            (at, rest) = (at + read, &rest[read..]);
            let next = rest.find([',', '}']).unwrap_or(rest.len());
            let next = next + usize::from(rest[next..].starts_with(','));
            (at, rest) = (at + next, &rest[next..]);
        }
        return at + 1;
    }
    let end = begins.find(|c| !name(c)).unwrap_or(begins.len());
    let mut path = prefix.to_vec();
    match &begins[..end] {
        "super" => drop(path.pop()),
        "self" => {}
        word => path.push(word.to_owned()),
    }
    at += end;
    match text[at..].strip_prefix("::") {
        Some(rest) => at + 2 + paths(&path, rest, found),
        None => {
            found.push(path);
            at
        }
    }
}

/// The paths that a file imports or names, tests and comments left out; `here` is its own path.
fn imports(here: &[String], text: &str) -> Vec<Vec<String>> {
    let text = text.split("#[cfg(test)]\nmod tests {").next().unwrap_or("");
    let code: Vec<&str> = text.lines().filter_map(|l| l.split("//").next()).collect();
    let code = code.join("\n");
    let mut found = Vec::new();
    for (root, prefix) in [("crate::", &[][..]), ("super::", here)] {
        for (at, _) in code.match_indices(root) {
            let before = code[..at].chars().next_back().unwrap_or(' ');
            if before.is_alphanumeric() || before == '_' || before == ':' {
                continue;
            }
            let tree = match root {
                "crate::" => &code[at + root.len()..],
                _ => &code[at..],
            };
            paths(prefix, tree, &mut found);
        }
    }
    found
}

/// Every arrow between two rooms, with a file that has it.
fn arrows(folder: &Path, path: &[String], found: &mut BTreeSet<(String, String, String)>) {
    for entry in std::fs::read_dir(folder).expect("a folder of src") {
        let file = entry.expect("a file of src").path();
        let stem = file.file_stem().expect("a name").to_string_lossy();
        let mut here = path.to_vec();
        if !matches!(&*stem, "mod" | "lib" | "main") {
            here.push(stem.to_string());
        }
        if file.is_dir() {
            arrows(&file, &here, found);
        }
        let is_code = file.extension().is_some_and(|e| e == "rs") && stem != "tests";
        let from = here.first().filter(|top| *top != "cli" && is_code);
        let Some(from) = from.map(|_| room(&here)) else {
            continue;
        };
        let from = from.unwrap_or_else(|| panic!("{}: a room that is not drawn", file.display()));
        let text = std::fs::read_to_string(&file).expect("code");
        for path in imports(&here, &text) {
            let to = room(&path).unwrap_or(match path.first().map(String::as_str) {
                Some("cli") => "cli",
                _ => from,
            });
            if from != to && to != "error" {
                found.insert((from.into(), to.into(), file.display().to_string()));
            }
        }
    }
}

#[test]
fn rooms_import_only_what_the_drawing_allows() {
    let mut found = BTreeSet::new();
    let src = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    arrows(&src, &[], &mut found);
    let is_drawn = |from: &str, to: &str| {
        let (_, allowed) = DRAWING.iter().find(|(r, _)| *r == from).expect("a room");
        let is_within = |room: &str| to == room || to.starts_with(&format!("{room}/"));
        is_within(from) || allowed.split_whitespace().any(is_within)
    };
    let is_known = |from: &str, to: &str| WRONG_YET.contains(&(from, to));
    let wrong = found
        .iter()
        .filter(|(f, t, _)| !is_drawn(f, t) && !is_known(f, t));
    let wrong: Vec<_> = wrong
        .map(|(f, t, file)| format!("{file}: {f} imports {t}"))
        .collect();
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    for (from, to) in WRONG_YET {
        let is_there = found.iter().any(|(f, t, _)| (&**f, &**t) == (*from, *to));
        assert!(
            is_there,
            "{from} no longer imports {to}: strike it from the list"
        );
    }
}

#[test]
fn the_drawing_has_no_circle() {
    for (number, (room, allowed)) in DRAWING.iter().enumerate() {
        for below in allowed.split_whitespace() {
            let at = DRAWING.iter().position(|(r, _)| *r == below);
            let at = at.unwrap_or_else(|| panic!("{room} imports {below}, which is not drawn"));
            assert!(
                at < number,
                "{room} stands before {below}, which it imports"
            );
        }
    }
}

#[test]
fn imports_are_read_from_trees_and_expressions() {
    let here = ["vision".to_owned(), "pose".to_owned()];
    let text = "use crate::spin::{Fit, robust::{A as B, C}};\nuse super::super::plot;\n// crate::cli::x\nlet x = super::camera::Pixel { u: 1 };";
    let found = imports(&here, text);
    let found: BTreeSet<String> = found.iter().map(|p| p.join("/")).collect();
    let expected = [
        "spin/Fit",
        "spin/robust/A",
        "spin/robust/C",
        "plot",
        "vision/camera/Pixel",
    ];
    assert_eq!(found, expected.map(String::from).into());
}
