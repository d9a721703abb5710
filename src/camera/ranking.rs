//! Ranking the finalists of a search by a race on rendered frames of a camera, of a seed that nothing else
//! uses.

use super::race_patterns;
use super::{CameraConditions, CameraTrials, FrameRates, RaceConfig, RaceResult, Racer};
use crate::design::{CameraRank, CameraRecord, Candidate};
use crate::error::{Error, Result};

/// A ranking that is to be done, for a search and its shards: at most `frames` frames a finalist, of scenes with
/// this seed.
///
/// # Errors
/// [`Error::Internal`].
pub fn finalist_ranking(
    conditions: &CameraConditions,
    frames: u64,
    seed: u64,
) -> Result<CameraRecord> {
    Ok(CameraRecord {
        conditions: serde_json::to_value(conditions)
            .map_err(|e| Error::Internal(format!("conditions as JSON: {e}")))?,
        frames,
        seed,
        finalists: Vec::new(),
    })
}

/// Puts the finalists in order, and records their rates.
///
/// # Errors
/// [`Error::Argument`] for conditions that are none, or outside their domain.
pub fn rank_finalists(camera: &mut CameraRecord, finalists: &mut [Candidate]) -> Result<()> {
    let conditions: CameraConditions = serde_json::from_value(camera.conditions.clone())
        .map_err(|e| Error::argument("camera", e.to_string()))?;
    let trials = CameraTrials::new(conditions, camera.seed);
    let patterns = finalists.iter().map(Candidate::pattern);
    let patterns = patterns.collect::<Result<Vec<_>>>()?;
    let racers = patterns.iter().map(|pattern| Racer {
        pattern,
        dot_diameter: conditions.dot_diameter,
    });
    let racers: Vec<Racer<'_>> = racers.collect();
    let race = RaceConfig::of_frames(camera.frames);
    let standings = race_patterns(&trials, &racers, &race, &|_| ())?;
    let place = |s: &RaceResult| finalists[s.entry].clone();
    let ranked: Vec<Candidate> = standings.iter().map(place).collect();
    let ranks = ranked.iter().zip(&standings).map(|(candidate, standing)| {
        let rates = FrameRates::of(&standing.outcomes, camera.seed);
        CameraRank {
            start: candidate.start,
            right: rates.right,
            wrong: rates.wrong,
            mean_error_deg: rates.mean_error_deg,
            effective_error_deg: rates.effective_error_deg,
        }
    });
    camera.finalists = ranks.collect();
    finalists.clone_from_slice(&ranked);
    Ok(())
}
