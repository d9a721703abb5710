//! Which marks of a ball are its dots.
//!
//! A mark is a *dot* where it is as likely one as [`MarkEvidence`] says, *doubtful* where neither a dot nor anything else is likely, and
//! what hardly faces the camera and may be a dot is *turned away*. Of what the detector sees and the surface does not show a dot is what looks like one on a
//! ball without print. Where there is print, it may have discs too: there a person must say which marks are the dots.

use super::candidates::{A_DOT, Candidates, Kind, MarkCandidate, NO_DOT};
use super::contrast::Contrast;
use super::evidence::{MarkEvidence, SUSPECTED};
use super::map::{DotMap, MapDot};
use super::marks::DarkMark;
use super::seen::UsableFrame;
use super::tidy::FACING;
use super::{ESTABLISHED, MIN_VIEWS, UnknownRejection};
use crate::geometry::{Vec3, angle_between};
use crate::stats::median;
use crate::surface::Darkness;
use crate::vision::dots::detector::LIKELY_DOT;

/// A dot of the map so near a mark, radians or radii of the mark, is that mark; and one that is nearer than this is no other mark.
const SAME: [f64; 2] = [0.09, 0.7];
const BESIDE: f64 = 0.14;
/// Dots of the map within so many of a mark's longer half axes and so many radians more may be part of it.
const WITHIN: [f64; 2] = [1.6, 0.03];
/// A detection so near a mark, radians, in a view that it faces so far, is that mark.
const NEAR: f64 = 0.08;
const FACES: f64 = 0.2;
/// A mark that is shown by a smaller share of its views is a finger or a shadow. Of 14 that fingers left in 8 views or more, on 39 plain
/// balls (`bench calibration-unknown`, seeds 35100001 and with --guided 35300001, 20 clips each), all had 0.68 at most; dots that were
/// not in the map had 0.73 or more.
const STEADY: f64 = 0.7;
/// Where the middle dot has a smaller likeness, the detector misses too many.
const HARDLY: f64 = 0.3;
/// Fewer views decide nothing.
const FEW_VIEWS: usize = 8;
/// Where all is less dark, over the middle dot, the surface is bare, whatever the detector saw in some frames.
const BARE: f64 = 0.07;
/// Print: surely no dot, steady, and at least so dark over the middle dot. Of the 35 balls with print of seed 36510003 it is found on 13, and on 3 of the
/// 101 without; from 0.4 on on 12 and 2, from 0.1 on on 19 and 9.
const PRINT: f64 = 0.25;
/// Fewer discs that the detector finds too do not show what a dot looks like.
const MIN_TYPICAL: usize = 4;

/// What a dot looks like.
struct Typical {
    radius: f64,
    darkness: f64,
    likeness: f64,
    contrast: f64,
}

/// A mark and what the detector sees there.
struct Witnessed<'m> {
    mark: &'m DarkMark,
    contrast: &'m Contrast,
    /// The dot of the map there.
    joined: Option<usize>,
    /// The mean probability of a dot over the views that the mark faces; `None` where there is none.
    likeness: Option<f64>,
}

impl DotMap<'_> {
    /// What may be a dot among the marks of the surface. `blind` is the share of it that no view shows.
    ///
    /// # Errors
    /// Where too few marks show what a dot looks like.
    pub fn candidates(
        &self,
        (marks, contrasts): (&[DarkMark], &[Contrast]),
        surface: &Darkness,
        blind: f64,
    ) -> std::result::Result<Candidates, UnknownRejection> {
        let joined = self.at_marks(marks);
        let witnessed: Vec<Witnessed<'_>> = (marks.iter().zip(contrasts).zip(joined))
            .map(|((mark, contrast), joined)| Witnessed {
                mark,
                contrast,
                joined,
                likeness: self.likeness(&mark.direction),
            })
            .collect();
        let found = witnessed.iter().filter(|w| w.joined.is_some()).count();
        let typical = typical(&witnessed).ok_or(UnknownRejection::NoDots)?;
        if typical.likeness < HARDLY {
            return Err(UnknownRejection::TooFaint { dots: found });
        }
        let weighed = witnessed.iter().map(|seen| {
            let evidence = typical.evidence(seen);
            let probability = evidence.probability();
            let known = seen.joined.map(|j| self.dots[j]);
            MarkCandidate {
                dot: known.unwrap_or_else(|| new_dot(&seen.mark.direction)),
                radius: seen.mark.radius,
                kind: kind(probability, seen.mark.views),
                probability,
                evidence: Some(evidence),
            }
        });
        let mut dots: Vec<MarkCandidate> = weighed.collect();
        let is_print = |(seen, found): (&Witnessed<'_>, &MarkCandidate)| {
            found.kind == Kind::Other && typical.is_on_the_ball(seen.mark)
        };
        let is_printed = witnessed.iter().zip(&dots).any(is_print);
        dots.extend(self.detected_alone(marks, &typical, is_printed, surface));
        let is_none = |c: &MarkCandidate| c.kind == Kind::Other;
        dots.sort_by(|a, b| {
            let likelier = b.probability.total_cmp(&a.probability);
            is_none(a).cmp(&is_none(b)).then(likelier)
        });
        Ok(Candidates {
            dots,
            blind,
            radius: typical.radius,
            darkness: typical.darkness,
            is_printed,
        })
    }

    /// What the detector sees and the surface does not show.
    fn detected_alone(
        &self,
        marks: &[DarkMark],
        typical: &Typical,
        is_printed: bool,
        surface: &Darkness,
    ) -> Vec<MarkCandidate> {
        let candidate = |j: usize| {
            let at = self.dots[j].direction;
            let is_there =
                |m: &DarkMark| angle_between(&m.direction, &at) < BESIDE.max(SAME[1] * m.radius);
            if marks.iter().any(is_there) || !self.is_likely(j) {
                return None;
            }
            let likeness = self.likeness(&at).unwrap_or(0.0) / typical.likeness;
            let is_seen = likeness >= SUSPECTED;
            Some(MarkCandidate {
                dot: self.dots[j],
                radius: typical.radius,
                probability: likeness,
                evidence: None,
                kind: match () {
                    () if is_seen && !is_printed => Kind::Dot,
                    () if !is_seen && surface.is_bare(&at, BARE * typical.darkness) => Kind::Other,
                    () => Kind::Doubtful,
                },
            })
        };
        let established = self.established().into_iter();
        established.filter_map(candidate).collect()
    }

    /// Makes these dots the map's only ones.
    pub fn keep(&mut self, dots: &[MarkCandidate]) {
        self.dots = dots.iter().map(|c| c.dot).collect();
        self.rename();
    }

    /// The mean, over the views that a place faces, of the probability of a dot there; `None` where there is none.
    fn likeness(&self, place: &Vec3) -> Option<f64> {
        let (mut sum, mut views) = (0.0, 0usize);
        for (frame, at) in self.facing(place, FACES) {
            views += 1;
            let detections = &self.estimates[frame.index].dots;
            let near = frame.dots.iter();
            let near = near.filter(|d| d.direction.dot(&at) > NEAR.cos());
            let probabilities = near.map(|d| detections[d.detection].probability);
            sum += probabilities.fold(0.0, f64::max);
        }
        (views > 0).then(|| sum / views as f64)
    }

    /// The frames that a place faces by this depth or more, and where each has it.
    pub(super) fn facing(
        &self,
        place: &Vec3,
        depth: f64,
    ) -> impl Iterator<Item = (&UsableFrame, Vec3)> {
        let place = *place;
        let placed = self.frames.iter().zip(&self.placed);
        let seen = placed.filter_map(move |(f, p)| Some((f, p.as_ref()?.rotation * place)));
        seen.filter(move |(frame, at)| frame.depth(at) >= depth)
    }

    /// The dots of the map at these marks, each at the nearest of them.
    fn at_marks(&self, marks: &[DarkMark]) -> Vec<Option<usize>> {
        let mut joined: Vec<Option<usize>> = marks.iter().map(|m| self.at_mark(m)).collect();
        let off = |m: usize, j: usize| angle_between(&marks[m].direction, &self.dots[j].direction);
        for m in 0..marks.len() {
            let is_nearer = |j: usize| {
                let others = (0..marks.len()).filter(|o| *o != m && joined[*o] == Some(j));
                others.map(|o| off(o, j)).any(|other| other < off(m, j))
            };
            joined[m] = joined[m].filter(|j| !is_nearer(*j));
        }
        joined
    }

    /// The dot of the map at a mark.
    fn at_mark(&self, mark: &DarkMark) -> Option<usize> {
        let within = SAME[0].max(SAME[1] * mark.radius);
        let near = self.established().into_iter();
        let near = near.map(|j| (j, angle_between(&self.dots[j].direction, &mark.direction)));
        let nearest = near.min_by(|a, b| a.1.total_cmp(&b.1))?;
        (nearest.1 < within).then_some(nearest.0)
    }

    /// How many dots of the map lie in a mark, or so near it that it may be several that run into one.
    pub(super) fn within_mark(&self, mark: &DarkMark) -> usize {
        let within = WITHIN[0] * mark.radius * mark.shape.elongation.sqrt() + WITHIN[1];
        let near = self.established().into_iter();
        near.filter(|j| angle_between(&self.dots[*j].direction, &mark.direction) < within)
            .count()
    }

    /// Whether the detector, where it finds this dot of the map, takes it for one.
    fn is_likely(&self, j: usize) -> bool {
        self.probability(j).is_some_and(|p| p >= LIKELY_DOT)
    }

    /// The detector's mean probability of a dot at this place of the map, over the views that it faces:
    /// at the limb dots are doubted too. `None` where there are hardly any.
    fn probability(&self, j: usize) -> Option<f64> {
        let (mut sum, mut views) = (0.0, 0usize);
        for (frame, placed) in self.frames.iter().zip(&self.placed) {
            let Some(placed) = placed else { continue };
            let dots = &self.estimates[frame.index].dots;
            for (dot, name) in frame.dots.iter().zip(&placed.names) {
                if *name == Some(j) && dot.depth >= FACING {
                    sum += dots[dot.detection].probability;
                    views += 1;
                }
            }
        }
        (views >= ESTABLISHED).then(|| sum / views as f64)
    }

    /// In how many views a dot is found, and how many face it.
    pub(super) fn rate(&self, j: usize) -> (usize, usize) {
        let direction = self.dots[j].direction;
        let (mut views, mut found) = (0usize, 0usize);
        for (frame, placed) in self.frames.iter().zip(&self.placed) {
            let Some(placed) = placed else { continue };
            if frame.depth(&(placed.rotation * direction)) >= FACING {
                views += 1;
                found += usize::from(placed.names.contains(&Some(j)));
            }
        }
        (found, views)
    }
}

/// The middle disc that the detector finds too.
fn typical(witnessed: &[Witnessed<'_>]) -> Option<Typical> {
    let is_dot = |w: &&Witnessed<'_>| {
        w.mark.is_disc() && w.mark.views >= MIN_VIEWS && w.joined.is_some() && w.likeness.is_some()
    };
    let found: Vec<&Witnessed<'_>> = witnessed.iter().filter(is_dot).collect();
    let middle =
        |f: fn(&Witnessed<'_>) -> f64| median(&mut found.iter().map(|w| f(w)).collect::<Vec<_>>());
    (found.len() >= MIN_TYPICAL).then(|| Typical {
        radius: middle(|w| w.mark.radius),
        darkness: middle(|w| w.mark.darkness),
        likeness: middle(|w| w.likeness.unwrap_or(0.0)),
        contrast: middle(|w| w.contrast.middle),
    })
}

impl Typical {
    /// What the witnesses say of a mark.
    fn evidence(&self, seen: &Witnessed<'_>) -> MarkEvidence {
        let Witnessed { mark, contrast, .. } = seen;
        MarkEvidence {
            radius: mark.radius / self.radius,
            darkness: mark.darkness / self.darkness,
            solidity: mark.shape.solidity,
            around: mark.shape.around,
            contrast: contrast.middle / self.contrast,
            likeness: self.likeness(seen).unwrap_or(0.0),
            views: contrast.views,
        }
    }

    /// Whether a mark is dark enough for print, and no finger or shadow.
    fn is_on_the_ball(&self, mark: &DarkMark) -> bool {
        let is_steady = mark.views >= FEW_VIEWS && mark.steady >= STEADY;
        is_steady && mark.darkness / self.darkness >= PRINT
    }

    /// The detector's likeness of a mark over that of the middle dot.
    fn likeness(&self, seen: &Witnessed<'_>) -> Option<f64> {
        Some(seen.likeness? / self.likeness)
    }
}

/// What a mark is that is a dot with this probability, and that so many views show.
fn kind(probability: f64, views: usize) -> Kind {
    match () {
        () if probability < NO_DOT => Kind::Other,
        () if views < MIN_VIEWS => Kind::TurnedAway,
        () if probability >= A_DOT => Kind::Dot,
        () => Kind::Doubtful,
    }
}

/// A dot that no detection has shown yet.
fn new_dot(direction: &Vec3) -> MapDot {
    MapDot {
        direction: *direction,
        found: 0,
        weight: 1.0,
    }
}
