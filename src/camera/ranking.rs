//! Ranking the finalists of a search by a race on rendered frames of a camera, of a seed that nothing else
//! uses.

use super::race_patterns;
use super::{CameraConditions, CameraTrials, FrameRates, RaceConfig, RaceResult, Racer};
use crate::design::{CameraRank, CameraRecord, CameraRequest, Candidate};
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

/// Puts the finalists in order; their rates.
///
/// # Errors
/// As [`requested_conditions`].
pub fn rank_finalists(
    request: &CameraRequest,
    finalists: &mut [Candidate],
) -> Result<CameraRecord> {
    let conditions = requested_conditions(request)?;
    let trials = CameraTrials::new(conditions, request.seed);
    let patterns = finalists.iter().map(Candidate::pattern);
    let patterns = patterns.collect::<Result<Vec<_>>>()?;
    let racers = patterns.iter().map(|pattern| Racer {
        pattern,
        dot_diameter: conditions.dot_diameter,
    });
    let racers: Vec<Racer<'_>> = racers.collect();
    let race = RaceConfig::of_frames(request.frames);
    let standings = race_patterns(&trials, &racers, &race, &|_| ())?;
    let place = |s: &RaceResult| finalists[s.entry].clone();
    let ranked: Vec<Candidate> = standings.iter().map(place).collect();
    let ranks = ranked.iter().zip(&standings).map(|(candidate, standing)| {
        let rates = FrameRates::of(&standing.outcomes, request.seed);
        CameraRank {
            start: candidate.start,
            right: rates.right,
            wrong: rates.wrong,
            mean_error_deg: rates.mean_error_deg,
            effective_error_deg: rates.effective_error_deg,
        }
    });
    let ranks = ranks.collect();
    finalists.clone_from_slice(&ranked);
    Ok(CameraRecord {
        request: request.clone(),
        finalists: ranks,
    })
}
