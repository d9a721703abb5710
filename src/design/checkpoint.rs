//! A search on disk: everything needed to continue it, written atomically after every batch of
//! work.

use std::path::Path;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::candidate::{Candidate, Milestone};
use super::config::DesignConfig;
use super::objective;
use super::shard::Shard;
use crate::error::{Error, Result};
#[cfg(feature = "native")]
use crate::files;

/// How much nearer than demanded two dots of a candidate may be, radians: the constraints' own
/// tolerance.
const SEPARATION_ROUNDING: f64 = 2e-3;

/// Version of the checkpoint's format.
pub const CHECKPOINT_VERSION: u32 = 4;
/// The version before, which is read as far as nothing in it has gone since ([`removed`]).
const VERSION_BEFORE: u32 = 3;

/// The progress of a search.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct SearchState {
    /// Rounds completed.
    pub round: usize,
    /// Candidates of the current round after their first steps, in the order of their starts.
    pub scouted: Vec<Candidate>,
    /// The best quarter of them after the full descent; best scouted first.
    pub climbed: Vec<Candidate>,
    /// The best of all rounds, best first.
    pub pool: Vec<Candidate>,
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

/// What a shard's file says beside its state.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ShardRecord {
    /// Which shard of how many.
    pub shard: Shard,
    /// The command that runs the whole search, where a command ran the shard.
    pub command: Option<String>,
}

/// A shard as read from disk.
#[derive(Debug, Clone, PartialEq)]
pub struct ShardFile {
    /// Configuration of the whole search.
    pub config: DesignConfig,
    /// Which shard.
    pub record: ShardRecord,
    /// Its progress.
    pub state: SearchState,
}

#[derive(Deserialize)]
struct Version {
    checkpoint_version: u32,
}

#[derive(Serialize, Deserialize)]
struct File {
    checkpoint_version: u32,
    config: DesignConfig,
    state: SearchState,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    shard: Option<ShardRecord>,
}

impl File {
    /// Reads the file's bytes; `path` only names it in errors.
    fn read(path: &Path, bytes: &[u8]) -> Result<Self> {
        let unreadable =
            |e: serde_json::Error| Error::input(path, "checkpoint", format!("cannot be read: {e}"));
        // The version first: another format may have other fields.
        let Version { checkpoint_version } = serde_json::from_slice(bytes).map_err(unreadable)?;
        match checkpoint_version {
            CHECKPOINT_VERSION => {}
            VERSION_BEFORE => {
                let file: Value = serde_json::from_slice(bytes).map_err(unreadable)?;
                if let Some((field, problem)) = removed(&file) {
                    return Err(Error::input(path, field, problem));
                }
            }
            _ => {
                let problem =
                    format!("expected version {CHECKPOINT_VERSION}, found {checkpoint_version}");
                return Err(Error::input(path, "checkpoint_version", problem));
            }
        }
        serde_json::from_slice(bytes).map_err(unreadable)
    }
}

/// What a checkpoint of the version before holds that this version would silently leave out: its
/// field, and what to do instead. Rounds of polishing that were still to come are no such thing.
fn removed(file: &Value) -> Option<(&'static str, &'static str)> {
    let at = |pointer: &str| file.pointer(pointer);
    if at("/config/objective/name").is_some_and(|name| name == objective::NAME_BEFORE) {
        let problem = "coincidence was replaced by coverage; begin with --objective coverage";
        return Some(("config.objective", problem));
    }
    let certified = at("/config/constraints/min_certified_rad").and_then(Value::as_f64);
    if certified.is_some_and(|angle| angle > 0.0) {
        let problem =
            "certified patterns are no longer searched; begin without --min-certified-deg";
        return Some(("config.constraints.min_certified_rad", problem));
    }
    if at("/state/polish/from/dots") != at("/state/polish/at/dots") {
        let problem = "polishing was removed, and this search ended with a polished pattern; keep its \
                       pattern.csv, or begin from that with --from";
        return Some(("state.polish", problem));
    }
    None
}

impl ShardFile {
    /// Reads a shard.
    ///
    /// # Errors
    /// [`Error::Read`]; [`Error::Input`] for a file of another version, a damaged one, or one that is
    /// no shard's.
    #[cfg(feature = "native")]
    pub fn load(path: &Path) -> Result<Self> {
        let file = File::read(path, &files::read_bytes(path)?)?;
        let record = file.shard.ok_or_else(|| {
            let problem = "expected a shard's search, found one of one piece";
            Error::input(path, "shard", problem)
        })?;
        Ok(Self {
            config: file.config,
            record,
            state: file.state,
        })
    }

    /// Writes the shard atomically.
    ///
    /// # Errors
    /// [`Error::Write`].
    #[cfg(feature = "native")]
    pub fn save(&self, path: &Path) -> Result<()> {
        let record = Some(self.record.clone());
        files::write_bytes(path, &self.state.as_json(&self.config, record)?)
    }
}

impl SearchState {
    /// The best pattern of the rounds so far.
    pub fn best(&self) -> Option<&Candidate> {
        self.pool.first()
    }

    /// The search as JSON.
    ///
    /// # Errors
    /// [`Error::Internal`].
    pub fn to_json(&self, config: &DesignConfig) -> Result<Vec<u8>> {
        self.as_json(config, None)
    }

    fn as_json(&self, config: &DesignConfig, shard: Option<ShardRecord>) -> Result<Vec<u8>> {
        let file = File {
            checkpoint_version: CHECKPOINT_VERSION,
            config: config.clone(),
            state: self.clone(),
            shard,
        };
        serde_json::to_vec(&file).map_err(|e| Error::Internal(format!("checkpoint as JSON: {e}")))
    }

    /// Writes the search atomically.
    ///
    /// # Errors
    /// [`Error::Write`].
    #[cfg(feature = "native")]
    pub fn save(&self, path: &Path, config: &DesignConfig) -> Result<()> {
        files::write_bytes(path, &self.to_json(config)?)
    }

    /// Reads a search that was saved under the same configuration. The number of rounds may be larger.
    ///
    /// # Errors
    /// [`Error::Read`], and those of [`SearchState::from_json`].
    #[cfg(feature = "native")]
    pub fn load(path: &Path, config: &DesignConfig) -> Result<Self> {
        Self::from_json(path, &files::read_bytes(path)?, config)
    }

    /// As [`SearchState::load`], from the file's bytes; `path` only names the file in errors.
    ///
    /// # Errors
    /// [`Error::Input`] for another version, another configuration or a damaged file.
    pub fn from_json(path: &Path, bytes: &[u8], config: &DesignConfig) -> Result<Self> {
        let file = File::read(path, bytes)?;
        if let Some(record) = file.shard {
            let problem = format!("belongs to shard {}; repeat --shard", record.shard);
            return Err(Error::input(path, "shard", problem));
        }
        let mut same = file.config;
        same.rounds = config.rounds;
        if same != *config {
            let problem =
                "belongs to a search with other arguments; repeat those, or leave --resume out";
            return Err(Error::input(path, "config", problem));
        }
        file.state.check(path, config)?;
        Ok(file.state)
    }

    /// Checks that every candidate could come from this search: a file that was edited would end as
    /// a pattern that breaks its own constraints.
    fn check(&self, path: &Path, config: &DesignConfig) -> Result<()> {
        let groups = [
            ("scouted", &self.scouted),
            ("climbed", &self.climbed),
            ("pool", &self.pool),
        ];
        for (name, candidates) in groups {
            for (k, candidate) in candidates.iter().enumerate() {
                check_candidate(path, &format!("{name} {k}"), candidate, config)?;
            }
        }
        Ok(())
    }
}

/// Checks the dots of a candidate, and of one that is not known to violate a constraint its
/// separations.
fn check_candidate(
    path: &Path,
    place: &str,
    candidate: &Candidate,
    config: &DesignConfig,
) -> Result<()> {
    let reject = |problem: String| Err(Error::input(path, place, problem));
    let (expected, found) = (config.dots, candidate.dots.len());
    if found != expected {
        return reject(format!("expected {expected} dots, found {found}"));
    }
    let pattern = match candidate.pattern() {
        Ok(pattern) => pattern,
        Err(error) => return reject(error.to_string()),
    };
    let separation = pattern.summary().min_separation_rad;
    let expected = config.constraints.min_separation_rad;
    if candidate.missed.is_none() && separation < expected - SEPARATION_ROUNDING {
        let [expected, found] = [expected, separation].map(f64::to_degrees);
        return reject(format!(
            "expected dots at least {expected:.2} deg apart, found {found:.2} deg"
        ));
    }
    Ok(())
}
