//! Starts of a search from good patterns, with some dots moved elsewhere. Random starts come from
//! [`crate::pattern::random_pattern`].

use rand::Rng;
use rand::seq::index::sample;

use crate::error::Result;
use crate::geometry::{Vec3, random_direction};
use crate::pattern::Pattern;

/// Tries to place one dot at random apart from the others before it stays where it was.
const PLACEMENT_TRIES: usize = 2_000;

/// `pattern` with `moved` of its dots placed elsewhere at random, no nearer to others than required
/// where that is possible (a descent fixes the rest).
///
/// # Errors
/// [`crate::Error::Argument`] where dots coincide.
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
