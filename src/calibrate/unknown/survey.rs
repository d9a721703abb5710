//! How much of a ball a clip shows, and where what it lacks lies.

use super::candidates::MarkCandidate;
use super::map::DotMap;
use super::{BuiltPattern, MarkEvidence, MarkKind, UnknownRejection};
use crate::geometry::{Vec3, angle_between};
use crate::pattern::Pattern;
use crate::surface::{Darkness, SurfacePlace};

/// Of the places that no view shows, one in so many is tried for the middle of the largest hole.
const TRIED: usize = 16;
/// Radius of a hole, radians.
const HOLE: f64 = 0.4;
/// What is turned away so far, as the cosine of its angle to the camera, is behind the ball; what is turned to it so far, visible.
const BEHIND: f64 = -0.75;
const VISIBLE: f64 = 0.2;

/// A mark that is less likely a dot is not shown to a person: of 1 483 marks that are none 39 % have more, and all dots do.
const WORTH_A_LOOK: f64 = 0.001;

/// A fit moves no dot so far, radians; marks are farther apart.
const SAME_DOT: f64 = 0.05;

/// What a clip shows of a ball without a table.
#[derive(Debug, Clone, PartialEq)]
pub struct Survey {
    /// Frames looked at.
    pub frames: usize,
    /// The frames that are placed, by their places among the estimates, ascending.
    pub placed: Vec<usize>,
    /// Dots found so far.
    pub dots: usize,
    /// Share of the ball's surface that the frames show.
    pub shown: f64,
    /// Where what the frames lack lies.
    pub missing: Option<MissingSide>,
    /// The ball's surface with its marks, where the frames hang together and show what a dot looks like.
    pub surface: Option<MarkedSurface>,
    /// The dots that are likely by these frames, whatever is known of their number: by them frames can be identified, and seen better
    /// for a second survey. `None` where the frames do not make a pattern.
    pub likely: Option<Pattern>,
    /// The pattern, or why there is none yet.
    pub pattern: std::result::Result<BuiltPattern, UnknownRejection>,
}

impl Survey {
    /// What the number of a ball's dots has decided of the marks in doubt, where that has given a pattern.
    pub fn decided(&self) -> DecidedMarks {
        let Ok(built) = &self.pattern else {
            return DecidedMarks::default();
        };
        let marks = self.surface.iter().flat_map(|s| &s.marks);
        let in_doubt =
            marks.filter(|mark| matches!(mark.kind, MarkKind::Doubtful | MarkKind::TurnedAway));
        let is_dot = |mark: &SurfaceMark| {
            let dots = built.pattern.dots().iter();
            dots.map(|dot| angle_between(dot, &mark.direction))
                .any(|off| off < SAME_DOT)
        };
        let (dots, others): (Vec<&SurfaceMark>, Vec<_>) = in_doubt.partition(|m| is_dot(m));
        DecidedMarks {
            dots: dots.len(),
            others: others.len(),
        }
    }

    /// Where nothing can be said of the ball's surface.
    pub(super) fn rejected(frames: usize, rejection: UnknownRejection) -> Self {
        Self {
            frames,
            placed: Vec::new(),
            dots: 0,
            shown: 0.0,
            missing: None,
            surface: None,
            likely: None,
            pattern: Err(rejection),
        }
    }
}

/// Marks in doubt that the number of dots has decided.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct DecidedMarks {
    /// Those that are dots.
    pub dots: usize,
    /// Those that are none.
    pub others: usize,
}

/// A ball's surface as a clip shows it, in a frame of its own.
#[derive(Debug, Clone, PartialEq)]
pub struct MarkedSurface {
    /// Spread evenly.
    pub places: Vec<SurfacePlace>,
    /// All marks: those that are dots or may be, the likeliest first, and then the others.
    pub marks: Vec<SurfaceMark>,
}

/// A mark of a ball's surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfaceMark {
    /// Where it is.
    pub direction: Vec3,
    /// Its angular radius, radians.
    pub radius_rad: f64,
    /// What it is taken for.
    pub kind: MarkKind,
    /// What speaks for a dot; `None` where nothing but the detector sees it.
    pub evidence: Option<MarkEvidence>,
}

impl MarkedSurface {
    /// The marks that may be dots to a person who looks at the surface; their order numbers them.
    pub fn worth_a_look(&self) -> impl Iterator<Item = &SurfaceMark> {
        self.marks.iter().filter(|mark| {
            let probability = mark.evidence.map(|e| e.probability());
            probability.is_none_or(|p| p >= WORTH_A_LOOK)
        })
    }

    pub(super) fn new(surface: &Darkness, marks: &[MarkCandidate]) -> Self {
        let mark = |c: &MarkCandidate| SurfaceMark {
            direction: c.dot.direction,
            radius_rad: c.radius,
            kind: c.kind,
            evidence: c.evidence,
        };
        Self {
            places: surface.places.clone(),
            marks: marks.iter().map(mark).collect(),
        }
    }
}

/// A side of the ball that frames do not show well enough.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MissingSide {
    /// The frame that comes nearest to showing it, by its place among the estimates.
    pub nearest: usize,
    /// Where it lies there.
    pub there: Side,
    /// The last frame that is placed, and where it lies there.
    pub last: usize,
    /// Where it lies in the last frame.
    pub now: Side,
}

impl MissingSide {
    /// By the frames in order, and where the side lies in the view frame of each.
    pub(super) fn of(seen: impl Iterator<Item = (usize, Vec3)>) -> Option<Self> {
        let seen: Vec<(usize, Vec3)> = seen.collect();
        let nearest = seen.iter().max_by(|a, b| a.1.z.total_cmp(&b.1.z))?;
        let last = seen.last()?;
        Some(Self {
            nearest: nearest.0,
            there: Side::of(&nearest.1),
            last: last.0,
            now: Side::of(&last.1),
        })
    }
}

/// Where a place lies that frames do not show well enough, seen from the camera.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// Beyond the left edge of the ball.
    Left,
    /// Beyond its right edge.
    Right,
    /// Beyond its upper edge.
    Top,
    /// Beyond its lower edge.
    Bottom,
    /// On the far side.
    Behind,
    /// It faces the camera: something covers it, or it was there too briefly.
    Visible,
}

impl Side {
    /// Of a direction in the view frame.
    fn of(direction: &Vec3) -> Self {
        match direction {
            d if d.z > VISIBLE => Self::Visible,
            d if d.z < BEHIND => Self::Behind,
            d if d.x.abs() >= d.y.abs() && d.x < 0.0 => Self::Left,
            d if d.x.abs() >= d.y.abs() => Self::Right,
            d if d.y > 0.0 => Self::Top,
            _ => Self::Bottom,
        }
    }

    /// In a sentence: where it is.
    pub fn words(self) -> &'static str {
        match self {
            Self::Left => "beyond the left edge of the ball",
            Self::Right => "beyond the right edge of the ball",
            Self::Top => "beyond the upper edge of the ball",
            Self::Bottom => "beyond the lower edge of the ball",
            Self::Behind => "on the far side of the ball",
            Self::Visible => "visible, but covered or shown too briefly",
        }
    }
}

impl DotMap<'_> {
    /// Where what is missing lies in the frames: what a rejection names, else the middle of the largest hole.
    pub(super) fn missing(&self, surface: &Darkness) -> Option<MissingSide> {
        let lacking = self.lacking.or_else(|| largest_hole(surface))?;
        let placed = self.frames.iter().zip(&self.placed);
        MissingSide::of(placed.filter_map(|(seen, placed)| {
            let direction = seen.to_view() * placed.as_ref()?.rotation * lacking;
            Some((seen.index, direction))
        }))
    }
}

/// The middle of the largest part of the surface that no view shows.
fn largest_hole(surface: &Darkness) -> Option<Vec3> {
    let unseen: Vec<Vec3> = surface
        .places
        .iter()
        .filter(|p| !p.is_shown())
        .map(|p| p.direction)
        .collect();
    let about = |middle: &Vec3| {
        let near = unseen.iter().filter(|p| angle_between(p, middle) < HOLE);
        near.fold((0usize, Vec3::zeros()), |(n, sum), p| (n + 1, sum + p))
    };
    let tried = unseen.iter().step_by(unseen.len().div_ceil(TRIED).max(1));
    let (_, sum) = tried.map(about).max_by_key(|hole| hole.0)?;
    Some(sum.normalize())
}
