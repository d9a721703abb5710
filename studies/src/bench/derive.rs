//! The numbers that follow from the nets and the synthetic world: `models/derived.json`.
//!
//! An entry has its value, its meaning, the command and the SHA-256 of each input: of files, and of what the world renders. An entry whose command and
//! inputs are as they were is kept. The map of confidences begins with the recognizer's own probability, never with
//! the shipped map, so that it can be derived from nothing but the nets.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use spindoe::calibrate::MARK_FEATURES;
use spindoe::files;
use spindoe::synth::world_sha256;
use spindoe::vision::pose::{PoseSource, TrustMap};
use spindoe_studies::Outcome;
use spindoe_studies::score::median;

use crate::marks;
use crate::small;
use crate::trust::kinds::{self, Judged};
use crate::trust::logistic;

/// The input that is no file: what is rendered.
const WORLD: &str = "synthetic world";
/// Numbers that are derived together.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Part {
    /// From images of balls of any size and of other things.
    Any,
    /// From those of small ones.
    Small,
    /// From clips of balls that are drawn by hand.
    Drawn,
}

impl Part {
    const ALL: [Self; 3] = [Self::Any, Self::Small, Self::Drawn];

    fn names(self) -> &'static [&'static str] {
        match self {
            Self::Any => &["trust_map", "dense_map", "trust_map_wide", "usual_doubt"],
            Self::Small => &["pixels_map"],
            Self::Drawn => &["mark_map"],
        }
    }

    /// The files that they depend on.
    fn inputs(self) -> &'static [&'static str] {
        const INPUTS: [&str; 6] = [
            "models/dots.npz",
            "models/dots-large.npz",
            "models/outline.npz",
            "designs/dots20/pattern.csv",
            "designs/dots32/pattern.csv",
            "studies/patterns/hidden12.csv",
        ];
        match self {
            Self::Any => &INPUTS,
            Self::Small => &INPUTS[..4],
            Self::Drawn => &INPUTS[..3],
        }
    }
}

/// What the numbers are derived from besides the files, and where they go.
#[derive(clap::Args)]
pub struct Args {
    /// The file of derived numbers, read and written.
    #[arg(long, default_value = "models/derived.json")]
    out: PathBuf,
    /// Images for each of the designs.
    #[arg(long, default_value_t = 3_000)]
    images: u64,
    /// Rounds of the fit; each estimates with the map of the one before, the first with none.
    #[arg(long, default_value_t = 2)]
    rounds: u64,
    /// Seed of the images.
    #[arg(long, default_value_t = 14_220_001)]
    seed: u64,
    /// Images of small balls and other small things, for the poses by all pixels.
    #[arg(long, default_value_t = 1_800)]
    small_images: u64,
    /// Seed of these.
    #[arg(long, default_value_t = 9_100)]
    small_seed: u64,
    /// Clips of balls that are drawn by hand, a quarter of them with print.
    #[arg(long, default_value_t = 120)]
    clips: u64,
    /// Seed of these.
    #[arg(long, default_value_t = 36_520_001)]
    clips_seed: u64,
    /// Derive what is up to date, too.
    #[arg(long)]
    force: bool,
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

impl Args {
    /// Derives what is not up to date, and writes the file.
    pub fn run(&self) -> Outcome {
        let out = self.out.as_path();
        let world = world_sha256()?;
        let mut entries: BTreeMap<String, Entry> = match out.exists() {
            true => serde_json::from_slice(&files::read_bytes(out)?)?,
            false => BTreeMap::new(),
        };
        for part in Part::ALL {
            let command = self.command(part);
            let mut inputs = BTreeMap::from([(WORLD.to_owned(), world.clone())]);
            for path in part.inputs() {
                let bytes = files::read_bytes(Path::new(path))?;
                inputs.insert((*path).to_owned(), files::sha256_hex(&bytes));
            }
            let is_kept = |e: &Entry| e.command == command && e.inputs == inputs;
            let names = part.names();
            if !self.force && names.iter().all(|n| entries.get(*n).is_some_and(is_kept)) {
                eprintln!("{}: {} up to date", out.display(), names.join(", "));
                continue;
            }
            for (name, meaning, value) in self.derive(part)? {
                let entry = Entry {
                    meaning: meaning.to_owned(),
                    value,
                    command: command.clone(),
                    inputs: inputs.clone(),
                };
                entries.insert(name.to_owned(), entry);
            }
        }
        let is_known = |name: &str| Part::ALL.iter().any(|part| part.names().contains(&name));
        entries.retain(|name, _| is_known(name));
        let text = serde_json::to_string_pretty(&entries)? + "\n";
        files::write_bytes(out, text.as_bytes())?;
        Ok(())
    }

    /// What repeats a part.
    fn command(&self, part: Part) -> String {
        match part {
            Part::Any => format!(
                "bench derive --images {} --rounds {} --seed {}",
                self.images, self.rounds, self.seed
            ),
            Part::Small => format!(
                "bench derive --small-images {} --small-seed {}",
                self.small_images, self.small_seed
            ),
            Part::Drawn => format!(
                "bench derive --clips {} --clips-seed {}",
                self.clips, self.clips_seed
            ),
        }
    }

    fn derive(&self, part: Part) -> Outcome<Vec<Derived>> {
        match part {
            Part::Any => self.of_any_balls(),
            Part::Small => {
                let answers = small::fitting_answers(self.small_images, self.small_seed)?;
                eprintln!("{} poses by all pixels", answers.len());
                Ok(vec![(
                    "pixels_map",
                    "weights of the evidence of a pose by all pixels of a small ball, the constant first",
                    rounded(logistic::of_pixels(&answers)),
                )])
            }
            Part::Drawn => self.of_drawn_balls(),
        }
    }

    fn of_drawn_balls(&self) -> Outcome<Vec<Derived>> {
        let marks = marks::fitting_marks(self.clips, self.clips_seed)?;
        eprintln!("{} marks", marks.len());
        let rows = marks.iter().map(|m| (m.evidence.features(), m.is_dot));
        let map = logistic::regression::<MARK_FEATURES, { MARK_FEATURES + 1 }>(rows);
        Ok(vec![(
            "mark_map",
            "weights of the evidence that a mark of a ball is a dot, the constant first",
            rounded(map),
        )])
    }

    fn of_any_balls(&self) -> Outcome<Vec<Derived>> {
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
                rounded(map.detections),
            ),
            (
                "dense_map",
                "weights of the evidence of a pose by all places where dots may be, the constant first",
                rounded(map.places),
            ),
            (
                "trust_map_wide",
                "the same without the detector's doubt and the misfit",
                rounded(wide.detections),
            ),
            (
                "usual_doubt",
                "median of the detector's doubt of the dots of correct poses: mean of -ln p",
                serde_json::json!(to_places(usual_doubt(&answers), 3)),
            ),
        ])
    }
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
        .filter(|a| a.is_correct && !matches!(a.evidence.source, PoseSource::Places(_)));
    let correct: Vec<&Judged> = correct.collect();
    match correct.is_empty() {
        true => 0.0,
        false => median(&correct, |a| a.evidence.doubt),
    }
}
