//! The descent: a pattern's cost lowered under the constraints, on the sphere.
//!
//! Three methods, all run by argmin's executor:
//! - [`DescentMethod::Program`]: sequential convex programming by clarabel, the default. From the same starts it comes
//!   lower than the others at 12 to 40 dots, and on `whitened-nn` it ends in a third of the time
//!   (`docs/measurements/objectives.md`),
//! - [`DescentMethod::Lbfgs`]: limited-memory BFGS with the line search of Moré and Thuente on an augmented
//!   Lagrangian of the constraints, and a few convex programs at its end, which meet the constraints exactly,
//! - [`DescentMethod::Gradient`]: steepest descent over the dots' spherical coordinates, as in the SpinDOE paper
//!   (Sec. II-D), on the same Lagrangian and with the same end.
//!
//! All count evaluations of the cost with its gradient, which take nearly all the time, and none takes more than
//! [`Descent::steps`]. The result is the point of the lowest merit, `cost + 200 violation`, that was met: never a
//! worse one than the start. Costs with kinks (nearest neighbors that switch) are supported: the gradient is one
//! of those that meet there. A descent finds a local minimum; it does not guarantee a global one.

mod lagrangian;
mod program;

use std::sync::atomic::{AtomicBool, Ordering};

use super::constraints::Constraints;
use super::objective::{Evaluation, Objective};
use crate::error::{Error, Result, require};
use crate::geometry::Vec3;
use crate::pattern::Pattern;
use crate::stencil::max_margin_seam;
use lagrangian::Chart;

/// Price of a violation (in cosines) against the cost (a logarithm).
const RHO: f64 = 200.0;
/// Length of the first move of a vector, radians.
const FIRST_MOVE: f64 = 0.05;
/// Convex programs at the end of a descent by gradients: after them the separation is met within the constraints'
/// tolerance, which the Lagrangian misses by 0.02 to 0.04 degrees.
const LAST_PROGRAMS: u64 = 6;

/// A cost on unit vectors, to be minimized.
pub trait Cost: Sync {
    /// The cost with its gradient.
    ///
    /// # Errors
    /// Where the dots are not finite.
    fn cost(&self, dots: &[Vec3]) -> Result<Evaluation>;
}

impl Cost for Objective {
    fn cost(&self, dots: &[Vec3]) -> Result<Evaluation> {
        Self::cost(self, dots)
    }
}

/// How a descent finds its steps.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, Hash, Default, serde::Serialize, serde::Deserialize,
)]
#[serde(rename_all = "kebab-case")]
pub enum DescentMethod {
    /// Sequential convex programming.
    #[default]
    Program,
    /// Limited-memory BFGS on an augmented Lagrangian.
    Lbfgs,
    /// Steepest descent over spherical coordinates, as the SpinDOE paper has it.
    Gradient,
}

impl DescentMethod {
    /// All methods.
    pub const ALL: [Self; 3] = [Self::Program, Self::Lbfgs, Self::Gradient];

    /// As written on the command line.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Lbfgs => "lbfgs",
            Self::Program => "program",
            Self::Gradient => "gradient",
        }
    }
}

impl std::str::FromStr for DescentMethod {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        crate::error::by_name(&Self::ALL, Self::as_str, "descent", name)
    }
}

impl std::fmt::Display for DescentMethod {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.pad(self.as_str())
    }
}

/// The dots and the seam's normal after them, with the cost there.
#[derive(Debug, Clone)]
struct Point {
    vectors: Vec<Vec3>,
    cost: f64,
    violation: f64,
    /// Projected on the tangent planes; zero for drawn dots and for the normal.
    gradient: Vec<Vec3>,
}

impl Point {
    fn merit(&self) -> f64 {
        self.cost + RHO * self.violation
    }
}

/// What a descent lowers, and under what.
struct Demand<'a, C: Cost> {
    cost: &'a C,
    constraints: &'a Constraints,
}

impl<C: Cost> Demand<'_, C> {
    fn at(&self, vectors: Vec<Vec3>) -> Result<Point> {
        let n = vectors.len() - 1;
        let found = self.cost.cost(&vectors[..n])?;
        let mut gradient: Vec<Vec3> = vectors
            .iter()
            .zip(&found.gradient)
            .map(|(d, g)| g - d * d.dot(g))
            .collect();
        gradient[..self.constraints.drawn].fill(Vec3::zeros());
        gradient.push(Vec3::zeros());
        Ok(Point {
            violation: self.constraints.violation(&vectors),
            cost: found.value,
            gradient,
            vectors,
        })
    }
}

fn flat(vectors: &[Vec3]) -> Vec<f64> {
    vectors.iter().flat_map(|v| [v.x, v.y, v.z]).collect()
}

fn vectors(flat: &[f64]) -> Vec<Vec3> {
    flat.chunks_exact(3).map(Vec3::from_column_slice).collect()
}

/// Method and extent of a descent.
#[derive(Debug, Clone, Copy)]
pub struct Descent<'a> {
    /// How it finds its steps.
    pub method: DescentMethod,
    /// Maximum number of evaluations.
    pub steps: u64,
    /// Ends the descent after the current evaluation when set; the best point so far is its result.
    pub stop: &'a AtomicBool,
}

/// A stop that is never set.
static NEVER: AtomicBool = AtomicBool::new(false);

impl Descent<'static> {
    /// A descent by the default method of at most `steps` evaluations without a stop.
    pub fn of_steps(steps: u64) -> Self {
        Self {
            method: DescentMethod::default(),
            steps,
            stop: &NEVER,
        }
    }
}

/// Lowers the cost of a pattern under the constraints by the default method, with at most `steps` evaluations.
///
/// # Errors
/// As [`Descent::run`].
pub fn descend<C: Cost>(
    start: &Pattern,
    cost: &C,
    constraints: &Constraints,
    steps: u64,
) -> Result<Pattern> {
    Descent::of_steps(steps).run(start, cost, constraints)
}

impl Descent<'_> {
    /// Lowers the cost of a pattern under the constraints.
    ///
    /// # Errors
    /// Those of the cost; [`crate::Error::Argument`] where more dots are drawn than there are.
    pub fn run<C: Cost>(
        &self,
        start: &Pattern,
        cost: &C,
        constraints: &Constraints,
    ) -> Result<Pattern> {
        let drawn = constraints.drawn;
        let expected = format!("at most {}", start.len());
        require(drawn <= start.len(), "drawn", &expected, drawn)?;
        let mut x = start.dots().to_vec();
        x.push(max_margin_seam(start.dots()).normal);
        let demand = Demand { cost, constraints };
        let at = demand.at(x)?;
        let last = LAST_PROGRAMS.min(self.steps / 2);
        let reached = match self.method {
            DescentMethod::Program => program::run(&demand, at, self.steps, self.stop)?,
            DescentMethod::Lbfgs | DescentMethod::Gradient => {
                let chart = match self.method {
                    DescentMethod::Gradient => Chart::Spherical,
                    _ => Chart::Ambient,
                };
                let at = lagrangian::run(&demand, at, chart, self.steps - last, self.stop)?;
                program::run(&demand, at, last, self.stop)?
            }
        };
        let mut dots = reached.vectors;
        dots.truncate(start.len());
        Pattern::new(dots)
    }

    fn is_stopped(stop: &AtomicBool) -> bool {
        stop.load(Ordering::Relaxed)
    }
}

/// The crate's own error of what argmin carried, or that of a failure within argmin.
fn from_argmin(error: argmin::core::Error) -> Error {
    error
        .downcast::<Error>()
        .unwrap_or_else(|other| Error::Internal(format!("descent: {other}")))
}
