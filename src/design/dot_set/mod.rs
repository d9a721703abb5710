//! Whether a set of dots is good: the share of views that it is identified in, which dots are taken for others, from
//! where it is seen worst, and where one more dot would help most.
//!
//! All of it comes from Monte Carlo trials of a view model, read by the robust recognizer at its default threshold of
//! confidence. A view is *right* (orientation under 20 degrees off), *wrong*, or *unanswered*; one that shows too few
//! dots is unanswered.
//!
//! - [`DotSet::lookalikes`]: in each view that is not right, the most probable explanation with another orientation
//!   takes dots `i` for dots `j`. Pairs that keep returning belong to one turn of the pattern onto itself.
//! - [`DotSet::weak_side`]: the cap of viewing directions with the lowest share of right views. Half of the trials
//!   choose it, the other half give its rate.
//! - [`DotSet::next_dot`]: the best place for one more dot, see [`NextDot`].
//!
//! Guaranteed: the same arguments give the same result on any number of threads. Not guaranteed: that no better place
//! lies between those that are tried, some 14 degrees apart.

mod lookalikes;
mod next_dot;

use serde::{Deserialize, Serialize};

use super::constraints::Constraints;
use crate::error::Result;
use crate::geometry::{Vec3, angle_between, spiral_directions};
use crate::pattern::Pattern;
use crate::recognize::robust::RobustRecognizer;
use crate::recognize::{MIN_CONFIDENCE_DOTS, ORIENTATION_FAILURE_RAD};
use crate::stats::Proportion;
use crate::validate::{TrialResult, Trials};
use crate::view::{Trial, ViewModel};

pub use lookalikes::Lookalike;
pub use next_dot::NextDot;

/// Half angle of a side, radians: 40 degrees, 12 % of the viewing directions.
const SIDE_RAD: f64 = 40.0 * std::f64::consts::PI / 180.0;
/// Sides that are compared.
const SIDES: usize = 60;
/// A side is weak where views are not right this many times as often as over all, beyond chance: 17 of the same 60 random
/// patterns have such a side, most of them of 8 and 12 dots.
const WEAK: f64 = 1.5;
/// Distinguishes the trials that choose the next dot, and those that say what it gains.
const CHOICE: u64 = 0xd075_0001 << 32;
const GAIN: u64 = 0xd075_0002 << 32;

/// What is asked of a set of dots.
#[derive(Debug, Clone, PartialEq)]
pub struct DotSetConfig {
    /// The views.
    pub view: ViewModel,
    /// Trials; twice as many say what the next dot gains.
    pub samples: u64,
    /// Seed of the trials; those of the next dot are derived from it.
    pub seed: u64,
    /// What a further dot has to keep: its separation, and clear of cones.
    pub constraints: Constraints,
    /// Where no dot should be drawn, such as print: a further dot keeps the separation from these, too.
    pub avoided: Vec<Vec3>,
}

/// What comes of views.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Answers {
    /// An orientation under 20 degrees off.
    pub right: Proportion,
    /// Another one.
    pub wrong: Proportion,
    /// None.
    pub unanswered: Proportion,
}

/// A side of the ball.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BallSide {
    /// The direction from which it is seen, pattern frame.
    pub direction: [f64; 3],
    /// The dots nearest to it, the nearest first.
    pub dots: Vec<usize>,
    /// Views that are not right, of those from within 40 degrees about the direction.
    pub failed: Proportion,
}

/// How good a set of dots is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DotSet {
    /// The views.
    pub view: ViewModel,
    /// Seed of the trials.
    pub seed: u64,
    /// What comes of them.
    pub answers: Answers,
    /// Dots that are taken for others in a large part of the views that are not right.
    pub lookalikes: Vec<Lookalike>,
    /// The side from which it is seen worst, where that is clearly worse than the others.
    pub weak_side: Option<BallSide>,
    /// The best place for one more dot; none where there is no room, or nothing to gain.
    pub next_dot: Option<NextDot>,
}

/// What comes of one view.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Answer {
    Right,
    Wrong,
    Unanswered,
}

impl Answer {
    fn of(result: &TrialResult) -> Self {
        match *result {
            TrialResult::Judged {
                error_rad,
                confidence,
                ..
            } if confidence >= MIN_CONFIDENCE_DOTS => match error_rad < ORIENTATION_FAILURE_RAD {
                true => Self::Right,
                false => Self::Wrong,
            },
            _ => Self::Unanswered,
        }
    }
}

impl Answers {
    fn of(answers: &[Answer]) -> Self {
        let share = |kind: Answer| {
            let count = answers.iter().filter(|a| **a == kind).count();
            Proportion::new(count as u64, answers.len() as u64)
        };
        Self {
            right: share(Answer::Right),
            wrong: share(Answer::Wrong),
            unanswered: share(Answer::Unanswered),
        }
    }
}

/// What comes of so many views of a pattern.
///
/// # Errors
/// As [`Trials::run`].
pub fn answers(pattern: &Pattern, view: &ViewModel, seed: u64, samples: u64) -> Result<Answers> {
    let trials = Trials::first(pattern, *view, seed, samples);
    let recognizer = RobustRecognizer::new(pattern, trials.view.into())?;
    Ok(Answers::of(&each_answer(&trials, &recognizer)?))
}

fn each_answer(trials: &Trials<'_>, recognizer: &RobustRecognizer) -> Result<Vec<Answer>> {
    let results = trials.run(recognizer, &|_| {})?;
    Ok(results.iter().map(Answer::of).collect())
}

impl DotSet {
    /// Judges the dots of a pattern.
    ///
    /// # Errors
    /// As [`Trials::run`].
    pub fn of(pattern: &Pattern, config: &DotSetConfig) -> Result<Self> {
        let DotSetConfig {
            view,
            samples,
            seed,
            ..
        } = *config;
        let trials = Trials::first(pattern, view, seed, samples);
        let recognizer = RobustRecognizer::new(pattern, view.into())?;
        let all = each_answer(&trials, &recognizer)?;
        let failed: Vec<u64> = (0..samples)
            .zip(&all)
            .filter(|(_, answer)| **answer != Answer::Right)
            .map(|(index, _)| index)
            .collect();
        Ok(Self {
            view,
            seed,
            answers: Answers::of(&all),
            lookalikes: lookalikes::lookalikes(&trials, &recognizer, &failed),
            weak_side: weak_side(&trials, &all),
            next_dot: match failed.is_empty() {
                true => None,
                false => next_dot::next_dot(pattern, config)?,
            },
        })
    }
}

/// The side with the lowest share of right views, where it is clearly low.
fn weak_side(trials: &Trials<'_>, all: &[Answer]) -> Option<BallSide> {
    let mut generator = trials.generator();
    let mut trial = Trial::default();
    let seen: Vec<Vec3> = (0..all.len() as u64)
        .map(|index| {
            generator.generate(index, &mut trial);
            trial.rotation.inverse() * Vec3::z()
        })
        .collect();
    let failed = |side: &Vec3, half: usize| {
        let views = seen.iter().zip(all).skip(half).step_by(2);
        let within = views.filter(|(v, _)| angle_between(v, side) < SIDE_RAD);
        let (mut failed, mut count) = (0, 0);
        for (_, answer) in within {
            count += 1;
            failed += u64::from(*answer != Answer::Right);
        }
        Proportion::new(failed, count)
    };
    let sides = spiral_directions(SIDES).map(|side| (failed(&side, 0).rate, side));
    let (_, side) = sides.max_by(|a, b| a.0.total_cmp(&b.0))?;
    let at_all = 1.0 - Answers::of(all).right.rate;
    let failed = failed(&side, 1);
    let dots = trials.pattern.dots();
    let mut near: Vec<usize> = (0..dots.len()).collect();
    near.sort_by(|&a, &b| dots[b].dot(&side).total_cmp(&dots[a].dot(&side)));
    near.truncate(3);
    (failed.low > WEAK * at_all).then(|| BallSide {
        direction: side.into(),
        dots: near,
        failed,
    })
}
