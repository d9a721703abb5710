//! What views show of a pattern, and the failure that follows from it.

use super::{COUNTS, Coincidence, MAX_COUNT, MIN_COUNT, Sums, VIEWS, volumes};
use crate::geometry::{Vec3, spiral_directions};
use crate::pattern::crowding::{CROWD, crowds, nearness};

/// Gauss and Hermite's nodes and weights for the mean over a normal distribution.
const LEVELS: [[f64; 2]; 5] = [
    [-2.856_970_013_872_806, 0.011_257_411_327_720_69],
    [-1.355_626_179_974_266, 0.222_075_922_005_612_6],
    [0.0, 0.533_333_333_333_333_3],
    [1.355_626_179_974_266, 0.222_075_922_005_612_6],
    [2.856_970_013_872_806, 0.011_257_411_327_720_69],
];
/// Share of the dots detected on average at which a view begins to have enough, and by how much
/// more of it the probability of too few falls by `e`.
const ENOUGH: f64 = 0.29;
const SCARCITY: f64 = 0.19;
/// Points of z over which the average view is worked out.
const HEIGHTS: usize = 200;

/// The dots' probabilities of detection.
pub(super) struct Views {
    directions: Vec<Vec3>,
    softness: f64,
    /// The most that a probability can be.
    most: f64,
    /// How much of its logit a dot loses to one that is next to it.
    crowding: f64,
    /// By level, dot and direction.
    by_level: Vec<f64>,
    /// By dot and direction, the mean over the levels.
    seen: Vec<f64>,
    /// `1 / e_k` of them over all dots, at most 1: a view of fewer dots is none.
    pub inverse_subsets: [[f64; VIEWS]; COUNTS],
    /// The probability that so many dots are too few to be sure of any pose.
    scarce: [f64; MAX_COUNT + 1],
    given: Option<usize>,
}

/// The value, with its derivatives by the sums over the rivals and by the probabilities.
pub(super) struct Closed {
    pub value: f64,
    pub slopes: Sums,
    /// As [`Views`] has them by level.
    by_level: Vec<f64>,
}

/// The share of a logistic curve.
fn logistic(logit: f64) -> f64 {
    1.0 / (1.0 + (-logit).exp())
}

impl Views {
    pub fn new(dots: &[Vec3], objective: &Coincidence) -> Self {
        let directions: Vec<Vec3> = spiral_directions(VIEWS).collect();
        let most = objective.detection_probability;
        let crowds = crowds(dots);
        let mut by_level = Vec::with_capacity(LEVELS.len() * dots.len() * VIEWS);
        let mut seen = vec![0.0; dots.len() * VIEWS];
        for [level, weight] in LEVELS {
            let limit = objective.visibility_limit + objective.limit_spread * level;
            for (i, (d, crowd)) in dots.iter().zip(&crowds).enumerate() {
                let lost = objective.crowding * crowd;
                for (v, direction) in directions.iter().enumerate() {
                    let logit = (d.dot(direction) - limit) / objective.softness - lost;
                    let s = most * logistic(logit);
                    by_level.push(s);
                    seen[i * VIEWS + v] += weight * s;
                }
            }
        }
        Self {
            directions,
            softness: objective.softness,
            most,
            crowding: objective.crowding,
            by_level,
            inverse_subsets: inverse_subsets(&seen),
            seen,
            scarce: scarce(objective, dots.len()),
            given: objective.given,
        }
    }

    /// The mean probabilities of a dot, by direction.
    pub fn of(&self, dot: usize) -> &[f64] {
        &self.seen[dot * VIEWS..(dot + 1) * VIEWS]
    }

    /// The mean over the views of the probability that too few dots are detected or a rival wins.
    pub fn close(&self, sums: &Sums) -> Closed {
        let n = self.seen.len() / VIEWS;
        let mut closed = Closed {
            value: 0.0,
            slopes: Sums::default(),
            by_level: vec![0.0; self.by_level.len()],
        };
        let volumes = volumes();
        let mut states = vec![[0.0; MAX_COUNT + 1]; n + 1];
        for v in 0..VIEWS {
            // The failure by number of detected dots.
            let mut failure = self.scarce;
            let mut left = [0.0; COUNTS];
            for c in 0..COUNTS {
                let enough = 1.0 - self.scarce[MIN_COUNT + c];
                left[c] = enough * (-0.5 * volumes[c] * sums.of[c][v]).exp();
                failure[MIN_COUNT + c] = 1.0 - left[c];
            }
            let counts = match self.given {
                Some(k) => {
                    let mut counts = [0.0; MAX_COUNT + 1];
                    counts[k.min(MAX_COUNT)] = 1.0 / VIEWS as f64;
                    counts
                }
                None => self.counts(v, &failure, &mut states, &mut closed.by_level),
            };
            for (count, failure) in counts.iter().zip(&failure) {
                closed.value += count * failure;
            }
            for c in 0..COUNTS {
                closed.slopes.of[c][v] = counts[MIN_COUNT + c] * 0.5 * volumes[c] * left[c];
            }
        }
        closed
    }

    /// The distribution of the number of detected dots in a direction, over the number of directions;
    /// adds the derivatives of the failure by the probabilities.
    fn counts(
        &self,
        v: usize,
        failure: &[f64; MAX_COUNT + 1],
        states: &mut [[f64; MAX_COUNT + 1]],
        by_level: &mut [f64],
    ) -> [f64; MAX_COUNT + 1] {
        let n = states.len() - 1;
        let mut counts = [0.0; MAX_COUNT + 1];
        for (l, [_, weight]) in LEVELS.iter().enumerate() {
            let share = weight / VIEWS as f64;
            let place = |i: usize| (l * n + i) * VIEWS + v;
            states[0] = [0.0; MAX_COUNT + 1];
            states[0][0] = share;
            for i in 0..n {
                states[i + 1] = with_dot(&states[i], self.by_level[place(i)]);
            }
            for (count, at_level) in counts.iter_mut().zip(&states[n]) {
                *count += at_level;
            }
            let mut slope = *failure;
            for i in (0..n).rev() {
                let s = self.by_level[place(i)];
                let mut by_dot = 0.0;
                for k in 0..MAX_COUNT {
                    let step = slope[k + 1] - slope[k];
                    by_dot += states[i][k] * step;
                    slope[k] += s * step;
                }
                by_level[place(i)] += by_dot;
            }
        }
        counts
    }

    /// Adds the derivatives by the mean probabilities through `1 / e_k`, by which the sums go.
    pub fn add_by_subsets(&self, sums: &Sums, slopes: &Sums, by_seen: &mut [f64]) {
        let n = self.seen.len() / VIEWS;
        let mut states = vec![[0.0; MAX_COUNT + 1]; n + 1];
        for v in 0..VIEWS {
            let mut slope = [0.0; MAX_COUNT + 1];
            for c in 0..COUNTS {
                let inverse = self.inverse_subsets[c][v];
                // Where it is held at one it does not change.
                if inverse < 1.0 {
                    slope[MIN_COUNT + c] = -slopes.of[c][v] * sums.of[c][v] * inverse;
                }
            }
            states[0] = [0.0; MAX_COUNT + 1];
            states[0][0] = 1.0;
            for i in 0..n {
                states[i + 1] = with_term(&states[i], self.seen[i * VIEWS + v]);
            }
            for i in (0..n).rev() {
                let s = self.seen[i * VIEWS + v];
                for k in 0..MAX_COUNT {
                    by_seen[i * VIEWS + v] += slope[k + 1] * states[i][k];
                    slope[k] += s * slope[k + 1];
                }
            }
        }
    }

    /// Adds the derivative through the probabilities, given that by their means.
    pub fn add_gradient(
        &self,
        dots: &[Vec3],
        closed: &Closed,
        by_seen: &[f64],
        gradient: &mut [Vec3],
    ) {
        let n = dots.len();
        let mut by_crowd = vec![0.0; n];
        for (l, [_, weight]) in LEVELS.iter().enumerate() {
            for i in 0..n {
                for (v, direction) in self.directions.iter().enumerate() {
                    let at = (l * n + i) * VIEWS + v;
                    let s = self.by_level[at];
                    let by_logit = (closed.by_level[at] + weight * by_seen[i * VIEWS + v])
                        * s
                        * (1.0 - s / self.most);
                    gradient[i] += by_logit / self.softness * direction;
                    by_crowd[i] -= by_logit * self.crowding;
                }
            }
        }
        for i in 0..n {
            for j in 0..i {
                let apart = dots[i] - dots[j];
                let by_nearness = by_crowd[i] + by_crowd[j];
                let slope = by_nearness * nearness(&dots[i], &dots[j]) / (CROWD * CROWD);
                gradient[i] -= slope * apart;
                gradient[j] += slope * apart;
            }
        }
    }
}

/// `1 / e_k` of the visibilities in each direction, at most 1.
fn inverse_subsets(seen: &[f64]) -> [[f64; VIEWS]; COUNTS] {
    let mut inverse = [[1.0; VIEWS]; COUNTS];
    for v in 0..VIEWS {
        let mut sums = [0.0; MAX_COUNT + 1];
        sums[0] = 1.0;
        for s in seen.iter().skip(v).step_by(VIEWS) {
            sums = with_term(&sums, *s);
        }
        for (inverse, sum) in inverse.iter_mut().zip(&sums[MIN_COUNT..]) {
            inverse[v] = 1.0 / sum.max(1.0);
        }
    }
    inverse
}

/// The elementary symmetric polynomials with one more term.
fn with_term(sums: &[f64; MAX_COUNT + 1], term: f64) -> [f64; MAX_COUNT + 1] {
    let mut next = *sums;
    for k in 0..MAX_COUNT {
        next[k + 1] += term * sums[k];
    }
    next
}

/// The probability that so many dots are too few: all but certain far below the number that a view
/// shows on average, for then other explanations than this pattern are as likely.
fn scarce(objective: &Coincidence, dots: usize) -> [f64; MAX_COUNT + 1] {
    let mut scarce = [0.0; MAX_COUNT + 1];
    scarce[..MIN_COUNT].fill(1.0);
    if objective.given.is_none() {
        let mean = dots as f64 * mean_probability(objective);
        for (k, scarce) in scarce.iter_mut().enumerate().skip(MIN_COUNT) {
            *scarce = ((ENOUGH - k as f64 / mean) / SCARCITY).exp().min(1.0);
        }
    }
    scarce
}

/// The probability that a dot anywhere on the ball is detected.
fn mean_probability(objective: &Coincidence) -> f64 {
    let height = |h: usize| 2.0 * (h as f64 + 0.5) / HEIGHTS as f64 - 1.0;
    let at = |limit: f64| {
        let all = (0..HEIGHTS).map(|h| logistic((height(h) - limit) / objective.softness));
        all.sum::<f64>() / HEIGHTS as f64
    };
    let levels = LEVELS.iter().map(|[level, weight]| {
        weight * at(objective.visibility_limit + objective.limit_spread * level)
    });
    objective.detection_probability * levels.sum::<f64>()
}

/// The distribution of a number of dots with one more that is detected with the probability `s`; the
/// last place stands for all larger numbers.
fn with_dot(counts: &[f64; MAX_COUNT + 1], s: f64) -> [f64; MAX_COUNT + 1] {
    let mut next = [0.0; MAX_COUNT + 1];
    for k in 0..MAX_COUNT {
        next[k] += (1.0 - s) * counts[k];
        next[k + 1] += s * counts[k];
    }
    next[MAX_COUNT] += counts[MAX_COUNT];
    next
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_number_of_detected_dots_is_distributed_as_all_subsets_say() {
        let chances = [0.3, 0.9, 0.05, 0.6, 0.5];
        let mut counts = [0.0; MAX_COUNT + 1];
        counts[0] = 1.0;
        for s in chances {
            counts = with_dot(&counts, s);
        }
        let mut brute = [0.0; MAX_COUNT + 1];
        for subset in 0..1 << chances.len() {
            let is_in = |i: usize| subset >> i & 1 == 1;
            let factors = chances.iter().enumerate();
            let share: f64 = factors
                .map(|(i, s)| if is_in(i) { *s } else { 1.0 - s })
                .product();
            brute[(subset as u32).count_ones() as usize] += share;
        }
        for (found, expected) in counts.iter().zip(&brute) {
            assert!((found - expected).abs() < 1e-12, "{found} {expected}");
        }
    }

    #[test]
    fn the_levels_weigh_a_normal_distribution() {
        let moment = |power: i32| -> f64 { LEVELS.iter().map(|[x, w]| w * x.powi(power)).sum() };
        for (power, expected) in [
            (0, 1.0),
            (1, 0.0),
            (2, 1.0),
            (4, 3.0),
            (6, 15.0),
            (8, 105.0),
        ] {
            assert!((moment(power) - expected).abs() < 1e-9, "{power}");
        }
    }
}
