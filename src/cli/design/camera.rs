//! A design for a camera: how many dots, and which finalist.
//!
//! The number of dots is chosen among a few, each searched briefly with the largest holes that so
//! many dots leave room for; then the winner's search runs as asked. Both choices are by the
//! effective error of an orientation ([`crate::predict`]), on seeds that nothing else uses.

use std::path::Path;
use std::sync::atomic::AtomicBool;

use super::Arguments;
use crate::cli::camera::read_conditions;
use crate::cli::output::Counter;
use crate::design::search::feasible::packed_separation;
use crate::design::{Candidate, DesignConfig, SearchState, design};
use crate::error::{Error, Result};
use crate::pattern::Pattern;
use crate::predict::{
    CameraConditions, Judge, Judgment, MAX_DOT, NamedPattern, Trial, shipped_designs,
};
use crate::report::{CameraRank, CameraRecord};
use crate::stencil::{Stencil, StencilConfig};

/// Numbers of dots that are tried.
const DOTS: [usize; 6] = [16, 20, 24, 28, 32, 40];
/// Starts of each brief search.
const STARTS: usize = 6;
/// Part of the largest separation known for so many dots that a search is left with: with all of it
/// there is one pattern.
const ROOM: f64 = 0.9;
/// Predicted frames a pattern.
const FRAMES: u64 = 2000;
/// Set in the seed of the frames that choose the number of dots, and of those that rank finalists.
const CHOICE: u64 = 0xca3e_0001 << 32;
const RANKING: u64 = 0xca3e_0002 << 32;

/// Ranks the finalists of a search.
pub(super) struct CameraRanking {
    judge: Judge,
    conditions: CameraConditions,
    trial: Trial,
    seed: u64,
    record: Option<CameraRecord>,
}

impl CameraRanking {
    /// The ranking that the arguments ask for; `None` without a camera.
    pub fn new(arguments: &Arguments) -> Result<Option<Self>> {
        let Some(path) = &arguments.camera else {
            return Ok(None);
        };
        let stencil = arguments.stencil();
        let conditions = conditions(path, &stencil)?;
        let trial = arguments
            .render
            .map_or(Trial::Predicted(FRAMES), Trial::Rendered);
        Ok(Some(Self {
            judge: Judge::new(conditions, trial)?,
            conditions,
            trial,
            seed: arguments.seed ^ RANKING,
            record: None,
        }))
    }

    /// Puts the finalists in order.
    pub fn rank(&mut self, finalists: &mut [Candidate]) -> Result<()> {
        let mut ranked = Vec::with_capacity(finalists.len());
        for candidate in &*finalists {
            let judgment = self.judge.judge(&candidate.pattern()?, self.seed)?;
            ranked.push((candidate.clone(), judgment));
        }
        ranked.sort_by(|(_, a), (_, b)| a.effective_error_deg.total_cmp(&b.effective_error_deg));
        let (rendered, frames) = match self.trial {
            Trial::Predicted(frames) => (false, frames),
            Trial::Rendered(frames) => (true, frames),
        };
        self.record = Some(CameraRecord {
            conditions: serde_json::to_value(self.conditions)
                .map_err(|e| Error::Internal(format!("conditions as JSON: {e}")))?,
            rendered,
            frames,
            seed: self.seed,
            finalists: ranked.iter().map(|(c, j)| rank_of(c, j)).collect(),
        });
        for (place, (candidate, _)) in finalists.iter_mut().zip(ranked) {
            *place = candidate;
        }
        Ok(())
    }

    /// What the report tells.
    pub fn record(&self) -> Option<CameraRecord> {
        self.record.clone()
    }
}

fn rank_of(candidate: &Candidate, judgment: &Judgment) -> CameraRank {
    CameraRank {
        start: candidate.start,
        right: judgment.rates.right,
        wrong: judgment.rates.wrong,
        mean_error_deg: judgment.rates.mean_error_deg,
        effective_error_deg: judgment.effective_error_deg,
    }
}

/// The camera of a file before dots as large as the stencil's holes.
pub(super) fn conditions(path: &Path, stencil: &StencilConfig) -> Result<CameraConditions> {
    Ok(CameraConditions {
        dot_diameter: stencil.hole_diameter_mm / stencil.ball_diameter_mm,
        ..read_conditions(path)?
    })
}

/// The arguments with the number of dots and the holes settled for the camera: those given, or the
/// best of a few brief searches, beside what the shipped designs would give.
pub(super) fn settled(arguments: &Arguments, stop: &AtomicBool) -> Result<Arguments> {
    let mut chosen = arguments.clone();
    let Some(path) = &arguments.camera else {
        return Ok(chosen);
    };
    if arguments.dots.is_some() || arguments.from.is_some() {
        return Ok(chosen);
    }
    if arguments.resume || arguments.shard.is_some() || arguments.shards.is_some() {
        let problem = "must be given here: with --camera alone it would be chosen anew";
        return Err(Error::argument("dots", problem));
    }
    let mut judge = Judge::new(read_conditions(path)?, Trial::Predicted(FRAMES))?;
    let seed = arguments.seed ^ CHOICE;
    let shipped = shipped_designs()?;
    let counter = Counter::new((shipped.len() + DOTS.len()) as u64, "patterns");
    let mut rows: Vec<(String, Judgment)> = Vec::new();
    for NamedPattern { name, pattern } in &shipped {
        let hole = Stencil::largest_hole_mm(pattern, &arguments.stencil());
        let hole = hole.unwrap_or(arguments.stencil().hole_diameter_mm);
        let diameter = (hole / arguments.ball_diameter_mm).min(MAX_DOT);
        judge = judge.with_dot_diameter(diameter);
        rows.push((name.clone(), judge.judge(pattern, seed)?));
        counter.add(1);
    }
    let mut best: Option<(f64, Arguments)> = None;
    for dots in DOTS {
        let mut tried = arguments.clone();
        tried.dots = Some(dots);
        tried
            .hole_diameter_mm
            .get_or_insert_with(|| hole_for(dots, arguments));
        let config = DesignConfig {
            starts: STARTS.min(arguments.starts),
            rounds: 1,
            ..tried.config()?
        };
        let found = design(&config, &mut SearchState::default(), stop, &mut ());
        counter.add(1);
        // So many dots may leave no room for what else is asked.
        let Ok(found) = found else { continue };
        let stencil = tried.stencil();
        judge = judge.with_dot_diameter(stencil.hole_diameter_mm / stencil.ball_diameter_mm);
        let judgment = best_of(&judge, &found.finalists, seed)?;
        let error = judgment.effective_error_deg;
        rows.push((
            format!("{dots} dots of {} mm", stencil.hole_diameter_mm),
            judgment,
        ));
        if best.as_ref().is_none_or(|(least, _)| error < *least) {
            best = Some((error, tried));
        }
    }
    counter.finish();
    print_choice(&rows);
    let (_, tried) = best.ok_or_else(|| {
        Error::argument(
            "dots",
            "no number of dots leaves room for what else is asked",
        )
    })?;
    chosen.dots = tried.dots;
    chosen.hole_diameter_mm = tried.hole_diameter_mm;
    Ok(chosen)
}

/// The judgment of the best of these.
fn best_of(judge: &Judge, finalists: &[Candidate], seed: u64) -> Result<Judgment> {
    let mut best: Option<Judgment> = None;
    for candidate in finalists {
        let pattern: Pattern = candidate.pattern()?;
        let judgment = judge.judge(&pattern, seed)?;
        let is_better = best
            .as_ref()
            .is_none_or(|b| judgment.effective_error_deg < b.effective_error_deg);
        if is_better {
            best = Some(judgment);
        }
    }
    best.ok_or_else(|| Error::argument("design", "no finalist"))
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

fn print_choice(rows: &[(String, Judgment)]) {
    errln!("predicted for the camera, {FRAMES} frames a pattern, shipped designs first:");
    for (name, j) in rows {
        errln!(
            "  {name:22} right {}, wrong {:.2} %, error {:.2} deg",
            j.rates.right,
            100.0 * j.rates.wrong.rate,
            j.effective_error_deg
        );
    }
}
