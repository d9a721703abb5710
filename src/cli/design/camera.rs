//! A design for a camera: how many dots, and which finalist.
//!
//! The number of dots is chosen among a few, each searched briefly with the largest holes that so
//! many dots leave room for; then the winner's search runs as asked. Both choices are races on rendered
//! frames of the camera ([`crate::camera`]), of seeds that nothing else uses. A signal ends the choice with the
//! best so far, which is then the design.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use super::progress::Forecast;
use super::{Arguments, STOPPING};
use crate::camera::{
    CameraConditions, CameraTrials, FrameRates, MAX_DOT, RaceConfig, RaceResult, Racer,
    race_patterns,
};
use crate::cli::camera::{CameraSource, shown};
use crate::cli::interrupt::stop_on_interrupt;
use crate::cli::output::Progress;
use crate::design::search::feasible::packed_separation;
use crate::design::state::Checkpoint;
use crate::design::{
    CameraRequest, DesignCandidate, DesignConfig, DesignObserver, Objective, SearchState, Stage,
    design,
};
use crate::error::{Error, Result};
use crate::files;
use crate::pattern::{Pattern, shipped_designs};
use crate::report::{CHECKPOINT, DesignJob};
use crate::stencil::StencilConfig;

/// Numbers of dots that are tried.
const DOTS: [usize; 6] = [16, 20, 24, 28, 32, 40];
/// Starts of each brief search, and trials of each of its candidates: frames choose among the numbers of dots.
const STARTS: usize = 4;
const SAMPLES: u64 = 2_000;
/// Frames of each pattern in the choice and of each finalist in the ranking, of which half choose and half
/// measure. With them the whole takes some 5 minutes of CPU in any surroundings, 30 ms a frame.
pub(super) const FRAMES: u64 = 512;
/// Part of the largest separation known for so many dots that a search is left with: with all of it
/// there is one pattern.
const ROOM: f64 = 0.9;
/// Set in the seed of the frames that choose the number of dots, and of those that rank finalists.
const CHOICE: u64 = 0xca3e_0001 << 32;
const RANKING: u64 = 0xca3e_0002 << 32;
/// Frames by which the time that one takes is estimated.
const PROBES: u64 = 8;

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

/// A brief search's winner.
struct Tried {
    arguments: Arguments,
    finalists: Vec<DesignCandidate>,
    pattern: Pattern,
    hole_mm: f64,
    /// How long the search took.
    seconds: f64,
}

/// What is settled before the search.
pub(super) struct SettledView {
    /// The arguments with the number of dots and the holes.
    pub arguments: Arguments,
    /// How long what follows takes; none without a camera.
    pub forecast: Option<Forecast>,
    /// Where the choice was stopped, the finalists of the best number of dots so far.
    pub best_so_far: Option<Vec<DesignCandidate>>,
}

impl SettledView {
    /// Where the choice was stopped, leaves its best for a search that is stopped at once; whether it was.
    pub fn leave(&self, job: &DesignJob) -> Result<bool> {
        let Some(finalists) = &self.best_so_far else {
            return Ok(false);
        };
        let state = SearchState {
            pool: finalists.clone(),
            ..SearchState::default()
        };
        files::create_dir(&job.dir)?;
        let path = job.dir.join(CHECKPOINT);
        Checkpoint::new(job.config.clone(), state, None).save(&path)?;
        Ok(true)
    }
}

/// The arguments with the number of dots and the holes settled for the camera: those given, or the
/// best of a few brief searches.
pub(super) fn settled(arguments: &Arguments) -> Result<SettledView> {
    let mut settled = SettledView {
        arguments: arguments.clone(),
        forecast: None,
        best_so_far: None,
    };
    let Some(camera) = &arguments.camera else {
        return Ok(settled);
    };
    errln!("{}", camera.assumed()?);
    let is_given = arguments.dots.is_some() || arguments.pattern.is_some();
    if !is_given && (arguments.resume || arguments.shard.is_some() || arguments.shards.is_some()) {
        let problem = "must be given here: with --camera alone it would be chosen anew";
        return Err(Error::argument("dots", problem));
    }
    let trials = CameraTrials::new(camera.conditions()?, arguments.seed ^ CHOICE);
    let mut forecast = Forecast::new(seconds_a_frame(&trials)?);
    if !is_given {
        choose(arguments, &trials, &mut forecast, &mut settled)?;
    }
    settled.forecast = Some(forecast);
    Ok(settled)
}

/// Time that a frame takes on all cores, s.
fn seconds_a_frame(trials: &CameraTrials) -> Result<f64> {
    let designs = shipped_designs()?;
    let Some(named) = designs.first() else {
        return Ok(0.0);
    };
    let clock = Instant::now();
    trials.frames(&named.pattern, 0..PROBES, &|_| ())?;
    Ok(clock.elapsed().as_secs_f64() / PROBES as f64)
}

/// Chooses the number of dots, and the holes.
fn choose(
    arguments: &Arguments,
    trials: &CameraTrials,
    forecast: &mut Forecast,
    settled: &mut SettledView,
) -> Result<()> {
    errln!("choosing the number of dots for the camera; --dots N spares it");
    let stop = stop_on_interrupt(STOPPING)?;
    let race = RaceConfig::of_frames(arguments.camera_frames);
    let mut line = Choosing::new(arguments, *forecast, race.frames());
    let tried = brief_searches(arguments, &stop, &mut line)?;
    let best = match stop.load(Ordering::Relaxed) {
        true => by_rate(&tried),
        false => by_race(arguments, trials, &race, &tried, &stop, &line)?,
    };
    line.line.finish();
    let Some(best) = best else {
        return Err(Error::Internal("no number of dots was tried".into()));
    };
    settled.arguments = best.arguments.clone();
    if stop.load(Ordering::Relaxed) {
        settled.best_so_far = Some(best.finalists.clone());
    }
    forecast.gone_s = line.began.elapsed().as_secs_f64();
    forecast.search_s = Some(line.whole_search_s(best.seconds));
    Ok(())
}

/// The best by what the searches themselves know: the rate of identification.
fn by_rate(tried: &[Tried]) -> Option<&Tried> {
    let rate = |tried: &&Tried| {
        let best = tried.finalists.first().and_then(|best| best.answered);
        best.map_or(0.0, |identity| identity.rate)
    };
    tried.iter().max_by(|a, b| rate(a).total_cmp(&rate(b)))
}

/// The winner of a race, or of its last whole round where it is stopped.
fn by_race<'a>(
    arguments: &Arguments,
    trials: &CameraTrials,
    race: &RaceConfig,
    tried: &'a [Tried],
    stop: &AtomicBool,
    line: &Choosing,
) -> Result<Option<&'a Tried>> {
    let racers = tried.iter().map(|tried| Racer {
        pattern: &tried.pattern,
        dot_diameter: tried.hole_mm / arguments.ball_diameter_mm,
    });
    let racers: Vec<Racer<'_>> = racers.collect();
    let done = line.races(race.frames().saturating_mul(racers.len() as u64));
    let results = race_patterns(trials, &racers, race, stop, &done)?;
    print_choice(tried, &results, trials.seed);
    let best = results.first().and_then(|result| tried.get(result.entry));
    Ok(match results.iter().any(|result| result.raced == 0) {
        true => by_rate(tried),
        false => best,
    })
}

/// The bar while the number of dots is chosen: its length is the whole design, as far as it can be foreseen.
struct Choosing {
    line: Progress,
    began: Instant,
    forecast: Forecast,
    /// Frames of a pattern in a race.
    frames: u64,
    /// The budget of the search that follows, s.
    budget_s: Option<f64>,
    /// Starts of the search that follows, over those of a brief one.
    more_starts: f64,
    /// Numbers of dots that are left, the first at work, and how long those before took, each with its number.
    left: Vec<usize>,
    took: Vec<(usize, f64)>,
    /// When the search at work began.
    at_work: Instant,
}

impl Choosing {
    fn new(arguments: &Arguments, forecast: Forecast, frames: u64) -> Self {
        let starts = arguments.starts.saturating_mul(arguments.rounds);
        Self {
            line: Progress::of_design(),
            began: Instant::now(),
            forecast,
            frames,
            budget_s: arguments.budget.map(|budget| budget.as_secs_f64()),
            more_starts: starts as f64 / STARTS.min(arguments.starts).max(1) as f64,
            left: DOTS.to_vec(),
            took: Vec::new(),
            at_work: Instant::now(),
        }
    }

    /// Time that the search takes which follows a brief one of so long, s.
    fn whole_search_s(&self, brief_s: f64) -> f64 {
        self.budget_s.unwrap_or(self.more_starts * brief_s)
    }

    /// Time that a brief search for so many dots takes, s: it grows with their square.
    fn search_s(&self, dots: usize) -> Option<f64> {
        let squares: f64 = self.took.iter().map(|(n, _)| (n * n) as f64).sum();
        let seconds: f64 = self.took.iter().map(|(_, s)| s).sum();
        (squares > 0.0).then(|| seconds / squares * (dots * dots) as f64)
    }

    /// The share of the whole design that is done, when this part of the search at work is.
    fn share(&self, part: f64) -> f64 {
        let Some(&at_work) = self.left.first() else {
            return 0.0;
        };
        let gone = self.began.elapsed().as_secs_f64();
        let own = match self.search_s(at_work) {
            Some(seconds) => seconds,
            // Of the first one its own pace says it.
            None if part > 0.05 => self.at_work.elapsed().as_secs_f64() / part,
            None => return 0.0,
        };
        let per_square = own / (at_work * at_work) as f64;
        let of = |dots: usize| per_square * (dots * dots) as f64;
        let searches: f64 = self.left.iter().map(|n| of(*n)).sum::<f64>() - part * own;
        let racers = (self.took.len() + self.left.len()) as f64;
        let races = racers * self.frames as f64 * self.forecast.frame_s;
        // The middle of the numbers that are tried.
        let after = self
            .forecast
            .after(self.whole_search_s(of(DOTS[DOTS.len() / 2])), self.frames);
        gone / (gone + searches + races + after)
    }

    fn show(&mut self, part: f64) {
        let share = self.share(part);
        let Some(dots) = self.left.first() else {
            return;
        };
        let (done, all) = (self.took.len() + 1, DOTS.len());
        let what = format!("brief search {done} of {all}: {dots} dots");
        self.line.show_share(share, &what, self.began);
    }

    /// The search at work has ended.
    fn end_search(&mut self) {
        let seconds = self.at_work.elapsed().as_secs_f64();
        self.took.push((self.left.remove(0), seconds));
        self.at_work = Instant::now();
        self.show(0.0);
    }

    /// What learns of the frames that are read or spared, of so many.
    fn races(&self, total: u64) -> impl Fn(u64) + Send + Sync + use<> {
        let gone = self.began.elapsed().as_secs_f64();
        let race = total as f64 * self.forecast.frame_s;
        let of = self.search_s(DOTS[DOTS.len() / 2]).unwrap_or_default();
        let all = gone + race + self.forecast.after(self.whole_search_s(of), self.frames);
        let ends = [gone / all, (gone + race) / all];
        let what = "the camera chooses the number of dots";
        self.line.count(total, ends, what)
    }
}

impl DesignObserver for Choosing {
    fn progress(&mut self, state: &SearchState, stage: Stage) -> Result<()> {
        self.show(super::progress::in_round(state, stage, STARTS));
        Ok(())
    }
}

/// The winners of a brief search for each number of dots that leaves room for what else is asked.
fn brief_searches(
    arguments: &Arguments,
    stop: &AtomicBool,
    line: &mut Choosing,
) -> Result<Vec<Tried>> {
    let mut all = Vec::new();
    let mut refused = None;
    for dots in DOTS {
        if stop.load(Ordering::Relaxed) {
            break;
        }
        let mut tried = arguments.clone();
        tried.dots = Some(dots);
        tried
            .dot_diameter_mm
            .get_or_insert_with(|| hole_for(dots, arguments));
        let clock = Instant::now();
        let found = tried.config().and_then(|config| {
            if let Objective::FailureRate(rate) = &config.objective {
                tried.too_few = rate.too_few.first().copied();
            }
            let config = DesignConfig {
                starts: STARTS.min(arguments.starts),
                rounds: 1,
                samples: SAMPLES.min(config.samples),
                ..config
            };
            design(&config, &mut SearchState::default(), stop, line)
        });
        line.end_search();
        let found = match found {
            Ok(found) => found,
            Err(error) => {
                refused = Some(error);
                continue;
            }
        };
        all.push(Tried {
            hole_mm: tried.stencil().hole_diameter_mm,
            pattern: found.best.pattern()?,
            finalists: found.finalists,
            arguments: tried,
            seconds: clock.elapsed().as_secs_f64(),
        });
    }
    match (all.is_empty(), refused) {
        // The last of them: the more dots, the less room.
        (true, Some(error)) => Err(error),
        (true, None) => Err(Error::argument(
            "design",
            "stopped before the first candidate was tried",
        )),
        (false, _) => Ok(all),
    }
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

/// What each number of dots gives, on frames that did not choose.
fn print_choice(tried: &[Tried], results: &[RaceResult], seed: u64) {
    if results.iter().any(|result| result.outcomes.is_empty()) {
        return;
    }
    errln!("rendered frames of the camera, seed {seed}, others than those that chose:");
    for result in results {
        let Tried {
            pattern, hole_mm, ..
        } = &tried[result.entry];
        let rates = FrameRates::of(&result.outcomes, seed);
        errln!(
            "  {:22} {} frames: right {}, wrong {:.2} %, error {} deg",
            format!("{} dots of {hole_mm} mm", pattern.len()),
            rates.right.trials,
            rates.right,
            100.0 * rates.wrong.rate,
            shown(rates.effective_error_deg, 2)
        );
    }
}
