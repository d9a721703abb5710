//! Makes constants of `models/derived.json`, the numbers that follow from the nets and the synthetic world. A
//! damaged file ends the build with one line.

use std::fmt::Write as _;
use std::path::Path;
use std::process::ExitCode;

const DERIVED: &str = "models/derived.json";

fn main() -> ExitCode {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-changed={DERIVED}");
    match generate() {
        Ok(()) => ExitCode::SUCCESS,
        Err(problem) => {
            println!("cargo::error={DERIVED}: {problem}");
            ExitCode::FAILURE
        }
    }
}

/// Writes a constant for each entry: a number, or an array of numbers.
fn generate() -> Result<(), String> {
    let text = std::fs::read_to_string(DERIVED).map_err(|e| e.to_string())?;
    let all: serde_json::Value = serde_json::from_str(&text).map_err(|e| e.to_string())?;
    let entries = all.as_object().ok_or("expected an object of entries")?;
    let mut code = String::new();
    for (name, entry) in entries {
        let (kind, value) = literal(&entry["value"])
            .ok_or_else(|| format!("{name}.value: expected a number or an array of numbers"))?;
        let meaning = entry["meaning"].as_str().unwrap_or_default();
        let written = writeln!(
            code,
            "/// {meaning}.\npub const {}: {kind} = {value};",
            name.to_uppercase()
        );
        written.map_err(|e| e.to_string())?;
    }
    let folder = std::env::var_os("OUT_DIR").ok_or("OUT_DIR is not set")?;
    std::fs::write(Path::new(&folder).join("derived.rs"), code).map_err(|e| e.to_string())
}

/// The type and the literal of a value.
fn literal(value: &serde_json::Value) -> Option<(String, String)> {
    if let Some(number) = value.as_f64() {
        return Some(("f64".to_owned(), format!("{number:?}")));
    }
    let numbers: Option<Vec<f64>> = value.as_array()?.iter().map(|x| x.as_f64()).collect();
    let numbers = numbers?;
    Some((format!("[f64; {}]", numbers.len()), format!("{numbers:?}")))
}
