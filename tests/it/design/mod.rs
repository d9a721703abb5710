//! Tests of the stage `design`.

mod added;
mod confusion;
mod dot_set;
mod objectives;
mod orientation_bound;
mod search;
mod shard;
mod too_few;

use spindoe::geometry::Vec3;

/// The slope of a function of the dots where dot `i` moves along `axis`, by steps of `h` to both sides.
fn central_difference(
    dots: &[Vec3],
    i: usize,
    axis: &Vec3,
    h: f64,
    value: impl Fn(&[Vec3]) -> f64,
) -> f64 {
    let moved = |step: f64| {
        let mut moved = dots.to_vec();
        moved[i] = (moved[i] + step * axis).normalize();
        value(&moved)
    };
    (moved(h) - moved(-h)) / (2.0 * h)
}
