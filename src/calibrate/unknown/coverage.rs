//! Whether a map is a pattern: most frames hang together, and they show the whole ball.

use super::candidates::Candidates;
use super::choice::KnownDots;
use super::map::{DotMap, NEW_DEPTH};
use super::{BuiltPattern, MIN_VIEWS, UnknownRejection};
use crate::calibrate::bundle::Bundle;
use crate::calibrate::result::rms_sigma_rad;
use crate::geometry::{Vec3, spiral_directions};
use crate::pattern::{MIN_DOTS, Pattern};
use crate::surface::Darkness;
use crate::surface::PaintedFrame;

/// Depth from which a view faces a place well enough for a dot there to be taken in.
pub(super) const FACING: f64 = NEW_DEPTH;
/// Share of the frames that must hang together.
const MIN_PLACED: f64 = 0.6;
/// Share of the detections in these frames that must be the map's: in a map torn in two half of them are not, on 80
/// rendered balls at least 94 % were.
const MIN_EXPLAINED: f64 = 0.8;
/// Places at which the coverage is looked up.
const PLACES: usize = 400;
/// Share of the places that may lack views: of twenty dots six in ten hide none there. Where the number of
/// dots is known and found, none hides, and more may.
const MAX_BLIND: f64 = 0.03;
const MAX_BLIND_COUNTED: f64 = 0.15;
/// A dot shows where a view shows the surface so near its middle, radii.
const SHOWS: f64 = 0.7;
/// Largest standard deviation of a dot's place by the detections, radians. Dots that only the limb shows have more, and the outline's error shifts
/// them farther.
const MAX_SIGMA_RAD: f64 = 0.5 * std::f64::consts::PI / 180.0;

impl DotMap<'_> {
    /// Whether most frames hang together and agree with the map.
    ///
    /// # Errors
    /// What hinders that.
    pub fn connected(&self, rich: usize) -> std::result::Result<(), UnknownRejection> {
        let placed = self.count();
        if (placed as f64) < MIN_PLACED * rich as f64 || placed < self.config.min_frames {
            return Err(UnknownRejection::Disconnected {
                placed,
                frames: rich,
            });
        }
        let explained = self.explained();
        if explained < MIN_EXPLAINED {
            return Err(UnknownRejection::Contradictory { explained });
        }
        Ok(())
    }

    /// What may be a dot of the ball.
    ///
    /// # Errors
    /// Where too little shows what a dot looks like.
    pub fn judge(
        &self,
        surface: &Darkness,
        shown: &[PaintedFrame],
    ) -> std::result::Result<Candidates, UnknownRejection> {
        let (marks, radius) = self.marks(surface).ok_or(UnknownRejection::NoDots)?;
        let blind = surface.unseen(SHOWS * radius);
        let contrasts = self.contrasts(shown, surface, &marks);
        self.candidates((&marks, &contrasts), surface, blind)
    }

    /// The pattern of the dots among what may be some, or what is missing for one.
    pub fn finish(
        &mut self,
        candidates: &Candidates,
        surface: &Darkness,
        known: &KnownDots,
    ) -> std::result::Result<BuiltPattern, UnknownRejection> {
        let kept = candidates.dots(surface, known).map_err(|unclear| {
            self.lacking = unclear.lacking.or(self.lacking);
            unclear.rejection
        })?;
        self.keep(&kept);
        self.fit();
        let found = kept.len();
        let directions = self.dots.iter().map(|d| d.direction).collect();
        Ok(BuiltPattern {
            pattern: Pattern::new(directions).map_err(|_| UnknownRejection::NoPattern { found })?,
            radii_rad: kept.iter().map(|c| c.radius).collect(),
            blind: candidates.blind,
        })
    }

    /// The same where nothing is known of the surface.
    pub fn finish_by_detections(
        mut self,
        expected: Option<usize>,
    ) -> std::result::Result<BuiltPattern, UnknownRejection> {
        let fitted = self.fit();
        let blind = self.blind();
        let names = self.like_dots(&self.established(), expected);
        let found = names.len();
        let max_blind = match expected == Some(found) {
            true => MAX_BLIND_COUNTED,
            false => MAX_BLIND,
        };
        if blind > max_blind {
            return Err(UnknownRejection::NotCovered { blind });
        }
        if let Some(expected) = expected.filter(|n| *n != found) {
            return Err(UnknownRejection::WrongNumber { expected, found });
        }
        self.pattern_of(&names, &fitted, blind)
    }

    /// These dots as a pattern, where the detections fix the places of all.
    fn pattern_of(
        &self,
        names: &[usize],
        fitted: &Bundle,
        blind: f64,
    ) -> std::result::Result<BuiltPattern, UnknownRejection> {
        let found = names.len();
        if found < MIN_DOTS {
            return Err(UnknownRejection::NoPattern { found });
        }
        let fits = fitted
            .dot_fits()
            .ok_or(UnknownRejection::NotCovered { blind })?;
        let sigma = |j: &usize| rms_sigma_rad(&fits[*j].covariance);
        let rough = || names.iter().filter(|j| sigma(j) > MAX_SIGMA_RAD);
        if rough().next().is_some() {
            return Err(UnknownRejection::AtTheLimb {
                dots: rough().count(),
                sigma_rad: rough().map(sigma).fold(0.0, f64::max),
            });
        }
        let directions = names.iter().map(|&j| self.dots[j].direction).collect();
        let pattern =
            Pattern::new(directions).map_err(|_| UnknownRejection::NoPattern { found })?;
        Ok(BuiltPattern {
            pattern,
            radii_rad: Vec::new(),
            blind,
        })
    }

    /// Share of the detections that face the camera, of the placed frames, that are the map's dots.
    fn explained(&self) -> f64 {
        let (mut facing, mut named) = (0usize, 0usize);
        for (frame, placed) in self.frames.iter().zip(&self.placed) {
            let Some(placed) = placed else { continue };
            for (dot, name) in frame.dots.iter().zip(&placed.names) {
                if dot.is_likely && dot.depth >= FACING {
                    facing += 1;
                    named += usize::from(name.is_some());
                }
            }
        }
        named as f64 / facing.max(1) as f64
    }

    /// Share of the ball's surface that hardly any placed frame shows.
    fn blind(&self) -> f64 {
        let faced = |place: &Vec3| self.facing(place, FACING).take(MIN_VIEWS).count() == MIN_VIEWS;
        let blind = spiral_directions(PLACES)
            .filter(|place| !faced(place))
            .count();
        blind as f64 / PLACES as f64
    }
}
