//! Configuration of a design search: every value on which its result depends.

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use super::constraints::Constraints;
use super::descent::DescentMethod;
use super::objective::bound::BoundSummary;
use super::objective::{Objective, confusion};
use super::views::DesignViews;
use crate::error::{Error, Result, require};
use crate::pattern::{MAX_DOTS, MIN_DOTS};
use crate::recognize::RecognizerName;
use crate::validate::check_samples;
use crate::view::Protocol;

/// Configuration of a design search.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DesignConfig {
    /// Dots of the pattern.
    pub dots: usize,
    /// Seed of the random starts; the trials' seeds are derived from it.
    pub seed: u64,
    /// Random starts per round.
    pub starts: usize,
    /// Rounds.
    pub rounds: usize,
    /// Descent steps from every start.
    pub scout_steps: u64,
    /// Further descent steps of the best quarter.
    pub climb_steps: u64,
    /// How a descent finds its steps.
    pub descent: DescentMethod,
    /// Monte Carlo trials per candidate that meets the constraints; the last ones get up to eight times as many, fresh
    /// ones each time.
    pub samples: u64,
    /// Names the views.
    pub views: DesignViews,
    /// The views that candidates are tried on, in equal parts: the protocols of `views`, with the noise that was asked
    /// for.
    pub protocols: Vec<Protocol>,
    /// The recognizer that they are tried with.
    pub recognizer: RecognizerName,
    /// The constraints of the pattern.
    pub constraints: Constraints,
    /// The objective that a descent minimizes.
    pub objective: Objective,
    /// Weight of the orientation bound's worst direction beside the objective; 0 leaves it out.
    pub bound_weight: f64,
    /// Patterns with this orientation bound or better are preferred to all others, in units of the
    /// dots' noise; `None` prefers none.
    pub bound_goal: Option<BoundSummary>,
    /// Weight of the pairs' quality as bases, on which the paper's recognizer depends; 0 leaves it
    /// out.
    pub basis_weight: f64,
    /// A pattern to improve instead of random starts; or the dots that are on the ball already, as many as
    /// [`Constraints::drawn`].
    pub from: Option<Vec<[f64; 3]>>,
}

impl Default for DesignConfig {
    /// 20 dots, one round of 8 starts, 10 000 trials of mixed views each, the expected failure rate beside the
    /// orientation bound.
    fn default() -> Self {
        Self {
            dots: 20,
            seed: 0,
            starts: 8,
            rounds: 1,
            scout_steps: 20,
            climb_steps: 60,
            descent: DescentMethod::default(),
            samples: 10_000,
            views: DesignViews::default(),
            protocols: standard(DesignViews::default()),
            recognizer: RecognizerName::Robust,
            constraints: Constraints::default(),
            objective: Objective::default(),
            bound_weight: 10.0,
            bound_goal: None,
            basis_weight: 0.0,
            from: None,
        }
    }
}

fn standard(views: DesignViews) -> Vec<Protocol> {
    let names = views.protocols().iter();
    names.map(|&name| Protocol::standard(name)).collect()
}

impl DesignConfig {
    /// Checks the domains of all parameters.
    ///
    /// # Errors
    /// [`Error::Argument`] naming the parameter.
    pub fn check(&self) -> Result<()> {
        let dots = format!("{MIN_DOTS} to {MAX_DOTS}");
        require(
            (MIN_DOTS..=MAX_DOTS).contains(&self.dots),
            "dots",
            &dots,
            self.dots,
        )?;
        for (name, value) in [
            ("starts", self.starts as u64),
            ("rounds", self.rounds as u64),
            ("scout_steps", self.scout_steps),
            ("climb_steps", self.climb_steps),
        ] {
            require(value > 0, name, "at least 1", value)?;
        }
        check_samples(self.samples)?;
        for (name, weight) in [
            ("bound_weight", self.bound_weight),
            ("basis_weight", self.basis_weight),
        ] {
            let inside = weight >= 0.0 && weight.is_finite();
            require(inside, name, "a number not below 0", weight)?;
        }
        if !self.objective.name().suits(self.dots) {
            let problem = format!(
                "failure-rate is computed for at most {} dots, found {}; choose another",
                confusion::MAX_DOTS,
                self.dots
            );
            return Err(Error::argument("objective", problem));
        }
        let drawn = self.constraints.drawn;
        if drawn > 0 {
            let from = self.from.as_ref().map_or(0, Vec::len);
            require(from == drawn, "from", &format!("{drawn} dots"), from)?;
            require(drawn < self.dots, "add", "at least 1 dot", 0)?;
        }
        let names = self.protocols.iter().map(Protocol::name);
        if !names.eq(self.views.protocols().iter().copied()) {
            let problem = format!("expected the protocols of {}", self.views);
            return Err(Error::argument("protocols", problem));
        }
        for protocol in &self.protocols {
            protocol.view().check()?;
        }
        self.constraints.check_demand(self.dots)
    }

    /// Seed of the trials of one stage of one round, or of the last trial's halvings.
    pub fn selection_seed(&self, round: usize, halving: usize) -> u64 {
        let stage = (round as u64) << 8 | halving as u64;
        self.trial_seed(0x5e1e_c700 + (stage << 32))
    }

    /// Seed of the trials that show the progress; they select nothing.
    pub fn progress_seed(&self) -> u64 {
        self.trial_seed(0x9406_4e00)
    }

    /// Seed of the trials that are reported; never used before the winner is known.
    pub fn report_seed(&self) -> u64 {
        self.trial_seed(0x4e90_4700)
    }

    /// A seed for one purpose. A pattern to improve was selected by its own trials, perhaps of a
    /// design with the same seed. Its digest enters the seed, so these trials are not drawn again.
    fn trial_seed(&self, purpose: u64) -> u64 {
        let salt = self.from.as_ref().map_or(0, |dots| {
            let mut hasher = Sha256::new();
            for c in dots.iter().flatten() {
                hasher.update(c.to_le_bytes());
            }
            let digest = hasher.finalize();
            digest
                .iter()
                .take(8)
                .fold(0, |salt, &b| salt << 8 | u64::from(b))
        });
        self.seed ^ purpose ^ salt
    }
}
