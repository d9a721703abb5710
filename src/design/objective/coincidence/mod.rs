//! Expected rate at which detected dots coincide with the dots of a false pose: for any number of
//! dots, of which a camera shows any number.
//!
//! A view from the direction `v` shows dot `i` with a soft visibility `s_i(v)`; of those in view `k`
//! are detected. Under a false pose, the rotation `R` (at least 20 degrees or so from the true one),
//! dot `i` lies `delta` from the nearest `R p_j`. With Gaussian noise of sigma per tangent axis the
//! evidence of `k` dots for the false pose overtakes that for the true one with a probability of at
//! most `1/2 prod exp(-delta^2 / 8 sigma^2)` (Bhattacharyya's bound; A. Bhattacharyya, Bull.
//! Calcutta Math. Soc. 35, 1943). Averaged over which `k` of the visible dots are detected that is
//! about `1/2 x^k`, with
//!
//! ```text
//! x(v, R) = sum_i s_i g_i / sum_i s_i,      g_i = c + (1 - c) (1 - prod_j (1 - exp(-delta_ij^2 / 8 sigma^2))),
//! ```
//!
//! where `c` is what a dot loses as a false one that coincides with nothing. All false poses together:
//!
//! ```text
//! S_k(v) = int x(v, R)^k dR / V_k,          V_k = (8 pi sigma^2)^(3/2) (2 k / 3)^(-3/2)
//! ```
//!
//! (`V_k` is the volume that a pose of `k` dots takes of the rotations), and the value is
//! `mean_v sum_k P(k) (1 - exp(-S_k(v) / 2))`, with `P(k)` the distribution of the number of detected
//! dots, from three on. `S_k` falls with `k`: from [`MAX_COUNT`] on, its value there bounds the rest.
//!
//! The integral needs no search for look-alikes of `k` dots. With `w_i w_j sin^2` as the weight of a
//! pair of coinciding dots, and `N(R)` the sum over all such pairs, `1 = sum_pairs (w_i w_j sin^2) /
//! N(R)`: the integral becomes a sum over pairs of dots laid on pairs of dots, each integrated at
//! the rotation that lays midpoint on midpoint. Pairs are found by their angles in a sorted list,
//! what else coincides by an index over directions. Where there are many dots the seen pairs are a
//! sample in which every dot occurs alike: the sum over it, scaled, has the whole sum as its mean.
//!
//! What it leaves out: coincidences beyond [`REACH`] sigma (each less than 0.012), the shape of the
//! pairs' weights in their integrals, dots that the false pose shows and nobody detects, noise other
//! than Gaussian. The tests compare it with the integral by random rotations.

mod cells;
mod rivals;

use nalgebra::Matrix3;

use self::rivals::{Rival, Rivals, frame, rivals};
use super::Evaluation;
use super::erfc::normal_tail;
use crate::geometry::{Vec3, spiral_directions};

/// Dots farther apart than this many sigma do not coincide.
const REACH: f64 = 6.0;
/// Pairs are laid on others where dots come this near, in sigma.
const PAIR_REACH: f64 = 2.828_427_124_746_190_3;
/// Rotations by less than the first angle are the true pose; by more than the second, false ones.
const WINDOW_RAD: [f64; 2] = [0.26, 0.44];
/// Viewing directions.
const VIEWS: usize = 128;
/// Least and largest number of detected dots that is counted; all larger ones count as it.
const MIN_COUNT: usize = 3;
const MAX_COUNT: usize = 12;
/// Numbers of detected dots.
const COUNTS: usize = MAX_COUNT - MIN_COUNT + 1;
/// About how many false poses are evaluated, for so many dots.
const RIVALS: [(usize, usize); 3] = [(20, 6_000), (32, 20_000), (64, 100_000)];

/// The objective's assumptions about a view.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Coincidence {
    /// Noise of a dot, radians per tangent axis.
    pub sigma_rad: f64,
    /// Where a dot is detected half as often as one in the middle: its z.
    pub visibility_limit: f64,
    /// Width in z over which detection fades there: of a logistic curve.
    pub softness: f64,
    /// Standard deviation of the limit from view to view.
    pub limit_spread: f64,
    /// Probability that a dot in the middle is detected.
    pub detection_probability: f64,
    /// So many dots are given, of those detected; `None` where it is all.
    pub given: Option<usize>,
    /// What a detected dot that coincides with none weighs beside one that does, in [0, 1).
    pub false_weight: f64,
}

impl Default for Coincidence {
    /// About what a ball of 25 pixels gives.
    fn default() -> Self {
        Self {
            sigma_rad: 0.035,
            visibility_limit: 0.35,
            softness: 0.1,
            limit_spread: 0.2,
            detection_probability: 0.95,
            given: None,
            false_weight: 0.05,
        }
    }
}

/// How well two dots coincide, by their squared distance.
#[derive(Debug, Clone, Copy)]
struct Kernel {
    /// Largest distance that counts.
    reach: f64,
    /// `8 sigma^2`.
    width: f64,
    /// `(pair reach)^2`.
    pair_reach_squared: f64,
}

impl Kernel {
    fn new(sigma: f64) -> Self {
        Self {
            reach: REACH * sigma,
            width: 8.0 * sigma * sigma,
            pair_reach_squared: (PAIR_REACH * sigma).powi(2),
        }
    }

    /// `exp(-d^2 / 8 sigma^2)`, lowered to reach zero with its slope at the reach.
    fn at(&self, squared: f64) -> (f64, f64) {
        let most = REACH * REACH / 8.0;
        let end = (-most).exp();
        let scale = 1.0 / (1.0 - end * (1.0 + most));
        let u = squared / self.width;
        let value = (-u).exp();
        (
            scale * (value - end * (1.0 + most - u)),
            scale * (end - value) / self.width,
        )
    }

    /// The weight of a dot in a pair: `exp(-d^2 / 4 sigma^2)` with a short reach.
    fn pair_weight(&self, squared: f64) -> (f64, f64) {
        let t = 1.0 - squared / self.pair_reach_squared;
        if t > 0.0 {
            (t * t, -2.0 * t / self.pair_reach_squared)
        } else {
            (0.0, 0.0)
        }
    }
}

impl Coincidence {
    /// The expected failure rate, a fraction in [0, 1], and its derivative.
    pub fn evaluate(&self, dots: &[Vec3]) -> Evaluation {
        let kernel = Kernel::new(self.sigma_rad);
        let sample = Sample::of(dots.len(), self.sigma_rad);
        let found = rivals(dots, &kernel, &sample.pairs);
        let views = Views::new(dots, self);
        let mut sums = Sums::default();
        let mut shares = Shares::default();
        let weights: Vec<Weight> = found
            .rivals
            .iter()
            .map(|rival| {
                let weight = Weight::new(dots, &found, rival, &kernel);
                if weight.value > 0.0 {
                    shares.fill(self.false_weight, &found, rival, &views);
                    sums.add(sample.scale * weight.value, &shares, self.false_weight);
                }
                weight
            })
            .collect();
        let closed = views.close(&sums, self.given);
        let mut back = Backward {
            objective: self,
            dots,
            found: &found,
            views: &views,
            kernel: &kernel,
            slopes: &closed.slopes,
            scale: sample.scale,
            by_seen: closed.by_seen,
            by_total: vec![0.0; VIEWS],
            gradient: vec![Vec3::zeros(); dots.len()],
        };
        for (rival, weight) in found.rivals.iter().zip(&weights) {
            if weight.value > 0.0 {
                shares.fill(self.false_weight, &found, rival, &views);
                back.rival(rival, weight, &shares);
            }
        }
        Evaluation {
            value: closed.value,
            gradient: back.finish(),
        }
    }
}

/// The seen pairs that rivals are made from, and the ratio of all pairs to them.
struct Sample {
    pairs: Vec<[usize; 2]>,
    scale: f64,
}

impl Sample {
    /// Pairs of indices that differ by certain steps, so that every dot is in as many.
    fn of(n: usize, sigma: f64) -> Self {
        let wanted = wanted_rivals(n);
        // Of all pairs of pairs so many have nearly equal angles.
        let share = (2.0 * PAIR_REACH * sigma * 2.0 * 0.75).min(1.0);
        let all = n * (n - 1) / 2;
        let each = share * (n * (n - 1)) as f64;
        let half = n / 2;
        let steps = ((wanted as f64 / each / n as f64).ceil() as usize).clamp(1, half);
        let mut pairs = Vec::with_capacity(steps * n);
        for s in 0..steps {
            // Spread over all differences of indices, without a difference twice.
            let step = 1 + s * half / steps;
            for i in 0..n {
                let k = (i + step) % n;
                // Of an even number of dots half the way round is met from both ends.
                if 2 * step != n || i < k {
                    pairs.push([i, k]);
                }
            }
        }
        Self {
            scale: all as f64 / pairs.len() as f64,
            pairs,
        }
    }
}

fn wanted_rivals(n: usize) -> usize {
    let [first, .., last] = RIVALS;
    if n <= first.0 {
        return first.1;
    }
    for ends in RIVALS.windows(2) {
        let [(n0, r0), (n1, r1)] = [ends[0], ends[1]];
        if n <= n1 {
            return r0 + (r1 - r0) * (n - n0) / (n1 - n0);
        }
    }
    last.1
}

/// The dots' probabilities of detection by view, one row of views a dot.
struct Views {
    directions: Vec<Vec3>,
    softness: f64,
    /// The most that a probability can be.
    most: f64,
    seen: Vec<f64>,
    /// Inverse of their sum.
    inverse_total: Vec<f64>,
}

/// The value, with its derivatives by the sums over the rivals and by the visibilities.
struct Closed {
    value: f64,
    slopes: Sums,
    by_seen: Vec<f64>,
}

impl Views {
    fn new(dots: &[Vec3], objective: &Coincidence) -> Self {
        let directions: Vec<Vec3> = spiral_directions(VIEWS).collect();
        // Directions along the spiral have limits of a sequence that is even over any stretch of it.
        let limits: Vec<f64> = (0..VIEWS)
            .map(|v| {
                let share = (0.5 + v as f64 * GOLDEN).fract();
                objective.visibility_limit + objective.limit_spread * normal_quantile(share)
            })
            .collect();
        let mut seen = Vec::with_capacity(dots.len() * VIEWS);
        let mut total = vec![0.0; VIEWS];
        for d in dots {
            for ((v, limit), t) in directions.iter().zip(&limits).zip(&mut total) {
                let s = objective.detection_probability
                    / (1.0 + (-(d.dot(v) - limit) / objective.softness).exp());
                seen.push(s);
                *t += s;
            }
        }
        Self {
            directions,
            softness: objective.softness,
            most: objective.detection_probability,
            seen,
            // A view of less than one dot is none.
            inverse_total: total.iter().map(|t| 1.0 / t.max(1.0)).collect(),
        }
    }

    fn of(&self, dot: usize) -> &[f64] {
        &self.seen[dot * VIEWS..(dot + 1) * VIEWS]
    }

    /// The mean over the views of the probability that too few dots are detected or a rival wins.
    fn close(&self, sums: &Sums, given: Option<usize>) -> Closed {
        let n = self.seen.len() / VIEWS;
        let mut closed = Closed {
            value: 0.0,
            slopes: Sums::default(),
            by_seen: vec![0.0; self.seen.len()],
        };
        let volumes = volumes();
        let share = 1.0 / VIEWS as f64;
        let mut states = vec![[0.0; MAX_COUNT + 1]; n + 1];
        for v in 0..VIEWS {
            // The failure by number of detected dots.
            let mut failure = [1.0; MAX_COUNT + 1];
            let mut left = [0.0; COUNTS];
            for c in 0..COUNTS {
                left[c] = (-0.5 * volumes[c] * sums.of[c][v]).exp();
                failure[MIN_COUNT + c] = 1.0 - left[c];
            }
            let mut counts = [0.0; MAX_COUNT + 1];
            match given {
                Some(k) => counts[k.min(MAX_COUNT)] = 1.0,
                None => {
                    states[0] = [0.0; MAX_COUNT + 1];
                    states[0][0] = 1.0;
                    for i in 0..n {
                        states[i + 1] = with_dot(&states[i], self.seen[i * VIEWS + v]);
                    }
                    counts = states[n];
                    let mut slope = failure.map(|f| share * f);
                    for i in (0..n).rev() {
                        let s = self.seen[i * VIEWS + v];
                        closed.by_seen[i * VIEWS + v] = by_dot(&states[i], &slope);
                        for k in 0..MAX_COUNT {
                            slope[k] += s * (slope[k + 1] - slope[k]);
                        }
                    }
                }
            }
            for (count, failure) in counts.iter().zip(&failure) {
                closed.value += share * count * failure;
            }
            for c in 0..COUNTS {
                let count = counts[MIN_COUNT + c];
                closed.slopes.of[c][v] = share * count * 0.5 * volumes[c] * left[c];
            }
        }
        closed
    }
}

/// The distribution of a number of dots with one more that is detected with the probability `s`; the
/// last place stands for all larger numbers.
fn with_dot(counts: &[f64; MAX_COUNT + 1], s: f64) -> [f64; MAX_COUNT + 1] {
    let mut next = *counts;
    for k in (0..=MAX_COUNT).rev() {
        let stays = if k == MAX_COUNT { 1.0 } else { 1.0 - s };
        let comes = if k == 0 { 0.0 } else { s * counts[k - 1] };
        next[k] = counts[k] * stays + comes;
    }
    next
}

/// The derivative by the probability of that dot, from those by the distribution with it.
fn by_dot(counts: &[f64; MAX_COUNT + 1], slope: &[f64; MAX_COUNT + 1]) -> f64 {
    (0..MAX_COUNT)
        .map(|k| counts[k] * (slope[k + 1] - slope[k]))
        .sum()
}

/// The golden ratio's fraction: its multiples are even over the unit interval.
const GOLDEN: f64 = 0.618_033_988_749_894_9;

/// The quantile of the normal distribution, by bisection of its tail.
fn normal_quantile(share: f64) -> f64 {
    let (mut low, mut high) = (-9.0, 9.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if normal_tail(middle).0 > 1.0 - share {
            low = middle;
        } else {
            high = middle;
        }
    }
    0.5 * (low + high)
}

/// The share of the visible dots that coincide, by direction, for one rival.
struct Shares {
    /// Of each dot that coincides: its number, and how well.
    dots: Vec<(usize, f64)>,
    x: [f64; VIEWS],
}

impl Default for Shares {
    fn default() -> Self {
        Self {
            dots: Vec::new(),
            x: [0.0; VIEWS],
        }
    }
}

impl Shares {
    fn fill(&mut self, floor: f64, found: &Rivals, rival: &Rival, views: &Views) {
        self.dots.clear();
        // Matches come in the order of the seen dots.
        for m in found.matches_of(rival) {
            let seen = usize::from(m.seen);
            match self.dots.last_mut() {
                Some((dot, g)) if *dot == seen => *g = 1.0 - (1.0 - *g) * (1.0 - m.value),
                _ => self.dots.push((seen, m.value)),
            }
        }
        self.x = [0.0; VIEWS];
        for &(dot, g) in &self.dots {
            for (x, s) in self.x.iter_mut().zip(views.of(dot)) {
                *x += g * s;
            }
        }
        for (x, inverse) in self.x.iter_mut().zip(&views.inverse_total) {
            *x = floor + (1.0 - floor) * *x * inverse;
        }
    }
}

/// `(2 k / 3)^(3/2)` for each number of detected dots.
fn volumes() -> [f64; COUNTS] {
    std::array::from_fn(|c| (2.0 * (MIN_COUNT + c) as f64 / 3.0).powf(1.5))
}

/// `S_k(v)`, by number and direction.
struct Sums {
    of: [[f64; VIEWS]; COUNTS],
}

impl Default for Sums {
    fn default() -> Self {
        Self {
            of: [[0.0; VIEWS]; COUNTS],
        }
    }
}

impl Sums {
    fn add(&mut self, weight: f64, shares: &Shares, floor: f64) {
        let mut power: [f64; VIEWS] = std::array::from_fn(|v| weight * shares.x[v].powi(3));
        let mut base = weight * floor.powi(MIN_COUNT as i32);
        for sums in &mut self.of {
            for v in 0..VIEWS {
                sums[v] += power[v] - base;
                power[v] *= shares.x[v];
            }
            base *= floor;
        }
    }
}

/// The weight of a rival in the integral over all rotations, and its derivatives.
struct Weight {
    value: f64,
    /// Its logarithm's derivative by each pair weight `w_i`: `1 / w - dN / N` of the two of the
    /// pair, `-dN / N` of all others; here the matrix `M` with `dN/dw_i = p_i M p_i`.
    invariant: Matrix3<f64>,
    second: f64,
    window: f64,
    window_slope: f64,
}

impl Weight {
    fn new(dots: &[Vec3], found: &Rivals, rival: &Rival, kernel: &Kernel) -> Self {
        let mut moment = Matrix3::zeros();
        let mut own = [0.0; 2];
        for m in found.matches_of(rival) {
            let (w, _) = kernel.pair_weight(squared(dots, rival, m.seen, m.other));
            if w > 0.0 {
                let p = dots[usize::from(m.seen)];
                moment += p * p.transpose() * w;
                for (own, (seen, other)) in own.iter_mut().zip(rival.pair.iter().zip(&rival.onto)) {
                    if (*seen, *other) == (usize::from(m.seen), usize::from(m.other)) {
                        *own = w;
                    }
                }
            }
        }
        let trace = moment.trace();
        // sum over pairs of w_i w_k sin^2(angle) = ((tr T)^2 - |T|^2) / 2, T = sum w p p^T.
        let second = 0.5 * (trace * trace - moment.norm_squared());
        let (window, window_slope) = window(rival.rotation.trace());
        let [i, k] = rival.pair.map(|i| dots[i]);
        let sine = i.cross(&k).norm();
        // The integral of the pair's own weight: (4 pi sigma^2)^(3/2) / (sqrt(2) sine), over that of
        // a pose.
        let value = if own[0] * own[1] > 0.0 && second > 0.0 {
            own[0] * own[1] * sine * window / (4.0 * second)
        } else {
            0.0
        };
        Self {
            value,
            invariant: Matrix3::identity() * trace - moment,
            second,
            window,
            window_slope,
        }
    }
}

fn squared(dots: &[Vec3], rival: &Rival, seen: u16, other: u16) -> f64 {
    let at = rival.rotation * dots[usize::from(other)];
    (dots[usize::from(seen)] - at).norm_squared()
}

/// 0 for rotations that are the true pose, 1 for false ones; by the trace, with its slope.
fn window(trace: f64) -> (f64, f64) {
    let [near, far] = WINDOW_RAD.map(|angle| 1.0 + 2.0 * angle.cos());
    let t = ((near - trace) / (near - far)).clamp(0.0, 1.0);
    (
        t * t * (3.0 - 2.0 * t),
        -6.0 * t * (1.0 - t) / (near - far),
    )
}

/// Collects the derivative.
struct Backward<'a> {
    objective: &'a Coincidence,
    dots: &'a [Vec3],
    found: &'a Rivals,
    views: &'a Views,
    kernel: &'a Kernel,
    slopes: &'a Sums,
    scale: f64,
    /// By a dot's visibility in a direction.
    by_seen: Vec<f64>,
    /// By the sum of the visibilities in a direction.
    by_total: Vec<f64>,
    gradient: Vec<Vec3>,
}

impl Backward<'_> {
    fn rival(&mut self, rival: &Rival, weight: &Weight, shares: &Shares) {
        let floor = self.objective.false_weight;
        let (by_weight, by_share) = self.by_shares(shares);
        let value = self.scale * weight.value;
        let by_ln_weight = by_weight * value;
        // By each direction's sum of what coincides.
        let mut by_sum = [0.0; VIEWS];
        for v in 0..VIEWS {
            let inverse = self.views.inverse_total[v];
            by_sum[v] = value * by_share[v] * (1.0 - floor) * inverse;
            self.by_total[v] -= by_sum[v] * (shares.x[v] - floor) / (1.0 - floor);
        }
        let mut torque = Vec3::zeros();
        let mut next = 0;
        for m in self.found.matches_of(rival) {
            let (seen, other) = (usize::from(m.seen), usize::from(m.other));
            while shares.dots[next].0 != seen {
                next += 1;
            }
            let (_, g) = shares.dots[next];
            let row = seen * VIEWS;
            let mut by_dot = 0.0;
            for (v, by) in by_sum.iter().enumerate() {
                by_dot += by * self.views.seen[row + v];
            }
            if self.is_first(rival, m.seen, m.other) {
                for (v, by) in by_sum.iter().enumerate() {
                    self.by_seen[row + v] += by * g;
                }
            }
            // By the dots' squared distance: through what coincides, and through the weight.
            let others = if m.value < 1.0 { (1.0 - g) / (1.0 - m.value) } else { 0.0 };
            let distance = squared(self.dots, rival, m.seen, m.other);
            let (w, w_slope) = self.kernel.pair_weight(distance);
            let mut by_distance = by_dot * others * m.slope;
            if w > 0.0 {
                let p = self.dots[seen];
                let mut by_w = -p.dot(&(weight.invariant * p)) / weight.second;
                for (s, o) in rival.pair.iter().zip(&rival.onto) {
                    if (*s, *o) == (seen, other) {
                        by_w += 1.0 / w;
                    }
                }
                by_distance += by_ln_weight * by_w * w_slope;
                // By where the seen dot is, in the moments.
                self.gradient[seen] -=
                    by_ln_weight / weight.second * 2.0 * w * (weight.invariant * p);
            }
            let (p, q) = (self.dots[seen], rival.rotation * self.dots[other]);
            self.gradient[seen] -= 2.0 * by_distance * q;
            self.gradient[other] -= 2.0 * by_distance * rival.rotation.tr_mul(&p);
            torque -= 2.0 * by_distance * q.cross(&p);
        }
        if weight.window > 0.0 {
            let r = &rival.rotation;
            let by_trace = by_ln_weight * weight.window_slope / weight.window;
            torque += by_trace
                * Vec3::new(
                    r[(1, 2)] - r[(2, 1)],
                    r[(2, 0)] - r[(0, 2)],
                    r[(0, 1)] - r[(1, 0)],
                );
        }
        let [i, k] = rival.pair;
        let (a, b) = (self.dots[i], self.dots[k]);
        let cross = a.cross(&b);
        let by_cross = by_ln_weight * cross / cross.norm_squared();
        self.gradient[i] += b.cross(&by_cross);
        self.gradient[k] += by_cross.cross(&a);
        self.turn(rival.pair, &torque);
        self.turn(rival.onto, &(-rival.rotation.tr_mul(&torque)));
    }

    /// Whether a match is the first of its seen dot.
    fn is_first(&self, rival: &Rival, seen: u16, other: u16) -> bool {
        let first = self.found.matches_of(rival).iter().find(|m| m.seen == seen);
        first.is_some_and(|m| m.other == other)
    }

    /// The derivatives of the value by a rival's weight, and by its share in each direction over the
    /// weight.
    fn by_shares(&self, shares: &Shares) -> (f64, [f64; VIEWS]) {
        let floor = self.objective.false_weight;
        let mut by_share = [0.0; VIEWS];
        let mut total = [0.0; VIEWS];
        let mut below: [f64; VIEWS] = std::array::from_fn(|v| shares.x[v] * shares.x[v]);
        let mut base = floor.powi(MIN_COUNT as i32);
        for (c, slopes) in self.slopes.of.iter().enumerate() {
            let k = (MIN_COUNT + c) as f64;
            for v in 0..VIEWS {
                by_share[v] += slopes[v] * k * below[v];
                below[v] *= shares.x[v];
                total[v] += slopes[v] * (below[v] - base);
            }
            base *= floor;
        }
        (total.iter().sum(), by_share)
    }

    /// Adds the derivative through the frame of a pair that turns with its dots.
    fn turn(&mut self, [i, k]: [usize; 2], torque: &Vec3) {
        let (a, b) = (self.dots[i], self.dots[k]);
        let Some(frame) = frame(&a, &b) else { return };
        let [mid, normal, third] = [0, 1, 2].map(|c| frame.column(c).into_owned());
        let [t1, t2, t3] = [mid, normal, third].map(|axis| torque.dot(&axis));
        let by_mid = (t3 * normal - t2 * third) / (a + b).norm();
        let by_cross = t1 * third / a.cross(&b).norm();
        self.gradient[i] += by_mid + b.cross(&by_cross);
        self.gradient[k] += by_mid + by_cross.cross(&a);
    }

    /// The derivative, with that through the visibilities.
    fn finish(mut self) -> Vec<Vec3> {
        for (i, gradient) in self.gradient.iter_mut().enumerate() {
            for (v, direction) in self.views.directions.iter().enumerate() {
                let s = self.views.seen[i * VIEWS + v];
                // Where the sum of visibilities is below one it is held there.
                let by_total = if self.views.inverse_total[v] < 1.0 {
                    self.by_total[v] * self.views.inverse_total[v]
                } else {
                    0.0
                };
                let by_s = self.by_seen[i * VIEWS + v] + by_total;
                *gradient += by_s * s * (1.0 - s / self.views.most) / self.views.softness * direction;
            }
        }
        self.gradient
    }
}
