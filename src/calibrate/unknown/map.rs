//! The map of the dots: begun by one frame, and grown by its neighbors outwards.

use super::seen::{MIN_DEPTH, SeenDot, UsableFrame};
use super::{ESTABLISHED, PLACED};
use crate::calibrate::config::CalibrationConfig;
use crate::error::Result;
use crate::geometry::{Rotation, Vec3, angle_between};
use crate::pattern::{MAX_DOTS, Pattern};
use crate::recognize::robust::{RobustConfig, RobustRecognizer};
use crate::recognize::{Hint, Identification, Recognizer};
use crate::view::{DotUncertainty, FalseDots, ObservedDot, ViewModel};
use crate::vision::FrameEstimate;

/// Minimum depth (z over the horizon) of a detection that may become a dot.
pub(super) const NEW_DEPTH: f64 = 0.25;
/// Minimum number of matches of a frame that is placed.
const MIN_MATCHED: usize = 4;
/// The same where two neighbors in a row say how the ball turns.
const MIN_MATCHED_AHEAD: usize = 2;
/// Turn from a placed neighbor that a hint allows, radians; and from where the turn goes on, once it is known
/// how evenly the ball turns and before.
const HINT_SIGMA_RAD: f64 = 0.25;
const AHEAD_SIGMAS_RAD: [f64; 2] = [0.02, 0.1];
/// Number of turns from which it is known how even they are.
const MIN_TURNS: usize = 8;
/// Minimum probability of a frame that no neighbor helps to place: a map that lacks dots takes chance for
/// certainty.
const PLACED_ALONE: f64 = 0.999;
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
    /// Number of views in which it was found.
    pub found: usize,
    /// What these views say of its place until the next fit: the sum of their squared depths, since an error
    /// of the outline or of the camera's distance moves what is near the limb most.
    pub weight: f64,
}

impl MapDot {
    fn first(seen: &SeenDot, at: Vec3) -> Self {
        Self {
            direction: at,
            found: 1,
            weight: seen.depth * seen.depth,
        }
    }

    /// Takes another sighting into the mean.
    fn add(&mut self, seen: &SeenDot, at: &Vec3) {
        let weight = seen.depth * seen.depth;
        self.direction = (self.direction * self.weight + at * weight).normalize();
        self.weight += weight;
        self.found += 1;
    }
}

/// A frame that is placed.
#[derive(Debug, Clone)]
pub(super) struct Placed {
    /// DotMap to camera.
    pub rotation: Rotation,
    /// For each of its dots the map's, if any.
    pub names: Vec<Option<usize>>,
}

/// A map that grows from one frame.
pub(super) struct DotMap<'a> {
    /// As the last fit sees them.
    pub frames: Vec<UsableFrame>,
    pub estimates: &'a [FrameEstimate],
    pub config: &'a CalibrationConfig,
    pub dots: Vec<MapDot>,
    pub placed: Vec<Option<Placed>>,
    /// Number of placed frames when a frame could not be placed: it is tried again when there are more.
    tried: Vec<Option<usize>>,
    /// See [`DotMap::learn_turns`].
    ahead_sigma_rad: f64,
    /// Where something is that the clip does not show well enough.
    pub lacking: Option<Vec3>,
}

impl<'a> DotMap<'a> {
    pub fn new(
        frames: &[UsableFrame],
        estimates: &'a [FrameEstimate],
        config: &'a CalibrationConfig,
        seed: usize,
    ) -> Self {
        let dots = &frames[seed].dots;
        let mut begun: Vec<Option<usize>> = vec![None; dots.len()];
        for (name, (i, _)) in frames[seed].likely().enumerate() {
            begun[i] = Some(name);
        }
        let mut placed = vec![None; frames.len()];
        placed[seed] = Some(Placed {
            rotation: Rotation::identity(),
            names: begun.clone(),
        });
        let begin = |d: &SeenDot| MapDot {
            // What the first frame shows must serve until others are placed.
            found: ESTABLISHED,
            ..MapDot::first(d, d.direction)
        };
        Self {
            frames: frames.to_vec(),
            estimates,
            config,
            dots: frames[seed].likely().map(|(_, d)| begin(d)).collect(),
            placed,
            tried: vec![None; frames.len()],
            ahead_sigma_rad: AHEAD_SIGMAS_RAD[1],
            lacking: None,
        }
    }

    /// The placed frames, by their places among the estimates.
    pub fn placed_frames(&self) -> Vec<usize> {
        let frames = self.frames.iter().zip(&self.placed);
        let placed = frames.filter(|(_, placed)| placed.is_some());
        placed.map(|(frame, _)| frame.index).collect()
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
                self.learn_turns();
            }
        }
        for _ in 0..FINAL_ROUNDS {
            self.fit();
            self.tidy();
            let Some(recognizer) = self.recognizer()? else {
                return Ok(());
            };
            self.place_all(&recognizer);
            self.discover();
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

    /// The pattern of the established dots; `None` where they make none.
    pub fn pattern(&self) -> Option<Pattern> {
        let directions = self.established().into_iter();
        Pattern::new(directions.map(|j| self.dots[j].direction).collect()).ok()
    }

    /// The recognizer of the established dots; `None` where they are too few.
    fn recognizer(&self) -> Result<Option<(RobustRecognizer, Vec<usize>)>> {
        let Some(pattern) = self.pattern() else {
            return Ok(None);
        };
        let names = self.established();
        let estimator = self.config.estimator.recognizer;
        let view = ViewModel {
            visibility_limit: MIN_DEPTH,
            // Dots that come into view are not in the map yet.
            false_dots: FalseDots::Poisson(2.0),
            false_dot_limit: MIN_DEPTH,
            ..estimator.view
        };
        let config = RobustConfig { view, ..estimator };
        Ok(Some((RobustRecognizer::new(&pattern, config)?, names)))
    }

    /// The frame nearest to a placed one that can be placed.
    fn place_next(
        &mut self,
        recognizer: &(RobustRecognizer, Vec<usize>),
    ) -> Option<(usize, Placed)> {
        let count = self.count();
        let gaps = gaps(&self.placed);
        let is_due = |k: &usize| self.tried[*k].is_none_or(|then| count >= then + TRY_AGAIN);
        let open = (0..self.frames.len()).filter(|k| self.placed[*k].is_none());
        let mut open: Vec<usize> = open.filter(is_due).collect();
        open.sort_by_key(|k| gaps[*k]);
        for k in open {
            if let Some(found) = self.place(k, recognizer) {
                return Some((k, found));
            }
            self.tried[k] = Some(count);
        }
        None
    }

    /// Identifies every frame anew.
    fn place_all(&mut self, recognizer: &(RobustRecognizer, Vec<usize>)) {
        for k in 0..self.frames.len() {
            self.placed[k] = self.place(k, recognizer);
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
            .likely()
            .map(|(_, d)| ObservedDot {
                direction: d.direction,
                uncertainty: DotUncertainty::Isotropic {
                    sigma_rad: d.sigma_rad,
                },
            })
            .collect();
        let mut workspace = recognizer.workspace();
        let placed = |found: &Identification| {
            let mut named = vec![None; frame.dots.len()];
            for ((i, _), name) in frame.likely().zip(&found.assignment) {
                named[i] = name.map(|j| names[usize::from(j)]);
            }
            Placed {
                rotation: found.rotation,
                names: named,
            }
        };
        for (hint, least) in self.hints(k) {
            if let Ok(explanations) = recognizer.explain(&observed, Some(&hint), &mut workspace) {
                let found = explanations.best();
                if found.matched() >= least && found.confidence >= PLACED {
                    return Some(placed(found));
                }
            }
        }
        let alone = recognizer.explain(&observed, None, &mut workspace).ok()?;
        let found = alone.best();
        let sure = found.matched() > MIN_MATCHED && found.confidence >= PLACED_ALONE;
        sure.then(|| placed(found))
    }

    /// What the placed neighbors say of a frame's orientation, and the number of matches that it then needs:
    /// where two in a row are placed the turn goes on, else it is somewhere near.
    fn hints(&self, k: usize) -> Vec<(Hint, usize)> {
        let rotation = |k: Option<usize>| Some(self.placed.get(k?)?.as_ref()?.rotation);
        let sides = [
            [k.checked_sub(1), k.checked_sub(2)],
            [Some(k + 1), Some(k + 2)],
        ];
        let ahead = sides.iter().filter_map(|[one, two]| {
            let (one, two) = (rotation(*one)?, rotation(*two)?);
            let hint = Hint::isotropic(one * two.inverse() * one, self.ahead_sigma_rad);
            Some((hint, MIN_MATCHED_AHEAD))
        });
        let beside = sides.iter().filter_map(|[one, _]| {
            Some((
                Hint::isotropic(rotation(*one)?, HINT_SIGMA_RAD),
                MIN_MATCHED,
            ))
        });
        ahead.chain(beside).collect()
    }

    /// How well the turn between two frames predicts the next: what the placed frames show.
    fn learn_turns(&mut self) {
        let rotation = |k: usize| Some(self.placed[k].as_ref()?.rotation);
        let mut errors: Vec<f64> = (2..self.placed.len())
            .filter_map(|k| {
                let [two, one, now] = [rotation(k - 2)?, rotation(k - 1)?, rotation(k)?];
                Some((one * two.inverse() * one).angle_to(&now))
            })
            .collect();
        if errors.len() < MIN_TURNS {
            return;
        }
        errors.sort_unstable_by(f64::total_cmp);
        let often = errors[errors.len() * 9 / 10];
        self.ahead_sigma_rad = often.clamp(AHEAD_SIGMAS_RAD[0], AHEAD_SIGMAS_RAD[1]);
    }

    /// Takes a placed frame in, with its new dots.
    fn adopt(&mut self, (k, mut placed): (usize, Placed)) {
        let back = placed.rotation.inverse();
        for (dot, name) in self.frames[k].dots.iter().zip(&mut placed.names) {
            let at = back * dot.direction;
            let nearest = self.nearest(&at, APART_RAD);
            if name.is_none() {
                *name = nearest.filter(|&j| {
                    let known = &self.dots[j];
                    // What was seen once or twice came in at the limb: its place is rough.
                    known.found < ESTABLISHED || angle_between(&known.direction, &at) < MATCH_RAD
                });
            }
            if let Some(j) = *name {
                self.dots[j].add(dot, &at);
            } else if dot.is_likely && dot.depth >= NEW_DEPTH && nearest.is_none() {
                *name = Some(self.dots.len());
                self.dots.push(MapDot::first(dot, at));
            }
        }
        self.placed[k] = Some(placed);
    }

    /// Takes in what the placed frames show over and over where the map has no dot: dots that left it while
    /// it was not settled, and dots that only the limb shows.
    fn discover(&mut self) {
        let known = self.dots.len();
        for (frame, placed) in self.frames.iter().zip(&self.placed) {
            let Some(placed) = placed else { continue };
            let back = placed.rotation.inverse();
            for (dot, name) in frame.dots.iter().zip(&placed.names) {
                let at = back * dot.direction;
                if name.is_some() || !dot.is_likely {
                    continue;
                }
                match self.nearest(&at, APART_RAD) {
                    Some(j) if j < known => {}
                    Some(j) => self.dots[j].add(dot, &at),
                    None => self.dots.push(MapDot::first(dot, at)),
                }
            }
        }
        let mut k = 0;
        self.dots.retain(|dot| {
            k += 1;
            k <= known || dot.found >= ESTABLISHED
        });
        self.rename();
    }

    fn nearest(&self, at: &Vec3, within: f64) -> Option<usize> {
        let angles = self.dots.iter().map(|d| angle_between(&d.direction, at));
        let nearest = angles.enumerate().min_by(|a, b| a.1.total_cmp(&b.1))?;
        (nearest.1 < within).then_some(nearest.0)
    }
}

/// How many frames each is away from the nearest placed one.
fn gaps(placed: &[Option<Placed>]) -> Vec<usize> {
    let mut gaps = vec![usize::MAX; placed.len()];
    let mut sweep = |frames: &mut dyn Iterator<Item = usize>| {
        let mut gap = usize::MAX;
        for k in frames {
            gap = match placed[k] {
                Some(_) => 0,
                None => gap.saturating_add(1),
            };
            gaps[k] = gaps[k].min(gap);
        }
    };
    sweep(&mut (0..placed.len()));
    sweep(&mut (0..placed.len()).rev());
    gaps
}
