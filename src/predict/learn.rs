//! Learns a [`DetectionModel`] from rendered frames and what the estimator found in them.

use nalgebra::{Vector2, Vector3};

use super::lasting::Shares;
use super::model::{
    Classes, DetectionModel, FalseDots, GOOD_OUTLINE, Provenance, Recalibration, Spread, VERSION,
    can_be_found, radial,
};
use super::quantiles::Quantiles;
use super::regression::{Link, Regression, Scaling};
use super::second_look::SecondLook;
use crate::error::{Error, Result};
use crate::stats::quantile;
use crate::synth::observables::{BALL_OBSERVABLES, DOT_OBSERVABLES, SeenBall};
use crate::vision::estimator::FrameEstimate;

/// A detection nearer to a dot than this, ball radii, is that dot.
pub(super) const NEAR: f64 = 0.12;
/// Confidences from which a detection is a likely and a doubtful one.
const THRESHOLDS: [f64; 2] = [0.5, 0.15];
/// Shares of the cases below the borders of their classes.
const CLASSES: [f64; 5] = [0.08, 0.2, 0.4, 0.65, 0.85];
/// Parts into which a probability is corrected.
const PARTS: usize = 10;
/// Bounds of the logarithm of a squared error, by which an exact one does not weigh infinitely.
const LN_ERROR: [f64; 2] = [-9.0, 6.0];

/// How a dot was found; in this order in tables of steps from look to look.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Found {
    Likely,
    Doubtful,
    Missed,
}

#[derive(Debug, Clone, Copy)]
struct DotRow {
    observables: [f64; DOT_OBSERVABLES.len()],
    found: Found,
    /// Of the detection: logarithms of the variances and of the squared error.
    detection: Option<[f64; 3]>,
}

/// An outline that was found; of center and radius each.
#[derive(Debug, Clone, Copy)]
pub(super) struct OutlineRow {
    /// Logarithms of the stated variances, radii squared.
    pub ln_variance: [f64; 2],
    /// Logarithms of the squared errors over these.
    pub ln_error: [f64; 2],
    /// The errors: u, v, radius, pixels.
    pub off: Vector3<f64>,
    support: f64,
}

/// A detection that is no dot.
#[derive(Debug, Clone, Copy)]
pub(super) struct FalseRow {
    /// From the ball's middle, radii.
    pub place: Vector2<f64>,
    pub is_likely: bool,
    is_on_print: bool,
    /// Logarithm of its variance, radii squared.
    ln_variance: f64,
}

#[cfg(test)]
impl FalseRow {
    pub(super) fn at(place: Vector2<f64>, is_likely: bool) -> Self {
        Self {
            place,
            is_likely,
            is_on_print: false,
            ln_variance: 0.0,
        }
    }
}

/// A frame that was rendered and read.
#[derive(Debug, Clone)]
pub struct Observation {
    ball: [f64; BALL_OBSERVABLES.len()],
    dots: Vec<DotRow>,
    outline: Option<OutlineRow>,
    false_dots: Vec<FalseRow>,
    answered_wrongly: bool,
}

impl Observation {
    /// What the estimator found of a ball; `answered_wrongly` where its pose is off by 20 degrees or
    /// more.
    pub fn new(ball: &SeenBall, found: &FrameEstimate, answered_wrongly: bool) -> Self {
        let circle = &ball.circle;
        let r = circle.radius;
        let outline = found.outline.and_then(|o| {
            let off = Vector3::new(
                o.circle.center.u - circle.center.u,
                o.circle.center.v - circle.center.v,
                o.circle.radius - r,
            );
            let is_good = off.x.hypot(off.y) < GOOD_OUTLINE * r && off.z.abs() < GOOD_OUTLINE * r;
            let of_center = o.covariance.fixed_view::<2, 2>(0, 0).into_owned();
            let of_radius = o.covariance[(2, 2)];
            let shift = off.xy();
            let errors = [
                shift.dot(&(of_center.try_inverse()? * shift)) / 2.0,
                off.z * off.z / of_radius,
            ];
            let variances = [0.5 * of_center.trace(), of_radius].map(|v| (v / (r * r)).ln());
            let support = found.fit.map_or(0.0, |fit| fit.support);
            is_good.then(|| OutlineRow {
                ln_variance: variances,
                ln_error: errors.map(ln_error),
                off,
                support,
            })
        });
        let mut observation = Self {
            ball: ball.observables,
            dots: Vec::new(),
            outline,
            false_dots: Vec::new(),
            answered_wrongly,
        };
        if outline.is_some() {
            observation.match_dots(ball, found);
        }
        observation
    }

    pub(super) fn ball(&self) -> &[f64] {
        &self.ball
    }

    pub(super) fn outline(&self) -> Option<&OutlineRow> {
        self.outline.as_ref()
    }

    /// The covariates of the dots that could be found, and how each was.
    pub(super) fn dots(&self) -> impl Iterator<Item = (&[f64], Found)> {
        self.dots.iter().map(|d| (&d.observables[..], d.found))
    }

    /// The false dots.
    pub(super) fn false_dots(&self) -> &[FalseRow] {
        &self.false_dots
    }

    /// Number of false dots, likely or doubtful ones.
    fn count_false(&self, is_likely: bool) -> f64 {
        let of_kind = self.false_dots.iter().filter(|f| f.is_likely == is_likely);
        of_kind.count() as f64
    }

    fn match_dots(&mut self, ball: &SeenBall, found: &FrameEstimate) {
        let r = ball.circle.radius;
        let dots: Vec<_> = ball.dots.iter().filter(|d| can_be_found(d)).collect();
        let detections: Vec<_> = found
            .dots
            .iter()
            .filter(|d| d.confidence >= THRESHOLDS[1])
            .collect();
        let mut pairs: Vec<(f64, usize, usize)> = Vec::new();
        for (i, dot) in dots.iter().enumerate() {
            for (j, seen) in detections.iter().enumerate() {
                let (u, v) = (
                    seen.pixel.u - dot.truth.pixel.u,
                    seen.pixel.v - dot.truth.pixel.v,
                );
                let apart = u.hypot(v) / r;
                if apart < NEAR {
                    pairs.push((apart, i, j));
                }
            }
        }
        pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (mut of_dot, mut is_taken) = (vec![None; dots.len()], vec![false; detections.len()]);
        for (_, i, j) in pairs {
            if of_dot[i].is_none() && !is_taken[j] {
                of_dot[i] = Some(j);
                is_taken[j] = true;
            }
        }
        for (dot, j) in dots.iter().zip(of_dot) {
            let detection = j.map(|j| detections[j]);
            let found = match detection {
                Some(d) if d.confidence >= THRESHOLDS[0] => Found::Likely,
                Some(_) => Found::Doubtful,
                None => Found::Missed,
            };
            let detection = detection.and_then(|d| {
                let off =
                    Vector2::new(d.pixel.u - dot.truth.pixel.u, d.pixel.v - dot.truth.pixel.v);
                let along = radial(dot.truth.pixel, &ball.circle);
                let across = Vector2::new(-along.y, along.x);
                let squared = off.dot(&(d.covariance.try_inverse()? * off)) / 2.0;
                let variance = |axis: &Vector2<f64>| axis.dot(&(d.covariance * axis)).max(1e-8);
                Some([
                    variance(&along).ln(),
                    variance(&across).ln(),
                    ln_error(squared),
                ])
            });
            self.dots.push(DotRow {
                observables: dot.observables,
                found,
                detection,
            });
        }
        for (seen, is_taken) in detections.iter().zip(is_taken) {
            if is_taken {
                continue;
            }
            let apart = |u: f64, v: f64| (seen.pixel.u - u).hypot(seen.pixel.v - v) / r;
            let center = ball.circle.center;
            let variance = 0.5 * seen.covariance.trace() / (r * r);
            self.false_dots.push(FalseRow {
                place: Vector2::new(seen.pixel.u - center.u, seen.pixel.v - center.v) / r,
                is_likely: seen.confidence >= THRESHOLDS[0],
                is_on_print: ball.printed.iter().any(|p| apart(p.u, p.v) < 0.2),
                ln_variance: variance.max(1e-9).ln(),
            });
        }
    }
}

impl DetectionModel {
    /// Learns a model from single frames at first look, from pairs of frames of one sequence each what lasts, and from
    /// both looks at frames in doubt what the second one changes.
    ///
    /// # Errors
    /// [`Error::Argument`] where there are too few observations for its coefficients.
    pub fn learn(
        observations: &[Observation],
        pairs: &[[Observation; 2]],
        looks: &[[Observation; 2]],
        provenance: Provenance,
    ) -> Result<Self> {
        let good: Vec<&Observation> = observations
            .iter()
            .filter(|o| o.outline.is_some())
            .collect();
        let rows: Vec<&DotRow> = good.iter().flat_map(|o| &o.dots).collect();
        let flat: Vec<f64> = rows.iter().flat_map(|r| r.observables).collect();
        let dots = Scaling::of(&flat, DOT_OBSERVABLES.len())?;
        let flat: Vec<f64> = observations.iter().flat_map(|o| o.ball).collect();
        let ball_products = Scaling::of(&flat, BALL_OBSERVABLES.len())?;
        let ball = ball_products.clone().without_products();
        if observations.len() < 10 * ball_products.terms() {
            let needed = 10 * ball_products.terms();
            let problem = format!("expected at least {needed}, found {}", observations.len());
            return Err(Error::argument("observations", problem));
        }
        let dot_terms = Expanded::of(&dots, rows.iter().map(|r| &r.observables[..]));
        let ball_terms = Expanded::of(&ball, observations.iter().map(|o| &o.ball[..]));
        let good_terms = Expanded::of(&ball_products, good.iter().map(|o| &o.ball[..]));

        let likely = dot_terms.fit(
            Link::Logit,
            rows.iter()
                .map(|r| Some(f64::from(u8::from(r.found == Found::Likely)))),
        )?;
        let doubtful = dot_terms.fit(
            Link::Logit,
            rows.iter().map(|r| match r.found {
                Found::Likely => None,
                other => Some(f64::from(u8::from(other == Found::Doubtful))),
            }),
        )?;
        let dot_predictors = dot_terms.predictors(&likely);
        let dot_classes = classes(&dot_predictors);
        let of_class = |p: &f64| dot_classes.of(*p);
        let of_dots: Vec<usize> = dot_predictors.iter().map(of_class).collect();
        let of_likely = |k: usize| {
            rows.iter().map(move |r| {
                let detection = r.detection.filter(|_| r.found == Found::Likely)?;
                Some(detection[k])
            })
        };
        let ln_variance = [
            dot_terms.spread(of_likely(0), &of_dots)?,
            dot_terms.spread(of_likely(1), &of_dots)?,
        ];
        let ln_error = dot_terms.spread(of_likely(2), &of_dots)?;
        let beyond = |k: usize, regression: &Regression| {
            let left: Vec<f64> = rows
                .iter()
                .enumerate()
                .filter(|(_, r)| r.found == Found::Doubtful)
                .filter_map(|(i, r)| Some(r.detection?[k] - regression.value(dot_terms.row(i))))
                .collect();
            left.iter().sum::<f64>() / left.len().max(1) as f64
        };
        let more_variance =
            0.5 * (beyond(0, &ln_variance[0].mean) + beyond(1, &ln_variance[1].mean));
        let of_doubtful = [more_variance, beyond(2, &ln_error.mean)];

        let outline = ball_terms.fit(
            Link::Logit,
            observations
                .iter()
                .map(|o| Some(f64::from(u8::from(o.outline.is_some())))),
        )?;
        let found: Vec<bool> = observations.iter().map(|o| o.outline.is_some()).collect();
        let ball_predictors = ball_terms.predictors(&outline);
        let outline_correction = correction(&ball_predictors, &found);
        let ball_classes = classes(&ball_predictors);
        let of_balls: Vec<usize> = ball_predictors
            .iter()
            .zip(&found)
            .filter(|(_, is_found)| **is_found)
            .map(|(p, _)| ball_classes.of(*p))
            .collect();
        let frame_effect = (0..ball_classes.count())
            .map(|class| frame_effect(&good, &dot_terms, &likely, |i| of_balls[i] == class))
            .collect();
        let of_outlines = |value: &dyn Fn(&OutlineRow) -> f64| {
            let values = good.iter().map(|o| o.outline.as_ref().map(value));
            good_terms.spread(values, &of_balls)
        };
        let outline_ln_variance = [
            of_outlines(&|o| o.ln_variance[0])?,
            of_outlines(&|o| o.ln_variance[1])?,
        ];
        let outline_ln_error = [
            of_outlines(&|o| o.ln_error[0])?,
            of_outlines(&|o| o.ln_error[1])?,
        ];
        let support = of_outlines(&|o| o.support)?;
        let lost: Vec<_> = observations
            .iter()
            .filter(|o| o.outline.is_none())
            .collect();
        let wrong = lost.iter().filter(|o| o.answered_wrongly).count();
        let mut model = Self {
            version: VERSION,
            provenance,
            dot_names: DOT_OBSERVABLES.map(str::to_owned).to_vec(),
            ball_names: BALL_OBSERVABLES.map(str::to_owned).to_vec(),
            likely,
            doubtful,
            dot_classes,
            frame_effect,
            ln_variance,
            ln_error,
            of_doubtful,
            outline,
            outline_correction,
            outline_ln_variance,
            outline_ln_error,
            support,
            wrong_without_outline: wrong as f64 / lost.len().max(1) as f64,
            false_dots: [
                false_dots(&good, &good_terms, true, &of_balls, &ball_classes)?,
                false_dots(&good, &good_terms, false, &of_balls, &ball_classes)?,
            ],
            ball_classes,
            dots,
            ball,
            ball_products,
            shares: Shares::default(),
            second_look: SecondLook::default(),
        };
        model.shares = Shares::learn(&model, pairs);
        model.second_look = SecondLook::learn(&model, looks);
        Ok(model)
    }

    /// The model as a file.
    ///
    /// # Errors
    /// [`Error::Internal`] where a number has no JSON.
    pub fn to_json(&self) -> Result<String> {
        serde_json::to_string(self)
            .map(|json| json + "\n")
            .map_err(|e| Error::Internal(e.to_string()))
    }
}

/// Rows of expanded covariates.
struct Expanded {
    columns: usize,
    terms: Vec<f64>,
}

impl Expanded {
    fn of<'a>(scaling: &Scaling, rows: impl Iterator<Item = &'a [f64]>) -> Self {
        let columns = scaling.terms();
        let mut terms = Vec::new();
        for row in rows {
            let at = terms.len();
            terms.resize(at + columns, 0.0);
            scaling.expand(row, &mut terms[at..]);
        }
        Self { columns, terms }
    }

    fn row(&self, i: usize) -> &[f64] {
        &self.terms[i * self.columns..(i + 1) * self.columns]
    }

    /// The rows that have a value, with their values.
    fn with_values(&self, values: impl Iterator<Item = Option<f64>>) -> (Vec<f64>, Vec<f64>) {
        let (mut terms, mut present) = (Vec::new(), Vec::new());
        for (i, value) in values.enumerate() {
            if let Some(value) = value {
                terms.extend_from_slice(self.row(i));
                present.push(value);
            }
        }
        (terms, present)
    }

    fn fit(&self, link: Link, values: impl Iterator<Item = Option<f64>>) -> Result<Regression> {
        let (terms, values) = self.with_values(values);
        Regression::fit(link, &terms, &values)
    }

    /// The linear predictors of all rows.
    fn predictors(&self, regression: &Regression) -> Vec<f64> {
        let rows = self.terms.chunks_exact(self.columns);
        rows.map(|terms| regression.predictor(terms)).collect()
    }

    /// Mean and residuals of the rows that have a value; `classes` says of which class each is.
    fn spread(
        &self,
        values: impl Iterator<Item = Option<f64>>,
        classes: &[usize],
    ) -> Result<Spread> {
        let values: Vec<Option<f64>> = values.collect();
        let (terms, present) = self.with_values(values.iter().copied());
        let mean = Regression::fit(Link::Identity, &terms, &present)?;
        let count = 1 + classes.iter().copied().max().unwrap_or(0);
        let mut left = vec![Vec::new(); count];
        for (i, (value, class)) in values.iter().zip(classes).enumerate() {
            if let Some(value) = value {
                left[*class].push(value - mean.value(self.row(i)));
            }
        }
        Ok(Spread {
            mean,
            residuals: left.iter_mut().map(|l| Quantiles::of(l)).collect(),
        })
    }
}

fn ln_error(squared: f64) -> f64 {
    squared.max(1e-9).ln().clamp(LN_ERROR[0], LN_ERROR[1])
}

/// The standard deviation of the shift that a frame's dots share, by the variance of the number of
/// likely dots a frame beyond that of independent ones: `E (y - p)^2 = sum p (1 - p) + s^2 (sum p (1
/// - p))^2`.
fn frame_effect(
    good: &[&Observation],
    terms: &Expanded,
    likely: &Regression,
    is_of_class: impl Fn(usize) -> bool,
) -> f64 {
    let (mut i, mut beyond, mut squared) = (0, 0.0, 0.0);
    for (at, frame) in good.iter().enumerate() {
        if !is_of_class(at) {
            i += frame.dots.len();
            continue;
        }
        let dots = frame.dots.iter().enumerate().map(|(k, dot)| {
            let p = likely.value(terms.row(i + k));
            (p, dot.found == Found::Likely)
        });
        let (off, variance) = beyond_expected(dots);
        i += frame.dots.len();
        beyond += off * off - variance;
        squared += variance * variance;
    }
    (beyond / squared.max(1e-9)).max(0.0).sqrt()
}

/// How many more of these cases are true than their probabilities say, and the variance of that number if the cases
/// are independent.
pub(super) fn beyond_expected(cases: impl Iterator<Item = (f64, bool)>) -> (f64, f64) {
    cases.fold((0.0, 0.0), |(more, variance), (p, is_true)| {
        let more = more + (f64::from(u8::from(is_true)) - p);
        (more, variance + p * (1.0 - p))
    })
}

fn false_dots(
    good: &[&Observation],
    terms: &Expanded,
    is_likely: bool,
    of_balls: &[usize],
    classes: &Classes,
) -> Result<FalseDots> {
    let rate = terms.fit(
        Link::Log,
        good.iter().map(|o| Some(o.count_false(is_likely))),
    )?;
    // Var = m + m^2 / shape.
    let shape_of = |class: usize| {
        let (mut beyond, mut squared) = (0.0, 0.0);
        for (i, o) in good
            .iter()
            .enumerate()
            .filter(|(i, _)| of_balls[*i] == class)
        {
            let m = rate.value(terms.row(i));
            beyond += (o.count_false(is_likely) - m).powi(2) - m;
            squared += m * m;
        }
        (squared / beyond.max(1e-9)).clamp(0.05, 100.0)
    };
    let shape = (0..classes.count()).map(shape_of).collect();
    let places = || good.iter().flat_map(|o| &o.false_dots);
    let printed: Vec<_> = good.iter().filter(|o| o.ball[9] > 0.0).collect();
    let of_printed = || printed.iter().flat_map(|o| &o.false_dots);
    let on_print = of_printed().filter(|f| f.is_on_print).count() as f64;
    let others = places().filter(|f| !f.is_on_print);
    let mut distance: Vec<f64> = others.map(|f| f.place.norm().min(1.0)).collect();
    let mut ln_variance: Vec<f64> = places().map(|f| f.ln_variance).collect();
    if distance.is_empty() || ln_variance.is_empty() {
        return Err(Error::argument("observations", "expected some false dots"));
    }
    Ok(FalseDots {
        rate,
        shape,
        on_print: on_print / of_printed().count().max(1) as f64,
        distance: Quantiles::of(&mut distance),
        ln_variance: Quantiles::of(&mut ln_variance),
    })
}

/// Classes with the shares [`CLASSES`] below their borders.
fn classes(predictors: &[f64]) -> Classes {
    let mut sorted = predictors.to_vec();
    sorted.sort_unstable_by(f64::total_cmp);
    Classes {
        borders: CLASSES.iter().map(|q| quantile(&sorted, *q)).collect(),
    }
}

/// Makes a predictor say what was observed, in parts of as many cases each.
fn correction(predictors: &[f64], observed: &[bool]) -> Recalibration {
    let mut pairs: Vec<(f64, bool)> = predictors
        .iter()
        .copied()
        .zip(observed.iter().copied())
        .collect();
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (mut from, mut to) = (Vec::new(), Vec::new());
    for part in pairs.chunks(pairs.len().div_ceil(PARTS).max(1)) {
        let n = part.len() as f64;
        let hits = part.iter().filter(|p| p.1).count() as f64;
        // Half an observation of either kind keeps the logit finite.
        let p = (hits + 0.5) / (n + 1.0);
        from.push(part.iter().map(|p| p.0).sum::<f64>() / n);
        to.push((p / (1.0 - p)).ln());
    }
    Recalibration { from, to }
}
