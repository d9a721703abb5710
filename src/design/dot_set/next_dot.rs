//! Where one more dot would help most.
//!
//! The expected rate of views that fail ranks all places. The best are compared on trials, all on the same views: those of a ball without the dot, with the dot shown
//! besides ([`TrialGenerator::show_one_more`](crate::view::TrialGenerator::show_one_more)). The gain of the best one is
//! measured on the trials of another seed, with Newcombe's interval for the paired difference.

use serde::{Deserialize, Serialize};

use super::{Answer, CHOICE, DotSetConfig, GAIN};
use crate::concurrency;
use crate::design::objective::FailureRate;
use crate::error::Result;
use crate::geometry::{Vec3, angle_between, spiral_directions};
use crate::pattern::{MAX_DOTS, Pattern};
use crate::recognize::Recognizer;
use crate::recognize::robust::RobustRecognizer;
use crate::stats::{PairedDifference, Pairs, Proportion};
use crate::validate::Trials;
use crate::view::{Trial, ViewModel};

/// Places on the ball, some 26 degrees apart: with 200 the ranking took 23 s of one core for 20 dots.
const PLACES: usize = 60;
/// Places that are compared on trials.
const COMPARED: usize = 4;
/// Trials for one task.
const CHUNK: usize = 16;

/// The best place for one more dot, and what it gains: places are ranked by objectives, the best compared on trials, and the
/// gain of the winner measured on trials of another seed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct NextDot {
    /// Its direction, pattern frame.
    pub direction: [f64; 3],
    /// Places that were tried.
    pub places: usize,
    /// Seed of the trials that measure the gain.
    pub seed: u64,
    /// Right views without it.
    pub before: Proportion,
    /// Right views with it.
    pub after: Proportion,
    /// The difference, on the same views.
    pub gain: PairedDifference,
}

impl NextDot {
    /// Whether it helps beyond chance.
    pub fn helps(&self) -> bool {
        self.gain.low > 0.0
    }
}

/// A pattern with one more dot.
struct Extended<'a> {
    base: &'a Pattern,
    dot: Vec3,
    pattern: Pattern,
    recognizer: RobustRecognizer,
    view: ViewModel,
}

impl<'a> Extended<'a> {
    fn new(base: &'a Pattern, dot: Vec3, view: ViewModel) -> Result<Self> {
        let dots = base.dots().iter().copied().chain([dot]);
        let pattern = Pattern::new(dots.collect())?;
        Ok(Self {
            recognizer: RobustRecognizer::new(&pattern, view.into())?,
            base,
            dot,
            pattern,
            view,
        })
    }

    /// The answers to these trials of the pattern without the dot, with the dot shown besides.
    fn answers(&self, seed: u64, indices: &[u64]) -> Vec<Answer> {
        let without = Trials::first(self.base, self.view, seed, 0);
        let with = Trials::first(&self.pattern, self.view, seed, 0);
        let chunks = 0..indices.len().div_ceil(CHUNK) as u64;
        let found = concurrency::map_range(chunks, |chunk| {
            let mut generator = without.generator();
            let mut trial = Trial::default();
            let mut workspace = self.recognizer.workspace();
            let chunk = indices
                .chunks(CHUNK)
                .nth(chunk as usize)
                .unwrap_or_default();
            let judged = chunk.iter().map(|&index| {
                generator.generate(index, &mut trial);
                generator.show_one_more(&self.dot, index, &mut trial);
                Answer::of(&with.judge(&trial, &self.recognizer, &mut workspace))
            });
            judged.collect::<Vec<_>>()
        });
        found.into_iter().flatten().collect()
    }

    /// How many of these are right.
    fn right(&self, seed: u64, indices: &[u64]) -> usize {
        let answers = self.answers(seed, indices);
        answers.iter().filter(|a| **a == Answer::Right).count()
    }
}

/// The best place for one more dot; none where there is no room.
pub(super) fn next_dot(base: &Pattern, config: &DotSetConfig) -> Result<Option<NextDot>> {
    let places = places(base, config);
    if places.is_empty() || base.len() == MAX_DOTS {
        return Ok(None);
    }
    let objective = FailureRate::of_views(&[config.view], base.len() + 1)?;
    let ranked = ranked(base, &places, &objective);
    let chosen: Vec<u64> = (0..config.samples).collect();
    let mut best: Option<(usize, Extended<'_>)> = None;
    for k in ranked.into_iter().take(COMPARED) {
        let extended = Extended::new(base, places[k], config.view)?;
        let right = extended.right(config.seed ^ CHOICE, &chosen);
        if best.as_ref().is_none_or(|(most, _)| right > *most) {
            best = Some((right, extended));
        }
    }
    best.map(|(_, extended)| gain(&extended, config, places.len()))
        .transpose()
}

/// The numbers of the places, that of the fewest expected failures first.
fn ranked(base: &Pattern, places: &[Vec3], objective: &FailureRate) -> Vec<usize> {
    let rates = concurrency::map(places, |place| {
        let dots: Vec<Vec3> = base.dots().iter().copied().chain([*place]).collect();
        objective.evaluate(&dots).value
    });
    let mut order: Vec<usize> = (0..places.len()).collect();
    order.sort_by(|&a, &b| rates[a].total_cmp(&rates[b]));
    order
}

/// The directions that leave room for a dot.
fn places(base: &Pattern, config: &DotSetConfig) -> Vec<Vec3> {
    let DotSetConfig {
        constraints,
        avoided,
        ..
    } = config;
    let apart = |v: &Vec3| {
        let mut all = avoided.iter();
        all.all(|a| angle_between(a, v) >= constraints.min_separation_rad)
    };
    spiral_directions(PLACES)
        .filter(|v| constraints.has_room(base.dots(), v) && apart(v))
        .collect()
}

/// What a place gains, on trials that did not choose it.
fn gain(best: &Extended<'_>, config: &DotSetConfig, places: usize) -> Result<NextDot> {
    let seed = config.seed ^ GAIN;
    let samples = 2 * config.samples;
    let trials = Trials::first(best.base, best.view, seed, samples);
    let recognizer = RobustRecognizer::new(best.base, best.view.into())?;
    let before = super::each_answer(&trials, &recognizer)?;
    let after = best.answers(seed, &(0..samples).collect::<Vec<_>>());
    let mut pairs = Pairs::default();
    for (before, after) in before.iter().zip(&after) {
        match (*after == Answer::Right, *before == Answer::Right) {
            (true, true) => pairs.both += 1,
            (true, false) => pairs.gained += 1,
            (false, true) => pairs.lost += 1,
            (false, false) => pairs.neither += 1,
        }
    }
    Ok(NextDot {
        direction: best.dot.into(),
        places,
        seed,
        before: Proportion::new(pairs.both + pairs.lost, samples),
        after: Proportion::new(pairs.both + pairs.gained, samples),
        gain: PairedDifference::new(pairs),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::design::Constraints;
    use crate::view::ProtocolName;

    /// Trials that chose a place would flatter it.
    #[test]
    fn a_gain_is_measured_on_trials_that_did_not_choose() {
        let base = Pattern::new(spiral_directions(7).collect()).expect("a pattern");
        let config = DotSetConfig {
            view: ProtocolName::Sparse.view(),
            samples: 30,
            seed: 5,
            constraints: Constraints::default(),
            avoided: Vec::new(),
        };
        let next = next_dot(&base, &config).expect("trials").expect("room");
        assert!(next.seed != config.seed && next.seed != config.seed ^ CHOICE);
        // What is stated of that seed's trials is so, and on twice as many.
        let extended =
            Extended::new(&base, Vec3::from(next.direction), config.view).expect("a pattern");
        let all: Vec<u64> = (0..60).collect();
        assert_eq!(next.after.successes, extended.right(next.seed, &all) as u64);
        assert_eq!(next.after.trials, 60);
    }
}
