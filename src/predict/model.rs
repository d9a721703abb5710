//! The detection model: what the estimator's first stages give for a ball that is not rendered.
//!
//! For every dot in sight the probability that it is found, as a likely dot or as a doubtful one
//! (the two thresholds of [`EstimatorConfig::dot_confidence`]), the covariance that the detector
//! states and how far off the detection is in units of it; for the ball whether its outline is
//! found, the outline's error, and the number and place of false dots. All are [`Regression`]s on
//! the numbers of [`crate::synth::observables`]; what is left beyond them is drawn from the
//! quantiles of the residuals, and dots of a frame share one random effect. The file
//! `models/camera.json` ships the coefficients, the domain in which they were learned, and how they
//! came about.
//!
//! These are of the detector's first look; [`SecondLook`] is what another look at a frame in doubt changes. What
//! lasts over a sequence is in [`super::lasting`]. What is not modeled: detections that merge two dots, false
//! dots that stay at their place from frame to frame, errors of single dots that last.
//!
//! [`EstimatorConfig::dot_confidence`]: crate::vision::EstimatorConfig

use std::f64::consts::TAU;

use nalgebra::{Matrix2, Matrix3, Vector2};
use rand::{Rng, RngExt};
use rand_distr::{Distribution, Gamma, Poisson, StandardNormal};
use serde::{Deserialize, Serialize};

use super::lasting::{Shares, Variates};
use super::learn::{Found, Observation, beyond_expected};
use super::quantiles::Quantiles;
use super::regression::{Regression, Scaling};
use super::second_look::SecondLook;
use crate::error::{Error, Result};
use crate::stats::normal_cdf;
use crate::synth::observables::{BALL_OBSERVABLES, DOT_OBSERVABLES, SeenBall, SeenDot};
use crate::vision::camera::{BallCircle, Pixel};
use crate::vision::detect::DotDetection;
use crate::vision::estimator::{FrameEstimate, Outline};

/// The file's version.
pub const VERSION: u32 = 4;
/// Below this cosine no dot is found.
pub(super) const MIN_FACING: f64 = 0.05;
/// Confidences that stand for likely and for doubtful detections.
pub(super) const CONFIDENCE: [f64; 2] = [0.9, 0.3];
/// Bounds of a stated standard deviation, pixels.
const SIGMA_PX: [f64; 2] = [0.02, 10.0];

/// How a model came about.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Provenance {
    /// Rendered frames from which it was learned.
    pub frames: usize,
    /// Their seed.
    pub seed: u64,
    /// SHA-256 of the detector's weights that read them.
    pub weights_sha256: String,
    /// SHA-256 of the weights of the net for frames in doubt.
    pub large_sha256: String,
    /// SHA-256 of the weights of the net for outlines.
    pub outline_sha256: String,
}

/// A mean with the quantiles of what is left, which differ with how easy the case is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Spread {
    /// The mean.
    pub mean: Regression,
    /// For each class of cases ([`Classes`]) the residuals.
    pub residuals: Vec<Quantiles>,
}

impl Spread {
    fn draw<R: Rng + ?Sized>(&self, terms: &[f64], class: usize, rng: &mut R) -> f64 {
        self.at(terms, class, rng.random())
    }

    /// The value of a probability.
    fn at(&self, terms: &[f64], class: usize, probability: f64) -> f64 {
        self.mean.value(terms) + self.residuals[class].at(probability)
    }

    /// The probability of a value.
    pub(super) fn level(&self, terms: &[f64], class: usize, value: f64) -> f64 {
        self.residuals[class].level(value - self.mean.value(terms))
    }
}

/// Classes of cases by the linear predictor of a probability: hard ones first.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Classes {
    /// The predictor's value between one class and the next, ascending.
    pub borders: Vec<f64>,
}

impl Classes {
    /// The class of a case.
    pub fn of(&self, predictor: f64) -> usize {
        self.borders.partition_point(|b| *b <= predictor)
    }

    /// Their number.
    pub fn count(&self) -> usize {
        self.borders.len() + 1
    }
}

/// A probability in place of one that is off in some of its range: straight between the points of a
/// table of predictors.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Recalibration {
    /// Predictors, ascending.
    pub from: Vec<f64>,
    /// What they should be.
    pub to: Vec<f64>,
}

impl Recalibration {
    /// The corrected probability.
    pub fn probability(&self, predictor: f64) -> f64 {
        let (from, to) = (&self.from, &self.to);
        let at = from.partition_point(|b| *b <= predictor);
        let eta = match (at, from.len()) {
            (_, 0) => predictor,
            (0, _) => to[0],
            (at, n) if at == n => to[n - 1],
            (at, _) => {
                let share = (predictor - from[at - 1]) / (from[at] - from[at - 1]).max(1e-9);
                to[at - 1] + share * (to[at] - to[at - 1])
            }
        };
        1.0 / (1.0 + (-eta).exp())
    }
}

/// Counts of false dots.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FalseDots {
    /// Their expected number.
    pub rate: Regression,
    /// Shape of the gamma distribution by which single frames' rates differ from it, by class of
    /// balls.
    pub shape: Vec<f64>,
    /// Share of them that lie on print or beside it, where the ball is printed on.
    pub on_print: f64,
    /// The others' distance from the middle, ball radii.
    pub distance: Quantiles,
    /// The logarithm of their stated variance, ball radii squared.
    pub ln_variance: Quantiles,
}

/// See the module.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DetectionModel {
    /// The file's version.
    pub version: u32,
    /// How it came about.
    pub provenance: Provenance,
    /// Names of the dots' covariates.
    pub dot_names: Vec<String>,
    /// Names of the ball's covariates.
    pub ball_names: Vec<String>,
    /// Scaling of the dots' covariates.
    pub dots: Scaling,
    /// Scaling of the ball's covariates, for the probability of its outline: without products, so that
    /// no corner is extrapolated.
    pub ball: Scaling,
    /// The same with products, for all else.
    pub ball_products: Scaling,
    /// Probability that a dot is found as a likely one.
    pub likely: Regression,
    /// Probability that one which is not is found as a doubtful one.
    pub doubtful: Regression,
    /// Classes of dots by the predictor of `likely`.
    pub dot_classes: Classes,
    /// Standard deviation of the shift that the dots of a frame share in the logit of `likely`, by
    /// class of balls.
    pub frame_effect: Vec<f64>,
    /// Logarithm of the stated variance along the ball's radius and across it, px^2.
    pub ln_variance: [Spread; 2],
    /// Logarithm of the squared error over the stated covariance, by dimension.
    pub ln_error: Spread,
    /// What a doubtful detection adds to the variances and to the error.
    pub of_doubtful: [f64; 2],
    /// Probability that the outline is found within [`GOOD_OUTLINE`] radii.
    pub outline: Regression,
    /// What that probability is corrected to.
    pub outline_correction: Recalibration,
    /// Classes of balls by the predictor of `outline`.
    pub ball_classes: Classes,
    /// Logarithm of the outline's stated variance, of its center and of its radius, radii squared.
    pub outline_ln_variance: [Spread; 2],
    /// Logarithm of the squared error of its center, by dimension, and of its radius, over the stated
    /// variances. Apart: blur moves the radius and leaves the center where it is.
    pub outline_ln_error: [Spread; 2],
    /// Share of the outline that the edges show.
    pub support: Spread,
    /// Probability of a wrong answer where the outline is not found.
    pub wrong_without_outline: f64,
    /// False dots, likely and doubtful ones.
    pub false_dots: [FalseDots; 2],
    /// What of it lasts over a sequence.
    pub shares: Shares,
    /// What another look at a frame in doubt changes.
    pub second_look: SecondLook,
}

/// Largest error of the center, and of the radius, of an outline that counts as found, radii.
pub const GOOD_OUTLINE: f64 = 0.1;

/// What the first stages find of a ball.
#[derive(Debug, Clone)]
pub struct Detected {
    /// The frame, not identified yet.
    pub frame: FrameEstimate,
    /// For each detection the dot of the ball that it is; `None` for a false one.
    pub(super) of_dots: Vec<Option<usize>>,
}

impl Detected {
    pub(super) fn new(
        mut found: Vec<(Option<usize>, DotDetection)>,
        frame: impl FnOnce(Vec<DotDetection>) -> FrameEstimate,
    ) -> Self {
        found.sort_by(|a, b| b.1.confidence.total_cmp(&a.1.confidence));
        let (of_dots, dots) = found.into_iter().unzip();
        Self {
            frame: frame(dots),
            of_dots,
        }
    }
}

/// Working memory of [`DetectionModel::detect`].
#[derive(Debug, Clone, Default)]
pub struct Terms {
    dot: Vec<f64>,
    ball: Vec<f64>,
    products: Vec<f64>,
}

impl Terms {
    /// Those of the dot of the last [`DetectionModel::dot_class`].
    pub(super) fn dot(&self) -> &[f64] {
        &self.dot
    }

    /// Those of the ball with products, of the last [`DetectionModel::outline_chance`].
    pub(super) fn products(&self) -> &[f64] {
        &self.products
    }
}

impl DetectionModel {
    /// The model that the crate ships.
    ///
    /// # Errors
    /// [`Error::Internal`] where it does not fit this version of the code.
    pub fn shipped() -> Result<Self> {
        let text = include_str!("../../models/camera.json");
        Self::from_json(text).map_err(|why| Error::Internal(format!("models/camera.json: {why}")))
    }

    /// Reads a model.
    ///
    /// # Errors
    /// The reason in words: no JSON, another version, other covariates, numbers that are missing or
    /// not finite.
    pub fn from_json(text: &str) -> std::result::Result<Self, String> {
        let model: Self = serde_json::from_str(text).map_err(|e| e.to_string())?;
        if model.version != VERSION {
            return Err(format!(
                "expected version {VERSION}, found {}",
                model.version
            ));
        }
        if model.dot_names != DOT_OBSERVABLES || model.ball_names != BALL_OBSERVABLES {
            return Err("its covariates are not those of this version".into());
        }
        if !model.is_complete() {
            return Err(
                "a function has not one finite coefficient for each term, or a share is none"
                    .into(),
            );
        }
        Ok(model)
    }

    /// Whether every function has one finite coefficient for each term.
    fn is_complete(&self) -> bool {
        let fits = |r: &Regression, scaling: &Scaling| {
            let is_finite = r.coefficients.iter().all(|b| b.is_finite());
            is_finite && r.coefficients.len() == scaling.terms()
        };
        let whole = |s: &Spread, scaling: &Scaling, classes: &Classes| {
            let tables = &s.residuals;
            let has_tables =
                tables.len() == classes.count() && tables.iter().all(Quantiles::is_complete);
            has_tables && fits(&s.mean, scaling)
        };
        let [along, across] = &self.ln_variance;
        let mut of_dots = [along, across, &self.ln_error].into_iter();
        let of_outline = self
            .outline_ln_variance
            .iter()
            .chain(&self.outline_ln_error);
        let mut of_ball = of_outline.chain([&self.support]);
        let classes = self.ball_classes.count();
        let correction = &self.outline_correction;
        of_dots.all(|s| whole(s, &self.dots, &self.dot_classes))
            && of_ball.all(|s| whole(s, &self.ball_products, &self.ball_classes))
            && [&self.likely, &self.doubtful]
                .into_iter()
                .all(|r| fits(r, &self.dots))
            && fits(&self.outline, &self.ball)
            && correction.from.len() == correction.to.len()
            && self.frame_effect.len() == classes
            && self.shares.are_valid()
            && self.second_look.is_valid(self.dot_classes.count())
            && self.false_dots.iter().all(|f| {
                fits(&f.rate, &self.ball_products)
                    && f.shape.len() == classes
                    && f.distance.is_complete()
                    && f.ln_variance.is_complete()
            })
    }

    /// What the estimator would find on this ball at first, before it identifies the dots; `None` where it
    /// does not find the outline. `sequence` is what the frame shares with others of its sequence; `None` for
    /// a single frame.
    pub fn detect<R: Rng + ?Sized>(
        &self,
        ball: &SeenBall,
        sequence: Option<&Variates>,
        terms: &mut Terms,
        rng: &mut R,
    ) -> Option<Detected> {
        let own = Variates::draw(rng);
        let variates = sequence.map_or(own, |shared| self.shares.mix(shared, &own));
        let (probability, class) = self.outline_chance(&ball.observables, terms);
        if normal_cdf(variates.found) >= probability {
            return None;
        }
        terms.dot.resize(self.dots.terms(), 0.0);
        let outline = self.outline_at(ball, &terms.products, class, &variates);
        let mut found = Vec::with_capacity(ball.dots.len() + 4);
        let scale = self.frame_effect[class];
        let effect = FrameEffect {
            // The coefficients are those of the mean over all frames; given the frame's own shift
            // they are steeper (S. L. Zeger, K.-Y. Liang, P. S. Albert, Biometrics 44, 1988).
            steeper: (1.0 + 0.346 * scale * scale).sqrt(),
            shift: scale * variates.dots,
        };
        for (i, dot) in ball.dots.iter().enumerate() {
            let drawn = self.draw_dot(dot, &ball.circle, &effect, &mut terms.dot, rng);
            found.extend(drawn.map(|detection| (Some(i), detection)));
        }
        for (false_dots, confidence) in self.false_dots.iter().zip(CONFIDENCE) {
            let rate = false_dots.rate.value(&terms.products);
            false_dots.draw(ball, rate, class, confidence, rng, &mut found);
        }
        Some(Detected::new(found, |dots| {
            FrameEstimate::from_detections(outline, dots)
        }))
    }

    /// The probability that the outline of a ball is found, and the ball's class; `terms` then hold its terms.
    pub(super) fn outline_chance(&self, ball: &[f64], terms: &mut Terms) -> (f64, usize) {
        terms.ball.resize(self.ball.terms(), 0.0);
        terms.products.resize(self.ball_products.terms(), 0.0);
        self.ball.expand(ball, &mut terms.ball);
        self.ball_products.expand(ball, &mut terms.products);
        let predictor = self.outline.predictor(&terms.ball);
        let probability = self.outline_correction.probability(predictor);
        (probability, self.ball_classes.of(predictor))
    }

    fn outline_at(
        &self,
        ball: &SeenBall,
        terms: &[f64],
        class: usize,
        variates: &Variates,
    ) -> Outline {
        let r = ball.circle.radius;
        let [center, radius] = [0, 1].map(|k| {
            let probability = normal_cdf(variates.ln_variance[k]);
            let ln = self.outline_ln_variance[k].at(terms, class, probability);
            r * (0.5 * ln).exp().clamp(1e-4, GOOD_OUTLINE)
        });
        // The squared length of two normal variates is exponentially distributed.
        let [along_u, along_v] = variates.center;
        let length = along_u.hypot(along_v);
        let probabilities = [
            1.0 - (-0.5 * length * length).exp(),
            1.0 - 2.0 * normal_cdf(-variates.radius.abs()),
        ];
        let [shift, growth] = [0, 1].map(|k| {
            let ln = self.outline_ln_error[k].at(terms, class, probabilities[k]);
            (0.5 * ln).exp()
        });
        let limit = GOOD_OUTLINE * r;
        let shift = (shift * 2f64.sqrt() * center).min(limit) / length.max(f64::MIN_POSITIVE);
        let growth = (growth * radius).min(limit).copysign(variates.radius);
        Outline {
            circle: BallCircle {
                center: Pixel {
                    u: ball.circle.center.u + shift * along_u,
                    v: ball.circle.center.v + shift * along_v,
                },
                radius: r + growth,
            },
            covariance: Matrix3::from_diagonal(&nalgebra::Vector3::new(
                center * center,
                center * center,
                radius * radius,
            )),
        }
    }

    fn draw_dot<R: Rng + ?Sized>(
        &self,
        dot: &SeenDot,
        circle: &BallCircle,
        effect: &FrameEffect,
        terms: &mut [f64],
        rng: &mut R,
    ) -> Option<DotDetection> {
        if !can_be_found(dot) {
            return None;
        }
        self.dots.expand(&dot.observables, terms);
        let predictor = self.likely.predictor(terms);
        let class = self.dot_classes.of(predictor);
        let eta = predictor * effect.steeper + effect.shift;
        let is_likely = rng.random::<f64>() < 1.0 / (1.0 + (-eta).exp());
        if !is_likely && rng.random::<f64>() >= self.doubtful.value(terms) {
            return None;
        }
        Some(self.detection(dot, circle, is_likely, class, terms, rng))
    }

    /// A detection of a dot that is found, as a likely or a doubtful one; `terms` are those of the dot.
    pub(super) fn detection<R: Rng + ?Sized>(
        &self,
        dot: &SeenDot,
        circle: &BallCircle,
        is_likely: bool,
        class: usize,
        terms: &[f64],
        rng: &mut R,
    ) -> DotDetection {
        let truth = &dot.truth;
        let [more_variance, more_error] = if is_likely {
            [0.0, 0.0]
        } else {
            self.of_doubtful
        };
        let sigmas = [0, 1].map(|k| {
            let ln = self.ln_variance[k].draw(terms, class, rng) + more_variance;
            (0.5 * ln).exp().clamp(SIGMA_PX[0], SIGMA_PX[1])
        });
        let ln_error = self.ln_error.draw(terms, class, rng) + more_error;
        let (s, c) = (TAU * rng.random::<f64>()).sin_cos();
        let scale = (0.5 * ln_error).exp() * 2f64.sqrt();
        let radial = radial(truth.pixel, circle);
        let across = Vector2::new(-radial.y, radial.x);
        let off = radial * (scale * c * sigmas[0]) + across * (scale * s * sigmas[1]);
        let covariance: Matrix2<f64> = radial * radial.transpose() * sigmas[0].powi(2)
            + across * across.transpose() * sigmas[1].powi(2);
        DotDetection {
            pixel: Pixel {
                u: truth.pixel.u + off.x,
                v: truth.pixel.v + off.y,
            },
            covariance,
            confidence: if is_likely {
                CONFIDENCE[0]
            } else {
                CONFIDENCE[1]
            },
        }
    }

    /// The class of a dot; `terms` then hold its own.
    pub(super) fn dot_class(&self, observables: &[f64], terms: &mut Terms) -> usize {
        self.dot_classes.of(self.likely_logit(observables, terms))
    }

    /// The logit of the probability that a dot is found as a likely one, in a frame like most; `terms` then hold its own.
    pub(super) fn likely_logit(&self, observables: &[f64], terms: &mut Terms) -> f64 {
        terms.dot.resize(self.dots.terms(), 0.0);
        self.dots.expand(observables, &mut terms.dot);
        self.likely.predictor(&terms.dot)
    }

    /// Standard deviation of the shift of that logit that the dots of a frame share.
    pub(super) fn shared_shift(&self, ball: &SeenBall, terms: &mut Terms) -> f64 {
        let (_, class) = self.outline_chance(&ball.observables, terms);
        self.frame_effect[class]
    }

    /// How many more dots of a frame were found as likely ones than the model expects, and the variance of that
    /// number if each were found by itself.
    pub(super) fn more_dots(&self, seen: &Observation, terms: &mut Terms) -> (f64, f64) {
        terms.dot.resize(self.dots.terms(), 0.0);
        beyond_expected(seen.dots().map(|(observables, found)| {
            self.dots.expand(observables, &mut terms.dot);
            (self.likely.value(&terms.dot), found == Found::Likely)
        }))
    }

    /// Share of the dots and balls that lie within what the model was learned from.
    pub fn covers(&self, ball: &SeenBall) -> bool {
        self.ball.contains(&ball.observables)
    }
}

/// What the dots of a frame share.
struct FrameEffect {
    /// Factor on the predictor.
    steeper: f64,
    /// Added to it.
    shift: f64,
}

impl FalseDots {
    /// Draws false dots, `rate` of them on the average.
    pub(super) fn draw<R: Rng + ?Sized>(
        &self,
        ball: &SeenBall,
        rate: f64,
        class: usize,
        confidence: f64,
        rng: &mut R,
        found: &mut Vec<(Option<usize>, DotDetection)>,
    ) {
        let own =
            Gamma::new(self.shape[class], 1.0 / self.shape[class]).map_or(1.0, |g| g.sample(rng));
        let count = Poisson::new((rate * own).clamp(1e-9, 50.0)).map_or(0.0, |p| p.sample(rng));
        let BallCircle { center, radius } = ball.circle;
        for _ in 0..count as usize {
            let is_on_print = rng.random::<f64>() < self.on_print && !ball.printed.is_empty();
            let pixel = if is_on_print {
                let at = ball.printed[rng.random_range(0..ball.printed.len())];
                let off = 0.08 * radius;
                Pixel {
                    u: at.u + off * normal(rng),
                    v: at.v + off * normal(rng),
                }
            } else {
                let out = radius * self.distance.draw(rng);
                let (s, c) = (TAU * rng.random::<f64>()).sin_cos();
                Pixel {
                    u: center.u + out * c,
                    v: center.v + out * s,
                }
            };
            let variance = self.ln_variance.draw(rng).exp() * radius * radius;
            let detection = DotDetection {
                pixel,
                covariance: Matrix2::from_diagonal_element(variance),
                confidence,
            };
            found.push((None, detection));
        }
    }
}

/// Whether a detector could find the dot at all.
pub(super) fn can_be_found(dot: &SeenDot) -> bool {
    dot.truth.inside && !dot.truth.occluded && dot.truth.facing > MIN_FACING
}

/// The direction from the ball's middle to a pixel.
pub(super) fn radial(pixel: Pixel, circle: &BallCircle) -> Vector2<f64> {
    Vector2::new(pixel.u - circle.center.u, pixel.v - circle.center.v)
        .try_normalize(1e-9)
        .unwrap_or_else(Vector2::x)
}

fn normal<R: Rng + ?Sized>(rng: &mut R) -> f64 {
    rng.sample(StandardNormal)
}
