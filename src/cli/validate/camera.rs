//! Patterns before a camera, on rendered frames.

use serde_json::json;

use super::{Arguments, Sweep, compare};
use crate::ball::Ball;
use crate::camera::{
    CameraConditions, CameraPoint, CameraSweep, CameraTrials, FrameRates, paired, sweep_csv,
};
use crate::cli::camera::{CAMERA_FRAMES, print_frames, shown};
use crate::cli::output::Counter;
use crate::cli::print_json;
use crate::error::{Error, Result};
use crate::files;
use crate::validate::check_samples;

/// Frames of a camera at each point of a sweep where none are stated.
const POINT_FRAMES: u64 = 200;

pub(super) fn run(arguments: &Arguments, balls: Vec<Ball>) -> Result<()> {
    arguments.reject(
        "with a camera",
        &["protocol", "sigma-deg", "recognizer", "sweep-alpha"],
    )?;
    let conditions = arguments.camera.conditions()?;
    arguments.samples.map_or(Ok(()), check_samples)?;
    match (balls.as_slice(), arguments.sweep.as_slice()) {
        ([ball], [Sweep::Camera]) => sweep(arguments, ball, &conditions),
        (_, [_, ..]) => {
            let problem = "expected camera, and one pattern, where --camera is given";
            Err(Error::argument("sweep", problem))
        }
        ([ball], []) => {
            arguments.reject("with one pattern and no sweep", &["output"])?;
            one(arguments, ball, &conditions)
        }
        (_, []) => {
            arguments.reject("with several patterns and a camera", &["output"])?;
            several(arguments, balls, &conditions)
        }
    }
}

fn one(arguments: &Arguments, ball: &Ball, conditions: &CameraConditions) -> Result<()> {
    let trials = CameraTrials::new(*conditions, arguments.seed);
    let frames = arguments.samples.unwrap_or(CAMERA_FRAMES);
    let counter = Counter::new(frames, "frames");
    let outcomes = trials.frames(ball.pattern(), 0..frames, &|n| counter.add(n))?;
    counter.finish();
    let found = FrameRates::of(&outcomes, arguments.seed);
    if arguments.json {
        return print_json(&json!({
            "protocol": "camera",
            "recognizer": "robust",
            "samples": frames,
            // A frame's dots have no noise that was stated, and are not named one by one.
            "sigma_deg": null,
            "seed": arguments.seed,
            "skipped": 0,
            "identity": null,
            "orientation": found.right,
            "mean_error_deg": found.mean_error_deg,
            "median_error_deg": found.median_error_deg,
            "us_per_identification": null,
            "conditions": conditions,
            "frames": found,
        }));
    }
    outln!("{}", arguments.camera.assumed()?);
    print_frames(&found);
    Ok(())
}

/// The patterns on the same scenes.
fn several(arguments: &Arguments, balls: Vec<Ball>, conditions: &CameraConditions) -> Result<()> {
    let entries = compare::entries(&arguments.inputs, balls);
    let trials = CameraTrials::new(*conditions, arguments.seed);
    let frames = arguments.samples.unwrap_or(CAMERA_FRAMES);
    let counter = Counter::new(frames.saturating_mul(entries.len() as u64), "frames");
    let mut outcomes = Vec::with_capacity(entries.len());
    for entry in &entries {
        outcomes.push(trials.frames(entry.ball.pattern(), 0..frames, &|n| counter.add(n))?);
    }
    counter.finish();
    let rows = entries.iter().zip(&outcomes).map(|(entry, own)| {
        let difference = paired(&outcomes[0], own);
        (entry, FrameRates::of(own, arguments.seed), difference)
    });
    if arguments.json {
        let rows: Vec<_> = rows
            .map(|(entry, rates, difference)| {
                json!({ "pattern": entry.name, "frames": rates, "difference": difference })
            })
            .collect();
        return print_json(&json!({
            "protocol": "camera", "samples": frames, "seed": arguments.seed,
            "conditions": conditions, "patterns": rows
        }));
    }
    outln!("{}", arguments.camera.assumed()?);
    outln!(
        "{frames} frames of seed {}, the same scenes for all:",
        arguments.seed
    );
    for (entry, r, difference) in rows {
        outln!("{} ({} dots)", entry.name, entry.ball.pattern().len());
        outln!(
            "  right {}, wrong {}, error: mean {} deg",
            r.right,
            r.wrong,
            shown(r.mean_error_deg, 3)
        );
        outln!(
            "  right more often than the first by {:.2} [{:.2}, {:.2}] points",
            100.0 * difference.difference,
            100.0 * difference.low,
            100.0 * difference.high
        );
    }
    Ok(())
}

/// The stated camera, and others that differ from it in one property.
fn sweep(arguments: &Arguments, ball: &Ball, conditions: &CameraConditions) -> Result<()> {
    let sweep = CameraSweep::around(conditions);
    let set = arguments.begin()?;
    let frames = arguments.samples.unwrap_or(POINT_FRAMES);
    let total = frames.saturating_mul(sweep.cameras.len() as u64);
    let counter = Counter::new(total, "frames");
    let done = |n| counter.add(n);
    let points = sweep.run(ball.pattern(), arguments.seed, frames, &mut |_| {}, &done)?;
    counter.finish();
    if let Some(set) = set {
        let csv = sweep_csv(&points);
        files::write_bytes(&set.path().join("sensitivity.csv"), csv.as_bytes())?;
        #[cfg(feature = "plot")]
        {
            use crate::report::plots::{PictureFormat, camera_plots};
            camera_plots(set.path(), &points, &[PictureFormat::Png])?;
        }
        set.publish(&[], "sensitivity.csv")?;
    }
    if arguments.json {
        return print_json(&json!({ "conditions": conditions, "points": points }));
    }
    outln!("{}", arguments.camera.assumed()?);
    outln!("{frames} frames a point, seed {}", arguments.seed);
    for p in &points {
        print_point(p);
    }
    Ok(())
}

fn print_point(p: &CameraPoint) {
    outln!(
        "{:<13} {:>8.3}  right {}  wrong {}  {} deg",
        p.parameter.as_str(),
        p.value,
        p.frames.right,
        p.frames.wrong,
        shown(p.frames.mean_error_deg, 3)
    );
}
