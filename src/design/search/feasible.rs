//! Feasibility of the constraints, tested before a search begins.
//!
//! Two quick tests run. First, dots that repel each other ever more sharply settle near the densest
//! packing (the Tammes problem), which estimates the separation that so many dots can have. Then
//! some random starts descend under all constraints as charges that repel each other. That cost
//! alone leaves no side of the ball bare. Where no start meets all constraints, the error states
//! the best value reached.
//!
//! The result is an estimate. Packings come within a degree of the best known ones for up to 64
//! dots, and a constraint that six starts violate may be met by a seventh.

use std::sync::atomic::{AtomicBool, Ordering};

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use crate::concurrency;
use crate::design::constraints::{Constraints, max_separation};
use crate::design::descent::{Cost, descend};
use crate::design::objective::Evaluation;
use crate::error::{Error, Result};
use crate::geometry::{Vec3, random_direction};
use crate::pattern::{Pattern, random_pattern};
use crate::stencil::Stencil;

/// Number of packings and descents.
const TRIES: u64 = 6;
/// Steps of a descent between two checks of the constraints, and the number of checks.
const STEPS: u64 = 10;
const CHECKS: usize = 8;
/// Attempts, and halvings of the interval, that find which demand is too large and by how much.
const RELAXED_TRIES: u64 = 2;
const BISECTIONS: usize = 3;
/// Steps of a packing at each sharpness, and how often that doubles.
const PACKING_STEPS: usize = 150;
const DOUBLINGS: i32 = 9;
/// A step of a packing, as part of the minimum separation.
const PACKING_STEP: f64 = 0.1;
/// Fraction of the densest packing's separation at which dots placed one by one at random still
/// fit.
const RANDOM_SHARE: f64 = 0.7;

/// The separation of a random start: the required one, or what random dots can have. The descent
/// fixes the rest.
pub(super) fn start_separation(dots: usize, demanded_rad: f64) -> f64 {
    demanded_rad.min(RANDOM_SHARE * max_separation(dots))
}

/// The largest minimum angle between so many dots that was reached, radians.
pub fn packed_separation(dots: usize) -> f64 {
    concurrency::map_range(0..TRIES, |stream| {
        let mut rng = ChaCha8Rng::seed_from_u64(0);
        rng.set_stream(stream);
        let start = (0..dots).map(|_| random_direction(&mut rng)).collect();
        packing(start)
    })
    .into_iter()
    .fold(0.0, f64::max)
}

/// Lets dots repel each other with energies `1 / d^k`, k doubling; their minimum angle then.
fn packing(mut dots: Vec<Vec3>) -> f64 {
    let mut best = 0.0f64;
    for doubling in 0..DOUBLINGS {
        let power = f64::from(1 << doubling);
        for step in 0..PACKING_STEPS {
            let smallest = min_distance(&dots);
            best = best.max(2.0 * (0.5 * smallest).min(1.0).asin());
            let pushes: Vec<Vec3> = dots
                .iter()
                .enumerate()
                .map(|(i, d)| {
                    let push: Vec3 = dots
                        .iter()
                        .enumerate()
                        .filter(|(j, _)| *j != i)
                        .map(|(_, other)| {
                            let away = d - other;
                            let distance = away.norm().max(1e-9);
                            away / distance * (smallest / distance).powf(power + 1.0)
                        })
                        .sum();
                    push - d * d.dot(&push)
                })
                .collect();
            let largest = pushes.iter().map(Vec3::norm).fold(1e-12, f64::max);
            let fading = 1.0 - step as f64 / PACKING_STEPS as f64;
            let scale = PACKING_STEP * smallest * fading / largest;
            for (d, push) in dots.iter_mut().zip(&pushes) {
                *d = (*d + push * scale).normalize();
            }
        }
    }
    best
}

fn min_distance(dots: &[Vec3]) -> f64 {
    let mut smallest = 2.0f64;
    for (i, a) in dots.iter().enumerate() {
        for b in &dots[..i] {
            smallest = smallest.min((a - b).norm());
        }
    }
    smallest
}

/// The logarithm of the electrostatic energy of unit charges (the Thomson problem).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Charges;

impl Cost for Charges {
    fn cost(&self, dots: &[Vec3]) -> Result<Evaluation> {
        let mut energy = 0.0;
        let mut gradient = vec![Vec3::zeros(); dots.len()];
        for i in 0..dots.len() {
            for j in 0..i {
                let away = dots[i] - dots[j];
                let distance = away.norm().max(1e-9);
                energy += distance.recip();
                let force = away / distance.powi(3);
                gradient[i] -= force;
                gradient[j] += force;
            }
        }
        Ok(Evaluation {
            value: energy.ln(),
            gradient: gradient.into_iter().map(|g| g / energy).collect(),
        })
    }
}

/// A constraint that can be relaxed by itself.
#[derive(Debug, Clone, Copy)]
enum Relaxable {
    SeamMargin,
    KeepOut,
    MinVisible,
    Separation,
}

impl Relaxable {
    const ALL: [Self; 4] = [
        Self::SeamMargin,
        Self::KeepOut,
        Self::MinVisible,
        Self::Separation,
    ];

    fn parameter(self) -> &'static str {
        match self {
            Self::SeamMargin => "seam_margin_rad",
            Self::KeepOut => "keep_out",
            Self::MinVisible => "min_visible",
            Self::Separation => "min_separation_rad",
        }
    }

    fn is_made(self, constraints: &Constraints) -> bool {
        match self {
            Self::SeamMargin => constraints.seam_margin_rad > 0.0,
            Self::KeepOut => !constraints.keep_out.is_empty(),
            Self::MinVisible => constraints.min_visible > 0,
            Self::Separation => constraints.min_separation_rad > Self::min_separation(constraints),
        }
    }

    /// The stencil's holes need theirs in any case.
    fn min_separation(constraints: &Constraints) -> f64 {
        let of_holes = |s: &crate::stencil::StencilConfig| s.min_separation_rad();
        constraints.stencil.as_ref().map_or(0.0, of_holes)
    }

    /// The constraints with this part of the demand.
    fn relaxed(self, constraints: &Constraints, part: f64) -> Constraints {
        let mut relaxed = constraints.clone();
        match self {
            Self::SeamMargin => relaxed.seam_margin_rad *= part,
            Self::KeepOut => {
                for cone in &mut relaxed.keep_out {
                    cone.half_angle_rad *= part;
                }
            }
            Self::MinVisible => {
                relaxed.min_visible = (part * constraints.min_visible as f64) as usize;
            }
            Self::Separation => {
                let least = Self::min_separation(constraints);
                relaxed.min_separation_rad =
                    least + part * (constraints.min_separation_rad - least);
            }
        }
        relaxed
    }

    /// Its value in words.
    fn value(self, constraints: &Constraints) -> String {
        let degrees = |angle: f64| format!("{:.1} degrees", angle.to_degrees());
        match self {
            Self::SeamMargin => degrees(constraints.seam_margin_rad),
            Self::KeepOut => {
                let angles: Vec<String> = constraints
                    .keep_out
                    .iter()
                    .map(|cone| degrees(cone.half_angle_rad))
                    .collect();
                format!("a half angle of {}", angles.join(", "))
            }
            Self::MinVisible => format!("{} visible dots", constraints.min_visible),
            Self::Separation => degrees(constraints.min_separation_rad),
        }
    }
}

/// Rejects constraints that no pattern of `dots` dots can satisfy ([`Constraints::check_demand`]), and
/// constraints that none of a few attempts satisfied.
///
/// # Errors
/// [`Error::Argument`] with the nearest value that was reached.
pub fn check_feasible(constraints: &Constraints, dots: usize) -> Result<()> {
    check_feasible_until(constraints, dots, &AtomicBool::new(false))
}

/// As [`check_feasible`], which setting `stop` ends.
///
/// # Errors
/// As [`check_feasible`]; [`Error::Stopped`].
pub(super) fn check_feasible_until(
    constraints: &Constraints,
    dots: usize,
    stop: &AtomicBool,
) -> Result<()> {
    constraints.check_demand(dots)?;
    if constraints.drawn > 0 {
        // The attempts here place all dots freely. Whether there is room beside drawn ones, each start finds out.
        return Ok(());
    }
    let demanded = constraints.min_separation_rad;
    let reached = packed_separation(dots);
    if demanded > reached {
        let fewer = (4..dots)
            .rev()
            .find(|&n| packed_separation(n) >= demanded)
            .map_or(String::new(), |n| format!(", or at most {n} dots"));
        let problem = format!(
            "no arrangement of {dots} dots that are {:.1} degrees apart was found; ask for at most {:.1}{fewer}",
            demanded.to_degrees(),
            (10.0 * reached.to_degrees()).floor() / 10.0
        );
        return Err(Error::argument("min_separation_rad", problem));
    }
    if is_met(constraints, dots, TRIES, stop)? {
        return Ok(());
    }
    match no_stencil(constraints, dots, stop)? {
        Some(error) => Err(error),
        None => Err(unmet(constraints, dots, stop)?),
    }
}

/// The error where an attempt meets all demands but has no stencil, with the largest hole that has one.
fn no_stencil(constraints: &Constraints, dots: usize, stop: &AtomicBool) -> Result<Option<Error>> {
    let Some(stencil) = &constraints.stencil else {
        return Ok(None);
    };
    let missed = |p: &Pattern| constraints.missed_but_stencil(p);
    let pattern = after_descent(dots, constraints, (0, stop), &missed)?;
    if constraints.missed_but_stencil(&pattern).is_some() {
        return Ok(None);
    }
    let fits = match Stencil::largest_hole_mm(&pattern, stencil) {
        Some(mm) => format!("holes of at most {mm:.1} mm fit"),
        None => "no hole fits".to_owned(),
    };
    let problem = format!(
        "no pattern of {dots} dots of {} mm on a ball of {} mm was found that leaves room for the stencil's hinge and \
         rims; {fits}",
        stencil.hole_diameter_mm, stencil.ball_diameter_mm
    );
    Ok(Some(Error::argument("dot_diameter_mm", problem)))
}

/// Whether one of so many attempts satisfies the constraints.
fn is_met(constraints: &Constraints, dots: usize, tries: u64, stop: &AtomicBool) -> Result<bool> {
    first_success(tries, |stream| {
        Ok(missed_after_descent(constraints, dots, (stream, stop))?.is_none())
    })
}

/// Whether an attempt succeeds before one fails, in the attempts' order: the same on any number of
/// threads.
fn first_success(tries: u64, attempt: impl Fn(u64) -> Result<bool> + Sync + Send) -> Result<bool> {
    let decided = concurrency::find_first(0..tries, attempt, |tried| !matches!(tried, Ok(false)));
    decided.unwrap_or(Ok(false))
}

/// The error for constraints that no attempt satisfied: the demand whose absence helps, with the
/// largest part of it that was reached.
fn unmet(constraints: &Constraints, dots: usize, stop: &AtomicBool) -> Result<Error> {
    let together = format!("no pattern of {dots} dots was found that meets all demands at once");
    for demand in Relaxable::ALL {
        let reaches = |part: f64| {
            is_met(
                &demand.relaxed(constraints, part),
                dots,
                RELAXED_TRIES,
                stop,
            )
        };
        if !demand.is_made(constraints) || !reaches(0.0)? {
            continue;
        }
        let (mut met, mut unmet) = (0.0, 1.0);
        for _ in 0..BISECTIONS {
            let part = 0.5 * (met + unmet);
            if reaches(part)? {
                met = part;
            } else {
                unmet = part;
            }
        }
        let reached = demand.value(&demand.relaxed(constraints, met));
        let problem = format!(
            "{together}; with the others as they are, the most that was reached is {reached}"
        );
        return Ok(Error::argument(demand.parameter(), problem));
    }
    let missed = missed_after_descent(constraints, dots, (0, stop))?.unwrap_or_default();
    let problem = format!("{together}; the closest attempt has: {missed}");
    Ok(Error::argument("constraints", problem))
}

/// What a random start violates after a descent under the constraints, if anything. Whether there is a stencil, which
/// takes longest to find out, is asked of the first pattern that meets all else, and of the last.
fn missed_after_descent(
    constraints: &Constraints,
    dots: usize,
    (stream, stop): (u64, &AtomicBool),
) -> Result<Option<String>> {
    let first = after_descent(dots, constraints, (stream, stop), &|p| {
        constraints.missed_but_stencil(p)
    })?;
    if constraints.missed(&first).is_none() {
        return Ok(None);
    }
    if stop.load(Ordering::Relaxed) {
        return Err(Error::Stopped);
    }
    let last = descend(&first, &Charges, constraints, STEPS * CHECKS as u64)?;
    Ok(constraints.missed(&last))
}

/// A random start after as many steps of a descent under the constraints as it takes until nothing is missed, or all.
fn after_descent(
    dots: usize,
    constraints: &Constraints,
    (stream, stop): (u64, &AtomicBool),
    missed: &dyn Fn(&Pattern) -> Option<String>,
) -> Result<Pattern> {
    let mut rng = ChaCha8Rng::seed_from_u64(0);
    rng.set_stream(stream);
    let separation = start_separation(dots, constraints.min_separation_rad);
    let mut pattern = random_pattern(dots, separation, &mut rng)?;
    for _ in 0..CHECKS {
        if stop.load(Ordering::Relaxed) {
            return Err(Error::Stopped);
        }
        if missed(&pattern).is_none() {
            break;
        }
        pattern = descend(&pattern, &Charges, constraints, STEPS)?;
    }
    Ok(pattern)
}

#[cfg(all(test, feature = "native"))]
mod tests {
    use std::time::Duration;

    use super::*;

    #[test]
    fn the_first_attempt_that_decides_is_the_same_on_any_number_of_threads() {
        // The later an attempt, the sooner it is done.
        let attempt = |stream: u64, ends: [Option<bool>; 3]| {
            std::thread::sleep(Duration::from_millis(40 - 5 * stream));
            let end = ends[stream.min(2) as usize];
            end.ok_or_else(|| Error::argument("attempt", "failed"))
        };
        for threads in [1, 2, 4] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
            let pool = pool.build().expect("threads start");
            let decided = |ends| pool.install(|| first_success(6, |stream| attempt(stream, ends)));
            // A miss; then a success, or a failure, before all others end the other way; or misses alone.
            let success = decided([Some(false), Some(true), None]);
            assert!(matches!(success, Ok(true)), "{threads}: {success:?}");
            let failure = decided([Some(false), None, Some(true)]);
            assert!(failure.is_err(), "{threads}: {failure:?}");
            let miss = decided([Some(false); 3]);
            assert!(matches!(miss, Ok(false)), "{threads}: {miss:?}");
        }
    }
}
