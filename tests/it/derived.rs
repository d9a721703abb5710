//! The numbers in `models/derived.json` belong to the nets, patterns and synthetic world that they were derived from.

use std::path::Path;

use spindoe::files;

#[test]
fn derived_numbers_are_of_the_nets_that_are_here() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let text = std::fs::read(root.join("models/derived.json")).expect("derived numbers");
    let entries: serde_json::Value = serde_json::from_slice(&text).expect("JSON");
    let world = spindoe::synth::world_sha256().expect("frames");
    for (name, entry) in entries.as_object().expect("entries") {
        let inputs = entry["inputs"].as_object().expect("inputs");
        assert!(inputs.contains_key("synthetic world"), "{name}");
        let is_net = |path: &String| path.starts_with("models/");
        assert!(inputs.keys().any(is_net), "{name}");
        for (path, digest) in inputs {
            let now = match path.as_str() {
                "synthetic world" => world.clone(),
                file => {
                    let bytes = std::fs::read(root.join(file)).expect("an input");
                    files::sha256_hex(&bytes)
                }
            };
            let command = &entry["command"];
            assert_eq!(*digest, now, "{name}: {path} has changed since: {command}");
        }
    }
}

#[test]
fn the_worlds_digest_is_the_same_on_any_number_of_threads() {
    let all = spindoe::synth::world_sha256().expect("frames");
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build();
    let one = pool
        .expect("a thread")
        .install(spindoe::synth::world_sha256);
    assert_eq!(one.expect("frames"), all);
}
