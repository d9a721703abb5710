//! Starts of a search from good patterns, with some dots moved elsewhere. Random starts come from
//! [`crate::pattern::random_pattern`].

use rand::Rng;
use rand::seq::index::sample;

use crate::design::constraints::Constraints;
use crate::error::{Error, Result};
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

/// Parts of the demanded separation at which dots are placed beside drawn ones, one after the other; the descent
/// widens what is left.
const CROWDED: [f64; 4] = [1.0, 0.9, 0.8, 0.7];

/// Adds dots at random places until there are `count`, apart from the others and clear of cones.
///
/// # Errors
/// [`Error::Argument`] where no room for them was found.
pub fn add_dots<R: Rng>(
    dots: &mut Vec<Vec3>,
    count: usize,
    constraints: &Constraints,
    rng: &mut R,
) -> Result<()> {
    let before = dots.len();
    for part in CROWDED {
        let nearer = Constraints {
            min_separation_rad: part * constraints.min_separation_rad,
            ..constraints.clone()
        };
        dots.truncate(before);
        for _ in 0..PLACEMENT_TRIES {
            let place = random_direction(rng);
            if nearer.has_room(dots, &place) {
                dots.push(place);
                if dots.len() == count {
                    return Ok(());
                }
            }
        }
    }
    let problem = format!(
        "{} more dots at least {:.1} degrees from all others do not fit on this ball; ask for fewer or smaller ones",
        count - before,
        constraints.min_separation_rad.to_degrees()
    );
    Err(Error::argument("add", problem))
}
