//! Bounces: where the path of a ball has a kink.
//!
//! Between each two positions a window of points before and after is fitted by two paths, a smooth one and one with a kink there at `s`,
//! a sudden change `j` of the velocity:
//!
//! ```text
//! p(t) = a + b t + c t^2,        p(t) = a + b t + c t^2 + j max(t - s, 0)
//! ```
//!
//! How much likelier the kink is follows from what both leave, `ln = (m / 2) ln(A0 / A1) + m ln(C0 / C1)` of `m` points, where `A` and `C` are
//! the sums of squares along the path and across it. Both scales are estimated: cameras lose frames and repeat them, so that a ball is far off *along* its
//! path and looks as if it had been hit. For the same reason a kink must explain more than a jump of the place does. Of kinks within a window the likeliest counts.
//!
//! On the published flights with even numbers half a window of 6, 8 and 10 points and odds of e^15 and e^20 find all 82 bounces off the table, and five or six more, which
//! are hits and walls at the ends of the paths; e^10 finds 17 to 23 that are not there. `tests/it/dataset.rs` counts those with odd numbers.
//!
//! Guarantees: the answer does not depend on the axes. Not guaranteed: bounces with fewer than [`MIN_SIDE`] points on one side, two within half a window of each other, and
//! those that change the velocity by less than [`BounceConfig::min_jump_m_s`].

use nalgebra::{Matrix3, SMatrix, SVector};

use crate::error::{Result, require};
use crate::geometry::Vec3;

/// Points on either side of a kink at least: three settle a parabola, and one is left to say how well.
pub const MIN_SIDE: usize = 4;
/// Places of a kink between two points that are tried.
const PLACES: usize = 4;
/// A kink explains what a jump does not, by odds of e to this: 20 to 1.
const OVER_JUMP: f64 = 3.0;
/// Nothing is smoother than this part of the window's size, squared: positions are rounded.
const ROUNDING: f64 = 1e-10;

/// What counts as a bounce.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BounceConfig {
    /// Points before a kink, and after it, that are fitted at most.
    pub half_window: usize,
    /// Natural logarithm of the odds for a kink, at least.
    pub min_log_odds: f64,
    /// The least change of the velocity, m/s: a ball that falls from 2 cm changes its by 1.2 m/s off a table.
    pub min_jump_m_s: f64,
}

impl Default for BounceConfig {
    /// 8 points to either side, odds of e^20, 0.7 m/s.
    fn default() -> Self {
        Self {
            half_window: 8,
            min_log_odds: 20.0,
            min_jump_m_s: 0.7,
        }
    }
}

impl BounceConfig {
    /// Checks the domains of all settings.
    ///
    /// # Errors
    /// [`crate::Error::Argument`] naming the setting.
    pub fn check(&self) -> Result<()> {
        let expected = format!("{MIN_SIDE} to 1000");
        let inside = (MIN_SIDE..=1000).contains(&self.half_window);
        require(inside, "half_window", &expected, self.half_window)?;
        let inside = self.min_log_odds > 0.0 && self.min_log_odds.is_finite();
        require(
            inside,
            "min_log_odds",
            "a positive number",
            self.min_log_odds,
        )?;
        let inside = self.min_jump_m_s >= 0.0 && self.min_jump_m_s.is_finite();
        require(
            inside,
            "min_jump_m_s",
            "a number of at least 0",
            self.min_jump_m_s,
        )
    }
}

/// Where a ball was.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PathPoint {
    /// Time, seconds.
    pub time_s: f64,
    /// Position, meters.
    pub position_m: Vec3,
}

/// A kink of a path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounce {
    /// The first point after it.
    pub after: usize,
    /// Its time, seconds.
    pub time_s: f64,
    /// Change of the velocity, m/s.
    pub jump_m_s: Vec3,
    /// Natural logarithm of the odds for it.
    pub log_odds: f64,
}

/// The bounces of a path, whose times do not decrease, in their order. `noise` is the covariance of a position up to a factor; without it all directions are
/// alike.
pub fn bounces(
    points: &[PathPoint],
    noise: Option<&Matrix3<f64>>,
    config: &BounceConfig,
) -> Vec<Bounce> {
    // In these axes all directions are as uncertain.
    let factor = noise.and_then(|c| c.cholesky()).map(|c| c.l());
    let whitened = factor
        .and_then(|l| l.try_inverse())
        .unwrap_or_else(Matrix3::identity);
    let back = whitened.try_inverse().unwrap_or_else(Matrix3::identity);
    let at = |after| BounceWindow::about(points, after, &whitened, config.half_window)?.kink();
    let found = (1..points.len()).filter_map(at).map(|kink| Bounce {
        jump_m_s: back * kink.jump_m_s,
        ..kink
    });
    let mut likely: Vec<Bounce> = found
        .filter(|b| b.log_odds >= config.min_log_odds && b.jump_m_s.norm() >= config.min_jump_m_s)
        .collect();
    likely.sort_by(|a, b| b.log_odds.total_cmp(&a.log_odds));
    let mut kept: Vec<Bounce> = Vec::new();
    for bounce in likely {
        let is_near = |k: &Bounce| k.after.abs_diff(bounce.after) <= config.half_window;
        if !kept.iter().any(is_near) {
            kept.push(bounce);
        }
    }
    kept.sort_by_key(|b| b.after);
    kept
}

/// The points about a place between two of them.
struct BounceWindow {
    /// Times from the point before the place on, in units of the window's duration.
    times: Vec<f64>,
    positions: Vec<Vec3>,
    /// How many lie before.
    before: usize,
    first: usize,
    start_s: f64,
    unit_s: f64,
}

/// What a fit leaves at each point, and the coefficients of what it has besides the smooth path.
struct FlightFit {
    left: Vec<Vec3>,
    slope: Vec3,
    extra: Vec3,
}

impl BounceWindow {
    fn about(points: &[PathPoint], after: usize, to: &Matrix3<f64>, half: usize) -> Option<Self> {
        let (first, end) = (after.saturating_sub(half), points.len().min(after + half));
        let (before, behind) = (after - first, end - after);
        let start_s = points[after - 1].time_s;
        let unit_s = points[end - 1].time_s - points[first].time_s;
        if before.min(behind) < MIN_SIDE || points[after].time_s <= start_s {
            return None;
        }
        let window = &points[first..end];
        Some(Self {
            times: window
                .iter()
                .map(|p| (p.time_s - start_s) / unit_s)
                .collect(),
            positions: window.iter().map(|p| to * p.position_m).collect(),
            before,
            first,
            start_s,
            unit_s,
        })
    }

    /// The smooth path with a further term, by least squares.
    fn fit(&self, term: Option<&dyn Fn(usize, f64) -> f64>) -> Option<FlightFit> {
        let more = |k: usize, t: f64| term.map_or(0.0, |term| term(k, t));
        let row = |k: usize, t: f64| SVector::<f64, 4>::new(1.0, t, t * t, more(k, t));
        let mut normal = SMatrix::<f64, 4, 4>::zeros();
        let mut right = SMatrix::<f64, 4, 3>::zeros();
        for (k, (t, p)) in self.times.iter().zip(&self.positions).enumerate() {
            let row = row(k, *t);
            normal += row * row.transpose();
            right += row * p.transpose();
        }
        if term.is_none() {
            normal[(3, 3)] = 1.0;
        }
        let solved = normal.cholesky()?.solve(&right);
        let of = |i: usize| solved.row(i).transpose();
        let points = self.times.iter().zip(&self.positions).enumerate();
        Some(FlightFit {
            left: points
                .map(|(k, (t, p))| p - solved.transpose() * row(k, *t))
                .collect(),
            slope: of(1),
            extra: of(3),
        })
    }

    /// The likeliest kink at this place, its jump in the window's axes; `None` where a jump of the place explains as much.
    fn kink(&self) -> Option<Bounce> {
        let smooth = self.fit(None)?;
        let along = smooth.slope.try_normalize(0.0)?;
        let size = self
            .positions
            .iter()
            .map(|p| (p - self.positions[0]).norm_squared());
        let rounding = ROUNDING * size.fold(0.0, f64::max) * self.times.len() as f64;
        let ln_left = |fit: &FlightFit| {
            let all: f64 = fit.left.iter().map(Vec3::norm_squared).sum();
            let ahead: f64 = fit.left.iter().map(|p| p.dot(&along).powi(2)).sum();
            let across = (all - ahead).max(0.0) + 2.0 * rounding;
            self.times.len() as f64 * (0.5 * (ahead + rounding).ln() + across.ln())
        };
        let jump = self.fit(Some(&|k, _| f64::from(u8::from(k >= self.before))))?;
        let next = self.times[self.before];
        let places = (0..PLACES).map(|k| next * (k as f64 + 0.5) / PLACES as f64);
        let kinks = places.filter_map(|place| {
            let fit = self.fit(Some(&|_, t| (t - place).max(0.0)))?;
            Some((place, ln_left(&fit), fit.extra))
        });
        let (place, ln, extra) = kinks.min_by(|a, b| a.1.total_cmp(&b.1))?;
        (ln_left(&jump) - ln > OVER_JUMP).then(|| Bounce {
            after: self.first + self.before,
            time_s: self.start_s + self.unit_s * place,
            jump_m_s: extra / self.unit_s,
            log_odds: ln_left(&smooth) - ln,
        })
    }
}
