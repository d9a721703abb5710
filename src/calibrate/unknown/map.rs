//! The map of the dots: begun by one frame, and grown by its neighbors outwards.

use super::seen::{MIN_DEPTH, Seen, SeenDot};
use super::{ESTABLISHED, PLACED};
use crate::calibrate::config::CalibrationConfig;
use crate::error::Result;
use crate::geometry::{Rotation, Vec3, angle_between};
use crate::pattern::{MAX_DOTS, Pattern};
use crate::recognize::robust::{Hint, RobustConfig, RobustRecognizer};
use crate::recognize::{DotUncertainty, Identification, ObservedDot, Outcome, Recognizer};
use crate::vision::FrameEstimate;

/// Minimum depth (z over the horizon) of a detection that may become a dot.
pub(super) const NEW_DEPTH: f64 = 0.25;
/// Minimum number of matches of a frame that is placed.
const MIN_MATCHED: usize = 4;
/// Turn from a placed neighbor that a hint allows, radians.
const HINT_SIGMA_RAD: f64 = 0.25;
/// A detection this near to a dot of the map is that dot; no new dot begins nearer than the second.
pub(super) const MATCH_RAD: f64 = 0.09;
const APART_RAD: f64 = 0.14;
/// A frame that could not be placed is tried again when so many more are.
const TRY_AGAIN: usize = 8;
/// Placed frames between two fits.
const FIT_EVERY: usize = 12;
/// Rounds of fit, merging, pruning and placing at the end.
const FINAL_ROUNDS: usize = 4;

/// A dot of the map.
#[derive(Debug, Clone, Copy)]
pub(super) struct MapDot {
    pub direction: Vec3,
    pub found: usize,
}

/// A frame that is placed.
#[derive(Debug, Clone)]
pub(super) struct Placed {
    /// Map to camera.
    pub rotation: Rotation,
    /// For each of its dots the map's, if any.
    pub names: Vec<Option<usize>>,
}

/// A map that grows from one frame.
pub(super) struct Map<'a> {
    pub frames: &'a [Seen],
    pub estimates: &'a [FrameEstimate],
    pub config: &'a CalibrationConfig,
    pub dots: Vec<MapDot>,
    pub placed: Vec<Option<Placed>>,
    /// Number of placed frames when a frame could not be placed: it is tried again when there are more.
    tried: Vec<Option<usize>>,
}

impl<'a> Map<'a> {
    pub fn new(
        frames: &'a [Seen],
        estimates: &'a [FrameEstimate],
        config: &'a CalibrationConfig,
        seed: usize,
    ) -> Self {
        let dots = &frames[seed].dots;
        let mut placed = vec![None; frames.len()];
        placed[seed] = Some(Placed {
            rotation: Rotation::identity(),
            names: (0..dots.len()).map(Some).collect(),
        });
        let begin = |d: &SeenDot| MapDot {
            direction: d.direction,
            // What the first frame shows must serve until others are placed.
            found: ESTABLISHED,
        };
        Self {
            frames,
            estimates,
            config,
            dots: dots.iter().map(begin).collect(),
            placed,
            tried: vec![None; frames.len()],
        }
    }

    /// Number of placed frames.
    pub fn count(&self) -> usize {
        self.placed.iter().flatten().count()
    }

    pub fn grow(&mut self) -> Result<()> {
        let mut since_fit = 0;
        while self.dots.len() <= MAX_DOTS {
            let Some(recognizer) = self.recognizer()? else {
                return Ok(());
            };
            let Some(next) = self.place_next(&recognizer) else {
                break;
            };
            self.adopt(next);
            since_fit += 1;
            if since_fit == FIT_EVERY {
                since_fit = 0;
                self.fit();
                self.tidy();
            }
        }
        for _ in 0..FINAL_ROUNDS {
            self.fit();
            self.tidy();
            let Some(recognizer) = self.recognizer()? else {
                return Ok(());
            };
            self.place_all(&recognizer);
        }
        self.fit();
        self.tidy();
        Ok(())
    }

    /// The dots that help to place frames.
    pub fn established(&self) -> Vec<usize> {
        let dots = self.dots.iter().enumerate();
        let established = dots.filter(|(_, d)| d.found >= ESTABLISHED);
        established.map(|(j, _)| j).take(MAX_DOTS).collect()
    }

    /// The recognizer of the established dots; `None` where they are too few.
    fn recognizer(&self) -> Result<Option<(RobustRecognizer, Vec<usize>)>> {
        let names = self.established();
        let directions = names.iter().map(|&j| self.dots[j].direction).collect();
        let Ok(pattern) = Pattern::new(directions) else {
            return Ok(None);
        };
        let config = RobustConfig {
            visibility_limit: MIN_DEPTH,
            // Dots that come into view are not in the map yet.
            expected_false_dots: 2.0,
            ..self.config.estimator.recognizer
        };
        Ok(Some((RobustRecognizer::new(&pattern, config)?, names)))
    }

    /// The frame nearest to a placed one that can be placed.
    fn place_next(
        &mut self,
        recognizer: &(RobustRecognizer, Vec<usize>),
    ) -> Option<(usize, Placed)> {
        let is_placed = |k: &usize| self.placed[*k].is_some();
        let (placed, mut open): (Vec<usize>, Vec<usize>) =
            (0..self.frames.len()).partition(is_placed);
        let gap = |k: &usize| placed.iter().map(|p| p.abs_diff(*k)).min();
        open.retain(|k| self.tried[*k].is_none_or(|then| placed.len() >= then + TRY_AGAIN));
        open.sort_by_key(gap);
        for k in open {
            if let Some(found) = self.place(k, recognizer) {
                return Some((k, found));
            }
            self.tried[k] = Some(placed.len());
        }
        None
    }

    /// Identifies every frame anew.
    fn place_all(&mut self, recognizer: &(RobustRecognizer, Vec<usize>)) {
        for k in 0..self.frames.len() {
            self.placed[k] = self.place(k, recognizer).or(self.placed[k].take());
        }
        self.rename();
    }

    /// Identifies a frame against the map: near the orientations of its neighbors, else anywhere.
    fn place(
        &self,
        k: usize,
        (recognizer, names): &(RobustRecognizer, Vec<usize>),
    ) -> Option<Placed> {
        let frame = &self.frames[k];
        let observed: Vec<ObservedDot> = frame
            .dots
            .iter()
            .map(|d| ObservedDot {
                direction: d.direction,
                uncertainty: DotUncertainty::Isotropic {
                    sigma_rad: d.sigma_rad,
                },
            })
            .collect();
        let mut workspace = recognizer.workspace();
        let mut found = Identification::default();
        let mut hinted = false;
        for neighbor in [k.checked_sub(1), Some(k + 1)].into_iter().flatten() {
            let Some(Some(beside)) = self.placed.get(neighbor) else {
                continue;
            };
            let hint = Hint::isotropic(beside.rotation, HINT_SIGMA_RAD);
            let done = recognizer.identify_hinted(&observed, &hint, &mut workspace, &mut found);
            hinted = done.is_ok() && is_sure(&found);
            if hinted {
                break;
            }
        }
        if !hinted {
            let Outcome::Identified(alone) = recognizer.identify(&observed, &mut workspace) else {
                return None;
            };
            found = alone;
        }
        is_sure(&found).then(|| Placed {
            rotation: found.rotation,
            names: found
                .assignment
                .iter()
                .map(|name| name.map(|j| names[usize::from(j)]))
                .collect(),
        })
    }

    /// Takes a placed frame in, with its new dots.
    fn adopt(&mut self, (k, mut placed): (usize, Placed)) {
        let back = placed.rotation.inverse();
        for (dot, name) in self.frames[k].dots.iter().zip(&mut placed.names) {
            let at = back * dot.direction;
            if name.is_none() {
                *name = self.nearest(&at, MATCH_RAD);
            }
            if let Some(j) = *name {
                let known = &mut self.dots[j];
                // A running mean, until the next fit.
                let weight = known.found as f64;
                known.direction = (known.direction * weight + at).normalize();
                known.found += 1;
            } else if dot.depth >= NEW_DEPTH && self.nearest(&at, APART_RAD).is_none() {
                *name = Some(self.dots.len());
                self.dots.push(MapDot {
                    direction: at,
                    found: 1,
                });
            }
        }
        self.placed[k] = Some(placed);
    }

    fn nearest(&self, at: &Vec3, within: f64) -> Option<usize> {
        let angles = self.dots.iter().map(|d| angle_between(&d.direction, at));
        let nearest = angles.enumerate().min_by(|a, b| a.1.total_cmp(&b.1))?;
        (nearest.1 < within).then_some(nearest.0)
    }
}

fn is_sure(found: &Identification) -> bool {
    found.matched() >= MIN_MATCHED && found.pose_confidence >= PLACED
}
