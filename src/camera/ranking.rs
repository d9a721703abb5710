//! Ranking the finalists of a search by a race on rendered frames of a camera, of a seed that nothing else
//! uses. The rates that are recorded are of other frames than those that ranked.

use std::sync::atomic::AtomicBool;

use super::race_patterns;
use super::{CameraConditions, CameraTrials, FrameRates, RaceConfig, RaceResult, Racer};
use crate::design::{CameraRank, CameraRecord, CameraRequest, DesignCandidate};
use crate::error::{Error, Result, require};

/// The conditions of a camera that is to rank finalists.
///
/// # Errors
/// [`Error::Argument`] for conditions that cannot be read or are outside their domain, and for no frames.
pub fn requested_conditions(request: &CameraRequest) -> Result<CameraConditions> {
    let conditions: CameraConditions = serde_json::from_value(request.conditions.clone())
        .map_err(|e| Error::argument("camera", e.to_string()))?;
    conditions.check()?;
    require(request.frames > 0, "frames", "at least 1", request.frames)?;
    Ok(conditions)
}

/// Puts the finalists in order; their rates, or none where `stop` was set before all were measured. `done` learns
/// how many more frames are read or spared, [`RaceConfig::frames`] of each in all.
///
/// # Errors
/// As [`requested_conditions`].
pub fn rank_finalists(
    request: &CameraRequest,
    finalists: &mut [DesignCandidate],
    stop: &AtomicBool,
    done: &(dyn Fn(u64) + Sync),
) -> Result<Option<CameraRecord>> {
    let conditions = requested_conditions(request)?;
    let trials = CameraTrials::new(conditions, request.seed);
    let patterns = finalists.iter().map(DesignCandidate::pattern);
    let patterns = patterns.collect::<Result<Vec<_>>>()?;
    let racers = patterns.iter().map(|pattern| Racer {
        pattern,
        dot_diameter: conditions.dot_diameter,
    });
    let racers: Vec<Racer<'_>> = racers.collect();
    let race = RaceConfig::of_frames(request.frames);
    let results = race_patterns(&trials, &racers, &race, stop, done)?;
    let place = |r: &RaceResult| finalists[r.entry].clone();
    let ranked: Vec<DesignCandidate> = results.iter().map(place).collect();
    let ranks = ranked.iter().zip(&results).map(|(candidate, result)| {
        let rates = FrameRates::of(&result.outcomes, request.seed);
        CameraRank {
            start: candidate.start,
            right: rates.right,
            wrong: rates.wrong,
            mean_error_deg: rates.mean_error_deg,
            effective_error_deg: rates.effective_error_deg,
        }
    });
    let finalists_then = ranks.collect();
    finalists.clone_from_slice(&ranked);
    let is_measured = results.iter().all(|r| !r.outcomes.is_empty());
    Ok(is_measured.then(|| CameraRecord {
        request: request.clone(),
        finalists: finalists_then,
    }))
}
