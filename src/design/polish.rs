//! The last stage: descent on the measured rate itself, by correction of the objective where it
//! errs.
//!
//! An objective predicts the failure rate but does not equal it: at the objective's optimum the
//! rate still has a slope. A round of polishing measures that slope over many views
//! ([`SmoothRate`]) and descends on the corrected model (first-order model correction: N. M.
//! Alexandrov et al., "A trust-region framework for managing the use of approximation models in
//! optimization", Structural Optimization 15, 1998)
//!
//! ```text
//! ln objective(x) + (grad ln rate(x0) - grad ln objective(x0)) . (x - x0)
//! ```
//!
//! under the constraints and beside the orientation bound. The objective provides the curvature,
//! without which sampling noise of the slope would dominate: a plain descent on fixed views gained
//! a tenth on those and nothing on fresh ones.
//!
//! The correction `c` is measured with sampling noise and shrunk accordingly (W. James, C. Stein,
//! "Estimation with quadratic loss", Proc. 4th Berkeley Symp., 1961). Of measurements `c_k` on
//! different views the products `c_j . c_k` estimate `|c|^2` without bias, and the mean of the
//! `c_k` is multiplied by the ratio of that estimate to its own square. Measurements at one pattern
//! accumulate until another pattern replaces it. Where the estimate is not positive, no step is
//! tried.
//!
//! Points along the descent are evaluated on further views, and the best of them is tested against
//! the current pattern. It replaces that pattern only where an exact sign test on the views that
//! exactly one of the two fails (McNemar's test) finds it better at the 5 % level. Every step of
//! every round has views of its own.
//!
//! What it does not guarantee: a gain. Where no gain is significant the pattern stays unchanged.

use std::sync::atomic::{AtomicBool, Ordering};

use serde::{Deserialize, Serialize};

use super::candidate::Candidate;
use super::config::DesignConfig;
use super::objective::Evaluation;
use super::rate::SmoothRate;
use super::scp::{Cost, Descent};
use super::work::{DesignCost, candidate, results};
use crate::error::Result;
use crate::geometry::Vec3;
use crate::validate::{Proportion, TrialResult};

/// Slopes that a round measures.
const SLOPES: u64 = 2;
/// Views of a slope, of an evaluation, and of a test, in units of the configuration's samples.
const SLOPE_VIEWS: u64 = 30;
const LOOK_VIEWS: u64 = 10;
const TEST_VIEWS: u64 = 20;
/// Fraction of a test after which it stops where nothing favors the new pattern.
const HALF_WAY: u64 = 4;
/// Descent steps between two evaluated points.
const STAGES: [u64; 3] = [3, 5, 8];
/// Initial trust radius, radians: the objective's optimum is near.
const FIRST_RADIUS: f64 = 0.012;
/// Level of the test.
const LEVEL: f64 = 0.05;

/// Result of one round.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct PolishStep {
    /// Views that both patterns were tried on; 0 where no point along the descent evaluated better.
    pub trials: u64,
    /// Views that only the new pattern passed.
    pub gained: u64,
    /// Views that only the old pattern passed.
    pub lost: u64,
    /// Whether the new pattern replaced the old one.
    pub taken: bool,
}

/// The state of polishing.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Polish {
    /// The pattern before polishing.
    pub from: Candidate,
    /// The current pattern.
    pub at: Candidate,
    /// Sum of the corrections measured there.
    pub correction: Vec<Vec3>,
    /// Sum of their squares.
    pub squares: f64,
    /// Their number.
    pub measured: usize,
    /// The rounds so far.
    pub steps: Vec<PolishStep>,
}

impl Polish {
    /// The state before the first round.
    pub(super) fn new(from: Candidate) -> Self {
        Self {
            at: from.clone(),
            correction: vec![Vec3::zeros(); from.dots.len()],
            squares: 0.0,
            measured: 0,
            steps: Vec::new(),
            from,
        }
    }

    /// The next round; `None` if stopped before its end, with nothing changed.
    pub(super) fn round(&self, config: &DesignConfig, stop: &AtomicBool) -> Result<Option<Self>> {
        let stopped = || stop.load(Ordering::Relaxed);
        let round = self.steps.len();
        let rate = |step, views| SmoothRate {
            protocol: config.protocol,
            seed: config.polish_seed(round, step),
            trials: views * config.samples,
            stop,
        };
        let mut next = self.clone();
        for slope in 0..SLOPES {
            next.measure(config, &rate(slope, SLOPE_VIEWS))?;
        }
        let on_the_way = next.descend(config, stop)?;
        let best = self.best_of(on_the_way, &rate(SLOPES, LOOK_VIEWS))?;
        if stopped() {
            return Ok(None);
        }
        let step = match best {
            Some(new) => next.test(config, new, round, stop)?,
            None => PolishStep {
                trials: 0,
                gained: 0,
                lost: 0,
                taken: false,
            },
        };
        next.steps.push(step);
        Ok((!stopped()).then_some(next))
    }

    /// Adds a measurement of the correction.
    fn measure(&mut self, config: &DesignConfig, rate: &SmoothRate) -> Result<()> {
        let at = dots(&self.at);
        let measured = rate.evaluate(&at)?;
        let predicted = config.objective.cost(&at)?;
        let slopes = measured.gradient.iter().zip(&predicted.gradient);
        for ((sum, (m, f)), d) in self.correction.iter_mut().zip(slopes).zip(&at) {
            let error = m - f;
            let error = error - d * d.dot(&error);
            *sum += error;
            self.squares += error.norm_squared();
        }
        self.measured += 1;
        Ok(())
    }

    /// The shrunk correction; `None` where it is not distinguishable from sampling noise.
    fn sure_correction(&self) -> Option<Vec<Vec3>> {
        let n = self.measured as f64;
        let sum: f64 = self.correction.iter().map(Vec3::norm_squared).sum();
        let sure = (sum - self.squares) / (n * (n - 1.0));
        let share = sure / (sum / (n * n));
        // With one measurement there are no products, and the share is not a number.
        (share > 0.0).then(|| self.correction.iter().map(|c| c * (share / n)).collect())
    }

    /// Points along the descent on the corrected model, without those that violate a constraint or
    /// miss the goal.
    fn descend(&self, config: &DesignConfig, stop: &AtomicBool) -> Result<Vec<Candidate>> {
        let Some(correction) = self.sure_correction() else {
            return Ok(Vec::new());
        };
        let model = Corrected {
            config,
            correction,
            at: dots(&self.at),
        };
        let mut pattern = self.at.pattern()?;
        let mut found = Vec::new();
        for steps in STAGES {
            let descent = Descent {
                steps,
                first_radius: FIRST_RADIUS,
                stop,
            };
            pattern = descent.run(&pattern, &model, &config.constraints)?;
            let new = candidate(config, self.at.start, self.at.value_before, &pattern)?;
            let worse = new.short_of_goal && !self.at.short_of_goal;
            if new.missed.is_none() && !worse {
                found.push(new);
            }
        }
        Ok(found)
    }

    /// The candidate that evaluates best; `None` where the current pattern does.
    fn best_of(&self, candidates: Vec<Candidate>, rate: &SmoothRate) -> Result<Option<Candidate>> {
        let mut best = None;
        if candidates.is_empty() {
            return Ok(best);
        }
        let mut smallest = rate.value(&dots(&self.at))?;
        for candidate in candidates {
            let value = rate.value(&dots(&candidate))?;
            if value < smallest {
                (smallest, best) = (value, Some(candidate));
            }
        }
        Ok(best)
    }

    /// Tests a new pattern against the current one, and takes it if it is significantly better.
    fn test(
        &mut self,
        config: &DesignConfig,
        mut new: Candidate,
        round: usize,
        stop: &AtomicBool,
    ) -> Result<PolishStep> {
        let (mut gained, mut lost, mut passed, mut judged, mut trials) = (0, 0, 0, 0, 0);
        for part in 0..TEST_VIEWS {
            if stop.load(Ordering::Relaxed) || (part == HALF_WAY && gained <= lost) {
                break;
            }
            let seed = config.polish_seed(round, SLOPES + 1 + part);
            let old = results(config, &self.at, seed, config.samples)?;
            for (old, new) in old
                .iter()
                .zip(&results(config, &new, seed, config.samples)?)
            {
                let (old, new) = (identified(old), identified(new));
                gained += u64::from(old == Some(false) && new == Some(true));
                lost += u64::from(old == Some(true) && new == Some(false));
                passed += u64::from(new == Some(true));
                judged += u64::from(new.is_some());
            }
            trials += config.samples;
        }
        let complete = trials == TEST_VIEWS * config.samples;
        let taken = complete && sign_test(gained, lost) < LEVEL;
        if taken {
            new.identity = Some(Proportion::new(passed, judged));
            self.correction.fill(Vec3::zeros());
            (self.squares, self.measured) = (0.0, 0);
            self.at = new;
        }
        Ok(PolishStep {
            trials,
            gained,
            lost,
            taken,
        })
    }
}

/// The objective with its slope corrected, beside the orientation bound.
struct Corrected<'a> {
    config: &'a DesignConfig,
    at: Vec<Vec3>,
    correction: Vec<Vec3>,
}

impl Cost for Corrected<'_> {
    fn cost(&self, dots: &[Vec3]) -> Result<Evaluation> {
        let mut here = DesignCost(self.config).cost(dots)?;
        let moves = dots.iter().zip(&self.at);
        for ((g, c), (d, at)) in here.gradient.iter_mut().zip(&self.correction).zip(moves) {
            here.value += c.dot(&(d - at));
            *g += c;
        }
        Ok(here)
    }
}

fn dots(candidate: &Candidate) -> Vec<Vec3> {
    candidate.dots.iter().map(|d| Vec3::from(*d)).collect()
}

/// Whether a view was identified; `None` where it had too few dots.
fn identified(result: &TrialResult) -> Option<bool> {
    match result {
        TrialResult::Skipped => None,
        TrialResult::Judged { identity, .. } => Some(*identity),
    }
}

/// One-sided exact sign test: the probability of at least so many gains among the views where one
/// of two equal patterns failed.
pub fn sign_test(gained: u64, lost: u64) -> f64 {
    let n = gained + lost;
    let ln_choose = |k: u64| {
        libm::lgamma(n as f64 + 1.0)
            - libm::lgamma(k as f64 + 1.0)
            - libm::lgamma((n - k) as f64 + 1.0)
    };
    let ln_half = n as f64 * std::f64::consts::LN_2;
    (gained..=n)
        .map(|k| (ln_choose(k) - ln_half).exp())
        .sum::<f64>()
        .min(1.0)
}
