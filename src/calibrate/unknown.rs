//! A pattern from a clip alone: structure from motion on the sphere.
//!
//! One frame's dots are the first map. The frames next to it are identified against the map (the robust
//! recognizer, with the neighbor's orientation as a hint), their new dots join it, and so on outwards
//! until no frame can be placed. The map and all orientations are fitted together again and again
//! ([`super::bundle`]); places that turn out the same when the ball comes around are merged, which closes
//! the loop; dots that are not found where they should be leave the map.
//!
//! # What is promised
//! A pattern only where most frames hang together and the clip shows the whole ball; else what is missing
//! ([`UnknownRejection`]). What is not: the pattern's own frame, which is that of the first map, and
//! marks that the detector takes for dots in most views are dots.

use nalgebra::Matrix2;

use super::bundle::{Bundle, BundleFrame, DotPrior, Observation};
use super::config::CalibrationConfig;
use crate::error::Result;
use crate::geometry::{Rotation, Vec3, angle_between, spiral_directions};
use crate::pattern::{MAX_DOTS, MIN_DOTS, Pattern};
use crate::recognize::robust::{Hint, RobustConfig, RobustRecognizer};
use crate::recognize::{DotUncertainty, Identification, ObservedDot, Outcome, Recognizer};
use crate::vision::FrameEstimate;
use crate::vision::camera::{BallView, Camera};
use crate::vision::estimator::{CameraModel, Outline};

/// Minimum confidence of the detections used.
const LIKELY: f64 = 0.5;
/// Minimum depth (z over the horizon) of a detection that may become a dot, and of one that is used.
const NEW_DEPTH: f64 = 0.35;
const MIN_DEPTH: f64 = 0.2;
/// Error of a direction beyond the detector's, radians: the camera's distance is not known yet.
const BASE_SIGMA_RAD: f64 = 0.02;
/// Minimum number of dots of a frame that begins a map.
const MIN_SEED: usize = 5;
/// Frames that may begin a map.
const SEEDS: usize = 6;
/// Minimum number of matches, and probability, of a frame that is placed.
const MIN_MATCHED: usize = 4;
const PLACED: f64 = 0.9;
/// Turn from a placed neighbor that a hint allows, radians.
const HINT_SIGMA_RAD: f64 = 0.25;
/// A detection this near to a dot of the map is that dot; no new dot begins nearer than the second.
const MATCH_RAD: f64 = 0.09;
const APART_RAD: f64 = 0.14;
/// Dots of the map this near, never seen together, are one.
const MERGE_RAD: f64 = 0.12;
/// Frames in which a dot must be found before it helps to place others.
const ESTABLISHED: usize = 3;
/// A frame that could not be placed is tried again when so many more are.
const TRY_AGAIN: usize = 8;
/// Placed frames between two fits.
const FIT_EVERY: usize = 12;
/// Rounds of fit, merging, pruning and placing at the end.
const FINAL_ROUNDS: usize = 4;
/// Minimum share of the views that face a dot in which it is found.
const MIN_RATE: f64 = 0.4;
/// Depth from which a view faces a place well.
const FACING: f64 = 0.35;
/// Share of the frames that must hang together.
const MIN_PLACED: f64 = 0.6;
/// Places at which the coverage is looked up, and the views that each must have.
const PLACES: usize = 400;
const MIN_VIEWS: usize = 3;
/// Share of the places that may lack views.
const MAX_BLIND: f64 = 0.02;
/// Error of a hand-drawn dot, per tangent axis, radians, and the share of a design's dots that must be
/// on the ball.
const DRAWN_SIGMA_RAD: f64 = 0.03;
const MIN_AGREEING: f64 = 0.8;
/// A visibility limit under which all dots are in sight.
const EVERYWHERE: f64 = -0.99;
/// Prior of a dot's place in a fit, radians: hardly any.
const FREE_SIGMA_RAD: f64 = 0.3;

/// Why no pattern can be built from a clip.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum UnknownRejection {
    /// Too few frames show a ball with dots.
    #[error(
        "too short a clip: {found} frames show {MIN_SEED} dots or more, needed are {needed} or more"
    )]
    TooFewFrames {
        /// Frames with so many dots.
        found: usize,
        /// Frames needed.
        needed: usize,
    },
    /// The frames do not hang together.
    #[error(
        "the frames do not hang together: {placed} of {frames} see the same dots (turn the ball more slowly, \
         at most 20 degrees from frame to frame, and film one ball only)"
    )]
    Disconnected {
        /// Frames of the largest part.
        placed: usize,
        /// Frames with dots.
        frames: usize,
    },
    /// A part of the ball was not shown.
    #[error(
        "too static a clip: {:.0} % of the ball never face the camera in {MIN_VIEWS} frames; turn it about \
         another axis as well", 100.0 * blind
    )]
    NotCovered {
        /// Share of the ball's surface.
        blind: f64,
    },
    /// Another number of dots than expected.
    #[error("expected {expected} dots, the clip shows {found}")]
    WrongNumber {
        /// Dots expected.
        expected: usize,
        /// Dots found.
        found: usize,
    },
    /// Too few or too many dots for a pattern.
    #[error("the clip shows {found} dots, a pattern has {MIN_DOTS} to {MAX_DOTS}")]
    NoPattern {
        /// Dots found.
        found: usize,
    },
}

/// A frame's usable detections.
#[derive(Debug, Clone)]
struct Seen {
    /// Its place in the clip.
    index: usize,
    outline: Outline,
    view: BallView,
    dots: Vec<SeenDot>,
}

#[derive(Debug, Clone, Copy)]
struct SeenDot {
    detection: usize,
    /// Camera frame.
    direction: Vec3,
    depth: f64,
    sigma_rad: f64,
}

/// A dot of the map.
#[derive(Debug, Clone, Copy)]
struct MapDot {
    direction: Vec3,
    found: usize,
}

/// A frame that is placed.
#[derive(Debug, Clone)]
struct Placed {
    /// Map to camera.
    rotation: Rotation,
    /// For each of its dots the map's, if any.
    names: Vec<Option<usize>>,
}

/// A map that grows from one frame.
struct Map<'a> {
    frames: &'a [Seen],
    estimates: &'a [FrameEstimate],
    config: &'a CalibrationConfig,
    dots: Vec<MapDot>,
    placed: Vec<Option<Placed>>,
    /// Number of placed frames when a frame could not be placed: it is tried again when there are more.
    tried: Vec<Option<usize>>,
}

/// Builds the pattern of the ball in a clip from its detections; the poses of the estimates do not matter.
/// `expected_dots` is the number of dots, where it is known.
///
/// # Errors
/// [`crate::Error::Argument`] for settings outside their domains.
pub fn build_pattern(
    estimates: &[FrameEstimate],
    expected_dots: Option<usize>,
    config: &CalibrationConfig,
) -> Result<std::result::Result<Pattern, UnknownRejection>> {
    config.check()?;
    let frames: Vec<Seen> = estimates
        .iter()
        .enumerate()
        .filter_map(|(k, estimate)| Seen::new(k, estimate, &config.estimator.camera))
        .collect();
    let rich: Vec<usize> = (0..frames.len())
        .filter(|&k| frames[k].dots.len() >= MIN_SEED)
        .collect();
    let (found, needed) = (rich.len(), 2 * config.min_frames);
    if found < needed {
        return Ok(Err(UnknownRejection::TooFewFrames { found, needed }));
    }
    let mut best: Option<Map> = None;
    for seed in seeds(&frames, &rich) {
        let mut map = Map::new(&frames, estimates, config, seed);
        map.grow()?;
        if best.as_ref().is_none_or(|b| map.count() > b.count()) {
            best = Some(map);
        }
        if best
            .as_ref()
            .is_some_and(|b| 10 * b.count() >= 9 * rich.len())
        {
            break;
        }
    }
    let Some(map) = best else {
        return Ok(Err(UnknownRejection::TooFewFrames { found, needed }));
    };
    Ok(map.finish(rich.len(), expected_dots))
}

/// Frames to begin with: rich in dots, spread over the clip.
fn seeds(frames: &[Seen], rich: &[usize]) -> Vec<usize> {
    let parts = rich.chunks(rich.len().div_ceil(SEEDS));
    let mut seeds: Vec<usize> = parts
        .filter_map(|part| part.iter().copied().max_by_key(|&k| frames[k].dots.len()))
        .collect();
    seeds.sort_by_key(|&k| std::cmp::Reverse(frames[k].dots.len()));
    seeds
}

impl Seen {
    fn new(index: usize, estimate: &FrameEstimate, camera: &CameraModel) -> Option<Self> {
        let outline = estimate.outline?;
        let camera = match *camera {
            CameraModel::Known(camera) => camera,
            CameraModel::Unknown(prior) => Camera::Near {
                inverse_distance: prior.inverse_distance,
            },
        };
        let view = BallView::new(&camera, outline.circle).ok()?;
        let likely = estimate.dots.iter().enumerate();
        let likely = likely.filter(|(_, dot)| dot.confidence >= LIKELY);
        let dots = likely.filter_map(|(detection, dot)| {
            let seen = view.back_project(dot.pixel, &dot.covariance)?;
            let depth = (seen.direction.z - view.horizon()) / (1.0 - view.horizon());
            let variance = match seen.uncertainty {
                DotUncertainty::Isotropic { sigma_rad } => sigma_rad * sigma_rad,
                DotUncertainty::Tangent { covariance } => 0.5 * covariance.trace(),
            };
            (depth >= MIN_DEPTH).then_some(SeenDot {
                detection,
                direction: view.to_camera() * seen.direction,
                depth,
                sigma_rad: (variance + BASE_SIGMA_RAD * BASE_SIGMA_RAD).sqrt(),
            })
        });
        Some(Self {
            index,
            outline,
            view,
            dots: dots.collect(),
        })
    }

    /// How far a direction of the camera's frame faces the camera.
    fn depth(&self, direction: &Vec3) -> f64 {
        let z = (self.view.to_camera().inverse() * direction).z;
        (z - self.view.horizon()) / (1.0 - self.view.horizon())
    }
}

impl<'a> Map<'a> {
    fn new(
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
    fn count(&self) -> usize {
        self.placed.iter().flatten().count()
    }

    fn grow(&mut self) -> Result<()> {
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
    fn established(&self) -> Vec<usize> {
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

    /// Fits the map and all placed frames together.
    fn fit(&mut self) {
        let priors = self.dots.iter().map(|d| DotPrior {
            direction: d.direction,
            sigma_rad: FREE_SIGMA_RAD,
            designed: true,
        });
        let mut which = Vec::new();
        let mut frames = Vec::new();
        for (k, placed) in self.placed.iter().enumerate() {
            let Some(placed) = placed else { continue };
            let seen = &self.frames[k];
            let dots = &self.estimates[seen.index].dots;
            let named = seen.dots.iter().zip(&placed.names);
            which.push(k);
            frames.push(BundleFrame {
                time_s: None,
                rotation: placed.rotation,
                circle: seen.outline.circle,
                outline: seen.outline,
                observations: named
                    .filter_map(|(dot, name)| {
                        Some(Observation {
                            dot: (*name)?,
                            pixel: dots[dot.detection].pixel,
                            covariance: with_floor(&dots[dot.detection].covariance),
                        })
                    })
                    .collect(),
            });
        }
        let mut bundle = Bundle::new(priors.collect(), frames, &self.config.estimator.camera);
        bundle.fit(false);
        for (dot, fitted) in self.dots.iter_mut().zip(&bundle.dots) {
            dot.direction = *fitted;
        }
        for (k, fitted) in which.into_iter().zip(&bundle.frames) {
            if let Some(placed) = &mut self.placed[k] {
                placed.rotation = fitted.rotation;
            }
        }
    }

    /// Merges dots that are one, names the placed frames' detections anew, drops dots that are not there.
    fn tidy(&mut self) {
        while let Some((a, b)) = self.twins() {
            let (keep, gone) = if self.dots[a].found >= self.dots[b].found {
                (a, b)
            } else {
                (b, a)
            };
            let (first, second) = (self.dots[keep], self.dots[gone]);
            let sum = first.direction * first.found as f64 + second.direction * second.found as f64;
            self.dots[keep] = MapDot {
                direction: sum.normalize(),
                found: first.found + second.found,
            };
            self.remove(gone, Some(keep));
        }
        self.rename();
        let weak: Vec<usize> = (0..self.dots.len()).filter(|&j| self.is_weak(j)).collect();
        for j in weak.into_iter().rev() {
            self.remove(j, None);
        }
    }

    /// Two dots near each other that no frame sees both.
    fn twins(&self) -> Option<(usize, usize)> {
        let together = |a: usize, b: usize| {
            let mut frames = self.placed.iter().flatten();
            frames.any(|p| p.names.contains(&Some(a)) && p.names.contains(&Some(b)))
        };
        for a in 0..self.dots.len() {
            for b in 0..a {
                let angle = angle_between(&self.dots[a].direction, &self.dots[b].direction);
                if angle < MERGE_RAD && !together(a, b) {
                    return Some((b, a));
                }
            }
        }
        None
    }

    /// Whether a dot is found too seldom in the frames that face it.
    fn is_weak(&self, j: usize) -> bool {
        let direction = self.dots[j].direction;
        let (mut views, mut found) = (0usize, 0usize);
        for (frame, placed) in self.frames.iter().zip(&self.placed) {
            let Some(placed) = placed else { continue };
            if frame.depth(&(placed.rotation * direction)) >= FACING {
                views += 1;
                found += usize::from(placed.names.contains(&Some(j)));
            }
        }
        views >= ESTABLISHED && (found as f64) < MIN_RATE * views as f64
    }

    fn remove(&mut self, gone: usize, instead: Option<usize>) {
        self.dots.remove(gone);
        let moved = |j: usize| j - usize::from(j > gone);
        for name in self.placed.iter_mut().flatten().flat_map(|p| &mut p.names) {
            *name = match *name {
                Some(j) if j == gone => instead.map(moved),
                other => other.map(moved),
            };
        }
    }

    /// Names the placed frames' detections by the nearest dot of the map, each dot once a frame.
    fn rename(&mut self) {
        for dot in &mut self.dots {
            dot.found = 0;
        }
        for k in 0..self.placed.len() {
            let Some(mut placed) = self.placed[k].take() else {
                continue;
            };
            let back = placed.rotation.inverse();
            let mut links: Vec<(f64, usize, usize)> = Vec::new();
            for (i, dot) in self.frames[k].dots.iter().enumerate() {
                let at = back * dot.direction;
                let near = self.dots.iter().enumerate();
                let near = near.map(|(j, d)| (angle_between(&d.direction, &at), i, j));
                links.extend(near.filter(|l| l.0 < MATCH_RAD));
            }
            links.sort_by(|a, b| a.0.total_cmp(&b.0));
            placed.names.fill(None);
            for (_, i, j) in links {
                if placed.names[i].is_none() && !placed.names.contains(&Some(j)) {
                    placed.names[i] = Some(j);
                    self.dots[j].found += 1;
                }
            }
            self.placed[k] = Some(placed);
        }
    }

    /// The pattern, or what is missing for one.
    fn finish(
        self,
        rich: usize,
        expected: Option<usize>,
    ) -> std::result::Result<Pattern, UnknownRejection> {
        let placed = self.count();
        if (placed as f64) < MIN_PLACED * rich as f64 || placed < self.config.min_frames {
            return Err(UnknownRejection::Disconnected {
                placed,
                frames: rich,
            });
        }
        let blind = self.blind();
        if blind > MAX_BLIND {
            return Err(UnknownRejection::NotCovered { blind });
        }
        let names = self.established();
        let found = names.len();
        if let Some(expected) = expected.filter(|n| *n != found) {
            return Err(UnknownRejection::WrongNumber { expected, found });
        }
        let directions = names.iter().map(|&j| self.dots[j].direction).collect();
        Pattern::new(directions).map_err(|_| UnknownRejection::NoPattern { found })
    }

    /// Share of the ball's surface that hardly any placed frame shows.
    fn blind(&self) -> f64 {
        let faced = |place: &Vec3| {
            let frames = self.frames.iter().zip(&self.placed);
            let views = frames.filter(|(frame, placed)| {
                placed
                    .as_ref()
                    .is_some_and(|p| frame.depth(&(p.rotation * place)) >= FACING)
            });
            views.take(MIN_VIEWS).count() == MIN_VIEWS
        };
        let blind = spiral_directions(PLACES)
            .filter(|place| !faced(place))
            .count();
        blind as f64 / PLACES as f64
    }
}

/// Which of these designs a built pattern is: its position, where all but a few of the dots of both agree.
///
/// # Errors
/// As [`RobustRecognizer::new`].
pub fn matching_design(built: &Pattern, designs: &[Pattern]) -> Result<Option<usize>> {
    let observed: Vec<ObservedDot> = built
        .dots()
        .iter()
        .map(|direction| ObservedDot {
            direction: *direction,
            uncertainty: DotUncertainty::Isotropic {
                sigma_rad: DRAWN_SIGMA_RAD,
            },
        })
        .collect();
    let config = RobustConfig {
        // The pattern is known from all sides.
        visibility_limit: EVERYWHERE,
        ..RobustConfig::default()
    };
    let mut best = (0, None);
    for (k, design) in designs.iter().enumerate() {
        let recognizer = RobustRecognizer::new(design, config)?;
        let Outcome::Identified(found) =
            recognizer.identify(&observed, &mut recognizer.workspace())
        else {
            continue;
        };
        let larger = design.len().max(built.len());
        let agrees = found.pose_confidence >= PLACED
            && found.matched() as f64 >= MIN_AGREEING * larger as f64;
        if agrees && found.matched() > best.0 {
            best = (found.matched(), Some(k));
        }
    }
    Ok(best.1)
}

fn is_sure(found: &Identification) -> bool {
    found.matched() >= MIN_MATCHED && found.pose_confidence >= PLACED
}

/// A detection of a map that is not settled is less certain than the detector says.
fn with_floor(covariance: &Matrix2<f64>) -> Matrix2<f64> {
    covariance * 2.0
}
