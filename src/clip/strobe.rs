//! The images of one ball in one exposure with several flashes, as a sequence in time.
//!
//! Which image was lit by which flash is a hypothesis: the images along the path in one direction or the other, each flash with one image
//! or missed. Between the flashes a ball flies straight, so that with the centers `c_i` at the times `t_i`
//!
//! ```text
//! ln p = sum_i -|c_i - a - b t_i|^2 / (2 s^2)  +  ln p(orientations | spin)  +  m ln(missed) + ...
//! ```
//!
//! with `a`, `b` by least squares, the spin by the crate's own estimators, `m` missed flashes, and an image that is left out paid for by
//! what makes it doubtful. With uneven times both parts know the direction and the missed flash; with two images neither
//! does, and both directions stand at one half unless the direction is given.
//!
//! Guarantees: every hypothesis of a probability of a hundredth or more is listed, the likeliest first; a missed flash or an unknown order
//! is never silently decided. Not modeled: a ball that bounces between two flashes.

use std::f64::consts::TAU;

use nalgebra::Matrix3;

use super::balls::BallEstimate;
use super::orientations;
use super::orientations::NamedFrame;
use crate::error::{Result, require};
use crate::geometry::{CameraFrame, Vec3};
use crate::spin::alias::{AliasConfig, Alternative, alternatives};
use crate::spin::golf::GolfFlight;
use crate::spin::orientations::{OrientationRow, Orientations};
use crate::spin::pair::fit_pair;
use crate::spin::robust::{RobustEstimator, SpinConfig};
use crate::spin::{Fit, MAX_TURNS, MIN_FRAMES, SpinRejection};
use crate::vision::optics::camera::{BallCircle, Pixel};
use crate::vision::outline::circle::is_one_place;

/// Flashes of one exposure, and images that are sorted, at most: an image for each flash.
const MAX_FLASHES: usize = 8;
const MAX_IMAGES: usize = MAX_FLASHES;
/// From the first flash to the last at most, s: a ball that flies has left the picture by then.
const MAX_SPAN_S: f64 = 1.0;
/// Paths whose ln of the likelihood is so far below that of the best are left out before spins are fitted.
const HOPELESS: f64 = 20.0;
/// Places where a missing image is looked for, at most.
const MAX_EXPECTED: usize = 6;
/// Deviation of an image's center from a straight path: pixels, and as a part of the diameter (perspective, outlines that overlap).
const OFF_PX: f64 = 0.5;
const OFF_DIAMETERS: f64 = 0.012;
/// Prior probability that a flash has no image, and that an image with a pose, and one without, is none of the ball's.
const MISSED: f64 = 0.05;
const FALSE_IMAGE: [f64; 2] = [0.005, 0.2];
/// Probability that a pose is wrong, or far less well known than it says, where several do not agree on one spin.
const WRONG_POSE: f64 = 0.01;
/// Where an image that is none of the ball's may lie, diameters squared.
const ANYWHERE: f64 = 50.0;
/// Hypotheses below this probability are not listed.
const LISTED: f64 = 0.01;
/// ln of the density of a wrong orientation: uniform over all rotations, whose vectors fill 8 pi^2.
const LN_UNIFORM: f64 = -4.368_9;

/// The flashes of an exposure.
#[derive(Debug, Clone, PartialEq)]
pub struct Strobe {
    times_s: Vec<f64>,
    flight: Option<GolfFlight>,
    spin: SpinConfig,
}

/// One way in which images and flashes may belong together.
#[derive(Debug, Clone)]
pub struct StrobeHypothesis {
    /// Its probability among all.
    pub probability: f64,
    /// The images, by their numbers, with the flashes that lit them, in order of time.
    pub lit: Vec<(usize, usize)>,
    /// Flashes without an image.
    pub missed: Vec<usize>,
    /// Velocity of the center in the picture, pixels a second (u, v).
    pub velocity_px_s: [f64; 2],
    /// The direction of flight: as given, else the one nearest to that motion.
    pub flight: GolfFlight,
    /// The orientations by the flashes' times.
    pub orientations: Orientations,
    /// The spin with the others that the flashes cannot distinguish from it, or why there is none.
    pub spin: std::result::Result<(Fit, Vec<Alternative>), SpinRejection>,
}

impl Strobe {
    /// Flashes at these times, s; the direction of the flight where it is known.
    ///
    /// # Errors
    /// [`crate::Error::Argument`] for times that do not ascend, are too many or too few, or span more than a second.
    pub fn new(times_s: Vec<f64>, flight: Option<GolfFlight>, spin: SpinConfig) -> Result<Self> {
        check_flashes(&times_s)?;
        Ok(Self {
            times_s,
            flight,
            spin,
        })
    }

    /// Times of the flashes, s.
    pub fn times_s(&self) -> &[f64] {
        &self.times_s
    }

    /// The hypotheses for the images of one ball, the likeliest first; none for fewer than two images. Orientations and spins are in
    /// `frame`.
    pub fn read(&self, balls: &[BallEstimate], frame: CameraFrame) -> Vec<StrobeHypothesis> {
        let images = images_of(balls);
        let mut paths: Vec<FlashPath> = Vec::new();
        for subset in 0u32..1 << images.len() {
            let count = subset.count_ones() as usize;
            if count < 2 || count > self.times_s.len() {
                continue;
            }
            let without = (0..images.len()).filter(|k| subset >> k & 1 == 0);
            let left: f64 = without.map(|k| images[k].ln_false()).sum();
            let ln_missed = (self.times_s.len() - count) as f64 * MISSED.ln();
            let begun = paths.len();
            self.add_paths(&images, subset, &mut paths);
            for path in &mut paths[begun..] {
                path.ln = left + path.ln + ln_missed;
            }
        }
        // Spins are fitted where the path leaves hope.
        let top = paths.iter().map(|p| p.ln).fold(f64::NEG_INFINITY, f64::max);
        paths.retain(|p| p.ln >= top - HOPELESS);
        let weighed = paths.iter().map(|path| {
            let mut hypothesis = self.hypothesis(&images, path);
            let ln = path.ln + self.fit(balls, frame, &mut hypothesis);
            (ln, hypothesis)
        });
        listed(weighed.collect())
    }

    /// Where images that were not found may be: on the straight paths through those that were, which flashes may have lit.
    pub fn expected(&self, balls: &[BallEstimate]) -> Vec<BallCircle> {
        let images: Vec<Image> = balls.iter().enumerate().filter_map(Image::of).collect();
        let count = images.len();
        if count < 2 || count >= self.times_s.len() {
            return Vec::new();
        }
        let mut paths = Vec::new();
        self.add_paths(&images, (1 << count) - 1, &mut paths);
        paths.sort_by(|a, b| b.ln.total_cmp(&a.ln));
        let mut circles: Vec<BallCircle> = Vec::new();
        for path in paths.iter().map(|path| self.hypothesis(&images, path)) {
            let lit = path.lit.iter();
            let known = lit.filter_map(|(ball, flash)| {
                let image = images.iter().find(|i| i.number == *ball)?;
                Some((self.times_s[*flash], image.at, image.radius))
            });
            let known: Vec<_> = known.collect();
            let mean = |of: fn(&(f64, [f64; 2], f64)) -> f64| {
                known.iter().map(of).sum::<f64>() / known.len() as f64
            };
            let (time_s, radius) = (mean(|k| k.0), mean(|k| k.2));
            let (u, v) = (mean(|k| k.1[0]), mean(|k| k.1[1]));
            for flash in &path.missed {
                let late_s = self.times_s[*flash] - time_s;
                let [a, b] = path.velocity_px_s;
                let center = Pixel {
                    u: u + a * late_s,
                    v: v + b * late_s,
                };
                let circle = BallCircle::new(center, radius);
                if circles.len() < MAX_EXPECTED && !circles.iter().any(|c| is_one_place(c, &circle))
                {
                    circles.push(circle);
                }
            }
        }
        circles
    }

    /// The paths through the images of a subset (bits) in both directions or the given one, by all flashes that may have lit them.
    fn add_paths(&self, images: &[Image], subset: u32, paths: &mut Vec<FlashPath>) {
        let (mut ordered, axis) = along_axis(images, subset);
        for is_reversed in [false, true] {
            let direction = axis.map(|a| if is_reversed { -a } else { a });
            let ahead = self.flight.map(|flight| {
                let way = flight.direction();
                direction[0] * way.x - direction[1] * way.y
            });
            if ahead.is_none_or(|ahead| ahead > 0.0) {
                let path = |(ln, flashes, velocity_px_s)| FlashPath {
                    ln,
                    images: subset,
                    flashes,
                    is_reversed,
                    velocity_px_s,
                };
                paths.extend(self.lit_in_order(&ordered).map(path));
            }
            ordered.reverse();
        }
    }

    /// The flashes (bits) that may have lit images in this order, with ln of the likelihood and the velocity.
    fn lit_in_order(&self, images: &[Image]) -> impl Iterator<Item = (f64, u32, [f64; 2])> {
        let count = images.len();
        let mean = images.iter().map(|i| 2.0 * i.radius).sum::<f64>() / count as f64;
        let sigma = OFF_PX + OFF_DIAMETERS * mean;
        let area = ANYWHERE * mean * mean;
        let ln_beyond = (count as f64 - 2.0) * (TAU * sigma * sigma / area).ln();
        let mut timed = Vec::with_capacity(count);
        let all = 0u32..1 << self.times_s.len();
        let possible = all.filter(move |flashes| flashes.count_ones() as usize == count);
        possible.map(move |flashes| {
            let lit = self.times_s.iter().enumerate();
            let lit = lit.filter(|(k, _)| flashes >> k & 1 == 1);
            timed.clear();
            timed.extend(lit.zip(images).map(|((_, t), image)| (*t, image.at)));
            let (velocity_px_s, squares) = straight(&timed);
            let ln = -0.5 * squares / (sigma * sigma) - ln_beyond;
            (ln, flashes, velocity_px_s)
        })
    }

    /// A path as a hypothesis whose spin is not fitted yet.
    fn hypothesis(&self, images: &[Image], path: &FlashPath) -> StrobeHypothesis {
        let (mut ordered, _) = along_axis(images, path.images);
        if path.is_reversed {
            ordered.reverse();
        }
        let (lit, missed): (Vec<usize>, Vec<usize>) =
            (0..self.times_s.len()).partition(|k| path.flashes >> k & 1 == 1);
        let pairs = lit.into_iter().zip(&ordered);
        StrobeHypothesis {
            probability: 0.0,
            lit: pairs.map(|(flash, image)| (image.number, flash)).collect(),
            missed,
            velocity_px_s: path.velocity_px_s,
            flight: self
                .flight
                .unwrap_or(GolfFlight::of_motion(path.velocity_px_s)),
            orientations: Orientations::default(),
            spin: Err(SpinRejection::TooFewFrames {
                found: 0,
                needed: 2,
            }),
        }
    }

    /// Fits the spin of a hypothesis; ln of the orientations' likelihood.
    fn fit(
        &self,
        balls: &[BallEstimate],
        frame: CameraFrame,
        hypothesis: &mut StrobeHypothesis,
    ) -> f64 {
        let named: Vec<NamedFrame<'_>> = hypothesis
            .lit
            .iter()
            .map(|(image, flash)| NamedFrame {
                name: "",
                time_s: Some(self.times_s[*flash]),
                estimate: &balls[*image].frame,
            })
            .collect();
        let file = orientations(&named, frame, true);
        let measurements = file.measurements();
        let config = file.spin_config(self.spin);
        let shared = config.shared.as_ref();
        let covariances = own_covariances(&file.rows, config.sigma_rad);
        let peak = -1.5 * (TAU * config.sigma_rad.powi(2)).ln();
        // Of orientations that do not agree all but so many may be wrong.
        let disagreeing = |right: usize, all: usize| {
            right as f64 * peak + (all - right) as f64 * (LN_UNIFORM + WRONG_POSE.ln())
        };
        let (spin, ln) = match (&measurements[..], &covariances[..]) {
            ([a, b], [c, d]) => {
                let fit = fit_pair(&[*a, *b], &[*c, *d], shared, self.spin.max_rps);
                let ln = disagreeing(agreeing(&fit), 2);
                (fit, ln)
            }
            (several, covariances) if several.len() >= MIN_FRAMES => {
                match RobustEstimator::new(config).fit(several) {
                    Ok(fit) => {
                        let ln = fit.log_likelihood.unwrap_or_default();
                        let mut others = alternatives(several, &fit, &AliasConfig::of(&config));
                        others.truncate(MAX_TURNS);
                        (Ok((fit, others)), ln)
                    }
                    // The two that are known best are then the likeliest to be right.
                    Err(_) => {
                        let [a, b] = best_known(covariances);
                        let pair = [several[a], several[b]];
                        let known = [covariances[a], covariances[b]];
                        let fit = fit_pair(&pair, &known, shared, self.spin.max_rps);
                        (fit, disagreeing(2, several.len()))
                    }
                }
            }
            (few, _) => {
                let rejection = SpinRejection::TooFewFrames {
                    found: few.len(),
                    needed: 2,
                };
                (Err(rejection), few.len() as f64 * peak)
            }
        };
        (hypothesis.spin, hypothesis.orientations) = (spin, file);
        ln
    }
}

/// The covariances of a file's orientations without what they share, rad^2; of those that state none that of the noise.
fn own_covariances(rows: &[OrientationRow], sigma_rad: f64) -> Vec<Matrix3<f64>> {
    let posed = rows.iter().filter(|r| r.orientation.is_some());
    let own = |r: &OrientationRow| match (r.covariance, r.turn) {
        (Some(all), Some(turn)) => all - turn.shared_covariance(),
        (Some(all), None) => all,
        (None, _) => Matrix3::identity() * sigma_rad.powi(2),
    };
    posed.map(own).collect()
}

/// A spin with the others that the flashes cannot distinguish from it, or why there is none.
type FittedSpin = std::result::Result<(Fit, Vec<Alternative>), SpinRejection>;

/// How many orientations of a pair may be right: both, unless no spin up to the limit leads from one to the other.
fn agreeing(fit: &FittedSpin) -> usize {
    match fit {
        Err(
            SpinRejection::NoConsensus { agreeing, .. }
            | SpinRejection::NotAtTheseTimes { agreeing, .. }
            | SpinRejection::NoMotion { agreeing, .. },
        ) => *agreeing,
        _ => 2,
    }
}

/// Checks the times of the flashes of one exposure, s.
///
/// # Errors
/// As [`Strobe::new`].
pub(crate) fn check_flashes(times_s: &[f64]) -> Result<()> {
    let ascend = times_s.windows(2).all(|w| w[1] - w[0] >= 1e-6);
    let span_s = times_s.last().zip(times_s.first()).map(|(a, b)| a - b);
    let inside = (2..=MAX_FLASHES).contains(&times_s.len())
        && ascend
        && times_s.iter().all(|t| t.is_finite())
        && span_s.is_some_and(|span_s| span_s <= MAX_SPAN_S);
    require(
        inside,
        "strobe_ms",
        "2 to 8 times within 1000 ms, each at least 0.001 ms after the one before",
        format_args!("{times_s:?} s"),
    )
}

/// Images on a straight path, each lit by one flash.
#[derive(Debug, Clone, Copy)]
struct FlashPath {
    /// ln of its likelihood.
    ln: f64,
    /// The images, and the flashes that lit them, as bits.
    images: u32,
    flashes: u32,
    /// Whether the images come against their order along the longer axis.
    is_reversed: bool,
    velocity_px_s: [f64; 2],
}

/// The images that are sorted: of too many those without a pose are left out first.
fn images_of(balls: &[BallEstimate]) -> Vec<Image> {
    let mut images: Vec<Image> = balls.iter().enumerate().filter_map(Image::of).collect();
    images.sort_by_key(|image| !image.has_pose);
    images.truncate(MAX_IMAGES);
    images
}

/// The images of a subset (bits) in their order along the longer axis of their places, and that axis.
fn along_axis(images: &[Image], subset: u32) -> (Vec<Image>, [f64; 2]) {
    let within = images.iter().enumerate();
    let within = within.filter(|(k, _)| subset >> k & 1 == 1);
    let mut ordered: Vec<Image> = within.map(|(_, image)| *image).collect();
    let axis = long_axis(&ordered);
    let along = |image: &Image| image.at[0] * axis[0] + image.at[1] * axis[1];
    ordered.sort_by(|a, b| along(a).total_cmp(&along(b)));
    (ordered, axis)
}

/// An image of the ball.
#[derive(Debug, Clone, Copy)]
struct Image {
    number: usize,
    at: [f64; 2],
    radius: f64,
    has_pose: bool,
}

impl Image {
    fn of((number, ball): (usize, &BallEstimate)) -> Option<Self> {
        let BallCircle { center, radius, .. } = ball.circle()?;
        Some(Self {
            number,
            at: [center.u, center.v],
            radius,
            has_pose: ball.frame.pose().is_some(),
        })
    }

    /// ln of the prior odds that it is none of the ball's.
    fn ln_false(&self) -> f64 {
        let p: f64 = FALSE_IMAGE[usize::from(!self.has_pose)];
        (p / (1.0 - p)).ln()
    }
}

/// The two orientations with the least variance, in order.
fn best_known(covariances: &[Matrix3<f64>]) -> [usize; 2] {
    let mut order: Vec<usize> = (0..covariances.len()).collect();
    order.sort_by(|a, b| covariances[*a].trace().total_cmp(&covariances[*b].trace()));
    let (a, b) = (order[0], order[1]);
    [a.min(b), a.max(b)]
}

/// The longer axis of some places.
fn long_axis(images: &[Image]) -> [f64; 2] {
    let count = images.len().max(1) as f64;
    let mean = [0, 1].map(|k| images.iter().map(|i| i.at[k]).sum::<f64>() / count);
    let sum = |a: usize, b: usize| {
        let parts = images
            .iter()
            .map(|i| (i.at[a] - mean[a]) * (i.at[b] - mean[b]));
        parts.sum::<f64>()
    };
    let angle = 0.5 * (2.0 * sum(0, 1)).atan2(sum(0, 0) - sum(1, 1));
    [angle.cos(), angle.sin()]
}

/// The velocity of a straight path through places at times, and the sum of the squares of what they are off.
fn straight(timed: &[(f64, [f64; 2])]) -> ([f64; 2], f64) {
    let count = timed.len() as f64;
    let time = timed.iter().map(|t| t.0).sum::<f64>() / count;
    let spread: f64 = timed.iter().map(|t| (t.0 - time).powi(2)).sum();
    let mut squares = 0.0;
    let velocity = [0, 1].map(|k| {
        let mean = timed.iter().map(|t| t.1[k]).sum::<f64>() / count;
        let parts = timed.iter().map(|t| (t.0 - time) * (t.1[k] - mean));
        let velocity = parts.sum::<f64>() / spread;
        let off = |t: &(f64, [f64; 2])| t.1[k] - mean - velocity * (t.0 - time);
        squares += timed.iter().map(|t| off(t).powi(2)).sum::<f64>();
        velocity
    });
    (velocity, squares)
}

/// The hypotheses with their probabilities, the likeliest first, without those that are hardly likely.
fn listed(found: Vec<(f64, StrobeHypothesis)>) -> Vec<StrobeHypothesis> {
    let top = found.iter().map(|f| f.0).fold(f64::NEG_INFINITY, f64::max);
    let sum: f64 = found.iter().map(|f| (f.0 - top).exp()).sum();
    let mut all: Vec<StrobeHypothesis> = found
        .into_iter()
        .map(|(ln, hypothesis)| StrobeHypothesis {
            probability: (ln - top).exp() / sum,
            ..hypothesis
        })
        .filter(|h| h.probability >= LISTED)
        .collect();
    all.sort_by(|a, b| b.probability.total_cmp(&a.probability));
    all
}

impl StrobeHypothesis {
    /// The spin, frame of the orientations, rad/s.
    pub fn spin(&self) -> Option<Vec3> {
        self.spin.as_ref().ok().map(|(fit, _)| fit.motion.spin)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_leaves_a_straight_path_counts_along_both_axes() {
        let at = |time: f64, u: f64, v: f64| (time, [u, v]);
        // Off the line v = 1/3 by -1/3, 2/3, -1/3; then the same along u.
        let (velocity, squares) =
            straight(&[at(0.0, 0.0, 0.0), at(1.0, 2.0, 1.0), at(2.0, 4.0, 0.0)]);
        assert!((velocity[0] - 2.0).abs() < 1e-12 && velocity[1].abs() < 1e-12);
        assert!((squares - 2.0 / 3.0).abs() < 1e-12, "{squares}");
        let (_, squares) = straight(&[at(0.0, 0.0, 0.0), at(1.0, 1.0, 2.0), at(2.0, 0.0, 4.0)]);
        assert!((squares - 2.0 / 3.0).abs() < 1e-12, "{squares}");
    }
}
