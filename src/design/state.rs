//! The state of a search: its candidates, how far it has come, and its file.
//!
//! A [`SearchState`] holds everything needed to continue a search. On disk it is a [`Checkpoint`], JSON
//! beside the configuration that it belongs to, written atomically after every batch of work.
//!
//! A search may run in shards, on several machines: each searches with a seed of its own, and the best
//! of all meet in one last trial. Shard `k` of `n` of a search with seed `s` runs the rounds of a search
//! with seed `s + k - 1`, and stops before the last trial. [`SearchState::merged`] makes one state of
//! the finished shards: their pools in the shards' order, without the rates under which they were kept,
//! since each shard has its own trials. [`super::search::design`] continues from it with the last
//! trial, on trials that no shard has drawn.
//!
//! Guarantees: the result is a function of the configuration and the number of shards, wherever and
//! in whatever order they ran. A file is read only where every candidate in it could come from its
//! search. Not guaranteed: that shards find what one search of as many rounds would find, whose later
//! rounds build on the earlier ones' best.

use std::path::Path;

use serde::{Deserialize, Serialize};

use super::config::DesignConfig;
use super::ranking::CameraRequest;
use crate::error::{Error, Result, require};
#[cfg(feature = "native")]
use crate::files;
use crate::geometry::Vec3;
use crate::pattern::Pattern;
use crate::stats::Proportion;

/// How much nearer than demanded two dots of a candidate may be, radians: the constraints' own
/// tolerance.
const SEPARATION_ROUNDING: f64 = 2e-3;

/// Version of the checkpoint's format.
pub const CHECKPOINT_VERSION: u32 = 5;

/// Maximum number of shards.
pub const MAX_SHARDS: usize = 10_000;

/// A pattern in the search.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DesignCandidate {
    /// The start it came from, counted over all rounds.
    pub start: usize,
    /// The objective's value at the start.
    pub value_before: f64,
    /// The objective's value now.
    pub value: f64,
    /// The cost now: objective and bound.
    pub cost: f64,
    /// The constraint that it violates, if any; such a candidate is never chosen.
    pub missed: Option<String>,
    /// Whether its orientation bound misses the goal; such a candidate ranks behind all others.
    pub short_of_goal: bool,
    /// Right orientations (under 20 degrees off) of all views of its last trials, if it was tried: a view with too few
    /// dots is a failure.
    pub answered: Option<Proportion>,
    /// The dots.
    pub dots: Vec<[f64; 3]>,
}

impl DesignCandidate {
    /// The pattern.
    ///
    /// # Errors
    /// [`crate::Error::Argument`] where the dots are none (only in a tampered checkpoint).
    pub fn pattern(&self) -> Result<Pattern> {
        Pattern::new(self.dots.iter().map(|d| Vec3::from(*d)).collect())
    }

    fn rate(&self) -> f64 {
        self.answered.map_or(-1.0, |p| p.rate)
    }

    /// Checks the dots, and of a candidate that is not known to violate a constraint their separations.
    /// `place` says where it stands in the file.
    fn check(&self, path: &Path, place: &str, config: &DesignConfig) -> Result<()> {
        let reject = |problem: String| Err(Error::input(path, place, problem));
        let (expected, found) = (config.dots, self.dots.len());
        if found != expected {
            return reject(format!("expected {expected} dots, found {found}"));
        }
        let pattern = match self.pattern() {
            Ok(pattern) => pattern,
            Err(error) => return reject(error.to_string()),
        };
        if let Some(from) = config
            .from
            .as_ref()
            .filter(|_| config.constraints.drawn > 0)
            && self.dots.get(..from.len()) != Some(&from[..])
        {
            return reject("expected the drawn dots where they are".to_owned());
        }
        let separation = config.constraints.separation(&pattern);
        let expected = config.constraints.min_separation_rad;
        if self.missed.is_none() && separation < expected - SEPARATION_ROUNDING {
            let [expected, found] = [expected, separation].map(f64::to_degrees);
            return reject(format!(
                "expected dots at least {expected:.2} deg apart, found {found:.2} deg"
            ));
        }
        Ok(())
    }
}

/// Candidates that reach the goal first, then the best rate; ties by cost, then by start.
pub(super) fn sort_by_rate(candidates: &mut [DesignCandidate]) {
    candidates.sort_by(|a, b| {
        a.short_of_goal
            .cmp(&b.short_of_goal)
            .then(b.rate().total_cmp(&a.rate()))
            .then(a.cost.total_cmp(&b.cost))
            .then(a.start.cmp(&b.start))
    });
}

/// The best pattern at a point in time.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Milestone {
    /// Seconds since the search began, over all its runs; none in a report, whose every run has the same bytes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub elapsed_s: Option<f64>,
    /// Rounds of the search completed.
    pub rounds: usize,
    /// The rate of the best candidate, of all views, always on the same trials, which select nothing.
    pub answered: Proportion,
}

/// The progress of a search.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct SearchState {
    /// Rounds completed.
    pub round: usize,
    /// Candidates of the current round after their first steps, in the order of their starts.
    pub scouted: Vec<DesignCandidate>,
    /// The best quarter of them after the full descent; best scouted first.
    pub climbed: Vec<DesignCandidate>,
    /// The best of all rounds, best first.
    pub pool: Vec<DesignCandidate>,
    /// Seconds spent.
    pub elapsed_s: f64,
    /// The best rate over time.
    pub milestones: Vec<Milestone>,
    /// A constraint that a recent candidate violated.
    pub missed: Option<String>,
    /// The shards that this is merged from; 0 for a search of one piece.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub shards: usize,
}

fn is_zero(count: &usize) -> bool {
    *count == 0
}

impl SearchState {
    /// The best pattern of the rounds so far.
    pub fn best(&self) -> Option<&DesignCandidate> {
        self.pool.first()
    }

    /// The state of a whole search from those of its shards, which have finished their rounds, in the
    /// shards' order.
    pub fn merged(config: &DesignConfig, shards: Vec<Self>) -> Self {
        let per_shard = config.starts * config.rounds;
        let count = shards.len();
        let mut pool = Vec::new();
        let mut missed = None;
        for (k, shard) in shards.into_iter().enumerate() {
            missed = missed.or(shard.missed);
            pool.extend(shard.pool.into_iter().map(|mut candidate| {
                // Numbered on over all shards: ties are decided by the start.
                candidate.start += k * per_shard;
                candidate.answered = None;
                candidate
            }));
        }
        Self {
            round: config.rounds,
            pool,
            missed,
            shards: count,
            ..Self::default()
        }
    }
}

/// Shard `index` (from 1) of `count`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
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
        let inside = (1..=MAX_SHARDS).contains(&count);
        require(inside, "shards", &expected, count)?;
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

/// What a shard's file says beside its state.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ShardRecord {
    /// Which shard of how many.
    pub shard: Shard,
    /// The command that runs the whole search, where a command ran the shard.
    pub command: Option<String>,
    /// The camera that ranks the finalists of all shards, where one does.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub camera: Option<CameraRequest>,
}

/// A search on disk, of one piece or a shard's.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Checkpoint {
    checkpoint_version: u32,
    /// Configuration of the whole search.
    pub config: DesignConfig,
    /// Its progress, or that of the shard.
    pub state: SearchState,
    /// Which shard of it this is; `None` for a search of one piece.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shard: Option<ShardRecord>,
}

impl Checkpoint {
    /// The checkpoint of a search.
    pub fn new(config: DesignConfig, state: SearchState, shard: Option<ShardRecord>) -> Self {
        Self {
            checkpoint_version: CHECKPOINT_VERSION,
            config,
            state,
            shard,
        }
    }

    /// Reads a checkpoint.
    ///
    /// # Errors
    /// [`Error::Read`], and those of [`Checkpoint::from_json`].
    #[cfg(feature = "native")]
    pub fn load(path: &Path) -> Result<Self> {
        Self::from_json(path, &files::read_bytes(path)?)
    }

    /// A checkpoint from its file's bytes; `path` only names the file in errors.
    ///
    /// # Errors
    /// [`Error::Input`] for another version, a damaged file, and candidates that cannot come from its search
    /// (an edited one would end as a pattern that breaks its own constraints).
    pub fn from_json(path: &Path, bytes: &[u8]) -> Result<Self> {
        #[derive(Deserialize)]
        struct Version {
            checkpoint_version: u32,
        }
        let unreadable =
            |e: serde_json::Error| Error::input(path, "checkpoint", format!("cannot be read: {e}"));
        // The version first: another format may have other fields.
        let Version { checkpoint_version } = serde_json::from_slice(bytes).map_err(unreadable)?;
        if checkpoint_version != CHECKPOINT_VERSION {
            let problem = format!(
                "expected version {CHECKPOINT_VERSION}, found {checkpoint_version}: searches of other versions count \
                 other views, so begin again without --resume"
            );
            return Err(Error::input(path, "checkpoint_version", problem));
        }
        let found: Self = serde_json::from_slice(bytes).map_err(unreadable)?;
        found.check(path)?;
        Ok(found)
    }

    fn check(&self, path: &Path) -> Result<()> {
        let groups = [
            ("scouted", &self.state.scouted),
            ("climbed", &self.state.climbed),
            ("pool", &self.state.pool),
        ];
        for (name, candidates) in groups {
            for (k, candidate) in candidates.iter().enumerate() {
                candidate.check(path, &format!("{name} {k}"), &self.config)?;
            }
        }
        Ok(())
    }

    /// The checkpoint as JSON.
    ///
    /// # Errors
    /// [`Error::Internal`].
    pub fn to_json(&self) -> Result<Vec<u8>> {
        serde_json::to_vec(self).map_err(|e| Error::Internal(format!("checkpoint as JSON: {e}")))
    }

    /// Writes the checkpoint atomically.
    ///
    /// # Errors
    /// [`Error::Write`].
    #[cfg(feature = "native")]
    pub fn save(&self, path: &Path) -> Result<()> {
        files::write_bytes(path, &self.to_json()?)
    }

    /// The state to continue the search `config`, or a shard of it, from. The number of rounds of a
    /// search of one piece may be larger than it was; `path` only names the file in errors.
    ///
    /// # Errors
    /// [`Error::Input`] where the checkpoint is of another search, or of another part of it.
    pub fn resume(
        self,
        path: &Path,
        config: &DesignConfig,
        shard: Option<Shard>,
    ) -> Result<SearchState> {
        let reject = |place: &str, problem: String| Err(Error::input(path, place, problem));
        let found = self.shard.map(|record| record.shard);
        match (found, shard) {
            (Some(found), None) => {
                return reject("shard", format!("belongs to shard {found}; repeat --shard"));
            }
            (None, Some(_)) => {
                let problem = "expected a shard's search, found one of one piece";
                return reject("shard", problem.to_owned());
            }
            (Some(found), Some(asked)) if found != asked => {
                return reject("shard", format!("expected shard {asked}, found {found}"));
            }
            _ => {}
        }
        let mut same = self.config;
        if shard.is_none() {
            same.rounds = config.rounds;
        }
        if same != *config {
            let problem =
                "belongs to a search with other arguments; repeat those, or leave --resume out";
            return reject("config", problem.to_owned());
        }
        Ok(self.state)
    }
}
