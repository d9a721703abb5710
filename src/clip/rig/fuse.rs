//! What several cameras measured at one time, as one measurement.
//!
//! Each camera gives an orientation and a center with their joint covariance `C_i` (6 x 6: the rotation vector that leads to the true
//! orientation, and the center). They are fitted to the dots, at the least squares of that camera, so that near them the squares of its
//! dots are `chi2_i + e_i^T C_i^-1 e_i`, with `e_i = (log(R R_i^-1), p - p_i)`. The least squares of all dots together are then where
//!
//! ```text
//! chi2 = sum_i e_i^T C_i^-1 e_i   is least,   C = (sum_i C_i^-1)^-1
//! ```
//!
//! (the information form). An outline whose dots are not named has a center alone. What is left of `chi2` says whether the
//! cameras saw one ball: it has six degrees of freedom for each camera beyond the first, three for a center alone.
//!
//! Guarantees: the result does not depend on the order of the cameras but for rounding. Not guaranteed: that errors which the
//! cameras share are counted, of dots that both see off their places and of the ball's diameter.

use nalgebra::{Matrix3, Matrix6, SMatrix, Vector6};

use crate::geometry::{Position, ROTATIONS, Rotation, Vec3};
use crate::vision::frame::estimate::{FrameEstimate, Pose};
use crate::vision::optics::rig::Extrinsics;

/// Steps of the fit; each leaves the square of what is off.
const STEPS: usize = 5;
/// The normal quantile that one in a thousand exceeds.
const Z999: f64 = 3.090_232;

/// What one camera says of a ball, in the rig's frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct CameraReading {
    pub rotation: Option<Rotation>,
    pub center_m: Option<Vec3>,
    /// Of the rotation vector and the center; zeros for what is not known.
    pub covariance: Matrix6<f64>,
    /// Probability that the rotation is right.
    pub confidence: f64,
    /// Whether an expected orientation decided.
    pub hinted: bool,
}

/// How much larger the errors of cameras are than they state, and what they are off by altogether.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Widening {
    /// Factors of the deviations of rotation and center.
    pub factors: [f64; 2],
    /// Variances that are added to each axis, rad^2 and m^2.
    pub variances: [f64; 2],
}

impl Default for Widening {
    /// None.
    fn default() -> Self {
        Self {
            factors: [1.0; 2],
            variances: [0.0; 2],
        }
    }
}

impl CameraReading {
    /// That of an estimate of a camera from whose frame `to_rig` leads; `None` where it knows nothing.
    pub fn of(estimate: &FrameEstimate, to_rig: &Extrinsics) -> Option<Self> {
        let position = estimate.position().map(|p| to_rig.place(&p));
        let pose = estimate.pose();
        if pose.is_none() && position.is_none() {
            return None;
        }
        let mut covariance = Matrix6::zeros();
        if let Some(pose) = pose {
            let own = crate::geometry::turned_covariance(&to_rig.rotation, &pose.covariance);
            covariance.fixed_view_mut::<3, 3>(0, 0).copy_from(&own);
        }
        if let Some(position) = &position {
            covariance
                .fixed_view_mut::<3, 3>(3, 3)
                .copy_from(&position.covariance);
            if let (Some(both), Some(_)) = (&position.with_rotation, pose) {
                covariance.fixed_view_mut::<3, 3>(3, 0).copy_from(both);
                covariance
                    .fixed_view_mut::<3, 3>(0, 3)
                    .copy_from(&both.transpose());
            }
        }
        Some(Self {
            rotation: pose.map(|pose| to_rig.rotation * pose.rotation),
            center_m: position.map(|p| p.center_m),
            covariance,
            confidence: pose.map_or(0.0, |pose| pose.confidence),
            hinted: pose.is_some_and(|pose| pose.hinted),
        })
    }

    /// The same with larger errors.
    #[must_use]
    pub fn widened(mut self, by: &Widening) -> Self {
        for i in 0..6 {
            for j in 0..6 {
                self.covariance[(i, j)] *= by.factors[i / 3] * by.factors[j / 3];
            }
            self.covariance[(i, i)] += by.variances[i / 3];
        }
        self
    }

    /// The same without the rotation, where the dots are not to count.
    #[must_use]
    pub fn center_alone(mut self) -> Self {
        self.rotation = None;
        self
    }

    /// The center, where it is known.
    pub fn position(&self) -> Option<Position> {
        Some(Position {
            center_m: self.center_m?,
            covariance: self.block(3, 3),
            with_rotation: self.rotation.map(|_| self.block(3, 0)),
        })
    }

    /// A part of the covariance.
    pub fn block(&self, row: usize, column: usize) -> Matrix3<f64> {
        self.covariance.fixed_view::<3, 3>(row, column).into_owned()
    }

    /// Its information, zero for what is not known; `None` where the covariance has no inverse.
    fn information(&self) -> Option<Matrix6<f64>> {
        let mut all = Matrix6::zeros();
        match (self.rotation.is_some(), self.center_m.is_some()) {
            (true, true) => all = self.covariance.try_inverse()?,
            (true, false) => {
                let own = self.block(0, 0).try_inverse()?;
                all.fixed_view_mut::<3, 3>(0, 0).copy_from(&own);
            }
            (false, true) => {
                let own = self.block(3, 3).try_inverse()?;
                all.fixed_view_mut::<3, 3>(3, 3).copy_from(&own);
            }
            (false, false) => {}
        }
        Some(0.5 * (all + all.transpose()))
    }

    /// How many numbers it says.
    fn count(&self) -> usize {
        3 * (usize::from(self.rotation.is_some()) + usize::from(self.center_m.is_some()))
    }

    /// How far a state is off it.
    fn off(&self, rotation: Option<&Rotation>, center_m: Option<&Vec3>) -> Vector6<f64> {
        let mut off = Vector6::zeros();
        if let (Some(own), Some(rotation)) = (&self.rotation, rotation) {
            let turn = (rotation * own.inverse()).scaled_axis();
            off.fixed_rows_mut::<3>(0).copy_from(&turn);
        }
        if let (Some(own), Some(center)) = (&self.center_m, center_m) {
            off.fixed_rows_mut::<3>(3).copy_from(&(center - own));
        }
        off
    }
}

/// Readings as one, and how well they agree.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Fused {
    pub reading: CameraReading,
    pub chi2: f64,
    /// Degrees of freedom.
    pub freedom: usize,
}

impl Fused {
    /// Whether so large a chi2 is seen more often than once in a thousand times.
    pub fn agrees(&self) -> bool {
        self.freedom == 0 || self.chi2 <= quantile_999(self.freedom)
    }
}

/// The quantile of chi-square that one in a thousand exceeds (E. B. Wilson, M. M. Hilferty, PNAS 17, 1931): within 2 % from 3 degrees of
/// freedom on.
pub(super) fn quantile_999(freedom: usize) -> f64 {
    let n = freedom as f64;
    let spread = 2.0 / (9.0 * n);
    n * (1.0 - spread + Z999 * spread.sqrt()).powi(3)
}

/// One measurement of several; `None` of none, or where a covariance has no inverse. The confidence is that of the surest.
pub(super) fn fuse(readings: &[CameraReading]) -> Option<Fused> {
    let first = |f: fn(&CameraReading) -> bool| readings.iter().find(|r| f(r));
    let mut rotation = first(|r| r.rotation.is_some()).and_then(|r| r.rotation);
    let mut center_m = first(|r| r.center_m.is_some()).and_then(|r| r.center_m);
    let informed: Option<Vec<Matrix6<f64>>> =
        readings.iter().map(CameraReading::information).collect();
    let informed = informed.filter(|all| !all.is_empty())?;
    let mut sum: Matrix6<f64> = informed.iter().sum();
    // What nobody knows stays where it is.
    for (from, is_known) in [(0, rotation.is_some()), (3, center_m.is_some())] {
        if !is_known {
            sum.fixed_view_mut::<3, 3>(from, from)
                .copy_from(&Matrix3::identity());
        }
    }
    let covariance = sum.try_inverse()?;
    for _ in 0..STEPS {
        let slope: Vector6<f64> = readings
            .iter()
            .zip(&informed)
            .map(|(reading, information)| {
                information * reading.off(rotation.as_ref(), center_m.as_ref())
            })
            .sum();
        let step = -(covariance * slope);
        let turn = Rotation::from_scaled_axis(step.fixed_rows::<3>(0).into_owned());
        rotation = rotation.map(|rotation| turn * rotation);
        center_m = center_m.map(|center| center + step.fixed_rows::<3>(3).into_owned());
    }
    let chi2 = readings
        .iter()
        .zip(&informed)
        .map(|(reading, information)| {
            let off = reading.off(rotation.as_ref(), center_m.as_ref());
            off.dot(&(information * off))
        });
    let known = 3 * (usize::from(rotation.is_some()) + usize::from(center_m.is_some()));
    let said: usize = readings.iter().map(CameraReading::count).sum();
    let mut reading = CameraReading {
        rotation,
        center_m,
        covariance: 0.5 * (covariance + covariance.transpose()),
        confidence: readings.iter().map(|r| r.confidence).fold(0.0, f64::max),
        hinted: readings.iter().all(|r| r.rotation.is_none() || r.hinted),
    };
    for (from, is_known) in [(0, rotation.is_some()), (3, center_m.is_some())] {
        if !is_known {
            reading.covariance.fixed_view_mut::<3, 6>(from, 0).fill(0.0);
            reading.covariance.fixed_view_mut::<6, 3>(0, from).fill(0.0);
        }
    }
    Some(Fused {
        reading,
        chi2: chi2.sum(),
        freedom: said - known,
    })
}

/// The probability that a wrong rotation, which may be any, agrees with another one by accident.
pub(super) fn chance(readings: &[CameraReading]) -> f64 {
    let sum: Matrix3<f64> = readings.iter().map(|r| r.block(0, 0)).sum();
    let ball = 4.0 / 3.0 * std::f64::consts::PI * quantile_999(3).powf(1.5);
    (ball * sum.determinant().max(0.0).sqrt() / ROTATIONS).min(1.0)
}

/// A pose of a rig, of what the surest of its cameras found.
pub(super) fn pose_of(reading: &CameraReading, surest: &Pose, confidence: f64) -> Option<Pose> {
    Some(Pose {
        rotation: reading.rotation?,
        covariance: reading.block(0, 0),
        confidence,
        distance: None,
        view: None,
        position: reading.position(),
        hinted: reading.hinted,
        ..*surest
    })
}

/// How a ball moves about a time: what brings a reading to another time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Drift {
    /// Rad/s, rig frame, with its covariance.
    pub spin: Vec3,
    pub spin_covariance: Matrix3<f64>,
    /// M/s, with its variance along each axis.
    pub velocity_m_s: Vec3,
    pub velocity_variance: f64,
}

impl CameraReading {
    /// The same `by_s` later.
    #[must_use]
    pub fn moved(mut self, by_s: f64, drift: &Drift) -> Self {
        let turn = Rotation::from_scaled_axis(drift.spin * by_s);
        let mut turned: SMatrix<f64, 6, 6> = Matrix6::identity();
        turned
            .fixed_view_mut::<3, 3>(0, 0)
            .copy_from(turn.to_rotation_matrix().matrix());
        self.covariance = turned * self.covariance * turned.transpose();
        let grown = self.block(0, 0) + drift.spin_covariance * (by_s * by_s);
        self.covariance
            .fixed_view_mut::<3, 3>(0, 0)
            .copy_from(&grown);
        for k in 3..6 {
            self.covariance[(k, k)] += drift.velocity_variance * by_s * by_s;
        }
        self.rotation = self.rotation.map(|rotation| turn * rotation);
        self.center_m = self.center_m.map(|p| p + drift.velocity_m_s * by_s);
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use rand_distr::StandardNormal;

    fn normal(rng: &mut impl Rng) -> Vector6<f64> {
        Vector6::from_fn(|_, _| rng.sample::<f64, _>(StandardNormal))
    }

    /// A reading of a state whose error has this root of its covariance.
    fn reading(
        rotation: &Rotation,
        center_m: &Vec3,
        root: &Matrix6<f64>,
        rng: &mut impl Rng,
    ) -> CameraReading {
        let error = root * normal(rng);
        let turn = Rotation::from_scaled_axis(error.fixed_rows::<3>(0).into_owned());
        CameraReading {
            rotation: Some(turn * rotation),
            center_m: Some(center_m + error.fixed_rows::<3>(3).into_owned()),
            covariance: root * root.transpose(),
            confidence: 0.9,
            hinted: false,
        }
    }

    /// Monte Carlo: what is fused is as far off as it says, and what is left has the distribution that it is judged by.
    #[test]
    fn errors_are_those_that_are_stated() {
        let mut rng = ChaCha8Rng::seed_from_u64(65_200);
        let scales = Vector6::new(0.01, 0.01, 0.01, 1e-3, 1e-3, 5e-3);
        let mut root = || {
            let mixed = Matrix6::from_fn(|_, _| rng.random_range(-0.6..0.6));
            Matrix6::from_diagonal(&scales) * (Matrix6::identity() + mixed)
        };
        let roots = [root(), root()];
        let mut rng = ChaCha8Rng::seed_from_u64(65_201);
        let (mut error2, mut chi2, mut better) = (0.0, 0.0, 0.0);
        let trials = 4000;
        for _ in 0..trials {
            let rotation = crate::geometry::random_rotation(&mut rng);
            let center = Vec3::new(0.1, -0.2, -1.0);
            let both = roots.map(|root| reading(&rotation, &center, &root, &mut rng));
            let fused = fuse(&both).expect("a measurement");
            assert_eq!(fused.freedom, 6);
            let off = fused.reading.off(Some(&rotation), Some(&center));
            let inverse = fused.reading.covariance.try_inverse().expect("an inverse");
            error2 += off.dot(&(inverse * off)) / trials as f64;
            chi2 += fused.chi2 / trials as f64;
            better += fused.reading.covariance.trace() / both[0].covariance.trace();
        }
        // Six degrees of freedom each; the mean of 4000 has a deviation of 0.055.
        assert!((error2 - 6.0).abs() < 0.25, "{error2}");
        assert!((chi2 - 6.0).abs() < 0.25, "{chi2}");
        assert!(better < 0.6 * trials as f64);
    }

    /// The dots of two cameras, fitted together from the start, against the fits of each, fused: both linear about the truth.
    #[test]
    fn what_is_fused_is_the_least_squares_of_all_dots() {
        let mut rng = ChaCha8Rng::seed_from_u64(65_202);
        let (rotation, center) = (Rotation::identity(), Vec3::new(0.0, 0.0, -1.0));
        // Each camera sees twelve dots: the derivatives of their pixels by the state, and the pixels' errors.
        let rows = |rng: &mut ChaCha8Rng| {
            SMatrix::<f64, 24, 6>::from_fn(|_, _| rng.sample(StandardNormal))
        };
        let cameras = [rows(&mut rng), rows(&mut rng)];
        let noise = |rng: &mut ChaCha8Rng| {
            SMatrix::<f64, 24, 1>::from_fn(|_, _| 1e-4 * rng.sample::<f64, _>(StandardNormal))
        };
        let errors = [noise(&mut rng), noise(&mut rng)];
        let normal = |j: &SMatrix<f64, 24, 6>| j.transpose() * j;
        let alone = [0, 1].map(|k| {
            let covariance = normal(&cameras[k]).try_inverse().expect("dots enough");
            let off = covariance * cameras[k].transpose() * errors[k];
            CameraReading {
                rotation: Some(
                    Rotation::from_scaled_axis(off.fixed_rows::<3>(0).into_owned()) * rotation,
                ),
                center_m: Some(center + off.fixed_rows::<3>(3).into_owned()),
                covariance: covariance * 1e-8,
                confidence: 0.9,
                hinted: false,
            }
        });
        let fused = fuse(&alone).expect("a measurement").reading;
        let all = normal(&cameras[0]) + normal(&cameras[1]);
        let slope = cameras[0].transpose() * errors[0] + cameras[1].transpose() * errors[1];
        let joint = all.try_inverse().expect("dots enough") * slope;
        let off = fused.off(Some(&rotation), Some(&center));
        assert!(
            (off + joint).norm() < 1e-8 || (off - joint).norm() < 1e-8,
            "{off} {joint}"
        );
    }

    #[test]
    fn a_center_alone_helps_the_center() {
        let mut rng = ChaCha8Rng::seed_from_u64(65_203);
        let root = Matrix6::from_diagonal(&Vector6::new(0.01, 0.01, 0.01, 1e-3, 1e-3, 5e-3));
        let (rotation, center) = (Rotation::identity(), Vec3::new(0.0, 0.0, -1.0));
        let whole = reading(&rotation, &center, &root, &mut rng);
        let side = reading(&rotation, &center, &root, &mut rng).center_alone();
        let fused = fuse(&[whole, side]).expect("a measurement");
        assert_eq!(fused.freedom, 3);
        assert!(fused.reading.block(3, 3).trace() < 0.51 * whole.block(3, 3).trace());
        let alone = fuse(&[side]).expect("a center");
        assert_eq!((alone.freedom, alone.reading.rotation), (0, None));
        assert!((alone.reading.block(3, 3) - side.block(3, 3)).norm() < 1e-12);
        assert!(fuse(&[]).is_none());
    }

    #[test]
    fn quantiles_are_those_of_tables() {
        for (freedom, value) in [(3, 16.266), (6, 22.458), (12, 32.909)] {
            // The approximation is 1.8 % too large for three degrees of freedom, and less beyond.
            assert!((quantile_999(freedom) / value - 1.0).abs() < 0.02);
        }
    }
}
