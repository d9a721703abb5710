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
use super::{NamedFrame, orientations};
use crate::error::{Result, require};
use crate::geometry::{CameraFrame, Vec3};
use crate::spin::alias::{AliasConfig, Alternative, alternatives};
use crate::spin::golf::Flight;
use crate::spin::orientations::Orientations;
use crate::spin::pair::fit_pair;
use crate::spin::robust::{RobustEstimator, SpinConfig};
use crate::spin::{Fit, MIN_FRAMES, SpinRejection};
use crate::vision::camera::{BallCircle, Pixel};
use crate::vision::circle::is_one_place;

/// Flashes of one exposure, and images that are sorted, at most.
const MAX_FLASHES: usize = 12;
const MAX_IMAGES: usize = 8;
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
    flight: Option<Flight>,
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
    pub flight: Flight,
    /// The orientations by the flashes' times.
    pub orientations: Orientations,
    /// The spin with the others that the flashes cannot tell apart, or why there is none.
    pub spin: std::result::Result<(Fit, Vec<Alternative>), SpinRejection>,
}

impl Strobe {
    /// Flashes at these times, s; the direction of the flight where it is known.
    ///
    /// # Errors
    /// [`crate::Error::Argument`] for times that do not ascend or are too many or too few.
    pub fn new(times_s: Vec<f64>, flight: Option<Flight>, spin: SpinConfig) -> Result<Self> {
        let ascend = times_s.windows(2).all(|w| w[1] - w[0] >= 1e-6);
        let inside = (2..=MAX_FLASHES).contains(&times_s.len())
            && ascend
            && times_s.iter().all(|t| t.is_finite());
        require(
            inside,
            "strobe_ms",
            "2 to 12 times, each at least 0.001 ms after the one before",
            format_args!("{times_s:?} s"),
        )?;
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
        let images: Vec<Image> = balls.iter().enumerate().filter_map(Image::of).collect();
        // Those with a pose come first.
        let images = &images[..images.len().min(MAX_IMAGES)];
        let mut found: Vec<(f64, StrobeHypothesis)> = Vec::new();
        for subset in 0u32..1 << images.len() {
            let is_in = |k: &usize| subset >> k & 1 == 1;
            let count = subset.count_ones() as usize;
            if count < 2 || count > self.times_s.len() {
                continue;
            }
            let (within, without): (Vec<usize>, Vec<usize>) = (0..images.len()).partition(is_in);
            let left: f64 = without.iter().map(|k| images[*k].ln_false()).sum();
            // Cheap and hopeless: an image with a pose is left out only where there are more images than flashes or it is off the path.
            let within: Vec<Image> = within.iter().map(|k| images[*k]).collect();
            for (ln_path, path) in self.paths(&within) {
                let ln_missed = (self.times_s.len() - count) as f64 * MISSED.ln();
                found.push((left + ln_path + ln_missed, path));
            }
        }
        // Spins are fitted where the path leaves hope.
        let top = found.iter().map(|f| f.0).fold(f64::NEG_INFINITY, f64::max);
        found.retain(|f| f.0 >= top - 20.0);
        for (ln, hypothesis) in &mut found {
            *ln += self.fit(balls, frame, hypothesis);
        }
        listed(found)
    }

    /// Where images that were not found may be: on the straight paths through those that were, which flashes may have lit.
    pub fn expected(&self, balls: &[BallEstimate]) -> Vec<BallCircle> {
        let images: Vec<Image> = balls.iter().enumerate().filter_map(Image::of).collect();
        let count = images.len();
        if count < 2 || count >= self.times_s.len() {
            return Vec::new();
        }
        let mut paths = self.paths(&images);
        paths.sort_by(|a, b| b.0.total_cmp(&a.0));
        let mut circles: Vec<BallCircle> = Vec::new();
        for (_, path) in &paths {
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

    /// The flashes that may have lit these images, in both directions or the given one; with ln of their likelihood.
    fn paths(&self, images: &[Image]) -> Vec<(f64, StrobeHypothesis)> {
        let axis = long_axis(images);
        let along = |image: &Image| image.at[0] * axis[0] + image.at[1] * axis[1];
        let mut ordered = images.to_vec();
        ordered.sort_by(|a, b| along(a).total_cmp(&along(b)));
        let mut found = Vec::new();
        for sign in [1.0, -1.0] {
            let direction = axis.map(|a| sign * a);
            let ahead = self.flight.map(|flight| {
                let way = flight.direction();
                direction[0] * way.x - direction[1] * way.y
            });
            if ahead.is_none_or(|ahead| ahead > 0.0) {
                self.lit_in_order(&ordered, &mut found);
            }
            ordered.reverse();
        }
        found
    }

    fn lit_in_order(&self, images: &[Image], found: &mut Vec<(f64, StrobeHypothesis)>) {
        let (all, count) = (self.times_s.len(), images.len());
        for flashes in 0u32..1 << all {
            if flashes.count_ones() as usize != count {
                continue;
            }
            let (lit, missed): (Vec<usize>, Vec<usize>) =
                (0..all).partition(|k| flashes >> k & 1 == 1);
            let pairs = lit.iter().zip(images);
            let timed: Vec<(f64, [f64; 2])> = pairs
                .clone()
                .map(|(flash, image)| (self.times_s[*flash], image.at))
                .collect();
            let (velocity_px_s, squares) = straight(&timed);
            let mean = images.iter().map(|i| 2.0 * i.radius).sum::<f64>() / count as f64;
            let sigma = OFF_PX + OFF_DIAMETERS * mean;
            let beyond = count as f64 - 2.0;
            let area = ANYWHERE * mean * mean;
            let ln = -0.5 * squares / (sigma * sigma) - beyond * (TAU * sigma * sigma / area).ln();
            let hypothesis = StrobeHypothesis {
                probability: 0.0,
                lit: pairs.map(|(flash, image)| (image.number, *flash)).collect(),
                missed,
                velocity_px_s,
                flight: self.flight.unwrap_or(Flight::of_motion(velocity_px_s)),
                orientations: Orientations::default(),
                spin: Err(SpinRejection::TooFewFrames {
                    found: 0,
                    needed: 2,
                }),
            };
            found.push((ln, hypothesis));
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
        let posed = file.rows.iter().filter(|r| r.orientation.is_some());
        let covariances: Vec<Matrix3<f64>> = posed
            .map(|r| {
                r.covariance
                    .unwrap_or(Matrix3::identity() * config.sigma_rad.powi(2))
            })
            .collect();
        let peak = -1.5 * (TAU * config.sigma_rad.powi(2)).ln();
        let (spin, ln) = match (&measurements[..], &covariances[..]) {
            ([a, b], [c, d]) => {
                let fit = fit_pair(&[*a, *b], &[*c, *d], self.spin.max_rps);
                (fit, 2.0 * peak)
            }
            (several, covariances) if several.len() >= MIN_FRAMES => {
                match RobustEstimator::new(config).fit(several) {
                    Ok(fit) => {
                        let listed = AliasConfig {
                            max_rps: self.spin.max_rps,
                            sigma_rad: config.sigma_rad,
                            ..AliasConfig::default()
                        };
                        let ln = fit.log_likelihood.unwrap_or_default();
                        let others = alternatives(several, &fit, &listed);
                        (Ok((fit, others)), ln)
                    }
                    // Of orientations that do not agree all but the two that are known best may be wrong.
                    Err(_) => {
                        let [a, b] = best_known(covariances);
                        let pair = [several[a], several[b]];
                        let fit =
                            fit_pair(&pair, &[covariances[a], covariances[b]], self.spin.max_rps);
                        let wrong = several.len() as f64 - 2.0;
                        (fit, 2.0 * peak + wrong * (LN_UNIFORM + WRONG_POSE.ln()))
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
