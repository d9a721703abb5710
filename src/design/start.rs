//! Patterns to start from: random ones, and good ones with some dots put elsewhere.

use rand::Rng;
use rand::seq::index::sample;

use crate::error::{Error, Result};
use crate::geometry::{Vec3, random_direction};
use crate::pattern::Pattern;

/// Tries to place one dot at random apart from the others before all start afresh.
const PLACEMENT_TRIES: usize = 2_000;
/// Fresh starts before a demand counts as infeasible at random.
const FRESH_STARTS: usize = 50;

/// Random dots no nearer to each other than demanded.
///
/// # Errors
/// [`Error::Argument`] where no such set was found: the demand is too dense.
pub fn random_pattern<R: Rng>(
    dots: usize,
    min_separation_rad: f64,
    rng: &mut R,
) -> Result<Pattern> {
    let bound = min_separation_rad.cos();
    for _ in 0..FRESH_STARTS {
        let mut placed: Vec<Vec3> = Vec::with_capacity(dots);
        for _ in 0..PLACEMENT_TRIES {
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
            min_separation_rad.to_degrees()
        ),
    ))
}

/// `pattern` with `moved` of its dots put elsewhere at random, no nearer to others than demanded where
/// that can be had (a descent mends the rest).
///
/// # Errors
/// [`Error::Argument`] where dots coincide.
pub fn move_dots<R: Rng>(
    pattern: &Pattern,
    moved: usize,
    min_separation_rad: f64,
    rng: &mut R,
) -> Result<Pattern> {
    let bound = min_separation_rad.cos();
    let mut dots = pattern.dots().to_vec();
    for i in sample(rng, dots.len(), moved.min(dots.len())) {
        for _ in 0..PLACEMENT_TRIES {
            let d = random_direction(rng);
            let apart = |(j, p): (usize, &Vec3)| j == i || p.dot(&d) < bound;
            if dots.iter().enumerate().all(apart) {
                dots[i] = d;
                break;
            }
        }
    }
    Pattern::new(dots)
}
