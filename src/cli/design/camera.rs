//! A design for a camera: how many dots, and which finalist.
//!
//! The number of dots is chosen among a few, each searched briefly with the largest holes that so
//! many dots leave room for; then the winner's search runs as asked. Both choices are races on rendered
//! frames of the camera ([`crate::camera`]), of seeds that nothing else uses.

use std::sync::atomic::AtomicBool;

use super::Arguments;
use crate::camera::{
    CameraConditions, CameraTrials, FrameRates, MAX_DOT, RaceConfig, RaceResult, Racer,
    race_patterns,
};
use crate::cli::camera::CameraSource;
use crate::cli::output::Counter;
use crate::design::search::feasible::packed_separation;
use crate::design::{CameraRequest, DesignConfig, SearchState, design};
use crate::error::{Error, Result};
use crate::pattern::Pattern;
use crate::stencil::StencilConfig;

/// Numbers of dots that are tried.
const DOTS: [usize; 6] = [16, 20, 24, 28, 32, 40];
/// Starts of each brief search.
const STARTS: usize = 6;
/// Part of the largest separation known for so many dots that a search is left with: with all of it
/// there is one pattern.
const ROOM: f64 = 0.9;
/// Set in the seed of the frames that choose the number of dots, and of those that rank finalists.
const CHOICE: u64 = 0xca3e_0001 << 32;
const RANKING: u64 = 0xca3e_0002 << 32;

/// The ranking of finalists that the arguments ask for; `None` without a camera.
pub(super) fn ranking(arguments: &Arguments) -> Result<Option<CameraRequest>> {
    let Some(camera) = &arguments.camera else {
        return Ok(None);
    };
    let conditions = conditions(camera, &arguments.stencil())?;
    Ok(Some(CameraRequest {
        conditions: serde_json::to_value(conditions)
            .map_err(|e| Error::Internal(format!("conditions as JSON: {e}")))?,
        frames: arguments.camera_frames,
        seed: arguments.seed ^ RANKING,
    }))
}

/// A camera before dots as large as the stencil's holes.
pub(super) fn conditions(
    camera: &CameraSource,
    stencil: &StencilConfig,
) -> Result<CameraConditions> {
    Ok(CameraConditions {
        dot_diameter: stencil.hole_diameter_mm / stencil.ball_diameter_mm,
        ..camera.conditions()?
    })
}

/// A brief search's finalist.
struct Tried {
    arguments: Arguments,
    pattern: Pattern,
    hole_mm: f64,
}

/// The arguments with the number of dots and the holes settled for the camera: those given, or the
/// best of a few brief searches.
pub(super) fn settled(arguments: &Arguments) -> Result<Arguments> {
    let mut chosen = arguments.clone();
    let Some(camera) = &arguments.camera else {
        return Ok(chosen);
    };
    if arguments.dots.is_some() || arguments.pattern.is_some() {
        return Ok(chosen);
    }
    if arguments.resume || arguments.shard.is_some() || arguments.shards.is_some() {
        let problem = "must be given here: with --camera alone it would be chosen anew";
        return Err(Error::argument("dots", problem));
    }
    let trials = CameraTrials::new(camera.conditions()?, arguments.seed ^ CHOICE);
    errln!(
        "choosing the number of dots for the camera, which takes some minutes; --dots N spares it"
    );
    let tried = brief_searches(arguments)?;
    let racers = tried.iter().map(|tried| Racer {
        pattern: &tried.pattern,
        dot_diameter: tried.hole_mm / arguments.ball_diameter_mm,
    });
    let racers: Vec<Racer<'_>> = racers.collect();
    let race = RaceConfig::of_frames(arguments.camera_frames);
    let total = race.max_frames.saturating_mul(racers.len() as u64);
    let counter = Counter::new(total, "frames");
    let standings = race_patterns(&trials, &racers, &race, &|n| counter.add(n))?;
    counter.finish();
    print_choice(&tried, &standings, trials.seed);
    // A race without racers is an error: there is a first.
    let best = &tried[standings[0].entry].arguments;
    chosen.dots = best.dots;
    chosen.dot_diameter_mm = best.dot_diameter_mm;
    Ok(chosen)
}

/// The finalists of a brief search for each number of dots that leaves room for what else is asked.
fn brief_searches(arguments: &Arguments) -> Result<Vec<Tried>> {
    let mut all = Vec::new();
    let never = AtomicBool::new(false);
    // The more dots, the longer a search takes.
    let counter = Counter::new(DOTS.iter().sum::<usize>() as u64, "dots, in brief searches");
    for dots in DOTS {
        let mut tried = arguments.clone();
        tried.dots = Some(dots);
        tried
            .dot_diameter_mm
            .get_or_insert_with(|| hole_for(dots, arguments));
        let found = tried.config().and_then(|config| {
            let config = DesignConfig {
                starts: STARTS.min(arguments.starts),
                rounds: 1,
                ..config
            };
            design(&config, &mut SearchState::default(), &never, &mut ())
        });
        counter.add(dots as u64);
        let Ok(found) = found else { continue };
        let hole_mm = tried.stencil().hole_diameter_mm;
        for candidate in &found.finalists {
            all.push(Tried {
                arguments: tried.clone(),
                pattern: candidate.pattern()?,
                hole_mm,
            });
        }
    }
    counter.finish();
    if all.is_empty() {
        let problem = "no number of dots leaves room for what else is asked";
        return Err(Error::argument("dots", problem));
    }
    Ok(all)
}

/// The largest holes, mm, that so many dots leave room for, up to the largest dots that the detector
/// was trained on.
fn hole_for(dots: usize, arguments: &Arguments) -> f64 {
    let room = ROOM * packed_separation(dots);
    let largest = (10.0 * MAX_DOT * arguments.ball_diameter_mm) as u32;
    let stencil = arguments.stencil();
    (5..=largest)
        .rev()
        .map(|tenths| f64::from(tenths) / 10.0)
        .find(|&hole_diameter_mm| {
            let sized = StencilConfig {
                hole_diameter_mm,
                ..stencil.clone()
            };
            sized.min_separation_rad() <= room
        })
        .unwrap_or(stencil.hole_diameter_mm)
}

/// The best pattern of each number of dots.
fn print_choice(tried: &[Tried], standings: &[RaceResult], seed: u64) {
    errln!("rendered frames of the camera, seed {seed}, the best of each number of dots:");
    let mut said = Vec::new();
    for standing in standings {
        let Tried {
            pattern, hole_mm, ..
        } = &tried[standing.entry];
        if said.contains(&pattern.len()) {
            continue;
        }
        said.push(pattern.len());
        let rates = FrameRates::of(&standing.outcomes, seed);
        errln!(
            "  {:22} {} frames: right {}, wrong {:.2} %, error {:.2} deg",
            format!("{} dots of {hole_mm} mm", pattern.len()),
            rates.right.trials,
            rates.right,
            100.0 * rates.wrong.rate,
            rates.effective_error_deg
        );
    }
}
