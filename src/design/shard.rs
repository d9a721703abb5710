//! A search in shards, for several machines: each searches with a seed of its own, and the best of all
//! meet in one last trial.
//!
//! Shard `k` of `n` of a search with seed `s` runs the rounds of a search with seed `s + k - 1`, and
//! stops before the last trial. [`merge`] makes one state of the finished shards: their pools in the
//! shards' order, without the rates under which they were kept, since each shard has its own trials.
//! [`search::design`](super::search::design) continues from it with the last trial, on trials that no
//! shard has drawn.
//!
//! Guarantees: the result is a function of the configuration and the number of shards, wherever and
//! in whatever order they ran. Not guaranteed: what one search of as many rounds would find, whose
//! later rounds build on the earlier ones' best.

use super::checkpoint::SearchState;
use super::config::DesignConfig;
use crate::error::{Error, Result, require};

/// Maximum number of shards.
pub const MAX_SHARDS: usize = 10_000;

/// Shard `index` (from 1) of `count`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Shard {
    /// Its number, from 1.
    pub index: usize,
    /// The number of shards.
    pub count: usize,
}

impl Shard {
    /// The shard of these numbers.
    ///
    /// # Errors
    /// [`Error::Argument`] where there is no such shard.
    pub fn new(index: usize, count: usize) -> Result<Self> {
        let expected = format!("K/N with K from 1 to N, and N up to {MAX_SHARDS}");
        let inside = (1..=MAX_SHARDS).contains(&count) && (1..=count).contains(&index);
        let found = format_args!("{index}/{count}");
        require(inside, "shard", &expected, found)?;
        Ok(Self { index, count })
    }

    /// All shards of this number.
    ///
    /// # Errors
    /// [`Error::Argument`] for none, or too many.
    pub fn all(count: usize) -> Result<Vec<Self>> {
        let expected = format!("1 to {MAX_SHARDS}");
        require(
            (1..=MAX_SHARDS).contains(&count),
            "shards",
            &expected,
            count,
        )?;
        Ok((1..=count).map(|index| Self { index, count }).collect())
    }

    /// The configuration of its rounds: the whole search's with the shard's seed.
    pub fn config(&self, whole: &DesignConfig) -> DesignConfig {
        DesignConfig {
            seed: whole.seed.wrapping_add(self.index as u64 - 1),
            ..whole.clone()
        }
    }
}

impl std::str::FromStr for Shard {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        let numbers = text.split_once('/');
        let parsed = numbers.and_then(|(k, n)| Some((k.parse().ok()?, n.parse().ok()?)));
        let (index, count) = parsed.ok_or_else(|| {
            Error::argument("shard", format!("expected K/N as in 3/8, found {text:?}"))
        })?;
        Self::new(index, count)
    }
}

impl std::fmt::Display for Shard {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}/{}", self.index, self.count)
    }
}

/// The state of the whole search from those of its shards, which have finished their rounds, in the
/// shards' order.
pub fn merge(config: &DesignConfig, shards: Vec<SearchState>) -> SearchState {
    let per_shard = config.starts * config.rounds;
    let count = shards.len();
    let mut pool = Vec::new();
    let mut missed = None;
    for (k, shard) in shards.into_iter().enumerate() {
        missed = missed.or(shard.missed);
        pool.extend(shard.pool.into_iter().map(|mut candidate| {
            // Numbered on over all shards: ties are decided by the start.
            candidate.start += k * per_shard;
            candidate.identity = None;
            candidate
        }));
    }
    SearchState {
        round: config.rounds,
        pool,
        missed,
        shards: count,
        ..SearchState::default()
    }
}
