//! Whether a map is a pattern: most frames hang together, and they show the whole ball.

use super::candidates::Candidates;
use super::choice::KnownDots;
use super::map::{DotMap, NEW_DEPTH};
use super::{BuiltPattern, UnknownRejection};
use crate::pattern::Pattern;
use crate::surface::Darkness;
use crate::surface::PaintedFrame;

/// Depth from which a view faces a place well enough for a dot there to be taken in.
pub(super) const FACING: f64 = NEW_DEPTH;
/// Share of the frames that must hang together.
const MIN_PLACED: f64 = 0.6;
/// Share of the detections in these frames that must be the map's: in a map torn in two half of them are not, on 80
/// rendered balls at least 94 % were.
const MIN_EXPLAINED: f64 = 0.8;
/// A dot shows where a view shows the surface so near its middle, radii.
const SHOWS: f64 = 0.7;
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
}
