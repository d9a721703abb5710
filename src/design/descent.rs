//! The descent: argmin's L-BFGS on the objective in spherical coordinates, with a penalty that keeps
//! dots apart.
//!
//! Minimized is `-f(x) + mu * sum_pairs max(0, cos(angle) - cos(least separation))^2`, where `f` is the
//! objective. The penalty is continuously differentiable; what it leaves of a violation is judged
//! afterwards by [`Constraints::check`].

use argmin::core::{CostFunction, Executor, Gradient, State};
use argmin::solver::linesearch::MoreThuenteLineSearch;
use argmin::solver::quasinewton::LBFGS;
use rand::Rng;

use super::objective::{MeanNearestNeighbour, ValueAndGradient};
use crate::error::{Error, Result};
use crate::geometry::{Spherical, Vec3, random_direction};
use crate::pattern::Pattern;

/// Gradients remembered by L-BFGS.
const MEMORY: usize = 8;
/// Weight of the separation penalty against an objective of order 0.1.
const PENALTY: f64 = 50.0;
/// Share of the demanded separation that a descent must reach to count as feasible.
const SEPARATION_SLACK: f64 = 0.98;
/// Tries to place one dot at random apart from the others before all start afresh.
const PLACEMENT_TRIES: usize = 2_000;
/// Fresh starts before a demand counts as infeasible.
const FRESH_STARTS: usize = 50;

/// What a pattern must satisfy to be drawn and read.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Constraints {
    /// Least angle between two dots, radians.
    pub least_separation_rad: f64,
    /// Fewest dots with z > 0 from any direction.
    pub least_visible: usize,
}

impl Default for Constraints {
    /// 18 degrees (6.3 mm on a 40 mm ball: holes of 4 mm with a wall between them), 5 dots in view.
    fn default() -> Self {
        Self {
            least_separation_rad: 18f64.to_radians(),
            least_visible: 5,
        }
    }
}

impl Constraints {
    /// Refuses what no pattern of `dots` dots can satisfy.
    ///
    /// Caps of half the separation must not overlap, and they cover the sphere at most to the density
    /// of the hexagonal packing; more exactly, by L. Fejes Toth, n points cannot all be farther apart
    /// than `acos((cot^2 w - 1) / 2)`, `w = pi n / (6 (n - 2))`. From a direction and its opposite at
    /// most n dots are seen together, so that no more than half of them can be promised.
    ///
    /// # Errors
    /// [`Error::Argument`] with the nearest figure that might work.
    pub fn check_demand(&self, dots: usize) -> Result<()> {
        let n = dots as f64;
        let w = std::f64::consts::PI * n / (6.0 * (n - 2.0));
        let limit = (0.5 * (w.tan().powi(-2) - 1.0)).clamp(-1.0, 1.0).acos();
        if !(self.least_separation_rad >= 0.0 && self.least_separation_rad < limit) {
            let problem = format!(
                "expected 0 to {:.1} degrees (no {dots} points on a sphere are farther apart), found {:.1}",
                limit.to_degrees(),
                self.least_separation_rad.to_degrees()
            );
            return Err(Error::argument("least separation", problem));
        }
        if self.least_visible > dots / 2 {
            let problem = format!(
                "expected at most {} of {dots} dots (opposite views share them), found {}",
                dots / 2,
                self.least_visible
            );
            return Err(Error::argument("least visible", problem));
        }
        Ok(())
    }

    /// Whether the pattern satisfies the constraints.
    pub fn check(&self, pattern: &Pattern) -> bool {
        let summary = pattern.summary();
        summary.least_separation_rad >= SEPARATION_SLACK * self.least_separation_rad
            && summary.least_visible >= self.least_visible
    }
}

struct Problem<'a> {
    objective: &'a MeanNearestNeighbour,
    constraints: &'a Constraints,
}

impl Problem<'_> {
    fn evaluate(&self, x: &[f64]) -> Result<ValueAndGradient> {
        let mut at = self.objective.evaluate(x)?;
        at.value = -at.value;
        at.gradient.iter_mut().for_each(|g| *g = -*g);
        let spherical: Vec<Spherical> = x
            .chunks_exact(2)
            .map(|c| Spherical {
                theta: c[0],
                phi: c[1],
            })
            .collect();
        let dots: Vec<Vec3> = spherical.iter().map(|s| s.to_unit()).collect();
        let bound = self.constraints.least_separation_rad.cos();
        for i in 0..dots.len() {
            for j in 0..i {
                let excess = dots[i].dot(&dots[j]) - bound;
                if excess <= 0.0 {
                    continue;
                }
                at.value += PENALTY * excess * excess;
                for (k, other) in [(i, dots[j]), (j, dots[i])] {
                    let jacobian = spherical[k].jacobian();
                    at.gradient[2 * k] += 2.0 * PENALTY * excess * jacobian.d_theta.dot(&other);
                    at.gradient[2 * k + 1] += 2.0 * PENALTY * excess * jacobian.d_phi.dot(&other);
                }
            }
        }
        Ok(at)
    }
}

impl CostFunction for Problem<'_> {
    type Param = Vec<f64>;
    type Output = f64;
    fn cost(&self, x: &Vec<f64>) -> std::result::Result<f64, argmin::core::Error> {
        Ok(self.evaluate(x)?.value)
    }
}

impl Gradient for Problem<'_> {
    type Param = Vec<f64>;
    type Gradient = Vec<f64>;
    fn gradient(&self, x: &Vec<f64>) -> std::result::Result<Vec<f64>, argmin::core::Error> {
        Ok(self.evaluate(x)?.gradient)
    }
}

/// Spherical coordinates of a pattern, two numbers a dot.
pub fn coordinates(pattern: &Pattern) -> Vec<f64> {
    pattern
        .dots()
        .iter()
        .flat_map(|d| {
            let s = Spherical::from_direction(d);
            [s.theta, s.phi]
        })
        .collect()
}

/// The pattern with these spherical coordinates.
///
/// # Errors
/// [`Error::Argument`] where two dots coincide or a coordinate is not finite.
pub fn pattern_at(coordinates: &[f64]) -> Result<Pattern> {
    Pattern::new(
        coordinates
            .chunks_exact(2)
            .map(|c| {
                Spherical {
                    theta: c[0],
                    phi: c[1],
                }
                .to_unit()
            })
            .collect(),
    )
}

/// Improves a pattern by at most `steps` steps of L-BFGS.
///
/// A line search can fail where the nearest neighbours switch; what was best until then is returned.
///
/// # Errors
/// [`Error::Argument`] where the result is no pattern.
pub fn descend(
    start: &Pattern,
    objective: &MeanNearestNeighbour,
    constraints: &Constraints,
    steps: u64,
) -> Result<Pattern> {
    let mut x = coordinates(start);
    let mut left = steps;
    // After a failed line search one restart from the best point with a fresh memory is worthwhile.
    for _ in 0..3 {
        let problem = Problem {
            objective,
            constraints,
        };
        let solver = LBFGS::new(MoreThuenteLineSearch::new(), MEMORY);
        let run = Executor::new(problem, solver)
            .configure(|state| state.param(x.clone()).max_iters(left))
            .ctrlc(false)
            .run();
        let Ok(result) = run else { break };
        left = left.saturating_sub(result.state().get_iter());
        match result.state().get_best_param() {
            Some(best) if *best != x => x.clone_from(best),
            _ => break,
        }
        if left == 0 {
            break;
        }
    }
    pattern_at(&x)
}

/// Random dots no nearer to each other than the constraint demands.
///
/// # Errors
/// [`Error::Argument`] where no such set was found: the demand is too dense.
pub fn random_pattern<R: Rng>(
    dots: usize,
    least_separation_rad: f64,
    rng: &mut R,
) -> Result<Pattern> {
    let bound = least_separation_rad.cos();
    for _ in 0..FRESH_STARTS {
        let mut placed: Vec<Vec3> = Vec::with_capacity(dots);
        for _ in 0..PLACEMENT_TRIES * dots {
            let d = random_direction(rng);
            if placed.iter().all(|p| p.dot(&d) < bound) {
                placed.push(d);
                if placed.len() == dots {
                    return Pattern::new(placed);
                }
            }
        }
    }
    Err(Error::argument(
        "dots",
        format!(
            "{dots} dots at least {:.1} degrees apart do not fit on a ball at random; ask for fewer or nearer dots",
            least_separation_rad.to_degrees()
        ),
    ))
}
