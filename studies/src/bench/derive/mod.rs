//! The numbers that follow from the nets and the synthetic world: `models/derived.json`.
//!
//! An entry has its value, its meaning, the command and the SHA-256 of each input: of files, and of what the world renders. The
//! numbers of a group are derived together; a group whose commands and inputs are as they were is kept. The map of
//! confidences begins with the recognizer's own probability, never with the shipped map, so that it can be derived from nothing but
//! the nets.

mod distance;
mod outline;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use spindoe::files;
use spindoe::synth::world_sha256;
use spindoe::vision::estimator::TrustMap;
use spindoe_studies::Outcome;
use spindoe_studies::score::median;

use crate::trust::kinds::{self, Judged};
use crate::trust::logistic;

/// The input that is no file: what is rendered.
const WORLD: &str = "synthetic world";
/// Files that poses depend on.
const POSES: [&str; 6] = [
    "models/dots.npz",
    "models/dots-large.npz",
    "models/outline.npz",
    "designs/dots12/pattern.csv",
    "designs/dots20/pattern.csv",
    "designs/dots32/pattern.csv",
];

/// What the numbers are derived from besides the files, and where they go.
#[derive(clap::Args)]
pub struct Args {
    /// The file of derived numbers, read and written.
    #[arg(long, default_value = "models/derived.json")]
    out: PathBuf,
    /// Images for each of the designs, for the map of confidences.
    #[arg(long, default_value_t = 3_000)]
    images: u64,
    /// Rounds of the map's fit; each estimates with the map of the one before, the first with none.
    #[arg(long, default_value_t = 2)]
    rounds: u64,
    /// Seed of the map's images.
    #[arg(long, default_value_t = 14_220_001)]
    seed: u64,
    /// Derive what is up to date, too.
    #[arg(long)]
    force: bool,
    /// Derive this number anew, with those that are derived together with it, and keep all others as they are.
    #[arg(long, value_name = "NAME")]
    only: Option<String>,
}

/// A derived number, or several.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Entry {
    meaning: String,
    value: serde_json::Value,
    command: String,
    inputs: BTreeMap<String, String>,
}

/// Name, meaning and value.
type Derived = (&'static str, &'static str, serde_json::Value);

/// Numbers that are derived together.
struct Group {
    names: &'static [&'static str],
    command: String,
    /// Files that they depend on, besides the world.
    files: &'static [&'static str],
    derive: fn(&Args) -> Outcome<Vec<Derived>>,
}

impl Args {
    fn groups(&self) -> [Group; 3] {
        let trust = format!(
            "bench derive --images {} --rounds {} --seed {}",
            self.images, self.rounds, self.seed
        );
        let fixed = || "bench derive".to_owned();
        [
            Group {
                names: &["trust_map", "dense_map", "trust_map_wide", "usual_doubt"],
                command: trust,
                files: &POSES,
                derive: Self::trust,
            },
            Group {
                names: &["outline_systematic"],
                command: fixed(),
                files: &["models/outline.npz", "designs/dots20/pattern.csv"],
                derive: |_| Ok(vec![outline_systematic()?]),
            },
            Group {
                names: &["shared_distance"],
                command: fixed(),
                files: &[
                    "models/dots.npz",
                    "models/dots-large.npz",
                    "models/outline.npz",
                    "designs/dots20/pattern.csv",
                ],
                derive: |_| Ok(vec![shared_distance()?]),
            },
        ]
    }

    /// Derives what is not up to date, and writes the file.
    pub fn run(&self) -> Outcome {
        let out = self.out.as_path();
        let world = world_sha256()?;
        let before: BTreeMap<String, Entry> = match out.exists() {
            true => serde_json::from_slice(&files::read_bytes(out)?)?,
            false => BTreeMap::new(),
        };
        let mut entries = BTreeMap::new();
        for group in self.groups() {
            let mut inputs = BTreeMap::from([(WORLD.to_owned(), world.clone())]);
            for path in group.files {
                let bytes = files::read_bytes(Path::new(path))?;
                inputs.insert((*path).to_owned(), files::sha256_hex(&bytes));
            }
            let kept = group.names.iter().map(|name| before.get(*name));
            let is_kept = |e: &&Entry| match &self.only {
                Some(name) => !group.names.contains(&name.as_str()),
                None => !self.force && e.command == group.command && e.inputs == inputs,
            };
            let kept: Option<Vec<&Entry>> = kept.map(|e| e.filter(is_kept)).collect();
            if let Some(kept) = kept {
                let names = group.names.iter().map(|name| (*name).to_owned());
                entries.extend(names.zip(kept.into_iter().cloned()));
                continue;
            }
            eprintln!("deriving {}", group.names.join(", "));
            for (name, meaning, value) in (group.derive)(self)? {
                let entry = Entry {
                    meaning: meaning.to_owned(),
                    value,
                    command: group.command.clone(),
                    inputs: inputs.clone(),
                };
                entries.insert(name.to_owned(), entry);
            }
        }
        if entries == before {
            eprintln!("{}: up to date", out.display());
            return Ok(());
        }
        let text = serde_json::to_string_pretty(&entries)? + "\n";
        files::write_bytes(out, text.as_bytes())?;
        Ok(())
    }

    /// The map of confidences, and what goes with it.
    fn trust(&self) -> Outcome<Vec<Derived>> {
        let mut map = TrustMap::IDENTITY;
        let mut answers: Vec<Judged> = Vec::new();
        for round in 1..=self.rounds {
            answers = kinds::fitting_answers(map, self.images, self.seed)?;
            map = logistic::fit(&answers, &[]);
            eprintln!("round {round}: {} poses, {map:?}", answers.len());
        }
        let wide = logistic::fit(&answers, &logistic::DOUBT_AND_MISFIT);
        Ok(vec![
            (
                "trust_map",
                "weights of a pose's evidence in its ln odds, the constant first",
                rounded(std::iter::once(map.constant).chain(map.weights)),
            ),
            (
                "dense_map",
                "weights of the evidence of a pose by all places where dots may be, the constant first",
                rounded(map.dense),
            ),
            (
                "trust_map_wide",
                "the same without the detector's doubt and the misfit",
                rounded(std::iter::once(wide.constant).chain(wide.weights)),
            ),
            (
                "usual_doubt",
                "median of the detector's doubt of the dots of correct poses: mean of -ln p",
                serde_json::json!(to_places(usual_doubt(&answers), 3)),
            ),
        ])
    }
}

fn outline_systematic() -> Outcome<Derived> {
    Ok((
        "outline_systematic",
        "standard deviation of what the surest outlines of the net err beyond their covariance, in radii",
        serde_json::json!(to_places(outline::systematic()?, 4)),
    ))
}

fn shared_distance() -> Outcome<Derived> {
    Ok((
        "shared_distance",
        "error of the camera's distance by all frames of a sequence over that by one",
        serde_json::json!(to_places(distance::shared()?, 2)),
    ))
}

/// The constant and the weights, to four places.
fn rounded(all: impl IntoIterator<Item = f64>) -> serde_json::Value {
    let all = all.into_iter();
    serde_json::json!(all.map(|w| to_places(w, 4)).collect::<Vec<f64>>())
}

fn to_places(value: f64, places: i32) -> f64 {
    let unit = 10f64.powi(places);
    // No negative zero.
    (value * unit).round() / unit + 0.0
}

fn usual_doubt(answers: &[Judged]) -> f64 {
    let correct = answers
        .iter()
        .filter(|a| a.is_correct && a.evidence.dense.is_none());
    let correct: Vec<&Judged> = correct.collect();
    match correct.is_empty() {
        true => 0.0,
        false => median(&correct, |a| a.evidence.doubt),
    }
}
