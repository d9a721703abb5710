//! Views on steady random numbers: a small change of the pattern makes a small change of every view.
//!
//! A [`TrialGenerator`](super::TrialGenerator) draws for the dots in view only, one after the other: a dot
//! that comes into view shifts all numbers after it, and the view becomes another. Here every dot has its
//! draws whether it is seen or not, and the dots that are given are those with the least of their random
//! keys. The views have the protocol's law all the same. They serve differences between neighboring
//! patterns; rates are measured elsewhere.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::protocol::Protocol;
use super::trial::{Trial, displaced, false_dot};
use crate::geometry::random_rotation;
use crate::pattern::Pattern;
use crate::recognize::ObservedDot;

/// Makes trials of a protocol that follow the pattern.
#[derive(Debug, Clone)]
pub struct CommonRandomTrials {
    protocol: Protocol,
    rng: ChaCha8Rng,
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
            protocol,
            rng: ChaCha8Rng::seed_from_u64(seed),
            keyed: Vec::new(),
        }
    }

    /// Makes trial number `index` of a pattern, whatever was made before.
    pub fn generate(&mut self, pattern: &Pattern, index: u64, trial: &mut Trial) {
        self.rng.set_stream(index);
        self.rng.set_word_pos(0);
        let (rng, p, keyed) = (&mut self.rng, &self.protocol, &mut self.keyed);
        trial.rotation = random_rotation(rng);
        keyed.clear();
        for (j, dot) in pattern.dots().iter().enumerate() {
            let q = trial.rotation * dot;
            let dot = displaced(&q, &p.noise, rng);
            let (key, luck) = (rng.random(), rng.random::<f64>());
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
        if let Some(most) = p.dots_given {
            keyed.sort_unstable_by(by_key);
            keyed.truncate(if keyed.len() < most { 0 } else { most });
        }
        keyed.retain(|k| !k.missed);
        for _ in 0..p.false_dots {
            keyed.push(Keyed {
                dot: false_dot(p, rng),
                key: rng.random(),
                truth: None,
                missed: false,
            });
        }
        keyed.sort_unstable_by(by_key);
        trial.dots.clear();
        trial.truth.clear();
        for k in keyed.iter() {
            trial.dots.push(k.dot);
            trial.truth.push(k.truth);
        }
    }
}
