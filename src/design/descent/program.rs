//! Sequential convex programming on the sphere.
//!
//! At the dots x with the cost's gradient g (in the tangent planes) and a quasi-Newton matrix B,
//! the move s solves the convex program
//!
//! ```text
//! min  g.s + s.B s / 2 + rho t    s.t.  violation_k + a_k.s <= t,  |s_i| <= Delta,  t >= 0,
//! ```
//!
//! by clarabel's interior point method; the vectors are then projected back onto the sphere. The
//! shared slack t keeps the program feasible where the constraints cannot all be met at once (an
//! exact penalty on the largest violation). The move is taken where the merit
//! `cost + rho * violation` falls by a sufficient fraction of the predicted decrease; the trust
//! region grows and shrinks accordingly (J. Nocedal, S. Wright, "Numerical Optimization", 2006, ch.
//! 18.5). B is updated by Powell's damped BFGS in ambient coordinates, so no transport between
//! tangent planes is needed; gradients are projected.
//!
//! The merit never rises. At kinks of the cost the trust region shrinks until the model predicts it, and on costs
//! that are all kinks the program gets stuck.

use std::sync::atomic::AtomicBool;

use argmin::core::{
    Executor, IterState, KV, Problem, Solver, TerminationReason, TerminationStatus,
};
use clarabel::algebra::CscMatrix;
use clarabel::solver::{
    DefaultSettingsBuilder, DefaultSolver, IPSolver, NonnegativeConeT, SolverStatus, SupportedConeT,
};
use nalgebra::{DMatrix, DVector};

use super::{Cost, Demand, Descent, FIRST_MOVE, Point, RHO, flat, from_argmin, vectors};
use crate::design::constraints::{ConstraintRow, Constraints};
use crate::error::Result;
use crate::geometry::{Vec3, tangent_frame};

/// Maximum trust radius, radians per tangent coordinate.
const MAX_RADIUS: f64 = 0.2;
/// A trust radius below this ends the descent.
const MIN_RADIUS: f64 = 1e-5;
/// Fraction of the predicted decrease that a move must reach to be taken, and to widen the trust
/// region.
const TAKEN: f64 = 0.05;
const WIDENED: f64 = 0.6;

/// The state of a descent: the current point, which is the best so far, and the model there.
struct Iteration<'a> {
    at: Point,
    hessian: DMatrix<f64>,
    radius: f64,
    stop: &'a AtomicBool,
}

impl<'a> Iteration<'a> {
    fn begin(at: Point, stop: &'a AtomicBool) -> Self {
        let squares = at.gradient.iter().map(Vec3::norm_squared);
        let norm = squares.sum::<f64>().sqrt();
        let size = 3 * at.vectors.len();
        // The first move then is about the trust radius.
        let scale = (norm / (FIRST_MOVE * (size as f64).sqrt())).max(1e-3);
        Self {
            at,
            hessian: DMatrix::identity(size, size) * scale,
            radius: FIRST_MOVE,
            stop,
        }
    }

    /// Solves one convex program, and takes its move where that lowers the merit as predicted.
    fn step<C: Cost>(&mut self, demand: &Demand<'_, C>) -> Result<()> {
        let constraints = demand.constraints;
        let Some(step) = Move::solve(&self.at, &self.hessian, self.radius, constraints) else {
            self.radius *= 0.3;
            return Ok(());
        };
        let (drawn, free) = self.at.vectors.split_at(constraints.drawn);
        let moved = free.iter().zip(&step.moves[drawn.len()..]);
        let moved = moved.map(|(v, m)| (v + m).normalize());
        let there = demand.at(drawn.iter().copied().chain(moved).collect())?;
        let kept = (self.at.merit() - there.merit()) / step.promised.max(1e-15);
        self.update(&there);
        self.radius = if kept > WIDENED {
            (1.6 * self.radius).min(MAX_RADIUS)
        } else if kept > TAKEN {
            0.8 * self.radius
        } else {
            0.4 * self.radius
        };
        if kept > TAKEN {
            self.at = there;
        }
        Ok(())
    }

    /// Powell's damped BFGS update from the current point to another, taken or not.
    fn update(&mut self, to: &Point) {
        let from = &self.at;
        let s = DVector::from_vec(flat(&to.vectors)) - DVector::from_vec(flat(&from.vectors));
        let y = DVector::from_vec(flat(&to.gradient)) - DVector::from_vec(flat(&from.gradient));
        let b_s = &self.hessian * &s;
        let s_b_s = s.dot(&b_s);
        if s_b_s < 1e-16 {
            return;
        }
        let s_y = s.dot(&y);
        let damping = if s_y >= 0.2 * s_b_s {
            1.0
        } else {
            0.8 * s_b_s / (s_b_s - s_y)
        };
        let r = y * damping + &b_s * (1.0 - damping);
        self.hessian.ger(-1.0 / s_b_s, &b_s, &b_s, 1.0);
        self.hessian.ger(1.0 / s.dot(&r), &r, &r, 1.0);
    }
}

/// What argmin keeps of it: the vectors' coordinates, and the merit.
type ProgramState = IterState<Vec<f64>, (), (), (), (), f64>;

impl<C: Cost> Solver<&Demand<'_, C>, ProgramState> for Iteration<'_> {
    fn name(&self) -> &str {
        "sequential convex programming"
    }

    fn next_iter(
        &mut self,
        problem: &mut Problem<&Demand<'_, C>>,
        state: ProgramState,
    ) -> std::result::Result<(ProgramState, Option<KV>), argmin::core::Error> {
        problem.problem("evaluations", |demand| Ok(self.step(demand)?))?;
        let state = state.param(flat(&self.at.vectors)).cost(self.at.merit());
        Ok((state, None))
    }

    fn terminate(&mut self, _: &ProgramState) -> TerminationStatus {
        if Descent::is_stopped(self.stop) {
            TerminationStatus::Terminated(TerminationReason::Interrupt)
        } else if self.radius < MIN_RADIUS {
            TerminationStatus::Terminated(TerminationReason::SolverConverged)
        } else {
            TerminationStatus::NotTerminated
        }
    }
}

/// Lowers the merit from `start` by at most `steps` convex programs, or until `stop`.
pub(super) fn run<C: Cost>(
    demand: &Demand<'_, C>,
    start: Point,
    steps: u64,
    stop: &AtomicBool,
) -> Result<Point> {
    let found = Executor::new(demand, Iteration::begin(start, stop))
        .configure(|state: ProgramState| state.max_iters(steps))
        .ctrlc(false)
        .run()
        .map_err(from_argmin)?;
    Ok(found.solver.at)
}

/// A solution of the convex program.
struct Move {
    /// Tangent moves of the vectors.
    moves: Vec<Vec3>,
    /// The predicted decrease of the merit.
    promised: f64,
}

impl Move {
    fn solve(
        at: &Point,
        hessian: &DMatrix<f64>,
        radius: f64,
        constraints: &Constraints,
    ) -> Option<Self> {
        let count = at.vectors.len();
        // Dots that are drawn have no coordinates in the program: they stay.
        let drawn = constraints.drawn;
        let free = &at.vectors[drawn..];
        let frames: Vec<[Vec3; 2]> = free.iter().map(tangent_frame).collect();
        let mut basis = DMatrix::zeros(3 * count, 2 * free.len());
        for (i, frame) in frames.iter().enumerate() {
            for (k, axis) in frame.iter().enumerate() {
                basis
                    .fixed_view_mut::<3, 1>(3 * (drawn + i), 2 * i + k)
                    .copy_from(axis);
            }
        }
        let quadratic = basis.tr_mul(&(hessian * &basis));
        let linear = basis.tr_mul(&DVector::from_vec(flat(&at.gradient)));
        let mut rows = Vec::new();
        constraints.rows(&at.vectors, 2.0 * radius, &mut |row| rows.push(row));
        for row in &mut rows {
            row.leave_out(drawn);
        }
        let program = Program::new(&quadratic, &linear, &rows, &frames, radius);
        let solution = program.solve()?;
        let (s, slack) = solution.split_at(2 * frames.len());
        let s = DVector::from_column_slice(s);
        let model = linear.dot(&s) + 0.5 * s.dot(&(&quadratic * &s));
        let promised = RHO * at.violation - model - RHO * slack[0].max(0.0);
        let ambient = basis * s;
        Some(Self {
            moves: vectors(ambient.as_slice()),
            promised,
        })
    }
}

/// The convex program in clarabel's form: `min x.P x / 2 + q.x` with `b - A x >= 0`.
struct Program {
    quadratic: CscMatrix<f64>,
    linear: Vec<f64>,
    matrix: CscMatrix<f64>,
    bounds: Vec<f64>,
}

impl Program {
    fn new(
        quadratic: &DMatrix<f64>,
        linear: &DVector<f64>,
        rows: &[ConstraintRow],
        frames: &[[Vec3; 2]],
        radius: f64,
    ) -> Self {
        let n = linear.len();
        let (mut i, mut j, mut v) = (Vec::new(), Vec::new(), Vec::new());
        for column in 0..n {
            for row in 0..=column {
                i.push(row);
                j.push(column);
                v.push(quadratic[(row, column)]);
            }
        }
        let quadratic = CscMatrix::new_from_triplets(n + 1, n + 1, i, j, v);
        let mut q: Vec<f64> = linear.iter().copied().collect();
        q.push(RHO);
        let (mut i, mut j, mut v, mut b) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        let mut put = |row: usize, column: usize, value: f64| {
            i.push(row);
            j.push(column);
            v.push(value);
        };
        for (r, row) in rows.iter().enumerate() {
            for (dot, gradient) in row.terms {
                for (k, axis) in frames[dot].iter().enumerate() {
                    let value = gradient.dot(axis);
                    if value != 0.0 {
                        put(r, 2 * dot + k, value);
                    }
                }
            }
            put(r, n, -1.0);
            b.push(-row.violation);
        }
        for column in 0..n {
            for sign in [1.0, -1.0] {
                put(b.len(), column, sign);
                b.push(radius);
            }
        }
        put(b.len(), n, -1.0);
        b.push(0.0);
        Self {
            quadratic,
            linear: q,
            matrix: CscMatrix::new_from_triplets(b.len(), n + 1, i, j, v),
            bounds: b,
        }
    }

    fn solve(&self) -> Option<Vec<f64>> {
        let settings = DefaultSettingsBuilder::default()
            .verbose(false)
            .max_threads(1)
            .build()
            .ok()?;
        let cones: [SupportedConeT<f64>; 1] = [NonnegativeConeT(self.bounds.len())];
        let mut solver = DefaultSolver::new(
            &self.quadratic,
            &self.linear,
            &self.matrix,
            &self.bounds,
            &cones,
            settings,
        )
        .ok()?;
        solver.solve();
        matches!(
            solver.solution.status,
            SolverStatus::Solved | SolverStatus::AlmostSolved
        )
        .then(|| solver.solution.x)
    }
}
