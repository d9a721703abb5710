//! Trials on common random numbers: a small change of the pattern makes a small change of every
//! view.
//!
//! A [`TrialGenerator`](super::TrialGenerator) draws random numbers for the visible dots only, one
//! after the other. A dot that comes into view shifts all numbers after it and changes the whole
//! view. Here every dot has its own draws whether it is visible or not, and the given dots are
//! those of the smallest random keys. The views still have the protocol's distribution.
//!
//! Use these trials for differences between neighboring patterns. They do not measure the reported
//! rates.

use rand::RngExt;

use super::protocol::Protocol;
use super::trial::{Draws, Trial};
use crate::pattern::Pattern;
use crate::recognize::ObservedDot;

/// Makes trials of a protocol that follow the pattern.
#[derive(Debug, Clone)]
pub struct CommonRandomTrials {
    draws: Draws,
    keyed: Vec<Keyed>,
}

/// A dot in view with its random place in the list.
#[derive(Debug, Clone, Copy)]
struct Keyed {
    key: f64,
    dot: ObservedDot,
    truth: Option<u16>,
    missed: bool,
}

impl CommonRandomTrials {
    /// A generator of the trials that belong to `seed`.
    pub fn new(protocol: Protocol, seed: u64) -> Self {
        Self {
            draws: Draws::new(protocol, seed),
            keyed: Vec::new(),
        }
    }

    /// Makes trial number `index` of a pattern, independent of earlier calls.
    pub fn generate(&mut self, pattern: &Pattern, index: u64, trial: &mut Trial) {
        let (draws, keyed) = (&mut self.draws, &mut self.keyed);
        let p = draws.protocol;
        trial.rotation = draws.begin(index);
        keyed.clear();
        for (j, dot) in pattern.dots().iter().enumerate() {
            let q = trial.rotation * dot;
            let dot = draws.displaced(&q);
            let (key, luck) = (draws.rng.random(), draws.rng.random::<f64>());
            if q.z > p.visibility_limit {
                keyed.push(Keyed {
                    key,
                    dot,
                    truth: Some(j as u16),
                    missed: luck < p.miss_probability,
                });
            }
        }
        let by_key = |a: &Keyed, b: &Keyed| a.key.total_cmp(&b.key);
        if p.dots_given.is_some() {
            keyed.sort_unstable_by(by_key);
            keyed.truncate(draws.given_of(keyed.len()));
        }
        keyed.retain(|k| !k.missed);
        for _ in 0..p.false_dots {
            keyed.push(Keyed {
                dot: draws.false_dot(),
                key: draws.rng.random(),
                truth: None,
                missed: false,
            });
        }
        keyed.sort_unstable_by(by_key);
        trial.fill(keyed.iter().map(|k| (k.dot, k.truth)));
    }
}
