//! Which marks of a ball are its dots.
//!
//! Three witnesses: the surface shows a disc, single frames show it dark, and the detector finds a dot there in the views that face it. Dots are of one pen:
//! of one size and one darkness, within what a hand makes of it. On a ball without print a disc that many frames show is a dot, and so is
//! what the detector sees and the surface does not contradict; what neither shows is none, and between them a mark is *doubtful*. Where there is
//! print, it may have discs too: there a person must say which marks are the dots.

use super::candidates::{Candidate, Candidates, Kind};
use super::contrast::Contrast;
use super::map::{DotMap, MapDot};
use super::marks::Mark;
use super::seen::Seen;
use super::tidy::FACING;
use super::{MIN_VIEWS, UnknownRejection};
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
/// Radius and darkness over those of the middle dot, where nothing but dots is on the ball, and beside print. (On 80 plain balls, seeds
/// 35100001 and 35100002, all nine marks of 0.15 to 0.25 times the middle darkness that the detector saw too were dots.)
const ALONE: [[f64; 2]; 2] = [[0.45, 2.2], [0.15, 2.5]];
const BESIDE_PRINT: [[f64; 2]; 2] = [[0.6, 1.5], [0.4, 1.7]];
/// A mark that is shown by a smaller share of its views is a finger or a shadow. Of 14 that fingers left in 8 views or more, on 39 plain
/// balls (`bench calibration-unknown`, seeds 35100001 and with --guided 35300001, 20 clips each), all had 0.68 at most; dots that were
/// not in the map had 0.73 or more.
const STEADY: f64 = 0.7;
/// A mark of no larger radius, over that of the middle disc, is one dot, whatever its shape.
const SINGLE: f64 = 1.2;
/// The contrast, over that of the middle dot, from which on a mark is dark in single frames, and from which on it may be; and the share of the
/// frames that must show it.
const CONTRAST: f64 = 0.25;
const HARDLY_DARK: f64 = 0.12;
const SHOWN: f64 = 0.7;
/// The likeness, over that of the middle dot, up to which the detector sees no dot in a mark, from which on it sees one where nothing
/// but dots is on the ball, and where there is print or the surface shows none. Chosen on 40 plain balls drawn by hand (`bench
/// calibration-unknown --clips 40 --seed 35100001 --plain`): fingers and shadows had 0.04 at most, dots 0.15 or more but for the smallest.
const UNSEEN: f64 = 0.05;
const SUSPECTED: f64 = 0.15;
const SEEN: f64 = 0.4;
/// Where the middle dot has a smaller likeness, the detector misses too many.
const HARDLY: f64 = 0.3;
/// Fewer views decide nothing.
const FEW_VIEWS: usize = 8;
/// Where all is less dark, over the middle dot, the surface is bare, whatever the detector saw in some frames.
const BARE: f64 = 0.07;
/// A mark that is at least so dark over the middle dot, beside what no view shows, may be a dot.
const FRINGE: f64 = 0.2;
/// Print: no disc, steady, at least so dark over the middle dot, and no dot to the detector. Discs so near it, radians, may be print.
const PRINT: f64 = 0.4;
const PRINT_LIKENESS: f64 = 0.2;
const NEAR_PRINT: f64 = 0.3;
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
    mark: &'m Mark,
    contrast: &'m Contrast,
    /// The dot of the map there.
    joined: Option<usize>,
    /// The mean probability of a dot over the views that the mark faces; `None` where there is none.
    likeness: Option<f64>,
}

impl Witnessed<'_> {
    /// Whether enough frames show the mark to decide.
    fn is_shown(&self) -> bool {
        self.mark.views >= FEW_VIEWS && self.contrast.views >= FEW_VIEWS
    }
}

impl DotMap<'_> {
    /// What may be a dot among the marks of the surface. `blind` is the share of it that no view shows.
    ///
    /// # Errors
    /// Where too few marks show what a dot looks like.
    pub fn candidates(
        &self,
        (marks, contrasts): (&[Mark], &[Contrast]),
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
        let print: Vec<Vec3> = witnessed
            .iter()
            .filter(|w| typical.is_print(w))
            .map(|w| w.mark.direction)
            .collect();
        let mut dots: Vec<Candidate> = Vec::new();
        for seen in &witnessed {
            let kind = typical.kind(seen, &print);
            // What is none and looks like none needs no name.
            if kind == Kind::Other && !typical.is_sized(seen.mark, ALONE) {
                continue;
            }
            let known = seen.joined.map(|j| self.dots[j]);
            dots.push(Candidate {
                dot: known.unwrap_or_else(|| new_dot(&seen.mark.direction)),
                radius: seen.mark.radius,
                likeness: typical.likeness(seen).unwrap_or(0.0),
                kind,
            });
        }
        dots.extend(self.detected_alone(marks, &typical, !print.is_empty(), surface));
        let is_none = |c: &Candidate| c.kind == Kind::Other;
        dots.sort_by(|a, b| {
            let likelier = b.likeness.total_cmp(&a.likeness);
            is_none(a).cmp(&is_none(b)).then(likelier)
        });
        Ok(Candidates {
            dots,
            blind,
            radius: typical.radius,
            darkness: typical.darkness,
            is_printed: !print.is_empty(),
        })
    }

    /// What the detector sees and the surface does not show.
    fn detected_alone(
        &self,
        marks: &[Mark],
        typical: &Typical,
        is_printed: bool,
        surface: &Darkness,
    ) -> Vec<Candidate> {
        let candidate = |j: usize| {
            let at = self.dots[j].direction;
            let is_there =
                |m: &Mark| angle_between(&m.direction, &at) < BESIDE.max(SAME[1] * m.radius);
            if marks.iter().any(is_there) || !self.is_likely(j) {
                return None;
            }
            let likeness = self.likeness(&at).unwrap_or(0.0) / typical.likeness;
            let is_seen = likeness >= SUSPECTED;
            Some(Candidate {
                dot: self.dots[j],
                radius: typical.radius,
                likeness,
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
    pub fn keep(&mut self, dots: &[Candidate]) {
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
    pub(super) fn facing(&self, place: &Vec3, depth: f64) -> impl Iterator<Item = (&Seen, Vec3)> {
        let place = *place;
        let placed = self.frames.iter().zip(&self.placed);
        let seen = placed.filter_map(move |(f, p)| Some((f, p.as_ref()?.rotation * place)));
        seen.filter(move |(frame, at)| frame.depth(at) >= depth)
    }

    /// The dots of the map at these marks, each at the nearest of them.
    fn at_marks(&self, marks: &[Mark]) -> Vec<Option<usize>> {
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
    fn at_mark(&self, mark: &Mark) -> Option<usize> {
        let within = SAME[0].max(SAME[1] * mark.radius);
        let near = self.established().into_iter();
        let near = near.map(|j| (j, angle_between(&self.dots[j].direction, &mark.direction)));
        let nearest = near.min_by(|a, b| a.1.total_cmp(&b.1))?;
        (nearest.1 < within).then_some(nearest.0)
    }

    /// How many dots of the map lie in a mark, or so near it that it may be several that run into one.
    pub(super) fn within_mark(&self, mark: &Mark) -> usize {
        let within = WITHIN[0] * mark.radius * mark.shape.elongation.sqrt() + WITHIN[1];
        let near = self.established().into_iter();
        near.filter(|j| angle_between(&self.dots[*j].direction, &mark.direction) < within)
            .count()
    }

    /// Whether the detector, where it finds this dot of the map, takes it for one.
    fn is_likely(&self, j: usize) -> bool {
        self.probability(j).is_some_and(|p| p >= LIKELY_DOT)
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
    /// The detector's likeness of a mark over that of the middle dot.
    fn likeness(&self, seen: &Witnessed<'_>) -> Option<f64> {
        Some(seen.likeness? / self.likeness)
    }

    /// Whether the frames show a mark, by so much over the middle dot.
    fn shows(&self, seen: &Witnessed<'_>, contrast: f64) -> bool {
        seen.contrast.steady >= SHOWN && seen.contrast.middle >= contrast * self.contrast
    }

    fn is_print(&self, seen: &Witnessed<'_>) -> bool {
        let Witnessed { mark, .. } = seen;
        let is_dot = self.likeness(seen).is_none_or(|l| l >= PRINT_LIKENESS);
        let is_steady = mark.views >= FEW_VIEWS && mark.steady >= STEADY;
        is_steady && !mark.is_round() && !is_dot && mark.darkness >= PRINT * self.darkness
    }

    /// Whether radius and darkness are those of a dot.
    fn is_sized(&self, mark: &Mark, [radius, darkness]: [[f64; 2]; 2]) -> bool {
        let within = |x: f64, [low, high]: [f64; 2]| (low..=high).contains(&x);
        within(mark.radius / self.radius, radius) && within(mark.darkness / self.darkness, darkness)
    }

    fn kind(&self, seen: &Witnessed<'_>, print: &[Vec3]) -> Kind {
        let likeness = self.likeness(seen).unwrap_or(0.0);
        if seen.mark.views < MIN_VIEWS {
            let is_seen = likeness >= UNSEEN && seen.mark.darkness >= FRINGE * self.darkness;
            return match seen.joined.is_some() || is_seen {
                true => Kind::TurnedAway,
                false => Kind::Other,
            };
        }
        match print.is_empty() {
            true => self.kind_alone(seen, likeness),
            false => self.kind_beside_print(seen, likeness, print),
        }
    }

    /// Where nothing but dots is on the ball.
    fn kind_alone(&self, seen: &Witnessed<'_>, likeness: f64) -> Kind {
        let Witnessed { mark, joined, .. } = seen;
        let is_known = joined.is_some();
        let is_shown = seen.is_shown();
        let is_sized = self.is_sized(mark, ALONE);
        let may_be_disc = is_sized && !mark.is_no_disc();
        // What the detector hardly sees must be one.
        let is_like = is_sized && mark.is_disc();
        // A few frames confirm what the detector has found.
        let is_enough = is_shown || is_known && seen.contrast.views >= MIN_VIEWS;
        let is_dark = |contrast| is_enough && self.shows(seen, contrast);
        // Two that run into one are larger.
        let is_single = is_sized && mark.radius <= SINGLE * self.radius;
        let is_seen = is_known || likeness >= SUSPECTED;
        let is_faint = mark.darkness < ALONE[1][0] * self.darkness;
        match () {
            () if is_faint && !is_known => Kind::Other,
            // Nothing else is dark in all frames of a ball without print, whatever the detector sees.
            () if is_dark(CONTRAST)
                && (is_like || is_seen && may_be_disc || is_known && is_single) =>
            {
                Kind::Dot
            }
            () if may_be_disc && is_dark(HARDLY_DARK) => Kind::Doubtful,
            // Too few frames face it to decide, or fingers cover it in many.
            () if is_known && likeness >= SUSPECTED && may_be_disc => Kind::Dot,
            // What many views show, most of them not, and no dot of the map, a hand has left.
            () if likeness < SEEN && !is_known && is_shown => Kind::Other,
            () if is_known || likeness >= UNSEEN => Kind::Doubtful,
            () => Kind::Other,
        }
    }

    fn kind_beside_print(&self, seen: &Witnessed<'_>, likeness: f64, print: &[Vec3]) -> Kind {
        let Witnessed { mark, joined, .. } = seen;
        let is_steady = mark.steady >= STEADY;
        // What many views show, most of them not, and no dot of the map, a hand has left.
        if joined.is_none() && seen.is_shown() && !is_steady && likeness < SEEN {
            return Kind::Other;
        }
        let is_apart = |p: &Vec3| angle_between(p, &mark.direction) > NEAR_PRINT;
        let is_like = mark.is_disc() && self.is_sized(mark, BESIDE_PRINT) && is_steady;
        match likeness {
            l if l < UNSEEN => Kind::Other,
            l if l >= SEEN && is_like && print.iter().all(is_apart) => Kind::Dot,
            _ => Kind::Doubtful,
        }
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
