//! Descents by gradients on an augmented Lagrangian.
//!
//! With constraints `g_k(x) <= 0`, multipliers `l_k` and a weight `w`, the function
//!
//! ```text
//! L(x) = cost(x) + sum_k (max(0, l_k + w g_k(x))^2 - l_k^2) / (2 w)
//! ```
//!
//! is minimized by argmin for a number of iterations; then `l_k` becomes `max(0, l_k + w g_k)`, and `w` grows where
//! the violation has not fallen (J. Nocedal, S. Wright, "Numerical Optimization", 2006, ch. 17.4). At the minimum
//! the constraints hold with a finite weight.
//!
//! The unknowns are either the vectors' ambient coordinates, each divided by its length where the cost is evaluated,
//! or the spherical ones. They are scaled so that the first move is as long as it should be.
//!
//! Not guaranteed: that the constraints hold at the end, which the programs after it see to.

use std::cell::{Cell, RefCell};
use std::sync::atomic::AtomicBool;

use argmin::core::{CostFunction, Executor, Gradient, IterState};
use argmin::solver::gradientdescent::SteepestDescent;
use argmin::solver::linesearch::MoreThuenteLineSearch;
use argmin::solver::quasinewton::LBFGS;

use super::{Cost, Demand, Descent, FIRST_MOVE, Point, flat, from_argmin, vectors};
use crate::design::constraints::ConstraintRow;
use crate::error::Result;
use crate::geometry::{Spherical, Vec3};

/// Iterations between two updates of the multipliers.
const INNER: u64 = 12;
/// Pairs of moves and changes that L-BFGS remembers.
const MEMORY: usize = 10;
/// The first weight of the constraints, and by what it grows where the violation falls by less than [`FALL`].
const FIRST_WEIGHT: f64 = 300.0;
const GROWTH: f64 = 3.0;
const FALL: f64 = 0.4;
/// Relative width of a line search's interval at which it ends: at a kink it would go on to rounding.
const WIDTH: f64 = 1e-3;

/// Coordinates of unit vectors.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Chart {
    /// x, y, z of any length.
    Ambient,
    /// theta, phi.
    Spherical,
}

impl Chart {
    fn coordinates(self, at: &[Vec3]) -> Vec<f64> {
        match self {
            Self::Ambient => flat(at),
            Self::Spherical => at
                .iter()
                .map(Spherical::from_direction)
                .flat_map(|s| [s.theta, s.phi])
                .collect(),
        }
    }

    fn vectors(self, x: &[f64]) -> Vec<Vec3> {
        match self {
            Self::Ambient => vectors(x).iter().map(Vec3::normalize).collect(),
            Self::Spherical => x.chunks_exact(2).map(|c| spherical(c).to_unit()).collect(),
        }
    }

    /// The derivative by the coordinates of one by the unit vectors, whose parts along them do not count.
    fn gradient(self, x: &[f64], by_vector: &[Vec3]) -> Vec<f64> {
        match self {
            Self::Ambient => {
                let all = vectors(x).into_iter().zip(by_vector);
                let by_coordinates = all.flat_map(|(v, g)| {
                    let (unit, length) = (v.normalize(), v.norm());
                    let tangent = (g - unit * unit.dot(g)) / length;
                    [tangent.x, tangent.y, tangent.z]
                });
                by_coordinates.collect()
            }
            Self::Spherical => {
                let all = x.chunks_exact(2).zip(by_vector);
                let by_coordinates = all.flat_map(|(c, g)| {
                    let jacobian = spherical(c).jacobian();
                    [jacobian.d_theta.dot(g), jacobian.d_phi.dot(g)]
                });
                by_coordinates.collect()
            }
        }
    }
}

fn spherical(coordinates: &[f64]) -> Spherical {
    Spherical {
        theta: coordinates[0],
        phi: coordinates[1],
    }
}

/// The evaluations are used up, or a stop was asked for.
#[derive(Debug, thiserror::Error)]
#[error("ended")]
struct Ended;

/// The multipliers of the constraints, by [`ConstraintRow::number`], and their weight.
struct Multipliers {
    of: Vec<f64>,
    weight: f64,
}

impl Multipliers {
    /// The constraints that count at `x`, each with `max(0, l + w g)`: of those with one number, the most violated.
    fn active<C: Cost>(&self, demand: &Demand<'_, C>, x: &[Vec3]) -> Vec<(ConstraintRow, f64)> {
        let largest = self.of.iter().copied().fold(0.0, f64::max);
        let mut rows: Vec<(ConstraintRow, f64)> = Vec::new();
        demand
            .constraints
            .rows(x, 0.5 * largest / self.weight, &mut |row| {
                let force = self.of[row.number] + self.weight * row.violation;
                match rows.last_mut() {
                    Some(last) if last.0.number == row.number => {
                        if last.0.violation < row.violation {
                            *last = (row, force);
                        }
                    }
                    _ => rows.push((row, force)),
                }
            });
        rows.retain(|(_, force)| *force > 0.0);
        rows
    }

    fn update<C: Cost>(&mut self, demand: &Demand<'_, C>, at: &Point, before: f64) {
        let active = self.active(demand, &at.vectors);
        self.of.fill(0.0);
        for (row, force) in active {
            self.of[row.number] = force;
        }
        if at.violation > FALL * before {
            self.weight *= GROWTH;
        }
    }
}

/// What argmin minimizes: the Lagrangian, with the best point met.
struct Lagrangian<'a, C: Cost> {
    demand: &'a Demand<'a, C>,
    chart: Chart,
    /// Length of a unit of a scaled coordinate.
    scale: f64,
    multipliers: Multipliers,
    /// Evaluations that are left.
    left: Cell<u64>,
    stop: &'a AtomicBool,
    /// Where it was evaluated last: argmin asks for value and gradient apart.
    last: RefCell<Option<Evaluated>>,
    best: RefCell<Point>,
}

#[derive(Clone)]
struct Evaluated {
    x: Vec<f64>,
    value: f64,
    gradient: Vec<f64>,
    point: Point,
}

impl<C: Cost> Lagrangian<'_, C> {
    /// The Lagrangian at a point: its value, and its derivative by the vectors.
    fn of(&self, point: &Point) -> (f64, Vec<Vec3>) {
        let mut value = point.cost;
        let mut gradient = point.gradient.clone();
        for (row, force) in self.multipliers.active(self.demand, &point.vectors) {
            value += 0.5 * force * force / self.multipliers.weight;
            for (index, by_vector) in row.terms {
                gradient[index] += force * by_vector;
            }
        }
        gradient[..self.demand.constraints.drawn].fill(Vec3::zeros());
        (value, gradient)
    }

    fn evaluate<T>(
        &self,
        x: &[f64],
        of: impl Fn(&Evaluated) -> T,
    ) -> std::result::Result<T, argmin::core::Error> {
        if let Some(last) = self.last.borrow().as_ref().filter(|last| last.x == x) {
            return Ok(of(last));
        }
        if self.left.get() == 0 || Descent::is_stopped(self.stop) {
            return Err(Ended.into());
        }
        self.left.set(self.left.get() - 1);
        let coordinates: Vec<f64> = x.iter().map(|c| c * self.scale).collect();
        let point = self.demand.at(self.chart.vectors(&coordinates))?;
        let found = self.scaled(x.to_vec(), &coordinates, point);
        if found.point.merit() < self.best.borrow().merit() {
            self.best.replace(found.point.clone());
        }
        let result = of(&found);
        self.last.replace(Some(found));
        Ok(result)
    }

    fn scaled(&self, x: Vec<f64>, coordinates: &[f64], point: Point) -> Evaluated {
        let (value, by_vector) = self.of(&point);
        let mut gradient = self.chart.gradient(coordinates, &by_vector);
        gradient.iter_mut().for_each(|g| *g *= self.scale);
        Evaluated {
            x,
            value,
            gradient,
            point,
        }
    }

    /// Sets the scale so that the first move, against the gradient, has its length, and begins at `point`, which is
    /// evaluated already.
    fn begin(&mut self, point: Point) -> Vec<f64> {
        let steepest = self.of(&point).1.iter().map(Vec3::norm).fold(0.0, f64::max);
        self.scale = (FIRST_MOVE / steepest.max(1e-6)).sqrt();
        let coordinates = self.chart.coordinates(&point.vectors);
        let x: Vec<f64> = coordinates.iter().map(|c| c / self.scale).collect();
        let found = self.scaled(x.clone(), &coordinates, point);
        self.last.replace(Some(found));
        x
    }
}

impl<C: Cost> CostFunction for &Lagrangian<'_, C> {
    type Param = Vec<f64>;
    type Output = f64;

    fn cost(&self, x: &Vec<f64>) -> std::result::Result<f64, argmin::core::Error> {
        self.evaluate(x, |found| found.value)
    }
}

impl<C: Cost> Gradient for &Lagrangian<'_, C> {
    type Param = Vec<f64>;
    type Gradient = Vec<f64>;

    fn gradient(&self, x: &Vec<f64>) -> std::result::Result<Vec<f64>, argmin::core::Error> {
        self.evaluate(x, |found| found.gradient.clone())
    }
}

/// Lowers the merit from `start` with at most `steps` evaluations, or until `stop`; the best point met.
pub(super) fn run<C: Cost>(
    demand: &Demand<'_, C>,
    start: Point,
    chart: Chart,
    steps: u64,
    stop: &AtomicBool,
) -> Result<Point> {
    let dots = start.vectors.len() - 1;
    let mut problem = Lagrangian {
        demand,
        chart,
        scale: 1.0,
        multipliers: Multipliers {
            of: vec![0.0; demand.constraints.count(dots)],
            weight: FIRST_WEIGHT,
        },
        left: Cell::new(steps),
        stop,
        last: RefCell::new(None),
        best: RefCell::new(start.clone()),
    };
    let mut at = start;
    while problem.left.get() > 0 && !Descent::is_stopped(stop) {
        let before = problem.left.get();
        let x = problem.begin(at.clone());
        minimize(&problem, x)?;
        let reached = problem
            .last
            .borrow()
            .as_ref()
            .map(|last| last.point.clone());
        let reached = reached.unwrap_or_else(|| at.clone());
        problem.multipliers.update(demand, &reached, at.violation);
        if problem.left.get() == before {
            // The first point is a minimum already.
            break;
        }
        at = reached;
    }
    Ok(problem.best.into_inner())
}

/// Minimizes the Lagrangian as it stands, from `x`.
fn minimize<C: Cost>(problem: &Lagrangian<'_, C>, x: Vec<f64>) -> Result<()> {
    let search = MoreThuenteLineSearch::new().with_width_tolerance(WIDTH);
    let search = search.map_err(from_argmin)?;
    let begin =
        |state: IterState<Vec<f64>, Vec<f64>, (), (), (), f64>| state.param(x).max_iters(INNER);
    let ended = match problem.chart {
        Chart::Ambient => Executor::new(problem, LBFGS::new(search, MEMORY))
            .configure(begin)
            .ctrlc(false)
            .run()
            .map(drop),
        Chart::Spherical => Executor::new(problem, SteepestDescent::new(search))
            .configure(begin)
            .ctrlc(false)
            .run()
            .map(drop),
    };
    match ended {
        Ok(()) => Ok(()),
        // A line search that finds no lower point ends where the last one did.
        Err(error) if error.is::<crate::error::Error>() => Err(from_argmin(error)),
        Err(_) => Ok(()),
    }
}
