//! The path of a ball whose spin changes at random: its smoother and its evidence.
//!
//! A ball at the times `t_k` with the orientation `R_k` and the spin `b_k + v_k`, where `b_k` is that of a motion that is already known,
//! the base, turns on by
//!
//! ```text
//! R_k+1 = exp(n) S_k R_k,   S_k = exp(dt (m + v)) exp(-dt m) T_k,   v = (v_k + v_k+1) / 2
//! v_k+1 = v_k + n',         n' ~ N(0, q dt),   n ~ N(0, q dt^3 / 12)
//! ```
//!
//! with the base's turn `T_k` and its spin `m` halfway. That is a spin in random motion about the base's with the density `q` of its change
//! (T. Barfoot, C. H. Tong, S. Sarkka, "Batch continuous-time trajectory estimation as exactly sparse Gaussian process regression", RSS
//! 2014: the white noise on acceleration; `n` and `n'` are independent as written here). With `q = 0` it is the base with any orientation and any
//! spin about it. Orientations are measured as `exp(e) R_k`, each wrong with a probability of its own.
//!
//! The path is the iterated Kalman smoother's (B. Bell, "The iterated Kalman smoother as a Gauss-Newton method", SIAM J. Optim. 4,
//! 1994), and with it by expectation-maximization the probabilities that the orientations are right, and their noise. The evidence is the
//! variational bound of the mixture: that of a Gaussian process whose measurements have the variances `s^2 / p_k`.
//!
//! A frame that turns at an unknown rate `d` (`super::super::shared`) makes every spin turn at `d x w`. It is a part of the state then, of nine
//! numbers instead of six.
//!
//! The cost is linear in the orientations.

use nalgebra::{Matrix3, SMatrix, SVector};

use crate::geometry::{Rotation, Vec3, left_jacobian};
use crate::spin::Measurement;
use crate::spin::mixture::{NoiseVariance, ROTATION_VOLUME, inlier_probability, trusted};

/// Variance of a normal distribution as dense at its middle as an orientation that nothing is known of, rad^2.
const ANY_ORIENTATION: f64 = 2.930_4;
/// A measurement less likely to be right than this has no say.
const MIN_PROBABILITY: f64 = 1e-6;
/// `ln(2 pi)`.
const LN_TAU: f64 = 1.837_877_066_409_345_5;
/// A path whose evidence rises by less has settled.
const SETTLED: f64 = 0.02;

/// A motion at the times of the measurements, which a path leaves.
#[derive(Debug, Clone)]
pub(super) struct Base {
    pub orientations: Vec<Rotation>,
    pub spins: Vec<Vec3>,
}

/// What is known of a path before its measurements.
#[derive(Debug, Clone, Copy)]
pub(super) struct ProcessPrior {
    /// Density of the spin's change, (rad/s)^2 per second.
    pub change: f64,
    /// Standard deviation of the spin at the beginning about the base's, rad/s.
    pub spin: f64,
    /// Covariance of the rate at which the frame turns, (rad/s)^2; nothing where it does not.
    pub turning: Option<Matrix3<f64>>,
    /// Variance that neighbors in time share beside their noise, rad^2 of a single one.
    pub shared: f64,
    pub noise: NoiseVariance,
}

/// A path.
#[derive(Debug, Clone)]
pub(super) struct SmoothPath {
    pub orientations: Vec<Rotation>,
    /// The spins beside the base's, rad/s.
    pub beside: Vec<Vec3>,
    /// The rate at which the frame turns, rad/s.
    pub turning: Vec3,
    /// Probability of each measurement to be right.
    pub right: Vec<f64>,
    /// Noise per axis, radians.
    pub sigma_rad: f64,
    /// Natural logarithm of the evidence, with the density of the noise.
    pub ln_evidence: f64,
    /// Covariances of orientations and spins.
    pub variances: Vec<[Matrix3<f64>; 2]>,
    /// Covariance of the mean spin.
    pub mean: Matrix3<f64>,
    /// By how much the likeliest jump of orientation and spin would raise twice the logarithm of the likelihood: of six degrees of
    /// freedom where there is none (P. de Jong, J. Penzer, "Diagnosing shocks in time series", J. Am. Stat. Assoc. 93, 1998).
    pub jump: f64,
}

impl SmoothPath {
    /// The base itself.
    pub fn of_base(base: &Base, measurements: &[Measurement], sigma_rad: f64) -> Self {
        let right = measurements.iter().zip(&base.orientations).map(|(m, r)| {
            let angle = r.angle_to(&m.orientation);
            inlier_probability(
                m.confidence,
                angle * angle,
                (sigma_rad * m.sigma_scale).powi(2),
            )
        });
        Self {
            orientations: base.orientations.clone(),
            beside: vec![Vec3::zeros(); base.spins.len()],
            turning: Vec3::zeros(),
            right: right.collect(),
            sigma_rad,
            ln_evidence: f64::NEG_INFINITY,
            variances: Vec::new(),
            mean: Matrix3::zeros(),
            jump: 0.0,
        }
    }

    /// The path after so many steps, or as many as raise its evidence.
    pub fn settled(
        self,
        measurements: &[Measurement],
        base: &Base,
        prior: &ProcessPrior,
        steps: usize,
    ) -> Option<Self> {
        let mut best: Option<Self> = None;
        let mut path = self;
        for _ in 0..steps {
            path = match prior.turning {
                None => improved::<6>(&path, measurements, base, prior)?,
                Some(_) => improved::<9>(&path, measurements, base, prior)?,
            };
            let before = best.as_ref().map_or(f64::NEG_INFINITY, |b| b.ln_evidence);
            if path.ln_evidence > before {
                best = Some(path.clone());
            }
            if path.ln_evidence < before + SETTLED {
                break;
            }
        }
        best
    }
}

/// The state of a frame by the measurements until then, and what leads to the next.
struct Filtered<const S: usize> {
    state: SVector<f64, S>,
    covariance: SMatrix<f64, S, S>,
    /// The next state and its covariance, before its measurement, and the smoother's gain.
    predicted: SVector<f64, S>,
    wide: SMatrix<f64, S, S>,
    gain: SMatrix<f64, S, S>,
}

impl<const S: usize> Filtered<S> {
    /// How surprising the next state is, as it is known in the end, for what was predicted of it.
    fn jump(&self, state: &SVector<f64, S>, covariance: &SMatrix<f64, S, S>) -> f64 {
        let off: SVector<f64, 6> = (state - self.predicted).fixed_rows::<6>(0).into_owned();
        let open: SMatrix<f64, 6, 6> = (self.wide - covariance)
            .fixed_view::<6, 6>(0, 0)
            .into_owned();
        let solved = open.cholesky().map(|c| off.dot(&c.solve(&off)));
        // Where nothing later is known nothing surprises.
        solved.unwrap_or(0.0)
    }
}

/// The path after a step of the smoother, its probabilities and its noise; the evidence is that of the given one.
fn improved<const S: usize>(
    path: &SmoothPath,
    measurements: &[Measurement],
    base: &Base,
    prior: &ProcessPrior,
) -> Option<SmoothPath> {
    let (filtered, ln_evidence) = filtered::<S>(path, measurements, base, prior)?;
    let n = measurements.len();
    let mut next = path.clone();
    next.ln_evidence = ln_evidence;
    next.variances = vec![[Matrix3::zeros(); 2]; n];
    next.jump = 0.0;
    let weights = trapezes(measurements);
    let last = &filtered[n - 1];
    let (mut state, mut covariance) = (last.state, last.covariance);
    // Covariances of the state with the weighted sum of the later spins, and of that sum.
    let (mut with_sum, mut of_sum) = (SMatrix::<f64, S, 3>::zeros(), Matrix3::zeros());
    for k in (0..n).rev() {
        if k + 1 < n {
            let f = &filtered[k];
            next.jump = next.jump.max(f.jump(&state, &covariance));
            state = f.state + f.gain * (state - f.predicted);
            let own = f.covariance + f.gain * (covariance - f.wide) * f.gain.transpose();
            covariance = (own + own.transpose()) * 0.5;
            with_sum = f.gain * with_sum;
        }
        let with_spin = covariance.fixed_view::<S, 3>(0, 3).into_owned();
        let of_spin: Matrix3<f64> = with_spin.fixed_view::<3, 3>(3, 0).into_owned();
        let mixed: Matrix3<f64> = with_sum.fixed_view::<3, 3>(3, 0).into_owned();
        let w = weights[k];
        of_sum += of_spin * (w * w) + (mixed + mixed.transpose()) * w;
        with_sum += with_spin * w;
        let turn: Vec3 = state.fixed_rows::<3>(0).into_owned();
        let turned = Rotation::from_scaled_axis(turn) * path.orientations[k];
        next.orientations[k] = Rotation::new_normalize(turned.into_inner());
        next.beside[k] += state.fixed_rows::<3>(3);
        next.variances[k] = [covariance.fixed_view::<3, 3>(0, 0).into_owned(), of_spin];
    }
    if S == 9 {
        next.turning += state.fixed_rows::<3>(S - 3);
    }
    next.mean = of_sum;
    next.judge(measurements, prior);
    Some(next)
}

/// The filter about a path, and its evidence; `None` where a covariance is none.
fn filtered<const S: usize>(
    path: &SmoothPath,
    measurements: &[Measurement],
    base: &Base,
    prior: &ProcessPrior,
) -> Option<(Vec<Filtered<S>>, f64)> {
    let n = measurements.len();
    let (mut state, mut covariance) = before::<S>(path, prior);
    let mut ln_evidence = prior.noise.ln_prior(path.sigma_rad, 0);
    let mut all = Vec::with_capacity(n);
    for (k, m) in measurements.iter().enumerate() {
        let p = path.right[k];
        ln_evidence += ln_of_mixture(m, p);
        if p > MIN_PROBABILITY {
            let own = (path.sigma_rad * m.sigma_scale).powi(2) + prior.shared;
            let off = m.orientation * path.orientations[k].inverse();
            let turn: Vec3 = state.fixed_rows::<3>(0).into_owned();
            let error: Vec3 = off.scaled_axis() - turn;
            let of_turn: Matrix3<f64> = covariance.fixed_view::<3, 3>(0, 0).into_owned();
            let wide = of_turn + Matrix3::from_diagonal_element(own / p);
            let solved = wide.cholesky()?;
            let ln_determinant = 2.0 * solved.l_dirty().diagonal().map(f64::ln).sum();
            ln_evidence -= 0.5 * (error.dot(&solved.solve(&error)) + ln_determinant)
                + 1.5 * (LN_TAU - (1.0 - p) * (LN_TAU + own.ln()) + p.ln());
            let gain = covariance.fixed_view::<S, 3>(0, 0) * solved.inverse();
            state += gain * error;
            let narrowed = covariance - gain * covariance.fixed_view::<3, S>(0, 0);
            covariance = (narrowed + narrowed.transpose()) * 0.5;
        }
        let (predicted, wide, gain) = match k + 1 < n {
            true => {
                let step = ProcessStep::<S>::of(path, base, prior, measurements, k);
                let wide = step.slope * covariance * step.slope.transpose() + step.noise;
                let solved = wide.cholesky()?;
                let gain = solved.solve(&(step.slope * covariance)).transpose();
                (step.slope * state + step.offset, wide, gain)
            }
            false => (state, covariance, SMatrix::zeros()),
        };
        all.push(Filtered {
            state,
            covariance,
            predicted,
            wide,
            gain,
        });
        (state, covariance) = (predicted, wide);
    }
    ln_evidence.is_finite().then_some((all, ln_evidence))
}

/// The state about a path before the first frame, and its covariance.
fn before<const S: usize>(
    path: &SmoothPath,
    prior: &ProcessPrior,
) -> (SVector<f64, S>, SMatrix<f64, S, S>) {
    let mut state = SVector::<f64, S>::zeros();
    let mut covariance = SMatrix::<f64, S, S>::zeros();
    state.fixed_rows_mut::<3>(3).copy_from(&-path.beside[0]);
    for i in 0..3 {
        covariance[(i, i)] = ANY_ORIENTATION;
        covariance[(3 + i, 3 + i)] = prior.spin * prior.spin;
    }
    if let Some(turning) = prior.turning.filter(|_| S == 9) {
        state.fixed_rows_mut::<3>(S - 3).copy_from(&-path.turning);
        covariance
            .fixed_view_mut::<3, 3>(S - 3, S - 3)
            .copy_from(&turning);
    }
    (state, covariance)
}

/// What a measurement that is right with the probability `p` adds to the evidence beside its density.
fn ln_of_mixture(m: &Measurement, p: f64) -> f64 {
    let c = trusted(m.confidence);
    let entropy = |p: f64| if p > 0.0 { -p * p.ln() } else { 0.0 };
    let wrong = ((1.0 - c) / ROTATION_VOLUME).ln();
    match p > MIN_PROBABILITY {
        true => p * c.ln() + (1.0 - p) * wrong + entropy(p) + entropy(1.0 - p),
        false => wrong,
    }
}

/// One step of the process, linear about a path: the state in the next frame is `slope * state + offset`, and noise.
struct ProcessStep<const S: usize> {
    slope: SMatrix<f64, S, S>,
    offset: SVector<f64, S>,
    noise: SMatrix<f64, S, S>,
}

impl<const S: usize> ProcessStep<S> {
    fn of(
        path: &SmoothPath,
        base: &Base,
        prior: &ProcessPrior,
        measurements: &[Measurement],
        k: usize,
    ) -> Self {
        let dt = measurements[k + 1].time_s - measurements[k].time_s;
        let beside = [path.beside[k], path.beside[k + 1]];
        let middle = (base.spins[k] + base.spins[k + 1]) * 0.5;
        let halfway = (beside[0] + beside[1]) * 0.5;
        let turn = base.orientations[k + 1] * base.orientations[k].inverse();
        let whole = (middle + halfway) * dt;
        let step =
            Rotation::from_scaled_axis(whole) * Rotation::from_scaled_axis(middle * -dt) * turn;
        let there = step * path.orientations[k] * path.orientations[k + 1].inverse();
        // The change of a turn by the spin.
        let lever = left_jacobian(&whole) * dt;
        let turning = path.turning.cross(&(base.spins[k] + beside[0])) * dt;
        let rise = beside[0] - beside[1] + turning;
        let mut slope = SMatrix::<f64, S, S>::identity();
        let mut offset = SVector::<f64, S>::zeros();
        slope
            .fixed_view_mut::<3, 3>(0, 0)
            .copy_from(step.to_rotation_matrix().matrix());
        slope.fixed_view_mut::<3, 3>(0, 3).copy_from(&lever);
        offset
            .fixed_rows_mut::<3>(0)
            .copy_from(&(there.scaled_axis() + lever * rise * 0.5));
        offset.fixed_rows_mut::<3>(3).copy_from(&rise);
        if S == 9 {
            let by_turning = (base.spins[k] + beside[0]).cross_matrix() * -dt;
            slope
                .fixed_view_mut::<3, 3>(0, S - 3)
                .copy_from(&(lever * by_turning * 0.5));
            slope
                .fixed_view_mut::<3, 3>(3, S - 3)
                .copy_from(&by_turning);
        }
        let mut noise = SMatrix::<f64, S, S>::zeros();
        let of_spin = prior.change * dt;
        let bridge = Matrix3::from_diagonal_element(of_spin * dt * dt / 12.0);
        noise
            .fixed_view_mut::<3, 3>(0, 0)
            .copy_from(&(lever * lever.transpose() * (0.25 * of_spin) + bridge));
        let mixed = lever * (0.5 * of_spin);
        noise.fixed_view_mut::<3, 3>(0, 3).copy_from(&mixed);
        noise
            .fixed_view_mut::<3, 3>(3, 0)
            .copy_from(&mixed.transpose());
        noise
            .fixed_view_mut::<3, 3>(3, 3)
            .copy_from(&Matrix3::from_diagonal_element(of_spin));
        Self {
            slope,
            offset,
            noise,
        }
    }
}

impl SmoothPath {
    /// The probabilities of the measurements and their noise that go with the path.
    fn judge(&mut self, measurements: &[Measurement], prior: &ProcessPrior) {
        let (mut support, mut squares) = (0.0, 0.0);
        for (k, m) in measurements.iter().enumerate() {
            let scale = m.sigma_scale * m.sigma_scale;
            let noise = self.sigma_rad * self.sigma_rad * scale;
            let own = noise + prior.shared;
            let open = self.variances[k][0].trace();
            let angle = self.orientations[k].angle_to(&m.orientation);
            let square = angle * angle;
            // What no right neighbor leads to yet is open, and may be.
            let p = inlier_probability(m.confidence, square, own + open / 3.0);
            // Of an error's square the share that is noise.
            let share = noise / own;
            squares += p * (share * share * (square + open) + 3.0 * share * prior.shared) / scale;
            support += p;
            self.right[k] = p;
        }
        self.sigma_rad = prior.noise.updated(support, squares, 0).0;
    }

    /// Measurements that are rather right than wrong.
    pub fn inliers(&self) -> usize {
        self.right.iter().filter(|p| **p > 0.5).count()
    }
}

/// Shares of the time that the spin of each measurement stands for.
pub(super) fn trapezes(measurements: &[Measurement]) -> Vec<f64> {
    let n = measurements.len();
    let whole = measurements[n - 1].time_s - measurements[0].time_s;
    let at = |k: usize| measurements[k.min(n - 1)].time_s;
    (0..n)
        .map(|k| 0.5 * (at(k + 1) - at(k.saturating_sub(1))) / whole)
        .collect()
}
