//! A pattern from a clip alone: structure from motion on the sphere.
//!
//! One frame's dots are the first map. The frames next to it are identified against the map (the robust
//! recognizer, with the neighbor's orientation as a hint), their new dots join it, and so on outwards
//! until no frame can be placed. The map and all orientations are fitted together again and again
//! ([`super::bundle`]); places that turn out the same when the ball comes around are merged, which closes
//! the loop; dots that are not found where they should be leave the map.
//!
//! A clip is looked at twice: fingers and shade draw outlines, too, and only known dots show which is the ball's. So the frames are found
//! with the dots that are likely by the first survey ([`Survey::likely`]), and surveyed again.
//!
//! What is a dot is decided on the ball's whole surface as all frames show it ([`Darkness`], [`marks`], [`kinds`]).
//!
//! # What is promised
//! A pattern only where most frames hang together, the clip shows the whole ball, and surface and detector agree on what is a dot or a person says
//! which marks are dots; else
//! what is missing ([`UnknownRejection`]). What is not: the pattern's own frame, which is that of the first map. How often it is wrong
//! all the same is measured (`bench calibration-unknown`).

mod candidates;
mod choice;
mod confirm;
mod contrast;
mod count;
mod coverage;
mod design;
mod evidence;
mod kinds;
mod map;
mod marks;
mod parts;
mod seen;
mod survey;
mod tidy;

use super::config::CalibrationConfig;
use super::result::CalibrationRejection;
use crate::error::{Result, are, counted, require};
use crate::pattern::{MAX_DOTS, MIN_DOTS, Pattern};
use crate::stats::median;
use crate::surface::{Darkness, PaintedFrame};
use crate::vision::FrameEstimate;

use candidates::Candidates;
pub use candidates::Kind as MarkKind;
pub use choice::KnownDots;
pub use confirm::calibrate_built;
pub use design::matching_design;
pub use evidence::{MARK_FEATURES, MarkEvidence};

pub use crate::clip::painted::SurfaceObserver;
pub use crate::surface::SurfacePlace;
use map::DotMap;
use marks::{MiddleDisc, marks};
use seen::UsableFrame;
pub use survey::{DecidedMarks, MarkedSurface, MissingSide, Side, SurfaceMark, Survey};

/// What so many marks are.
fn a_dot(count: usize) -> &'static str {
    if count == 1 { "a dot" } else { "dots" }
}

/// So many marks, each of which is a dot or print that looks like one.
fn like_dots(count: usize) -> String {
    match count {
        1 => "1 mark that looks like a dot".to_owned(),
        _ => format!("{count} marks that look like dots"),
    }
}

/// Minimum number of dots of a frame that begins a map.
const MIN_SEED: usize = 5;
/// Frames that may begin a map.
const SEEDS: usize = 6;
/// Frames in which a dot must be found before it helps to place others.
const ESTABLISHED: usize = 3;
/// Minimum probability of a frame that is placed, and of a design that is the ball's.
const PLACED: f64 = 0.9;
/// What is darker than so much of the middle dot, all over a disc of so many of its radii, is no dot: hands draw none so large, and fingers are larger.
const COVER: [f64; 2] = [0.2, 1.7];
/// Views that each place of the ball must have.
const MIN_VIEWS: usize = ESTABLISHED;

/// A pattern built from a clip alone.
#[derive(Debug, Clone, PartialEq)]
pub struct BuiltPattern {
    /// The pattern, in a frame of its own, about as the detections show it: what is exact is its calibration ([`calibrate_built`]).
    pub pattern: Pattern,
    /// About the angular radii of its dots, radians.
    pub radii_rad: Vec<f64>,
    /// Share of the ball's surface that hardly any frame shows: a dot there is not in the pattern.
    pub blind: f64,
}

impl BuiltPattern {
    /// About the angular radius of its middle dot, radians.
    pub fn middle_radius_rad(&self) -> f64 {
        median(&mut self.radii_rad.clone())
    }
}

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
        "too static a clip: {:.1} % of the ball was hardly seen, or something covers it; turn it about another axis as \
         well, and move your fingers", 100.0 * blind
    )]
    NotCovered {
        /// Share of the ball's surface.
        blind: f64,
    },
    /// Marks that may be dots or print.
    #[error(
        "{} may be {} or print, beside {}: a person must say which are dots",
        counted(*doubtful, "mark"), a_dot(*doubtful), like_dots(*likely)
    )]
    Doubtful {
        /// Marks that look like dots.
        likely: usize,
        /// Marks that may be.
        doubtful: usize,
    },
    /// Print beside the dots.
    #[error(
        "there is print on the ball, beside {} and {doubtful} that may be dots: a person must say which are dots",
        like_dots(*likely)
    )]
    Printed {
        /// Marks that look like dots.
        likely: usize,
        /// Marks that may be.
        doubtful: usize,
    },
    /// Marks that hardly face the camera.
    #[error(
        "too static a clip: {} that may be {} never faced the camera; turn that side of the ball to it",
        counted(*dots, "mark"), a_dot(*dots)
    )]
    TurnedAway {
        /// Number of these marks.
        dots: usize,
    },
    /// Dots that were found and are not confirmed when the clip is estimated with them.
    #[error(
        "{dots} of {} {} seen too seldom, or not alike in all frames: turn every side of the ball to the camera, \
         for longer", counted(*found, "dot"), are(*dots)
    )]
    Unconfirmed {
        /// Number of these dots.
        dots: usize,
        /// Dots found.
        found: usize,
        /// Where the first of them lies.
        first: Option<MissingSide>,
    },
    /// Dots that the detector rarely finds.
    #[error(
        "{} {} too faint or too small to be found in most frames: draw the dots larger and darker",
        counted(*dots, "dot"), are(*dots)
    )]
    TooFaint {
        /// Number of these dots.
        dots: usize,
    },
    /// Frames that hang together contradict each other.
    #[error(
        "the frames contradict each other: {:.0} % of the dots that they show are where one ball has its dots \
         (film one ball only, and turn it more slowly)", 100.0 * explained
    )]
    Contradictory {
        /// Share of the detections that are dots of the map.
        explained: f64,
    },
    /// Nothing shows what a dot looks like.
    #[error(
        "too few dark discs are on the ball to learn what a dot looks like: draw the dots round, filled and alike"
    )]
    NoDots,
    /// The clip is not the ball that it has given.
    #[error(
        "the frames contradict each other: {identified} of {balls} frames with a ball are identified with the dots that \
         they gave (turn the ball more slowly, and film one ball only)"
    )]
    Unidentified {
        /// Frames identified beyond doubt.
        identified: usize,
        /// Frames with a ball.
        balls: usize,
    },
    /// The dots that a clip has given cannot be calibrated.
    #[error(transparent)]
    Uncalibrated(CalibrationRejection),
    /// Another number of dots than expected.
    #[error("expected {}, the clip shows {}", counted(*expected, "dot"), like_dots(*found))]
    WrongNumber {
        /// Dots expected.
        expected: usize,
        /// Marks that look like dots.
        found: usize,
    },
    /// Marks that are said to be dots and are none of this clip's.
    #[error(
        "{marks} of the marks that are said to be dots {} not on the ball of this clip", are(*marks)
    )]
    OtherMarks {
        /// Number of these marks.
        marks: usize,
    },
    /// Too few or too many dots for a pattern.
    #[error("the clip shows {}, a pattern has {MIN_DOTS} to {MAX_DOTS}", counted(*found, "dot"))]
    NoPattern {
        /// Dots found.
        found: usize,
    },
}

impl UnknownRejection {
    /// Whether a person who looks at the ball's surface can say more.
    pub fn is_of_marks(&self) -> bool {
        matches!(
            self,
            Self::Doubtful { .. }
                | Self::Printed { .. }
                | Self::WrongNumber { .. }
                | Self::OtherMarks { .. }
        )
    }

    /// Where the first of the dots lies that are not confirmed.
    pub fn side(&self) -> Option<&MissingSide> {
        match self {
            Self::Unconfirmed { first, .. } => first.as_ref(),
            _ => None,
        }
    }

    /// Whether a part of the ball is not shown well enough.
    fn is_of_coverage(&self) -> bool {
        matches!(self, Self::NotCovered { .. } | Self::TurnedAway { .. })
    }
}

/// What a clip shows of its ball, from its detections (the poses of the estimates do not matter) and what its frames show of the ball's surface,
/// one a frame: the pattern of its dots, or what it lacks.
///
/// # Errors
/// [`crate::Error::Argument`] for settings outside their domains, and another number of frames shown than estimated.
pub fn survey(
    estimates: &[FrameEstimate],
    shown: &[PaintedFrame],
    known: &KnownDots,
    config: &CalibrationConfig,
) -> Result<Survey> {
    config.check()?;
    require(
        shown.len() == estimates.len(),
        "shown",
        "as many as the estimates",
        shown.len(),
    )?;
    let (mut map, rich) = match grown(estimates, config)? {
        Ok(grown) => grown,
        Err(rejection) => return Ok(Survey::rejected(estimates.len(), rejection)),
    };
    let likely = map.pattern();
    if let Err(rejection) = map.connected(rich) {
        return Ok(Survey {
            placed: map.placed_frames(),
            likely,
            ..Survey::rejected(estimates.len(), rejection)
        });
    }
    let covered = Darkness::of(map.lay_out(shown))?;
    let Some(dot) = MiddleDisc::of(&marks(&covered)) else {
        return Ok(Survey {
            placed: map.placed_frames(),
            shown: covered.shown(),
            likely,
            ..Survey::rejected(estimates.len(), UnknownRejection::NoDots)
        });
    };
    let surface = covered.uncovered(COVER[0] * dot.darkness, COVER[1] * dot.radius)?;
    let candidates = map.judge(&surface, shown);
    let marked = candidates.as_ref().ok();
    let likely = marked.and_then(Candidates::likely).or(likely);
    let marked = marked.map(|c| MarkedSurface::new(&surface, &c.dots));
    let pattern = candidates.and_then(|c| map.finish(&c, &surface, known));
    Ok(Survey {
        frames: estimates.len(),
        placed: map.placed_frames(),
        dots: map.dots.len(),
        shown: surface.shown(),
        missing: match &pattern {
            Err(rejection) if rejection.is_of_coverage() => map.missing(&surface),
            _ => None,
        },
        surface: marked,
        likely,
        pattern,
    })
}

/// The map of most frames, and how many frames have the dots for one.
fn grown<'a>(
    estimates: &'a [FrameEstimate],
    config: &'a CalibrationConfig,
) -> Result<std::result::Result<(DotMap<'a>, usize), UnknownRejection>> {
    let frames: Vec<UsableFrame> = estimates
        .iter()
        .enumerate()
        .filter_map(|(k, estimate)| UsableFrame::new(k, estimate, &config.estimator.camera))
        .collect();
    let rich: Vec<usize> = (0..frames.len())
        .filter(|&k| frames[k].likely().count() >= MIN_SEED)
        .collect();
    let (found, needed) = (rich.len(), 2 * config.min_frames);
    if found < needed {
        return Ok(Err(UnknownRejection::TooFewFrames { found, needed }));
    }
    let mut best: Option<DotMap> = None;
    for seed in seeds(&frames, &rich) {
        let mut map = DotMap::new(&frames, estimates, config, seed);
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
    let too_few = UnknownRejection::TooFewFrames { found, needed };
    Ok(best.map(|map| (map, rich.len())).ok_or(too_few))
}

/// Frames to begin with: rich in dots, spread over the clip.
fn seeds(frames: &[UsableFrame], rich: &[usize]) -> Vec<usize> {
    let parts = rich.chunks(rich.len().div_ceil(SEEDS));
    let mut seeds: Vec<usize> = parts
        .filter_map(|part| {
            part.iter()
                .copied()
                .max_by_key(|&k| frames[k].likely().count())
        })
        .collect();
    seeds.sort_by_key(|&k| std::cmp::Reverse(frames[k].likely().count()));
    seeds
}
