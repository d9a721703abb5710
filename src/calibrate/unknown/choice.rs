//! Which of a ball's marks are taken for its dots, where that is clear.
//!
//! Nothing may be in doubt, and no dot may be hidden: the expected number of dots where no view shows the surface, or where fingers cover it in most views,
//! must be small. A number of dots that is known decides for the likeliest, where these stand out.

use super::UnknownRejection;
use super::kinds::Kind;
use super::map::MapDot;
use super::surface::Surface;
use crate::geometry::Vec3;

/// Largest expected number of dots where no view shows the surface.
const MAX_HIDDEN: f64 = 0.03;
/// What is so dark over the middle dot, all within so many radii of that, and lies farther from all dots than so many of their radii and so many
/// radians, is covered in all views but a few, by fingers or their shadows: a dot there does not show. The largest expected number of such dots. What is less
/// dark hides none: on 35 plain balls (`bench calibration-unknown`, seed 36100001) no dot was missed there.
const COVERED: f64 = 0.35;
const WHOLE: f64 = 0.7;
const BEYOND: [f64; 2] = [2.2, 0.04];
const MAX_COVERED: f64 = 0.15;
/// Where the number of dots is known, the last of them has this likeness at least, and so much more than the next candidate. Of 15 printed balls drawn by
/// the guide (`bench calibration-unknown --guided`, seeds 36100005 and 36100006) the likeliest were the dots on all six that this holds for; a gap of
/// 0.22 was between 18 dots and print.
const LIKELY: f64 = 0.5;
const CLEAR: f64 = 0.4;

/// What may be a dot.
#[derive(Debug, Clone, Copy)]
pub(super) struct Candidate {
    pub dot: MapDot,
    /// Its angular radius, radians.
    pub radius: f64,
    /// What the detector takes it for, over the middle dot; half of that for what is no disc.
    pub likeness: f64,
    pub kind: Kind,
}

/// What may be a dot on a ball.
#[derive(Debug)]
pub(super) struct Candidates {
    pub dots: Vec<Candidate>,
    /// Radius, radians, and darkness of the middle dot.
    pub radius: f64,
    pub darkness: f64,
    /// Whether there is print beside the dots.
    pub is_printed: bool,
}

/// Why the dots are not clear, and where something is that the clip does not show well enough.
#[derive(Debug)]
pub(super) struct Unclear {
    pub rejection: UnknownRejection,
    pub lacking: Option<Vec3>,
}

impl Unclear {
    fn about(rejection: UnknownRejection, lacking: Vec3) -> Self {
        Self {
            rejection,
            lacking: Some(lacking),
        }
    }
}

impl From<UnknownRejection> for Unclear {
    fn from(rejection: UnknownRejection) -> Self {
        Self {
            rejection,
            lacking: None,
        }
    }
}

impl Candidates {
    /// The dots. `blind` is the share of the surface that no view shows, `expected` their number where it is known.
    ///
    /// # Errors
    /// What is in doubt.
    pub fn dots(
        &self,
        surface: &Surface,
        blind: f64,
        expected: Option<usize>,
    ) -> Result<Vec<Candidate>, Unclear> {
        let of = |kind: Kind| self.dots.iter().filter(move |c| c.kind == kind).copied();
        if let Some(away) = of(Kind::TurnedAway).next() {
            let dots = of(Kind::TurnedAway).count();
            let rejection = UnknownRejection::TurnedAway { dots };
            return Err(Unclear::about(rejection, away.dot.direction));
        }
        let (sure, doubtful) = (of(Kind::Dot).count(), of(Kind::Doubtful).count());
        if blind * sure as f64 > MAX_HIDDEN {
            return Err(UnknownRejection::NotCovered { blind }.into());
        }
        if !self.is_printed {
            let covered = self.covered(surface);
            let share = covered.len() as f64 / surface.places.len() as f64;
            if let Some(first) = covered.first()
                && share * sure as f64 > MAX_COVERED
            {
                let blind = blind + share;
                return Err(Unclear::about(
                    UnknownRejection::NotCovered { blind },
                    *first,
                ));
            }
        }
        let found = sure + doubtful;
        match expected {
            None if self.is_printed => Err(UnknownRejection::Printed { sure, doubtful }.into()),
            None if doubtful == 0 => Ok(of(Kind::Dot).collect()),
            None => Err(UnknownRejection::Doubtful { sure, doubtful }.into()),
            Some(expected) if expected == sure && !self.is_printed => Ok(of(Kind::Dot).collect()),
            Some(expected) => likeliest(&self.dots, expected)
                .ok_or(UnknownRejection::WrongNumber { expected, found }.into()),
        }
    }

    /// The places that are covered in most views.
    fn covered(&self, surface: &Surface) -> Vec<Vec3> {
        let known = self.dots.iter().filter(|c| c.kind != Kind::Other);
        let known = known.map(|c| (c.dot.direction, BEYOND[0] * c.radius + BEYOND[1]));
        surface.dark(known, COVERED * self.darkness, WHOLE * self.radius)
    }
}

/// So many of these candidates that are likelier dots than all others, where that is clear.
fn likeliest(dots: &[Candidate], count: usize) -> Option<Vec<Candidate>> {
    let mut sorted = dots.to_vec();
    sorted.sort_by(|a, b| b.likeness.total_cmp(&a.likeness));
    let last = sorted.get(count.checked_sub(1)?)?.likeness;
    let next = sorted.get(count).map_or(0.0, |c| c.likeness);
    sorted.truncate(count);
    (last >= LIKELY && last - next >= CLEAR).then_some(sorted)
}
