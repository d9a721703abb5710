//! The numbers in `models/derived.json` belong to the files that they were derived from.

use std::path::Path;

use spindoe::files;

#[test]
fn derived_numbers_are_of_the_nets_that_are_here() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let text = std::fs::read(root.join("models/derived.json")).expect("derived numbers");
    let entries: serde_json::Value = serde_json::from_slice(&text).expect("JSON");
    for (name, entry) in entries.as_object().expect("entries") {
        let inputs = entry["inputs"].as_object().expect("inputs");
        assert!(inputs.contains_key("models/dots.npz"), "{name}");
        for (path, digest) in inputs {
            let bytes = std::fs::read(root.join(path)).expect("an input");
            let now = files::sha256_hex(&bytes);
            let command = &entry["command"];
            assert_eq!(*digest, now, "{name}: {path} has changed since: {command}");
        }
    }
}
