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

use std::path::PathBuf;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use spindoe::Pattern;
use spindoe::camera::{CameraConditions, CameraTrials, FrameOutcome, coverage};
use spindoe::design::constraints::max_separation;
use spindoe::design::descent::descend;
use spindoe::design::objective::TooFewDots;
use spindoe::design::{Constraints, Objective, ObjectiveName};
use spindoe::geometry::Vec3;
use spindoe::pattern::random_pattern;
use spindoe::view::ProtocolName;
use spindoe::vision::Camera;
use spindoe::vision::frame::CameraModel;
use spindoe_studies::ranks::{correlation, spearman};
use spindoe_studies::score::mean;
use spindoe_studies::table::{Cell, Table, figure};
use spindoe_studies::{Outcome, row};

/// Seeds: of the patterns, and of the scenes.
const PATTERN_SEED: u64 = 15_400_001;
const SCENE_SEED: u64 = 15_400_002;
/// Distance of the camera, ball radii.
const DISTANCE: f64 = 20.0;
/// Objectives that patterns descend on, in turn.
const DESCENTS: [ObjectiveName; 2] = [ObjectiveName::MeanNn, ObjectiveName::WhitenedNn];

/// A pattern with what was measured on the two halves of the frames.
#[derive(Serialize, Deserialize)]
struct Row {
    dots: Vec<[f64; 3]>,
    descended: bool,
    failures: [f64; 2],
    /// Share of the frames with a wrong or no answer.
    failed: f64,
    /// Mean number of detected dots.
    detected: f64,
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
    let objective = Objective::for_views(name, &[ProtocolName::Image.view()], dots)?;
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
    let seen = trials.each_frame(&pattern, 0..frames, None, &|_| (), |rendering, found| {
        found.outline.is_some().then(|| {
            let outcome = FrameOutcome::of(found, &rendering.rotation);
            let failure = match found.pose() {
                Some(pose) if outcome.is_right() => 1.0 - pose.confidence,
                _ => 1.0,
            };
            let likely = found.dots.iter().filter(|d| d.probability >= 0.5).count();
            (outcome.is_right(), failure, likely)
        })
    })?;
    let (mut sums, mut counts, mut failed, mut detected) = ([0.0; 2], [0.0; 2], 0.0, 0.0);
    for (k, frame) in seen.into_iter().enumerate() {
        let Some((is_right, failure, likely)) = frame else {
            continue;
        };
        sums[k % 2] += failure;
        counts[k % 2] += 1.0;
        detected += likely as f64;
        failed += f64::from(u8::from(!is_right));
    }
    let count: f64 = counts.iter().sum();
    Ok(Row {
        dots: pattern.dots().iter().map(|d| [d.x, d.y, d.z]).collect(),
        descended,
        failures: [sums[0] / counts[0], sums[1] / counts[1]],
        failed: failed / count,
        detected: detected / count,
    })
}

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
    pub fn run(&self) -> Outcome {
        let (dir, count, frames) = (&self.out, self.patterns, self.frames);
        spindoe::files::create_dir(dir)?;
        println!("{count} patterns for each number of dots, {frames} frames a pattern");
        let table = Table::new(["dots", "values", "all", "random", "descended"]);
        for &dots in &self.dots {
            let path = dir.join(format!("dots{dots}.json"));
            let rows: Vec<Row> = if path.exists() {
                serde_json::from_slice(&spindoe::files::read_bytes(&path)?)?
            } else {
                let indices = (0..count).into_par_iter();
                let rows: Outcome<Vec<Row>> =
                    indices.map(|index| measured(dots, index, frames)).collect();
                let rows = rows?;
                spindoe::files::write_bytes(&path, &serde_json::to_vec(&rows)?)?;
                rows
            };
            let groups = [
                |_: &Row| true,
                |r: &Row| !r.descended,
                |r: &Row| r.descended,
            ];
            let groups = groups.map(|is| (0..rows.len()).filter(|&i| is(&rows[i])).collect());
            let line = |what: &str, cell: &dyn Fn(&Vec<usize>) -> Cell| {
                row!(table; dots, what; groups.each_ref().map(cell));
            };
            let percent = |of: fn(&Row) -> f64| {
                let rows = &rows;
                move |group: &Vec<usize>| figure(100.0 * mean(group, |&i| of(&rows[i])), 2, "%")
            };
            line(
                "failure",
                &percent(|r| 0.5 * (r.failures[0] + r.failures[1])),
            );
            line("wrong or missing", &percent(|r| r.failed));
            line("dots detected", &|group| {
                figure(mean(group, |&i| rows[i].detected), 1, "")
            });
            let view = ProtocolName::Image.view();
            let places: Vec<Vec<Vec3>> = rows
                .iter()
                .map(|r| r.dots.iter().copied().map(Vec3::from).collect())
                .collect();
            let mut values = Vec::new();
            for name in ObjectiveName::ALL.into_iter().filter(|n| n.suits(dots)) {
                let objective = Objective::for_views(name, &[view], dots)?;
                let all = places
                    .par_iter()
                    .map(|dots| Ok(objective.evaluate_at(dots)?.value));
                values.push((
                    format!("`{name}`"),
                    all.collect::<spindoe::Result<Vec<f64>>>()?,
                ));
            }
            let camera = coverage(&conditions(dots), dots, &|_| ())?;
            let without = TooFewDots {
                crowding: 0.0,
                ..camera
            };
            for (name, o) in [("of the camera", camera), ("without crowds", without)] {
                let all = places.par_iter().map(|dots| o.evaluate(dots).value);
                values.push((format!("too few {name}"), all.collect()));
            }
            let failures = |group: &[usize], of: &dyn Fn(&Row) -> f64| -> Vec<f64> {
                group.iter().map(|&i| of(&rows[i])).collect()
            };
            for (objective, all) in &values {
                line(objective, &|group| {
                    let own: Vec<f64> = group.iter().map(|&i| all[i]).collect();
                    correlation(&own, &failures(group, &|r| r.failures.iter().sum()))
                });
            }
            line("at most", &|group| {
                let [a, b] = [0, 1].map(|k: usize| failures(group, &|r| r.failures[k]));
                let halves = spearman(&a, &b);
                // Spearman and Brown: of the whole from that of its halves; no predictor exceeds its root.
                let reliability = (2.0 * halves / (1.0 + halves)).max(0.0);
                figure(reliability.sqrt(), 3, "")
            });
        }
        Ok(())
    }
}
