//! Votes of edges for the centers of circles.

use std::ops::RangeInclusive;

use super::{BallCircle, GrayImage};

/// Minimum radius that is voted for, pixels.
pub(crate) const MIN: usize = 10;
/// Largest radius that is voted for: twice the minimum, as images are halved.
pub(crate) const MAX: usize = 20;
/// Gradients above that of this rank (an outline has about as many pixels) count as no more: one bright edge is not ten.
const STRONG: usize = 64;
/// Gradients below this part of the strong ones do not vote: shading, noise.
const WEAK: f32 = 0.15;
/// Gradients below so many deviations of the noise do not vote either: their direction is off by half a radian, and their votes by half
/// a radius. The noise is that of the gradients' lowest tenth, since a tenth of all places is bare, whatever is painted on the others; so
/// many places show it.
const NOISE: f32 = 2.0;
const NOISE_PLACES: usize = 4096;
/// The strong gradients of nothing but noise are as long as its distribution has them, to this factor: then there is no edge. Of noise alone,
/// of a sensor or of bytes, they are to within 3 %; noise that is not even has longer ones.
const NOTHING_BUT_NOISE: f32 = 1.1;
/// Of lengths of a Gaussian vector the lowest tenth's largest over the deviation of its components (Rayleigh).
const LOWEST_TENTH: f32 = 0.459;
/// Edges this near to a circle's rim, in radii and at least in pixels, are the circle's.
const RIM: f64 = 0.2;
const MIN_RIM: f64 = 2.0;
/// Centers of one circle lie within this many pixels.
const APART: isize = 3;

/// A center with votes, pixels of the image that voted.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Center {
    pub u: f64,
    pub v: f64,
    votes: f32,
}

/// A ballot, one number a pixel.
#[derive(Debug, Default)]
pub(crate) struct Votes {
    width: usize,
    height: usize,
    gradients: Vec<[f32; 3]>,
    lengths: Vec<f32>,
    counts: Vec<f32>,
    smooth: Vec<f32>,
    /// Sums of three neighbors in a row.
    threes: Vec<f32>,
    /// The length of a strong gradient; 0 where there is none.
    strong: f32,
    /// The least length of a gradient that votes.
    least: f32,
}

/// The votes of edges of either sign: those of the one and of the other, added.
#[derive(Debug, Default)]
pub(crate) struct Ballot {
    counts: Vec<f32>,
    strong: f32,
}

impl Ballot {
    /// Reserves capacity for images of as many pixels.
    pub fn reserve(&mut self, pixels: usize) {
        self.counts
            .reserve(pixels.saturating_sub(self.counts.len()));
    }

    /// Forgets all votes.
    pub fn clear(&mut self) {
        self.counts.clear();
        self.strong = 0.0;
    }

    /// Adds the votes of one sign.
    pub fn add(&mut self, votes: &Votes) {
        self.counts.resize(votes.counts.len(), 0.0);
        self.strong = votes.strong;
        for (sum, count) in self.counts.iter_mut().zip(&votes.counts) {
            *sum += count;
        }
    }
}

impl Votes {
    /// Takes up the votes of an image of this width.
    pub fn take_up(&mut self, ballot: &Ballot, width: usize) {
        self.counts.clone_from(&ballot.counts);
        (self.width, self.height) = (width, ballot.counts.len() / width.max(1));
        self.strong = ballot.strong;
    }

    /// Reserves capacity for images of as many pixels.
    pub fn reserve(&mut self, pixels: usize) {
        self.gradients
            .reserve(pixels.saturating_sub(self.gradients.len()));
        for numbers in [
            &mut self.lengths,
            &mut self.counts,
            &mut self.smooth,
            &mut self.threes,
        ] {
            numbers.reserve(pixels.saturating_sub(numbers.len()));
        }
    }

    /// Finds the edges that vote: not those about the rims of these circles, pixels of the image, so that what they
    /// outshone does.
    pub fn look(&mut self, image: &GrayImage, rims: impl Iterator<Item = BallCircle>) {
        (self.width, self.height) = (image.width(), image.height());
        self.find_gradients(image);
        for rim in rims {
            let BallCircle { center, radius, .. } = rim;
            let width = (RIM * radius).max(MIN_RIM);
            let reach = radius + width;
            let within = |from: f64, to: f64, all: usize| {
                from.max(0.0) as usize..((to + 1.0).max(0.0) as usize).min(all)
            };
            for v in within(center.v - reach, center.v + reach, self.height) {
                for u in within(center.u - reach, center.u + reach, self.width) {
                    let out = (u as f64 - center.u).hypot(v as f64 - center.v);
                    if (out - radius).abs() < width {
                        self.gradients[v * self.width + u] = [0.0; 3];
                    }
                }
            }
        }
        let count = self.gradients.len();
        let stride = count.div_ceil(NOISE_PLACES);
        let places = self.gradients.iter().step_by(stride);
        self.lengths.clear();
        self.lengths.extend(places.map(|[.., length]| length));
        let noise = self.length_of_rank(9 * self.lengths.len() / 10) / LOWEST_TENTH;
        self.strong = self.strong_length(stride);
        self.least = (WEAK * self.strong).max(NOISE * noise);
        // Of so many Rayleigh lengths the one of that rank.
        let rare = count as f32 / STRONG as f32;
        if self.strong < NOTHING_BUT_NOISE * noise * (2.0 * rare.max(1.0).ln()).sqrt() {
            self.strong = 0.0;
        }
    }

    /// Whether there is no edge.
    pub fn is_bare(&self) -> bool {
        self.strong <= 0.0
    }

    /// Casts the votes of all edges for centers at these distances: uphill of edges (`sign` 1, balls brighter than what
    /// is behind them), downhill (-1), or both (0).
    pub fn cast(&mut self, radii: RangeInclusive<usize>, sign: f64) {
        self.counts.clear();
        self.counts.resize(self.width * self.height, 0.0);
        if self.is_bare() {
            return;
        }
        let strong = self.strong;
        for v in 0..self.height {
            for u in 0..self.width {
                let [x, y, length] = self.gradients[v * self.width + u];
                if length < self.least {
                    continue;
                }
                let weight = length.min(strong);
                let (x, y) = (x / length, y / length);
                if sign >= 0.0 {
                    self.vote(radii.clone(), [u, v], [x, y], weight);
                }
                if sign <= 0.0 {
                    self.vote(radii.clone(), [u, v], [-x, -y], weight);
                }
            }
        }
    }

    /// Votes for all centers in a direction from a pixel: those at the pixels nearest to the places, which are counted in parts of a pixel.
    fn vote(
        &mut self,
        radii: RangeInclusive<usize>,
        [u, v]: [usize; 2],
        [x, y]: [f32; 2],
        weight: f32,
    ) {
        const PARTS: f32 = 65_536.0;
        let step = [x, y].map(|x| (x * PARTS) as i32);
        let half = 1 << 15;
        let at = |radius: usize| {
            let at = |from: usize, step: i32| {
                (((from as i32) << 16) + half + radius as i32 * step) >> 16
            };
            [at(u, step[0]), at(v, step[1])]
        };
        let is_inside = |[u, v]: [i32; 2]| (u as usize) < self.width && (v as usize) < self.height;
        let ends = [*radii.start(), *radii.end()];
        let are_inside = ends.into_iter().all(|radius| is_inside(at(radius)));
        for radius in radii {
            let place = at(radius);
            if are_inside || is_inside(place) {
                self.counts[place[1] as usize * self.width + place[0] as usize] += weight;
            }
        }
    }

    /// The length of a strong gradient, by the lengths of every so many-th place.
    fn strong_length(&mut self, stride: usize) -> f32 {
        let rank = STRONG.min(self.gradients.len() - 1);
        // About eight times as many are longer than that.
        let among = (8 * STRONG / stride).clamp(4, 8 * STRONG);
        let enough = self.length_of_rank(among.min(self.lengths.len() - 1));
        let lengths = || self.gradients.iter().map(|[.., length]| *length);
        self.lengths.clear();
        self.lengths
            .extend(lengths().filter(|length| *length >= enough));
        if self.lengths.len() <= rank {
            self.lengths.clear();
            self.lengths.extend(lengths());
        }
        self.length_of_rank(rank)
    }

    /// The length of so many-th rank, the largest first.
    fn length_of_rank(&mut self, rank: usize) -> f32 {
        *self
            .lengths
            .select_nth_unstable_by(rank, |a, b| b.total_cmp(a))
            .1
    }

    /// Sobel's gradients, each with its length.
    fn find_gradients(&mut self, image: &GrayImage) {
        self.gradients.clear();
        for v in 0..self.height {
            let row = |v: usize| image.row(v, 0, self.width);
            let (above, below) = (v.saturating_sub(1), (v + 1).min(self.height - 1));
            let (above, here, below) = (row(above), row(v), row(below));
            let slope = |l: usize, u: usize, r: usize| {
                let x = above[r] + 2.0 * here[r] + below[r] - above[l] - 2.0 * here[l] - below[l];
                let y = below[l] + 2.0 * below[u] + below[r] - above[l] - 2.0 * above[u] - above[r];
                [x, y, (x * x + y * y).sqrt()]
            };
            // Beyond the border stands its own value.
            let last = self.width - 1;
            self.gradients.push(slope(0, 0, last.min(1)));
            let inner = 1..last;
            self.gradients.extend(inner.map(|u| slope(u - 1, u, u + 1)));
            if last > 0 {
                self.gradients.push(slope(last - 1, last, last));
            }
        }
    }

    /// The centers with most votes, at most `count` of them, best first.
    pub fn strongest(&mut self, count: usize, into: &mut Vec<Center>) {
        into.clear();
        if self.is_bare() {
            return;
        }
        self.smooth();
        let most = largest(&self.smooth);
        // A center with less than a third of the best one's votes is no rival of it.
        let least = most / 3.0;
        for v in 0..self.height {
            let row = &self.smooth[v * self.width..][..self.width];
            if largest(row) <= least {
                continue;
            }
            for (u, &votes) in row.iter().enumerate() {
                if votes <= least || !self.is_peak(u as isize, v as isize, votes) {
                    continue;
                }
                let at = into.partition_point(|c| c.votes >= votes);
                if at < count {
                    into.truncate(count - 1);
                    let (u, v) = (u as f64, v as f64);
                    into.insert(at, Center { u, v, votes });
                }
            }
        }
    }

    /// Whether no pixel nearby has more votes (of equals, the first is the peak).
    fn is_peak(&self, u: isize, v: isize, votes: f32) -> bool {
        let (width, height) = (self.width as isize, self.height as isize);
        // Most are none beside their neighbors.
        let at = (v * width + u) as usize;
        if (u > 0 && self.smooth[at - 1] >= votes) || (u + 1 < width && self.smooth[at + 1] > votes)
        {
            return false;
        }
        for other_v in (v - APART).max(0)..=(v + APART).min(height - 1) {
            for other_u in (u - APART).max(0)..=(u + APART).min(width - 1) {
                let other = self.smooth[(other_v * width + other_u) as usize];
                let before = (other_v, other_u) < (v, u);
                if other > votes || (other == votes && before) {
                    return false;
                }
            }
        }
        true
    }

    /// Sums over 3 x 3 pixels: a center is not known better than that.
    fn smooth(&mut self) {
        let (width, height) = (self.width, self.height);
        self.threes.clear();
        for row in self.counts.chunks_exact(width) {
            let from = self.threes.len();
            self.threes.extend_from_slice(row);
            let sums = &mut self.threes[from..];
            // In this order: sums are those of neighbors from the left to the right.
            for (sum, before) in sums[1..].iter_mut().zip(row) {
                *sum += before;
            }
            for (sum, behind) in sums.iter_mut().zip(&row[1..]) {
                *sum += behind;
            }
        }
        self.smooth.clear();
        for v in 0..height {
            let row = |v: usize| self.threes.get(v * width..(v + 1) * width);
            let here = &self.threes[v * width..][..width];
            let above = v.checked_sub(1).and_then(row);
            let below = row(v + 1);
            self.smooth.extend_from_slice(here);
            let sums = &mut self.smooth[v * width..];
            for other in [above, below].into_iter().flatten() {
                for (sum, x) in sums.iter_mut().zip(other) {
                    *sum += x;
                }
            }
        }
    }
}

/// The largest of numbers from 0 on.
fn largest(numbers: &[f32]) -> f32 {
    let larger = |a: f32, b: f32| if b > a { b } else { a };
    let (blocks, rest) = numbers.as_chunks::<16>();
    let mut most = [0.0; 16];
    for block in blocks {
        for (most, x) in most.iter_mut().zip(block) {
            *most = larger(*most, *x);
        }
    }
    most.iter().chain(rest).copied().fold(0.0, larger)
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use rand_distr::StandardNormal;

    use super::*;

    /// Noise of deviation 1 about 0, with a disc of this brightness and a radius of 15 pixels in it.
    fn noisy(disc: f32, seed: u64) -> GrayImage {
        let rng = ChaCha8Rng::seed_from_u64(seed);
        let noise: Vec<f32> = rng.sample_iter(StandardNormal).take(160 * 120).collect();
        GrayImage::from_fn(160, 120, |u, v| {
            let is_disc = (u as f64 - 70.3).hypot(v as f64 - 61.8) < 15.0;
            noise[v * 160 + u] + if is_disc { disc } else { 0.0 }
        })
    }

    #[test]
    fn noise_alone_has_no_edge_and_a_disc_in_it_has_one() {
        let mut votes = Votes::default();
        let mut is_bare = |image: &GrayImage| {
            votes.look(image, std::iter::empty());
            votes.is_bare()
        };
        let bare = (0..50).filter(|seed| is_bare(&noisy(0.0, *seed))).count();
        assert!(bare >= 48, "{bare} of 50");
        let bare = (0..50).filter(|seed| is_bare(&noisy(5.0, *seed))).count();
        assert!(bare == 0, "{bare} of 50");
        assert!(is_bare(&GrayImage::from_fn(80, 60, |_, _| 0.3)));
    }

    #[test]
    fn a_strong_gradient_is_that_of_its_rank_among_all() {
        for (side, disc) in [(6, 0.0), (40, 3.0), (160, 0.0), (400, 9.0)] {
            let image = noisy(disc, side as u64);
            let image = GrayImage::from_fn(side, side, |u, v| {
                image.values()[v % 120 * 160 + u % 160] * if u < side / 2 { 0.1 } else { 1.0 }
            });
            let mut votes = Votes::default();
            (votes.width, votes.height) = (side, side);
            votes.find_gradients(&image);
            for stride in [1, 7, 200] {
                let every = votes.gradients.iter().step_by(stride);
                votes.lengths = every.map(|[.., length]| *length).collect();
                let found = votes.strong_length(stride);
                let mut all: Vec<f32> = votes.gradients.iter().map(|g| g[2]).collect();
                all.sort_by(|a, b| b.total_cmp(a));
                assert_eq!(found, all[STRONG.min(all.len() - 1)], "{side} {stride}");
            }
        }
    }

    /// Beside the border and far from it a vote falls where its place is rounded to.
    #[test]
    fn votes_fall_on_the_nearest_pixels() {
        let mut votes = Votes::default();
        (votes.width, votes.height) = (60, 50);
        for (place, direction) in [
            ([30, 25], [0.6f32, -0.8f32]),
            ([3, 2], [-0.28, 0.96]),
            ([58, 48], [0.8, -0.6]),
        ] {
            votes.counts = vec![0.0; 60 * 50];
            votes.vote(10..=20, place, direction, 2.0);
            let mut expected = vec![0.0; 60 * 50];
            for radius in 10..=20 {
                let at = [0, 1].map(|k| (place[k] as f32 + radius as f32 * direction[k]).round());
                if (0.0..60.0).contains(&at[0]) && (0.0..50.0).contains(&at[1]) {
                    expected[at[1] as usize * 60 + at[0] as usize] += 2.0;
                }
            }
            assert_eq!(votes.counts, expected, "{place:?}");
        }
    }
}
