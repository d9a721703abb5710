//! How well do objectives predict what a camera fails to identify, for any number of dots?
//!
//!     cargo run --release -p spindoe-studies -- objectives-images --help
//!
//! For each number of dots: patterns in two groups, random ones and random ones after some descent
//! steps on an objective that takes turns. Each is put before a hard camera, in rendered frames that the
//! whole estimator reads. The measured quantity is the mean over frames of the probability that the answer is wrong: 1 less the probability that the
//! recognizer gives to its pose where that is right, 1 where it is wrong or missing. The scenes are
//! the same for all patterns of a number of dots; the camera's distance is known to the estimator,
//! which makes it faster. Frames without an outline are left out: no pattern changes them.
//!
//! Printed: the rank correlation (Spearman) of each objective with that quantity, and the
//! correlation of the quantity with itself on the other half of the frames, which bounds it.
//! Measurements are kept in OUT_DIR and read from there if present.

use std::error::Error;
use std::path::{Path, PathBuf};

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use serde_json::{Value, json};
use spindoe::Pattern;
use spindoe::camera::{CameraConditions, CameraTrials, FrameOutcome, coverage};
use spindoe::design::constraints::max_separation;
use spindoe::design::descent::descend;
use spindoe::design::objective::Coverage;
use spindoe::design::{Constraints, Objective, ObjectiveName};
use spindoe::geometry::Vec3;
use spindoe::pattern::random_pattern;
use spindoe::view::ProtocolName;
use spindoe::vision::Camera;
use spindoe::vision::estimator::CameraModel;
use spindoe_studies::ranks::spearman;

type Outcome<T> = Result<T, Box<dyn Error + Send + Sync>>;

/// Seeds: of the patterns, and of the scenes.
const PATTERN_SEED: u64 = 15_400_001;
const SCENE_SEED: u64 = 15_400_002;
/// Distance of the camera, ball radii.
const DISTANCE: f64 = 20.0;
/// Numbers of detected dots are counted up to this one.
const MAX_COUNT: usize = 24;
/// Objectives that patterns descend on, in turn.
const DESCENTS: [ObjectiveName; 2] = [ObjectiveName::MeanNn, ObjectiveName::WhitenedNn];

/// A pattern with what was measured on the two halves of the frames.
struct Row {
    dots: Vec<Vec3>,
    descended: bool,
    failures: [f64; 2],
    /// Share of the frames with a wrong or no answer.
    failed: f64,
    /// Mean number of detected dots.
    detected: f64,
    /// Frames, and the sum of their failures, by number of detected dots.
    by_count: Vec<[f64; 2]>,
}

/// A camera so hard that some percent of the frames fail.
fn conditions(dots: usize) -> CameraConditions {
    let (ball_px, dot_diameter) = match dots {
        0..=17 => (27.0, 0.08),
        18..=21 => (26.0, 0.08),
        22..=27 => (25.0, 0.08),
        28..=39 => (25.0, 0.07),
        _ => (26.0, 0.06),
    };
    CameraConditions {
        ball_px,
        noise_levels: Some(5.0),
        defocus_px: Some(0.5),
        distance_radii: Some(DISTANCE),
        dot_diameter,
        ..CameraConditions::default()
    }
}

fn pattern(dots: usize, index: usize) -> Outcome<(Pattern, bool)> {
    let mut rng = ChaCha8Rng::seed_from_u64(PATTERN_SEED + dots as u64);
    rng.set_stream(index as u64);
    let nearest = 1.5 * 2.0 * conditions(dots).dot_diameter;
    let separation = rng.random_range(nearest..0.6 * max_separation(dots));
    let start = random_pattern(dots, separation, &mut rng)?;
    if index.is_multiple_of(2) {
        return Ok((start, false));
    }
    let name = DESCENTS[index / 2 % DESCENTS.len()];
    let objective = Objective::for_view(name, &ProtocolName::Image.view());
    let constraints = Constraints {
        min_separation_rad: separation,
        min_visible: 4,
        seam_margin_rad: 0.0,
        ..Constraints::default()
    };
    let steps = rng.random_range(2..16);
    Ok((descend(&start, &objective, &constraints, steps)?, true))
}

fn measured(dots: usize, index: usize, frames: u64) -> Outcome<Row> {
    let (pattern, descended) = pattern(dots, index)?;
    let mut trials = CameraTrials::new(conditions(dots), SCENE_SEED);
    trials.estimator.camera = CameraModel::Known(Camera::Near {
        inverse_distance: 1.0 / DISTANCE,
    });
    let seen = trials.each_frame(&pattern, 0..frames, &|_| (), |rendering, found| {
        found.outline.is_some().then(|| {
            let outcome = FrameOutcome::of(found, &rendering.rotation);
            let failure = match found.pose() {
                Some(pose) if outcome.is_right() => 1.0 - pose.confidence,
                _ => 1.0,
            };
            let likely = found.dots.iter().filter(|d| d.confidence >= 0.5).count();
            (outcome.is_right(), failure, likely)
        })
    })?;
    let (mut sums, mut counts, mut failed, mut detected) = ([0.0; 2], [0.0; 2], 0.0, 0.0);
    let mut by_count = vec![[0.0; 2]; MAX_COUNT + 1];
    for (k, frame) in seen.into_iter().enumerate() {
        let Some((is_right, failure, likely)) = frame else {
            continue;
        };
        let of_count = &mut by_count[likely.min(MAX_COUNT)];
        *of_count = [of_count[0] + 1.0, of_count[1] + failure];
        sums[k % 2] += failure;
        counts[k % 2] += 1.0;
        detected += likely as f64;
        failed += f64::from(u8::from(!is_right));
    }
    let count: f64 = counts.iter().sum();
    Ok(Row {
        dots: pattern.dots().to_vec(),
        descended,
        failures: [sums[0] / counts[0], sums[1] / counts[1]],
        failed: failed / count,
        detected: detected / count,
        by_count,
    })
}

fn to_json(rows: &[Row]) -> Value {
    rows.iter()
        .map(|r| {
            json!({
                "dots": r.dots.iter().map(|d| [d.x, d.y, d.z]).collect::<Vec<_>>(),
                "descended": r.descended, "failures": r.failures, "failed": r.failed,
                "detected": r.detected, "by_count": r.by_count,
            })
        })
        .collect()
}

fn from_json(path: &Path) -> Outcome<Vec<Row>> {
    let rows: Vec<Value> = serde_json::from_slice(&std::fs::read(path)?)?;
    rows.iter()
        .map(|r| {
            let dots: Vec<[f64; 3]> = serde_json::from_value(r["dots"].clone())?;
            Ok(Row {
                dots: dots.into_iter().map(Vec3::from).collect(),
                descended: serde_json::from_value(r["descended"].clone())?,
                failures: serde_json::from_value(r["failures"].clone())?,
                failed: serde_json::from_value(r["failed"].clone())?,
                detected: serde_json::from_value(r["detected"].clone())?,
                by_count: serde_json::from_value(r["by_count"].clone()).unwrap_or_default(),
            })
        })
        .collect()
}

fn report(name: &str, rows: &[&Row], values: &[(String, Vec<f64>)], indices: &[usize]) {
    let half = |k: usize| -> Vec<f64> { rows.iter().map(|r| r.failures[k]).collect() };
    let both: Vec<f64> = rows.iter().map(|r| r.failures.iter().sum()).collect();
    let halves = spearman(&half(0), &half(1));
    // Spearman and Brown: of the whole from that of its halves; no predictor exceeds its root.
    let reliability = (2.0 * halves / (1.0 + halves)).max(0.0);
    println!(
        "  {name} {}: halves {halves:.3}, at most {:.3}",
        rows.len(),
        reliability.sqrt()
    );
    for (objective, all) in values {
        let own: Vec<f64> = indices.iter().map(|&i| all[i]).collect();
        let r = spearman(&own, &both);
        let half = 1.96 * (1.06 / (rows.len() as f64 - 3.0)).sqrt();
        let (low, high) = ((r.atanh() - half).tanh(), (r.atanh() + half).tanh());
        println!("    {objective:<26} {r:+.3} [{low:+.3}, {high:+.3}]");
    }
}

/// What is asked for.
#[derive(clap::Args)]
pub struct Args {
    /// Folder in which measurements are kept, and read from if present.
    #[arg(long, default_value = "any_dots")]
    out: PathBuf,
    /// Patterns of a number of dots.
    #[arg(long, default_value_t = 200)]
    patterns: usize,
    /// Frames of a pattern.
    #[arg(long, default_value_t = 400)]
    frames: u64,
    /// Numbers of dots.
    #[arg(long, num_args = 1.., default_values_t = [16, 20, 24, 32, 48])]
    dots: Vec<usize>,
}

impl Args {
    /// Measures and prints.
    ///
    /// # Errors
    /// What hinders the measurement.
    pub fn run(&self) -> Outcome<()> {
        let (dir, count, frames) = (&self.out, self.patterns, self.frames);
        std::fs::create_dir_all(dir)?;
        for &dots in &self.dots {
            let path = dir.join(format!("dots{dots}.json"));
            let rows = if path.exists() {
                from_json(&path)?
            } else {
                let rows: Outcome<Vec<Row>> = (0..count)
                    .into_par_iter()
                    .map(|index| measured(dots, index, frames))
                    .collect();
                let rows = rows?;
                std::fs::write(&path, serde_json::to_vec(&to_json(&rows))?)?;
                rows
            };
            let mean =
                |f: &dyn Fn(&Row) -> f64| rows.iter().map(f).sum::<f64>() / rows.len() as f64;
            println!(
                "{dots} dots: mean failure {:.2} %, wrong or missing {:.2} %, {:.1} dots detected",
                100.0 * mean(&|r| 0.5 * (r.failures[0] + r.failures[1])),
                100.0 * mean(&|r| r.failed),
                mean(&|r| r.detected)
            );
            let view = ProtocolName::Image.view();
            let mut values = Vec::new();
            for name in ObjectiveName::ALL.into_iter().filter(|n| n.suits(dots)) {
                let objective = Objective::for_view(name, &view);
                let all: Result<Vec<f64>, _> = rows
                    .par_iter()
                    .map(|r| Ok::<_, spindoe::Error>(objective.evaluate_at(&r.dots)?.value))
                    .collect();
                values.push((name.to_string(), all?));
            }
            let camera = coverage(&conditions(dots), dots, &|_| ())?;
            println!("{camera:?}");
            for (label, o) in [
                ("of the camera", camera),
                (
                    "without crowds",
                    Coverage {
                        crowding: 0.0,
                        ..camera
                    },
                ),
            ] {
                let all = rows.par_iter().map(|r| o.evaluate(&r.dots).value).collect();
                values.push((format!("coverage {label}"), all));
            }
            let group = |name: &str, keep: &dyn Fn(&Row) -> bool| {
                let indices: Vec<usize> = (0..rows.len()).filter(|&i| keep(&rows[i])).collect();
                let kept: Vec<&Row> = indices.iter().map(|&i| &rows[i]).collect();
                report(name, &kept, &values, &indices);
            };
            group("all", &|_| true);
            group("random", &|r| !r.descended);
            group("descended", &|r| r.descended);
        }
        Ok(())
    }
}
