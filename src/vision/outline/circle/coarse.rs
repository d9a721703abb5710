//! Rough circles in a large image, at a quarter of its scale: where a ball may be.
//!
//! The image is shrunk, each value the mean of a square of pixels, until its longer side is at most
//! [`SIDE`] values, and halved from there. At each size edges vote for centers as in
//! [`BallFinder`](super::BallFinder), for radii of 5 to 10 values at the first size and of 10 to 20 at
//! each. The radius at which most of 72 rays have an edge makes a circle of a center.
//!
//! A circle in which something has changed since the image before is *moving*. What changes is
//! measured against the whole image, half of which is taken for standing still: where the camera
//! moves, everything changes, and nothing is preferred. Moving circles come first: a lamp, a white
//! disc on the wall stand still, a ball moves or turns.
//!
//! A circle with strong edges outshines the others: no edge much fainter than its rim votes. Where none of the circles
//! that were tried is the ball, the search goes on without the edges of those whose rim is seen for the greater part
//! ([`CoarseSearch::search_beyond`]), and then in the image without what is thin ([`CoarseSearch::search_plain`]): a net or cords before
//! the ball have more edges than its rim.
//!
//! Guarantees: the work does not depend on how many circles there are. Not guaranteed: that any of
//! them is a ball. They are known to some tenth of the radius; [`fit`](super::BallFinder::fit_near) them.

use super::edges::Unrolled;
use super::vote::{Center, MAX, MIN, Votes};
use super::{BallCircle, GrayImage, Pixel, Polarity};
use crate::vision::optics::grid::Grid;

/// Maximum longer side of the first size that is searched, values.
const SIDE: usize = 320;
/// The smallest radius that is voted for, at the first size only, values.
const FINEST: usize = 5;
/// More than there are sizes of an image.
const SIZES: usize = 16;
/// Centers examined at each size and for each polarity.
const CENTERS: usize = 8;
/// Circles given out by one search.
pub const MAX_CIRCLES: usize = 12;
/// Circles nearer to each other than this, in radii, are one; so are those of radii within this ratio.
const SAME: f64 = 0.35;
/// A change of this many times the median change, and beyond this difference of brightness, is motion.
const CHANGE: (f32, f32) = (6.0, 0.02);
/// Share of a circle's values that must change.
const MOVING: f64 = 0.1;
/// Support from which on a circle is looked at before what it may outshine is searched for.
const STANDING_OUT: f64 = 0.8;
/// Support from which on a circle may outshine others.
const WHOLE: f64 = 0.6;
/// Every so many values count for the median change.
const STRIDE: usize = 7;

/// A circle that may be a ball's, full-size pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RoughCircle {
    /// To some tenth of its radius.
    pub circle: BallCircle,
    /// The sign of its edges.
    pub polarity: Polarity,
    /// About the share of its rim that has an edge.
    pub support: f64,
    /// Whether it differs from the image before.
    pub is_moving: bool,
}

impl RoughCircle {
    /// Whether it is as likely to be the ball as another, or likelier.
    fn ranks(&self, other: &Self) -> bool {
        (self.is_moving, self.support) >= (other.is_moving, other.support)
    }
}

/// How many of a search's circles are tried before [`CoarseSearch::search_beyond`]: those that move or have a rim that is
/// nearly whole, and the first in any case.
pub fn standing_out(found: &[RoughCircle]) -> usize {
    let stands_out = |c: &&RoughCircle| c.is_moving || c.support >= STANDING_OUT;
    let count = found.iter().take_while(stands_out).count();
    count.max(1).min(found.len())
}

/// The circles that may outshine others.
fn whole(circles: &[RoughCircle]) -> impl Iterator<Item = &RoughCircle> {
    circles.iter().filter(|c| c.support >= WHOLE)
}

/// Searches large images; keeps its memory, and the last image, from image to image.
#[derive(Debug, Default)]
pub struct CoarseSearch {
    /// The image at the first size and the halves of it.
    sizes: Vec<GrayImage>,
    previous: GrayImage,
    /// A size without what is thin.
    plain: GrayImage,
    /// Whether the image before belongs to the same camera and place.
    is_continued: bool,
    /// The change of every value.
    changes: Vec<f32>,
    sample: Vec<f32>,
    votes: Votes,
    centers: Vec<Center>,
    unrolled: Unrolled,
    found: Vec<RoughCircle>,
    /// Those of the search before, where this one goes on.
    before: Vec<RoughCircle>,
    /// How many of those were tried.
    tried: usize,
    /// Which sizes of the image have no edge.
    bare: [bool; SIZES],
}

/// How often an image of this size is halved until it is small enough.
pub fn level(width: usize, height: usize) -> u32 {
    let mut level = 0;
    while width.max(height) >> level > SIDE {
        level += 1;
    }
    level
}

impl CoarseSearch {
    /// Forgets the image before: the next one shows another place.
    pub fn forget(&mut self) {
        self.is_continued = false;
    }

    /// The circles of an image, the likeliest first. `shrink` writes the image at the scale
    /// `1 / 2^level`. Radii are within `radii`, full-size pixels. The image before is that of the last
    /// call, unless that was forgotten.
    pub fn search(
        &mut self,
        level: u32,
        radii: (f64, f64),
        shrink: impl FnOnce(&mut GrayImage),
    ) -> &[RoughCircle] {
        self.found.clear();
        self.before.clear();
        self.tried = 0;
        if self.sizes.is_empty() {
            self.sizes.push(GrayImage::default());
        }
        std::mem::swap(&mut self.previous, &mut self.sizes[0]);
        shrink(&mut self.sizes[0]);
        self.find_changes();
        self.scan(level, radii, false);
        &self.found
    }

    /// The circles that those of the last [`CoarseSearch::search`] outshone and, among them, those of that search but the
    /// first `tried` ones, likewise: edges about the rims of those do not vote. `level` and `radii` are those of that
    /// search.
    pub fn search_beyond(&mut self, tried: usize, level: u32, radii: (f64, f64)) -> &[RoughCircle] {
        std::mem::swap(&mut self.before, &mut self.found);
        self.found.clear();
        self.tried = tried.min(self.before.len());
        if whole(&self.before[..self.tried]).next().is_some() {
            self.scan(level, radii, false);
        }
        for circle in self.before.iter().skip(tried) {
            let at = self.found.partition_point(|other| other.ranks(circle));
            self.found.insert(at, *circle);
        }
        &self.found
    }

    /// The circles of the last image without what is thin: cords, nets and dots vanish from it, a ball does not. Those that were
    /// found before are left out.
    pub fn search_plain(&mut self, level: u32, radii: (f64, f64)) -> &[RoughCircle] {
        self.before.append(&mut self.found);
        self.tried = 0;
        self.scan(level, radii, true);
        &self.found
    }

    /// Searches all sizes.
    fn scan(&mut self, level: u32, radii: (f64, f64), is_plain: bool) {
        let mut plain = std::mem::take(&mut self.plain);
        for size in 0..SIZES {
            let grid = Grid::halved(level + size as u32);
            let scale = grid.side;
            let smallest = if size == 0 { FINEST } else { MIN };
            let is_over = smallest as f64 * scale > radii.1;
            if is_over || (size > 0 && !self.halve(size)) {
                break;
            }
            // What has no edge has none without what is thin.
            if is_plain && self.bare[size] {
                continue;
            }
            self.reserve(size);
            plain.reserve(self.sizes[size].values().len());
            let rims = whole(&self.before[..self.tried]);
            let rims = rims.map(|c| grid.circle_to_part(&c.circle));
            if is_plain {
                self.sizes[size].median_into(&mut plain);
            }
            self.votes
                .look(if is_plain { &plain } else { &self.sizes[size] }, rims);
            if self.tried == 0 && !is_plain {
                self.bare[size] = self.votes.is_bare();
            }
            if self.votes.is_bare() {
                continue;
            }
            let fine = (size == 0 && !is_plain).then_some(FINEST..=MIN);
            for voted in fine.into_iter().chain([MIN..=MAX]) {
                let (from, to) = (*voted.start() as f64 * scale, *voted.end() as f64 * scale);
                if to < radii.0 || from > radii.1 {
                    continue;
                }
                for polarity in [Polarity::Brighter, Polarity::Darker] {
                    self.votes.cast(voted.clone(), polarity.sign());
                    self.votes.strongest(CENTERS, &mut self.centers);
                    for k in 0..self.centers.len() {
                        let center = self.centers[k];
                        let image = if is_plain { &plain } else { &self.sizes[size] };
                        let (voted, sign) = (voted.clone(), polarity.sign());
                        let Some((radius, support)) =
                            self.unrolled.radius(image, &center, voted, sign)
                        else {
                            continue;
                        };
                        let Center { u, v, .. } = center;
                        let circle = BallCircle::new(Pixel { u, v }, radius);
                        let circle = grid.circle_to_image(&circle);
                        if circle.radius < radii.0 || circle.radius > radii.1 {
                            continue;
                        }
                        let is_moving = self.is_moving(&circle, &Grid::halved(level));
                        self.keep(RoughCircle {
                            circle,
                            polarity,
                            support,
                            is_moving,
                        });
                    }
                }
            }
        }
        self.plain = plain;
    }

    /// Makes the next smaller size; whether it has room for a circle.
    fn halve(&mut self, size: usize) -> bool {
        if self.sizes.len() == size {
            self.sizes.push(GrayImage::default());
        }
        let (done, rest) = self.sizes.split_at_mut(size);
        let Some(last) = done.last() else {
            return false;
        };
        let (width, height) = (last.width(), last.height());
        if width.max(height) < 4 * MIN || width.min(height) < 2 {
            return false;
        }
        last.halve_into(&mut rest[0]);
        true
    }

    fn reserve(&mut self, size: usize) {
        if size == 0 {
            let values = self.sizes[0].values().len();
            self.votes.reserve(values);
            self.previous.reserve(values);
            self.sample
                .reserve((values / STRIDE + 1).saturating_sub(self.sample.len()));
        }
        self.centers
            .reserve(CENTERS.saturating_sub(self.centers.len()));
        for circles in [&mut self.found, &mut self.before] {
            circles.reserve((3 * MAX_CIRCLES).saturating_sub(circles.len()));
        }
    }

    /// What has changed since the image before, in units of the limit of motion; nothing, where that
    /// was of another size.
    fn find_changes(&mut self) {
        let (now, before) = (&self.sizes[0], &self.previous);
        self.changes.clear();
        let is_continued = std::mem::replace(&mut self.is_continued, true);
        if !is_continued || (now.width(), now.height()) != (before.width(), before.height()) {
            // Room for the next.
            self.changes.reserve(now.values().len());
            return;
        }
        let both = now.values().iter().zip(before.values());
        self.changes.extend(both.map(|(a, b)| (a - b).abs()));
        self.sample.clear();
        self.sample
            .extend(self.changes.iter().step_by(STRIDE).copied());
        let middle = self.sample.len() / 2;
        let median = *self.sample.select_nth_unstable_by(middle, f32::total_cmp).1;
        let limit = (CHANGE.0 * median).max(CHANGE.1);
        for change in &mut self.changes {
            *change /= limit;
        }
    }

    fn is_moving(&self, circle: &BallCircle, grid: &Grid) -> bool {
        if self.changes.is_empty() {
            return false;
        }
        let (width, height) = (self.sizes[0].width(), self.sizes[0].height());
        let BallCircle {
            center: Pixel { u, v },
            radius,
            ..
        } = grid.circle_to_part(circle);
        let (mut changed, mut all) = (0u32, 0u32);
        let rows = (v - radius).ceil().max(0.0) as usize..=(v + radius).max(0.0) as usize;
        for row in rows.take_while(|r| *r < height) {
            let half = (radius * radius - (row as f64 - v).powi(2)).max(0.0).sqrt();
            let columns = (u - half).ceil().max(0.0) as usize..=(u + half).max(0.0) as usize;
            for column in columns.take_while(|c| *c < width) {
                all += 1;
                changed += u32::from(self.changes[row * width + column] > 1.0);
            }
        }
        f64::from(changed) >= MOVING * f64::from(all.max(1))
    }

    /// Keeps a circle once, among the best, in order.
    fn keep(&mut self, circle: RoughCircle) {
        let same = |other: &RoughCircle| {
            let (a, b) = (&other.circle, &circle.circle);
            let apart = (a.center.u - b.center.u).hypot(a.center.v - b.center.v);
            apart < SAME * a.radius.min(b.radius) && (a.radius / b.radius).ln().abs() < SAME
        };
        if self.before.iter().any(same) {
            return;
        }
        if let Some(at) = self.found.iter().position(same) {
            if self.found[at].ranks(&circle) {
                return;
            }
            self.found.remove(at);
        }
        let at = self.found.partition_point(|other| other.ranks(&circle));
        if at < MAX_CIRCLES {
            self.found.insert(at, circle);
            self.found.truncate(MAX_CIRCLES);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RADII: (f64, f64) = (15.0, 60.0);

    fn frame(discs: &[(f64, f64, f64, f32)]) -> GrayImage {
        GrayImage::from_fn(640, 480, |u, v| {
            let inside = |&&(x, y, radius, _): &&(f64, f64, f64, f32)| {
                (u as f64 - x).hypot(v as f64 - y) < radius
            };
            discs.iter().find(inside).map_or(0.02, |disc| disc.3)
        })
    }

    fn has(found: &[RoughCircle], u: f64, v: f64, radius: f64) -> bool {
        found.iter().any(|c| {
            let apart = (c.circle.center.u - u).hypot(c.circle.center.v - v);
            apart < 0.2 * radius && (c.circle.radius / radius - 1.0).abs() < 0.2
        })
    }

    /// A ball of a tenth of a lamp's brightness: no edge of it votes beside the lamp's.
    #[test]
    fn what_a_bright_disc_outshines_is_found_beyond_it() {
        let (lamp, ball) = ((450.0, 300.0, 38.0, 1.0), (200.0, 150.0, 30.0, 0.1));
        let mut search = CoarseSearch::default();
        let both = frame(&[lamp, ball]);
        let found = search.search(1, RADII, |out| both.halve_into(out));
        assert!(has(found, lamp.0, lamp.1, lamp.2));
        assert!(!has(found, ball.0, ball.1, ball.2));
        let found = search.search_beyond(1, 1, RADII);
        assert!(has(found, ball.0, ball.1, ball.2));
        assert!(!has(found, lamp.0, lamp.1, lamp.2));
        // The next image is searched as the first one was.
        let alone = frame(&[ball]);
        let found = search.search(1, RADII, |out| alone.halve_into(out));
        assert!(has(found, ball.0, ball.1, ball.2));
    }

    #[test]
    fn circles_that_were_not_tried_are_searched_for_again() {
        let (lamp, second) = ((250.0, 240.0, 40.0, 1.0), (350.0, 240.0, 40.0, 0.5));
        let both = frame(&[lamp, second]);
        let mut search = CoarseSearch::default();
        let found = search.search(1, RADII, |out| both.halve_into(out)).to_vec();
        let is_lamp = has(&found[..1], lamp.0, lamp.1, lamp.2);
        let (tried, other) = if is_lamp {
            (lamp, second)
        } else {
            (second, lamp)
        };
        assert!(has(&found[..1], tried.0, tried.1, tried.2));
        let beyond = search.search_beyond(1, 1, RADII);
        assert!(has(beyond, other.0, other.1, other.2));
        let untried = found[1..].iter();
        assert!(untried.clone().all(|c| beyond.contains(c)), "{found:?}");
        assert!(beyond.windows(2).all(|pair| pair[0].ranks(&pair[1])));
    }

    #[test]
    fn the_first_circle_and_all_whole_ones_stand_out() {
        let rough = |support, is_moving| RoughCircle {
            circle: BallCircle::new(Pixel { u: 0.0, v: 0.0 }, 10.0),
            polarity: Polarity::Brighter,
            support,
            is_moving,
        };
        let [whole, faint] = [rough(0.9, false), rough(0.5, false)];
        assert_eq!(standing_out(&[]), 0);
        assert_eq!(standing_out(&[faint, faint]), 1);
        assert_eq!(standing_out(&[rough(0.3, true), whole, whole, faint]), 3);
    }

    /// Nets of bright threads before faint discs, whose rims have a fifth of the threads' contrast.
    #[test]
    fn a_net_hides_no_disc() {
        let (mut at_once, mut at_last) = (0, 0);
        for k in 0..20 {
            let offset = f64::from(k);
            let ball = (
                300.0 + 3.7 * offset,
                200.0 + 2.3 * offset,
                24.0 + offset,
                0.2,
            );
            let disc = frame(&[ball]);
            let netted = GrayImage::from_fn(640, 480, |u, v| {
                let is_thread = u % 20 < 2 || v % 20 < 2;
                if is_thread {
                    1.0
                } else {
                    disc.values()[v * 640 + u]
                }
            });
            let is_ball = |found: &[RoughCircle]| has(found, ball.0, ball.1, ball.2);
            let mut search = CoarseSearch::default();
            let found = search.search(1, RADII, |out| netted.halve_into(out));
            let (was_found, all) = (is_ball(found), found.len());
            let was_found = was_found || is_ball(search.search_beyond(all, 1, RADII));
            at_once += usize::from(was_found);
            at_last += usize::from(was_found || is_ball(search.search_plain(1, RADII)));
        }
        assert!(at_once < 12 && at_last > 15, "{at_once}, {at_last} of 20");
    }

    #[test]
    fn where_nothing_shines_nothing_is_searched_again() {
        let mut search = CoarseSearch::default();
        let empty = frame(&[]);
        let found = search.search(1, RADII, |out| empty.halve_into(out));
        assert!(found.is_empty());
        assert!(search.search_beyond(0, 1, RADII).is_empty());
    }
}
