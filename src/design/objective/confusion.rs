//! Analytic confusion rate: the expected rate at which the detected dots of a view are explained by
//! a wrong pose.
//!
//! A view from the direction `v` shows dot `i` with the probability `p_i(v)`, displaced by Gaussian
//! noise of sigma per tangent axis, and false dots of constant density. A wrong pose differs from the
//! true one by a rotation `G` of the pattern. It explains the view as well as the true one with a
//! probability of at most half the Bhattacharyya coefficient of the two distributions of observations
//! (T. Kailath, "The divergence and Bhattacharyya distance measures in signal selection", IEEE
//! Trans. Commun. 15, 1967). For independent dots it is a product over dots, summed over the
//! possible matches:
//!
//! ```text
//! B(G, v) = W(v) W(G v) prod_i (1 + x_i),    W(v) = prod_i u_i(v),
//! x_i = p_i / u_i^2 sum_j exp(-|G q_i - q_j|^2 / (8 sigma^2)),
//! u_i = sqrt(1 - p_i) + sqrt(8 pi sigma^2 f p_i),
//! ```
//!
//! with the density `f` of false dots. `u` is the factor of a dot that the other pose lacks: it was
//! missed, or it passes for a false dot. The term of degree `k` in the `x_i` belongs to `k` matched
//! dots. So one product counts every subset of the dots in view, with misses and false dots.
//!
//! The wrong poses are those that lay a pair of dots on another ([`super::poses`]). `k` matched
//! dots have `k (k - 1) / 2` pairs, and each finds them: each term of degree `k` is divided by this
//! number. The sums `U_k` over poses and views saturate: with `P_k`, the probability of `k` detected
//! dots, the value is
//!
//! ```text
//! sum_(k >= 3) P_k (1 - exp(-U_k / P_k)) .
//! ```
//!
//! Where a protocol gives a fixed number of dots, only that `k` counts, and a view's weight is one
//! over the number of choices. No trial is drawn, so no trial can be over-fitted.
//!
//! Dots that are detected independently are judged by the orientation: poses that turn the ball by less
//! than 10 to 20 degrees are no failures then. A given number of dots is judged by their identities.
//!
//! What it leaves out:
//! - A pose is that of one pair, not the best of all its matches; this counts matches as less alike
//!   than they are.
//! - The likeness of two dots fades to zero between 4 and 5.5 sigma, where it is 0.14 to 0.02.
//! - Where a pattern has more pairs of pairs than [`Confusion::poses_per_square`] asks for, a sample stands for all:
//!   its mean over [`Confusion::sample_seed`] is the sum over all.
//! - The noise of the protocols is a rotation about a random axis, whose projections have heavier
//!   tails than a Gaussian. [`Confusion::tail_factor`] widens sigma for them.

use super::Evaluation;
use super::cube_map::Interpolation;
use super::poses::{Image, Kernel, Match, PoseSearch, WrongPose, add_frame_gradient};
use super::views::{DotModel, MAX_COUNT, VIEWS, ViewSlopes, Views};
use crate::error::{Result, require};
use crate::geometry::{Vec3, angle_between};
use crate::pattern::MAX_DOTS;

/// The likeness of two dots fades between these distances, in sigma.
const REACH: [f64; 2] = [4.0, 5.5];
/// The likeness of two pairs fades between these distances (root of the sum of squares), in sigma.
const PAIR_REACH: [f64; 2] = [3.0, 4.0];
/// Pairs less likely in view than this are skipped.
const MIN_PRODUCT: f64 = 1e-4;
/// Further dots with a smaller factor in a view are left out of it.
const MIN_FACTOR: f64 = 1e-4;
/// Poses with a smaller part than this, in units of the mean, are left out of the derivative.
const NEGLIGIBLE: f64 = 1e-3;
/// Where dots are detected independently, a failure is a wrong orientation. Rotations up to the first
/// of these angles are none, from the second on they are (20 degrees, the SpinDOE paper's), radians.
const SMALL: [f64; 2] = [
    10.0 * std::f64::consts::PI / 180.0,
    20.0 * std::f64::consts::PI / 180.0,
];
/// Poses, for each dot, that are looked at from more views than the others, and from how many times
/// as many.
const TOP_PER_DOT: usize = 12;
const FINER: usize = 8;
/// The survey that finds them takes one in so many of the views of the others.
const SURVEY: usize = 2;
/// Minimum number of matched dots.
const MIN_COUNT: usize = 3;
/// Minimum number of dots that a view can give.
pub const MIN_GIVEN: usize = MIN_COUNT;
/// Maximum number of dots that a view can give, where it is fixed.
pub const MAX_GIVEN: usize = MAX_COUNT;
/// Degrees of the polynomials in the further matches.
const DEGREES: usize = MAX_COUNT - 1;

/// The dots that a view gives.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Detection {
    /// So many of the visible dots at random, [`MIN_GIVEN`] to [`MAX_GIVEN`], and no others.
    Given {
        /// Their number.
        dots: usize,
    },
    /// Each visible dot by itself, and false ones.
    Independent {
        /// Probability that a visible dot is detected.
        probability: f64,
        /// Expected number of false dots of a view.
        false_dots: f64,
    },
}

/// The objective's assumptions about a view.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Confusion {
    /// Noise of a dot, radians per tangent axis.
    pub sigma_rad: f64,
    /// Factor on sigma for tails heavier than a Gaussian's, without unit.
    pub tail_factor: f64,
    /// Minimum z of a dot that can be given.
    pub visibility_limit: f64,
    /// The dots that a view gives.
    pub detection: Detection,
    /// Wrong poses to look at, about, in units of the squared number of dots; beyond, a sample
    /// stands for all.
    pub poses_per_square: f64,
    /// Every pose is judged from one in so many of 400 views, 1 to 200; those that matter most from
    /// eight times as many. The first one differs from pose to pose, so all of them together see
    /// every view.
    pub view_stride: usize,
    /// Seed of the sample.
    pub sample_seed: u64,
}

impl Default for Confusion {
    /// As in the `sparse` protocol: a rotation of N(0, 3 deg) about a random axis, four of the dots
    /// with z > 1/3.
    fn default() -> Self {
        Self {
            sigma_rad: 3f64.to_radians() / 3f64.sqrt(),
            tail_factor: 1.2,
            visibility_limit: 1.0 / 3.0,
            detection: Detection::Given { dots: 4 },
            poses_per_square: 8.0,
            view_stride: 16,
            sample_seed: 0,
        }
    }
}

/// Sums over poses and views, by the number of further matches: of each degree, and of all.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    by_degree: [f64; DEGREES],
    all: f64,
}

/// The derivative of the value with respect to [`Sums`].
type SumSlopes = Sums;

/// The part that each of the pairs among `count` dots has in their match.
fn share(count: usize) -> f64 {
    2.0 / (count * (count - 1)) as f64
}

/// The views that a pose is judged from.
#[derive(Debug, Clone, Copy)]
struct Sample {
    stride: usize,
    /// The bits of the pose's hash that choose the first one.
    shift: u32,
}

impl Sample {
    fn of(stride: usize) -> Self {
        Self { stride, shift: 0 }
    }

    /// Independent of the others: a pose that it shows too small is not small again.
    fn survey(stride: usize) -> Self {
        Self {
            stride: SURVEY * stride,
            shift: 20,
        }
    }
}

/// One pose seen from one view.
struct Sight {
    /// The weights of view and pair.
    weight: f64,
    pair: [[f64; 2]; 2],
    claimed: Option<Interpolation>,
    claimed_direction: Vec3,
}

/// The dots that match beside a pair, each with all that it matches.
#[derive(Debug, Default)]
struct Further {
    dots: Vec<usize>,
    likeness: Vec<f64>,
}

impl Further {
    fn collect(&mut self, matches: &[Match]) {
        self.dots.clear();
        self.likeness.clear();
        for m in matches {
            if self.dots.last() == Some(&m.seen) {
                if let Some(last) = self.likeness.last_mut() {
                    *last += m.likeness.value;
                }
            } else {
                self.dots.push(m.seen);
                self.likeness.push(m.likeness.value);
            }
        }
    }
}

/// A further dot that is in view.
#[derive(Debug, Clone, Copy)]
struct InView {
    /// Its place among the further dots.
    further: usize,
    x: f64,
    matched: f64,
    slope: f64,
}

/// Elementary symmetric polynomials of degree 0 to [`DEGREES`] - 1, and the product of `1 + x`.
fn polynomials(x: &[InView]) -> Sums {
    let mut sums = Sums::one();
    for in_view in x {
        sums.multiply(in_view.x);
    }
    sums
}

impl Sums {
    /// Of no factor.
    fn one() -> Self {
        let mut by_degree = [0.0; DEGREES];
        by_degree[0] = 1.0;
        Self {
            by_degree,
            all: 1.0,
        }
    }

    /// Takes in one more factor.
    fn multiply(&mut self, x: f64) {
        for k in (1..DEGREES).rev() {
            self.by_degree[k] += x * self.by_degree[k - 1];
        }
        self.all *= 1.0 + x;
    }

    fn dot(&self, other: &Self) -> f64 {
        let terms = self.by_degree.iter().zip(&other.by_degree);
        terms.map(|(a, b)| a * b).sum::<f64>() + self.all * other.all
    }

    fn add(&mut self, weight: f64, other: &Self) {
        for (a, b) in self.by_degree.iter_mut().zip(&other.by_degree) {
            *a += weight * b;
        }
        self.all += weight * other.all;
    }
}

impl Confusion {
    /// The expected failure rate, a fraction in [0, 1], and its derivative.
    ///
    /// # Errors
    /// [`crate::Error::Argument`] for parameters outside their domains, and for fewer than 2 or more
    /// than 64 dots.
    pub fn evaluate(&self, dots: &[Vec3]) -> Result<Evaluation> {
        self.evaluate_against(dots, Image::Own)
    }

    /// The same rate for the poses of the pattern's mirror image: how often a view of the ball is
    /// explained as well by that of a mirrored ball. A pattern of low rate tells flipped images from
    /// others.
    ///
    /// # Errors
    /// As [`Confusion::evaluate`].
    pub fn evaluate_mirrored(&self, dots: &[Vec3]) -> Result<Evaluation> {
        self.evaluate_against(dots, Image::Mirrored)
    }

    fn evaluate_against(&self, dots: &[Vec3], image: Image) -> Result<Evaluation> {
        self.check(dots.len())?;
        let sigma = self.sigma_rad * self.tail_factor;
        let views = Views::new(
            dots,
            DotModel::new(self.detection, self.visibility_limit, sigma),
        );
        let search = PoseSearch {
            image,
            kernel: Kernel::new(sigma, REACH[0], REACH[1]),
            pair_kernel: Kernel::new(sigma, PAIR_REACH[0], PAIR_REACH[1]),
            min_matches: match self.detection {
                Detection::Given { dots } => dots - 2,
                Detection::Independent { .. } => MIN_COUNT - 2,
            },
            max_poses: self.poses_per_square * (dots.len() * dots.len()) as f64,
            seed: self.sample_seed,
        };
        let found = search.run(dots);
        let scale = 0.5 / (VIEWS as f64 * found.fraction);
        let others = image.of(dots);
        let mut work = Work {
            dots,
            others: &others,
            sign: image.sign(),
            spare_small: image == Image::Own
                && matches!(self.detection, Detection::Independent { .. }),
            views: &views,
            scale,
            further: Further::default(),
            x: Vec::new(),
            before: Vec::new(),
            by_x: Vec::new(),
        };
        // Few poses have nearly all of the sum: these are looked at again, from more views.
        let matches = |pose: &WrongPose| &found.matches[pose.matches.clone()];
        let mut survey = Sums::default();
        let parts: Vec<f64> = found
            .poses
            .iter()
            .map(|pose| {
                work.add_sums(
                    pose,
                    matches(pose),
                    Sample::survey(self.view_stride),
                    &mut survey,
                )
            })
            .collect();
        let strides = self.strides(&parts, dots.len());
        let mut sums = Sums::default();
        for (pose, stride) in found.poses.iter().zip(&strides) {
            work.add_sums(pose, matches(pose), Sample::of(*stride), &mut sums);
        }
        let negligible = NEGLIGIBLE * parts.iter().sum::<f64>() / parts.len().max(1) as f64;
        let mut slopes = views.slopes();
        let (value, sum_slopes) = self.saturate(&sums, &views, &mut slopes);
        let mut gradient = vec![Vec3::zeros(); dots.len()];
        for ((pose, part), stride) in found.poses.iter().zip(&parts).zip(&strides) {
            if *part > negligible {
                work.add_gradient(
                    pose,
                    matches(pose),
                    *stride,
                    &sum_slopes,
                    &mut slopes,
                    &mut gradient,
                );
            }
        }
        views.add_gradient(dots, &slopes, &mut gradient);
        Ok(Evaluation { value, gradient })
    }

    fn check(&self, dots: usize) -> Result<()> {
        require((2..=MAX_DOTS).contains(&dots), "dots", "2 to 64", dots)?;
        for (name, value) in [
            ("sigma_rad", self.sigma_rad),
            ("tail_factor", self.tail_factor),
            ("poses_per_square", self.poses_per_square),
        ] {
            let inside = value > 0.0 && value.is_finite();
            require(inside, name, "a number above 0", value)?;
        }
        let limit = self.visibility_limit;
        require(
            (-1.0..1.0).contains(&limit),
            "visibility_limit",
            "a z in [-1, 1)",
            limit,
        )?;
        let inside = (1..=VIEWS / SURVEY).contains(&self.view_stride);
        require(inside, "view_stride", "1 to 200", self.view_stride)?;
        match self.detection {
            Detection::Given { dots } => {
                let expected = format!("{MIN_GIVEN} to {MAX_GIVEN}");
                require(
                    (MIN_GIVEN..=MAX_GIVEN).contains(&dots),
                    "dots_given",
                    &expected,
                    dots,
                )
            }
            Detection::Independent {
                probability,
                false_dots,
            } => {
                let inside = probability > 0.0 && probability <= 1.0;
                require(inside, "probability", "a number in (0, 1]", probability)?;
                let inside = false_dots >= 0.0 && false_dots.is_finite();
                require(inside, "false_dots", "a number not below 0", false_dots)
            }
        }
    }

    /// Each pose's stride through the views, by its part in a first survey.
    fn strides(&self, parts: &[f64], dots: usize) -> Vec<usize> {
        let fine = (self.view_stride / FINER).max(1);
        let top = TOP_PER_DOT * dots;
        if parts.len() <= top {
            return vec![fine; parts.len()];
        }
        let mut sorted = parts.to_vec();
        let (_, threshold, _) = sorted.select_nth_unstable_by(top, |a, b| b.total_cmp(a));
        let stride = |part: &f64| {
            if part > threshold {
                fine
            } else {
                self.view_stride
            }
        };
        parts.iter().map(stride).collect()
    }

    /// The value, and its derivatives with respect to the sums; those with respect to the
    /// probabilities of the counts are left in `slopes`.
    fn saturate(&self, sums: &Sums, views: &Views, slopes: &mut ViewSlopes) -> (f64, SumSlopes) {
        let mut by = SumSlopes::default();
        match self.detection {
            Detection::Given { dots } => {
                let union = share(dots) * sums.by_degree[dots - 2];
                by.by_degree[dots - 2] = share(dots) * (-union).exp();
                (1.0 - (-union).exp(), by)
            }
            Detection::Independent { .. } => {
                let mut value = 0.0;
                for count in MIN_COUNT..=MAX_COUNT {
                    let probability = views.count[count].max(f64::MIN_POSITIVE);
                    let last = count == MAX_COUNT;
                    let union = share(count)
                        * if last {
                            let counted: f64 = sums.by_degree[..MAX_COUNT - 2].iter().sum();
                            (sums.all - counted).max(0.0)
                        } else {
                            sums.by_degree[count - 2]
                        };
                    let ratio = union / probability;
                    let rest = (-ratio).exp();
                    value += probability * (1.0 - rest);
                    slopes.count[count] = 1.0 - rest - ratio * rest;
                    let slope = share(count) * rest;
                    if last {
                        by.all += slope;
                        by.by_degree[..MAX_COUNT - 2]
                            .iter_mut()
                            .for_each(|b| *b -= slope);
                    } else {
                        by.by_degree[count - 2] += slope;
                    }
                }
                (value, by)
            }
        }
    }
}

/// What the passes over all poses share.
struct Work<'a> {
    dots: &'a [Vec3],
    /// The dots that they are taken for, each `sign` times the dot.
    others: &'a [Vec3],
    sign: f64,
    /// Whether rotations by less than [`SMALL`] are no failures.
    spare_small: bool,
    views: &'a Views,
    scale: f64,
    further: Further,
    x: Vec<InView>,
    before: Vec<Sums>,
    by_x: Vec<f64>,
}

impl Work<'_> {
    /// How much of a failure a pose is, and the derivative for a turn of its rotation.
    fn wrongness(&self, pose: &WrongPose) -> (f64, Vec3) {
        if !self.spare_small {
            return (1.0, Vec3::zeros());
        }
        let r = &pose.rotation;
        let cosine = 0.5 * (r.trace() - 1.0);
        let [begin, end] = SMALL.map(f64::cos);
        let t = ((begin - cosine) / (begin - end)).clamp(0.0, 1.0);
        // A turn by w changes the trace by -w . axial.
        let axial = Vec3::new(
            r[(2, 1)] - r[(1, 2)],
            r[(0, 2)] - r[(2, 0)],
            r[(1, 0)] - r[(0, 1)],
        );
        let slope = 6.0 * t * (1.0 - t) / (begin - end);
        (t * t * (3.0 - 2.0 * t), 0.5 * slope * axial)
    }

    /// The pose from one view; `None` where the pair is not in view.
    fn sight(&self, pose: &WrongPose, view: usize) -> Option<Sight> {
        let pair = pose.seen.map(|i| self.views.matched(view, i));
        if pair[0][0] * pair[1][0] < MIN_PRODUCT {
            return None;
        }
        // The mirror image shows in a direction what the pattern shows in the opposite one.
        let claimed_direction = self.sign * (pose.rotation * self.views.direction(view));
        let claimed = self
            .views
            .claimed
            .as_ref()
            .map(|c| c.at(&claimed_direction));
        let ln_weight = self.views.ln_weight[view] + claimed.as_ref().map_or(0.0, |c| c.value);
        let weight = ln_weight.exp() * pair[0][0] * pair[1][0];
        Some(Sight {
            weight,
            pair,
            claimed,
            claimed_direction,
        })
    }

    fn views_of(pose: &WrongPose, sample: Sample) -> impl Iterator<Item = usize> + use<> {
        let first = (pose.hash >> sample.shift) as usize % sample.stride;
        (first..VIEWS).step_by(sample.stride)
    }

    /// The factors of the further dots that are in view.
    fn set_x(&mut self, view: usize) {
        self.x.clear();
        for (k, (&i, likeness)) in self
            .further
            .dots
            .iter()
            .zip(&self.further.likeness)
            .enumerate()
        {
            let [matched, slope] = self.views.matched(view, i);
            let x = likeness * matched;
            if x > MIN_FACTOR {
                self.x.push(InView {
                    further: k,
                    x,
                    matched,
                    slope,
                });
            }
        }
    }

    /// Adds a pose's part in all sums; returns a measure of it.
    fn add_sums(
        &mut self,
        pose: &WrongPose,
        matches: &[Match],
        sample: Sample,
        sums: &mut Sums,
    ) -> f64 {
        self.further.collect(matches);
        let (wrongness, _) = self.wrongness(pose);
        if wrongness == 0.0 {
            return 0.0;
        }
        let factor =
            sample.stride as f64 * self.scale * pose.multiplicity * wrongness * pose.likeness.value;
        let mut part = 0.0;
        for view in Self::views_of(pose, sample) {
            if let Some(sight) = self.sight(pose, view) {
                self.set_x(view);
                let polynomials = polynomials(&self.x);
                sums.add(factor * sight.weight, &polynomials);
                part += factor * sight.weight * (polynomials.all - 1.0);
            }
        }
        part
    }

    /// Adds a pose's part in the derivative.
    fn add_gradient(
        &mut self,
        pose: &WrongPose,
        matches: &[Match],
        stride: usize,
        slopes: &SumSlopes,
        by: &mut ViewSlopes,
        gradient: &mut [Vec3],
    ) {
        self.further.collect(matches);
        let (wrongness, by_turn) = self.wrongness(pose);
        let factor = stride as f64 * self.scale * pose.multiplicity * wrongness;
        let mut by_likeness = vec![0.0; self.further.dots.len()];
        let (mut by_pair, mut torque) = (0.0, Vec3::zeros());
        for view in Self::views_of(pose, Sample::of(stride)) {
            let Some(sight) = self.sight(pose, view) else {
                continue;
            };
            self.set_x(view);
            let polynomials = polynomials(&self.x);
            let weight = factor * sight.weight;
            let plain = weight * polynomials.dot(slopes);
            by_pair += plain;
            let value = plain * pose.likeness.value;
            by.ln_weight[view] += value;
            if let Some(claimed) = &sight.claimed {
                for (node, part) in claimed.nodes {
                    by.claimed[node] += part * value;
                }
                torque += value * sight.claimed_direction.cross(&claimed.gradient);
            }
            let v = self.views.direction(view);
            for (i, [matched, slope]) in pose.seen.iter().zip(sight.pair) {
                gradient[*i] += value / matched * slope * v;
            }
            let weight = weight * pose.likeness.value;
            self.slopes_by_x(slopes);
            for (k, in_view) in self.x.iter().enumerate() {
                let by_x = weight * self.by_x[k];
                by_likeness[in_view.further] += by_x * in_view.matched;
                let i = self.further.dots[in_view.further];
                gradient[i] += by_x * self.further.likeness[in_view.further] * in_view.slope * v;
            }
        }
        // |G q_i - q_j|^2 = 2 - 2 G q_i . q_j
        let mut at = 0;
        for m in matches {
            while self.further.dots[at] != m.seen {
                at += 1;
            }
            let slope = -2.0 * by_likeness[at] * m.likeness.slope;
            let moved = pose.rotation * self.dots[m.seen];
            let other = self.others[m.other];
            gradient[m.other] += self.sign * slope * moved;
            gradient[m.seen] += slope * pose.rotation.tr_mul(&other);
            torque += slope * moved.cross(&other);
        }
        torque += by_turn * (by_pair * pose.likeness.value / wrongness);
        // An opposite pair has the opposite midpoint and direction, and the same angle: a move of the
        // dots turns its frame as it turns theirs.
        add_frame_gradient(self.dots, pose.other, &torque, gradient);
        add_frame_gradient(
            self.dots,
            pose.seen,
            &-pose.rotation.tr_mul(&torque),
            gradient,
        );
        self.add_pair_slope(pose, by_pair * pose.likeness.slope, gradient);
    }

    /// Adds the derivative of `slope` times the squared distance of the two pairs, which is
    /// `4 - 4 cos((alpha - beta) / 2)` for their angles.
    fn add_pair_slope(&self, pose: &WrongPose, slope: f64, gradient: &mut [Vec3]) {
        let angle = |[a, b]: [usize; 2]| angle_between(&self.dots[a], &self.dots[b]);
        let difference = angle(pose.seen) - angle(pose.other);
        let by_angle = slope * 2.0 * (0.5 * difference).sin();
        for ([a, b], by_angle) in [(pose.seen, by_angle), (pose.other, -by_angle)] {
            let sine = self.dots[a].cross(&self.dots[b]).norm();
            gradient[a] -= by_angle / sine * self.dots[b];
            gradient[b] -= by_angle / sine * self.dots[a];
        }
    }

    /// The derivatives of the weighted polynomials with respect to each `x`, by the reverse of their
    /// recursion.
    fn slopes_by_x(&mut self, slopes: &SumSlopes) {
        self.before.clear();
        let mut at = Sums::one();
        for in_view in &self.x {
            self.before.push(at);
            at.multiply(in_view.x);
        }
        let mut by = *slopes;
        self.by_x.clear();
        self.by_x.resize(self.x.len(), 0.0);
        for (k, (in_view, before)) in self.x.iter().zip(&self.before).enumerate().rev() {
            let mut slope = by.all * before.all;
            for degree in 1..DEGREES {
                slope += by.by_degree[degree] * before.by_degree[degree - 1];
            }
            self.by_x[k] = slope;
            for degree in 1..DEGREES {
                by.by_degree[degree - 1] += in_view.x * by.by_degree[degree];
            }
            by.all *= 1.0 + in_view.x;
        }
    }
}
