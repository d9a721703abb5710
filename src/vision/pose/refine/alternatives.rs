//! Which of several readings of an outline the dots speak for.
//!
//! Without intrinsics an ellipse is that of a ball to either side of the camera's axis. And now and then an outline is not the ball's:
//! a side that no lamp reaches is lost before a dark wall, a shadow or a hand joins it. Its error is then far beyond what its edges
//! state, and dots that are drawn well show it.
//!
//! An outline that is drawn out may be a circle's, of which a hand hides a part.
//!
//! Readings are compared by Laplace's approximation of their evidence, `-2 ln p = cost + sum ln det S - ln det K + ln det H`, of the dots'
//! covariances `S` and the information at the minimum, of what is known before, `K`, and of all, `H` (D. MacKay, "Information Theory, Inference, and Learning Algorithms", 2003, ch. 28).
//! The covariance is that of their mixture, about the best.

use nalgebra::{Matrix3, SMatrix, SVector};

use super::{Drawn, Match, PARAMETERS, PosePrior, PoseRefiner, PoseState, offset};
use crate::geometry::{Rotation, Vec3};
use crate::vision::frame::config::CameraModel;
use crate::vision::frame::estimate::FrameEstimate;
use crate::vision::optics::camera::BallCircle;
use crate::vision::optics::oval::of_circle;

/// Shares of the outlines that were found whose error is as stated, or has a further standard deviation of center and radius, radii: the likeliest
/// shares of 2 072 images in all conditions (40, 80 and 140 px, crops and whole pictures, seeds 642040 to 6420140) are 0.66, 0.20 and 0.14 of six
/// sizes up to 0.08; of 133 path-traced ones 0.71, 0.17 and 0.12.
const ERRORS: [OutlineError; 3] = [
    OutlineError {
        share: 0.66,
        radii: 0.0,
    },
    OutlineError {
        share: 0.2,
        radii: 0.02,
    },
    OutlineError {
        share: 0.14,
        radii: 0.045,
    },
];
/// Share of the outlines that are drawn out which are the ball's in that: beside a hand an ellipse fits what is left of a circle, too.
const DRAWN_OUT: f64 = 0.8;
/// To either side and round, with each error.
const MAX_READINGS: usize = 3 * ERRORS.len();
/// A reading less likely than this beside the best adds nothing to the covariance.
const LEAST_SHARE: f64 = 1e-3;

/// Parameters of which something is known before the dots are seen.
const KNOWN: usize = PARAMETERS - 3;

struct OutlineError {
    share: f64,
    radii: f64,
}

/// A reading of the outline.
#[derive(Clone, Copy)]
pub(super) struct OutlineReading {
    pub state: PoseState,
    pub prior: PosePrior,
    /// Minus two logarithms of its evidence.
    cost: f64,
}

/// All readings that could be fitted.
pub(super) struct Readings {
    /// The likeliest.
    pub best: OutlineReading,
    all: [Option<OutlineReading>; MAX_READINGS],
}

impl PosePrior {
    /// The outline as that of a ball to the other side of the camera's axis, where it may be.
    fn other_side(&self) -> Option<Self> {
        let is_known = matches!(self.camera, CameraModel::Known(_));
        let mut other = *self;
        other.outline.circle.eccentricity = -other.outline.circle.eccentricity;
        (!is_known && self.outline.circle.is_ellipse()).then_some(other)
    }

    /// The outline as a circle, where it was found drawn out and the dots can say so.
    fn round(&self) -> Option<Self> {
        let is_known = matches!(self.camera, CameraModel::Known(_));
        let is_drawn_out = self.outline.circle.is_ellipse() || self.oval.is_some();
        let mut other = *self;
        let circle = &self.outline.circle;
        let mean = circle.radius * of_circle(&circle.eccentricity).0;
        other.outline.circle = BallCircle::new(circle.center, mean);
        other.oval = None;
        (!is_known && is_drawn_out && self.is_open()).then_some(other)
    }

    /// The outline with a further error, where it was found and the dots can say so.
    fn with_error(&self, error: &OutlineError) -> Option<Self> {
        let mut other = *self;
        let sigma = error.radii * self.outline.circle.radius;
        other.outline.covariance += Matrix3::from_diagonal_element(sigma * sigma);
        (error.radii == 0.0 || self.is_open()).then_some(other)
    }

    /// Whether the outline was found and the dots can say that it is astray.
    fn is_open(&self) -> bool {
        self.drawn == Drawn::AsSeen && !self.outline.is_given()
    }
}

impl PoseRefiner {
    /// Fits the dots under each reading of the outline.
    pub(super) fn read(
        &self,
        names: &[Vec3],
        prior: &PosePrior,
        rotation: &Rotation,
        frame: &FrameEstimate,
        matches: &[Match],
    ) -> Option<Readings> {
        let mut all: [Option<OutlineReading>; MAX_READINGS] = Default::default();
        let round = prior.round();
        let share = if round.is_some() { DRAWN_OUT } else { 1.0 };
        let shapes = [
            (Some(*prior), share),
            (prior.other_side(), share),
            (round, 1.0 - share),
        ];
        for ((shape, share), readings) in shapes.iter().zip(all.chunks_mut(ERRORS.len())) {
            let Some(shape) = shape else {
                continue;
            };
            let Some(mut start) = PoseState::new(shape, rotation) else {
                continue;
            };
            for (error, reading) in ERRORS.iter().zip(readings) {
                let prior = shape.with_error(error);
                let found = prior.and_then(|prior| {
                    let state = self.fit(names, &prior, start, frame, matches)?;
                    let cost = state.ln_evidence_cost(&prior)? - 2.0 * (share * error.share).ln();
                    Some(OutlineReading { state, prior, cost })
                });
                // Each begins where the one before ended.
                start = found.as_ref().map_or(start, |found| found.state);
                *reading = found;
            }
        }
        let found = all.iter().flatten();
        let best = found.min_by(|a, b| a.cost.total_cmp(&b.cost)).copied()?;
        Some(Readings { best, all })
    }
}

impl Readings {
    /// The covariance about the likeliest: that of each, and how far it is off.
    pub fn covariance(&self) -> Option<SMatrix<f64, PARAMETERS, PARAMETERS>> {
        let (mut sum, mut total) = (SMatrix::zeros(), 0.0);
        for OutlineReading { state, cost, .. } in self.all.iter().flatten() {
            let share = (0.5 * (self.best.cost - cost)).exp();
            if share < LEAST_SHARE {
                continue;
            }
            let off = state.off(&self.best.state);
            sum += (state.information.try_inverse()? + off * off.transpose()) * share;
            total += share;
        }
        Some(sum / total)
    }
}

impl PoseState {
    /// Minus two logarithms of the evidence of a reading, but for what all have in common.
    fn ln_evidence_cost(&self, prior: &PosePrior) -> Option<f64> {
        let of_outline = prior.outline.covariance.try_inverse()?;
        // What is known before of all but the turn.
        let known = prior.equations(&of_outline, &self.view).information;
        let known = known.fixed_view::<KNOWN, KNOWN>(3, 3).into_owned();
        let ln_known = known.cholesky()?.ln_determinant();
        let ln_information = self.information.cholesky()?.ln_determinant();
        Some(self.cost + self.ln_spread + ln_information - ln_known)
    }

    /// How far it is from another, in the fitted parameters.
    fn off(&self, from: &Self) -> SVector<f64, PARAMETERS> {
        let turn = (self.rotation * from.rotation.inverse()).scaled_axis();
        let (now, then) = (self.view.circle(), from.view.circle());
        let moved = offset(now.center, then.center);
        let drawn_out = now.eccentricity - then.eccentricity;
        let away = self.view.horizon() - from.view.horizon();
        let grown = now.radius - then.radius;
        SVector::from([
            turn.x,
            turn.y,
            turn.z,
            moved.x,
            moved.y,
            grown,
            away,
            drawn_out.x,
            drawn_out.y,
        ])
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Matrix2;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    use super::*;
    use crate::geometry::{random_rotation, spiral_directions};
    use crate::vision::dots::detector::DotDetection;
    use crate::vision::frame::config::EstimatorConfig;
    use crate::vision::frame::outline::{Outline, OutlineSource};
    use crate::vision::optics::camera::{BallView, Camera, Pixel};
    use crate::vision::pose::refine::RefinedFrame;

    const RADIUS: f64 = 60.0;
    const OUTLINE_PX: f64 = 0.2;
    const DOTS_PX: f64 = 0.1;
    /// 95 % of squared distances in three dimensions are below.
    const CHI2_95: f64 = 7.815;

    fn normal(sigma: f64, rng: &mut ChaCha8Rng) -> f64 {
        sigma * <StandardNormal as Distribution<f64>>::sample(&StandardNormal, rng)
    }

    fn prior_of(circle: BallCircle, source: OutlineSource) -> PosePrior {
        PosePrior {
            outline: Outline {
                circle,
                covariance: Matrix3::from_diagonal_element(OUTLINE_PX * OUTLINE_PX),
                source,
            },
            oval: None,
            camera: CameraModel::Known(Camera::Orthographic),
            start: Camera::Orthographic,
            drawn: Drawn::AsSeen,
            axis: None,
        }
    }

    /// The dots that face the camera, as they are detected.
    fn add_dots(
        names: &[Vec3],
        rotation: &Rotation,
        view: &BallView,
        frame: &mut FrameEstimate,
        rng: &mut ChaCha8Rng,
    ) {
        for (name, dot) in names.iter().enumerate() {
            let turned = rotation * dot;
            if turned.z < 0.35 {
                continue;
            }
            let at = view.project(&turned);
            frame.dots.push(DotDetection {
                pixel: Pixel {
                    u: at.u + normal(DOTS_PX, rng),
                    v: at.v + normal(DOTS_PX, rng),
                },
                covariance: Matrix2::from_diagonal_element(DOTS_PX * DOTS_PX),
                probability: 1.0,
            });
            frame.assignment.push(Some(name as u16));
        }
    }

    /// The error, degrees, and its squared distance, of a ball whose outline is off by so many pixels besides what it states.
    fn refined(
        off: [f64; 3],
        source: OutlineSource,
        rng: &mut ChaCha8Rng,
    ) -> (f64, f64, RefinedFrame) {
        let names: Vec<Vec3> = spiral_directions(20).collect();
        let rotation = random_rotation(rng);
        let circle = BallCircle::new(Pixel { u: 80.0, v: 80.0 }, RADIUS);
        let view = BallView::new(&Camera::Orthographic, circle).expect("a view");
        let mut frame = FrameEstimate::default();
        add_dots(&names, &rotation, &view, &mut frame, rng);
        let [u, v, radius] = off.map(|off| off + normal(OUTLINE_PX, rng));
        let found = BallCircle::new(
            Pixel {
                u: 80.0 + u,
                v: 80.0 + v,
            },
            RADIUS + radius,
        );
        let prior = prior_of(found, source);
        let refiner = PoseRefiner::new(&EstimatorConfig::default(), 0.02);
        let mut matches = Vec::new();
        let found = refiner
            .refine(&names, &prior, &rotation, &mut frame, &mut matches)
            .expect("enough dots");
        let error = (rotation * found.rotation.inverse()).scaled_axis();
        let inverse = found.covariance.try_inverse().expect("regular");
        let squared = error.dot(&(inverse * error));
        (error.norm().to_degrees(), squared, found)
    }

    fn median(mut values: Vec<f64>) -> f64 {
        crate::stats::median(&mut values)
    }

    #[test]
    fn dots_correct_an_outline_that_is_astray() {
        let rng = &mut ChaCha8Rng::seed_from_u64(6_420_001);
        let errors = |source, rng: &mut ChaCha8Rng| {
            let trials = (0..40).map(|_| refined([3.0, -2.0, -4.0], source, rng));
            let (errors, radii): (Vec<_>, Vec<_>) = trials
                .map(|(error, _, found)| (error, (found.view.circle().radius - RADIUS).abs()))
                .unzip();
            (median(errors), median(radii))
        };
        let (error, radius) = errors(OutlineSource::Detected, rng);
        assert!(error < 0.5 && radius < 0.5, "{error} deg, {radius} px");
        // One that is given is believed.
        let (error, radius) = errors(OutlineSource::Given, rng);
        assert!(error > 1.0 && radius > 1.0, "{error} deg, {radius} px");
    }

    /// By the share that another reading has beside the best.
    #[test]
    fn what_another_reading_leaves_open_widens_the_covariance() {
        let circle = BallCircle::new(Pixel { u: 80.0, v: 80.0 }, RADIUS);
        let prior = prior_of(circle, OutlineSource::Detected);
        let at_outline = PoseState::new(&prior, &Rotation::identity()).expect("a view");
        let best = PoseState {
            information: SMatrix::identity() * 1e4,
            ..at_outline
        };
        let other = PoseState {
            rotation: Rotation::from_scaled_axis(Vec3::z() * 0.1),
            ..best
        };
        for (cost, share) in [(0.0, 0.5), (2.0 * 4f64.ln(), 0.2), (20.0, 0.0)] {
            let read = |state, cost| OutlineReading { state, prior, cost };
            let best = read(best, 0.0);
            let mut all = [None; MAX_READINGS];
            (all[0], all[1]) = (Some(read(other, cost)), Some(best));
            let found = Readings { best, all }.covariance().expect("regular");
            assert!(
                (found[(2, 2)] - 1e-4 - share * 0.01).abs() < 1e-9,
                "{found}"
            );
            assert!((found[(0, 0)] - 1e-4).abs() < 1e-9, "{found}");
        }
    }

    /// An ellipse is found; the ball is one that is seen so, or a circle of which a hand hides a part.
    #[test]
    fn dots_show_whether_a_ball_is_drawn_out() {
        let rng = &mut ChaCha8Rng::seed_from_u64(6_470_003);
        let names: Vec<Vec3> = spiral_directions(20).collect();
        let camera = Camera::Near {
            inverse_distance: 0.07,
        };
        let drawn_out = BallCircle {
            eccentricity: nalgebra::Vector2::new(0.4, 0.0),
            ..BallCircle::new(Pixel { u: 80.0, v: 80.0 }, RADIUS)
        };
        let round = BallCircle::new(drawn_out.center, RADIUS * 1.04);
        let refiner = PoseRefiner::new(&EstimatorConfig::default(), 0.02);
        for (shown, least, most) in [(drawn_out, 0.3, 0.5), (round, 0.0, 0.15)] {
            let (mut errors, mut lengths) = (Vec::new(), Vec::new());
            for _ in 0..20 {
                let rotation = random_rotation(rng);
                let view = BallView::new(&camera, shown).expect("a view");
                let mut frame = FrameEstimate::default();
                add_dots(&names, &rotation, &view, &mut frame, rng);
                let prior = PosePrior {
                    camera: EstimatorConfig::default().camera,
                    start: camera,
                    ..prior_of(drawn_out, OutlineSource::Detected)
                };
                let found = refiner
                    .refine(&names, &prior, &rotation, &mut frame, &mut Vec::new())
                    .expect("enough dots");
                errors.push(found.rotation.angle_to(&rotation).to_degrees());
                lengths.push(found.view.circle().eccentricity.norm());
            }
            let (error, length) = (median(errors), median(lengths));
            assert!(error < 1.5, "{error} deg");
            assert!((least..most).contains(&length), "{length}");
        }
    }

    /// Outlines as often astray as measured, and all as they state.
    #[test]
    fn regions_hold_whether_outlines_are_astray_or_not() {
        let rng = &mut ChaCha8Rng::seed_from_u64(6_420_002);
        for is_mixed in [true, false] {
            let count = 300;
            let within = (0..count).filter(|_| {
                let mut share = rng.random::<f64>();
                let error = ERRORS.iter().find(|error| {
                    share -= error.share;
                    share < 0.0
                });
                let radii = error.filter(|_| is_mixed).map_or(0.0, |e| e.radii);
                let off = [(); 3].map(|()| normal(radii * RADIUS, rng));
                refined(off, OutlineSource::Detected, rng).1 < CHI2_95
            });
            let within = within.count();
            // 95 % of 300, less three deviations; more where all are as they state: dots may be drawn worse than they are.
            assert!(within >= 273, "{within} of {count}, {is_mixed}");
        }
    }
}
