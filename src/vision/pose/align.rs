//! The outline that the dots themselves ask for, where the one that was found is not the ball's.
//!
//! A shadow, a finger or a dark side leads edges and nets astray; dots stay where they are. Three dots with names fix turn, size and place of a ball that is seen
//! by parallel rays, but for a reflection: with the differences `d` in the image and `D` in the pattern of two dots to the third, the scale `s` solves
//! `(s^2 D1.D2 - d1.d2)^2 = (s^2 D1.D1 - d1.d1)(s^2 D2.D2 - d2.d2)` (T. Alter, "3-D pose from 3 points using weak-perspective", PAMI 16, 1994). The names of
//! a few triples are tried one after the other; the other dots say which fit.
//!
//! What is found is where to look, no answer: the ball is cut out there and its dots are found and identified anew.

use nalgebra::{Matrix3, Vector2};

use super::refine::Drawn;
use crate::geometry::{Vec3, pair_rotation, to_rotation};
use crate::vision::dots::detector::LIKELY_DOT;
use crate::vision::estimator::{Estimator, EstimatorWorkspace};
use crate::vision::frame::estimate::FrameEstimate;
use crate::vision::frame::outline::Outline;
use crate::vision::optics::camera::{BallCircle, Pixel};

/// Fewer dots say nothing: three of them are spent.
const MIN_DOTS: usize = 5;
/// So many of the likeliest dots take part.
const MAX_DOTS: usize = 12;
/// Triples whose names are tried, and so many names in all: fewer triples of a pattern with many dots.
const TRIPLES: usize = 6;
const MOST_NAMED: usize = 200_000;
/// Their least area, radii squared.
const LEAST_AREA: f64 = 0.08;
/// The ball's radius over that of the outline, and how far its center is off, radii.
const SIZES: [f64; 2] = [0.8, 1.4];
const MAX_SHIFT: f64 = 0.4;
/// Dots of a triple face the camera by so much.
const LEAST_FACING: f64 = 0.15;
/// A dot is the one that is expected next to it, radians: parallel rays are only about right.
const NEAR: f64 = 0.16;
/// As many dots as are needed, each halfway to where it has no name.
const LEAST_SCORE: f64 = 1.5 * MIN_DOTS as f64;
/// Standard deviation of the outline before the dots are fitted, radii.
const OPEN: f64 = 0.15;
/// And of the one that fits them.
const FITTED: f64 = 0.02;

/// The dots of the pattern that places are.
type Names = [Option<u16>; MAX_DOTS];

/// A ball by three dots with names: pattern to view frame, size and place in radii of the outline.
#[derive(Debug, Clone, Copy)]
struct Aligned {
    rotation: Matrix3<f64>,
    size: f64,
    shift: Vector2<f64>,
}

impl Aligned {
    /// How well the pattern explains places, and the names of those that it does.
    fn score(&self, dots: &[Vec3], seen: &[Vector2<f64>]) -> (f64, Names) {
        let back = self.rotation.transpose();
        let least = NEAR.cos();
        let (mut score, mut names) = (0.0, [None; MAX_DOTS]);
        for (place, name) in seen.iter().zip(&mut names) {
            let at = (place - self.shift) / self.size;
            let rest = 1.0 - at.norm_squared();
            if rest <= 0.0 {
                continue;
            }
            let toward = back * Vec3::new(at.x, at.y, rest.sqrt());
            let cosines = (0u16..).zip(dots).map(|(k, dot)| (k, dot.dot(&toward)));
            let nearest = cosines.max_by(|a, b| a.1.total_cmp(&b.1));
            if let Some((nearest, cosine)) = nearest.filter(|(_, cosine)| *cosine > least) {
                *name = Some(nearest);
                score += 1.0 + (cosine - least) / (1.0 - least);
            }
        }
        (score, names)
    }
}

/// Both balls near the outline whose dots with these names lie at these places.
fn by_three([a, b, c]: [&Vector2<f64>; 3], [p, q, r]: [&Vec3; 3]) -> Option<[Option<Aligned>; 2]> {
    let (d1, d2) = (b - a, c - a);
    let (s11, s12, s22) = (d1.norm_squared(), d1.dot(&d2), d2.norm_squared());
    let (e1, e2) = (q - p, r - p);
    let (l11, l12, l22) = (e1.norm_squared(), e1.dot(&e2), e2.norm_squared());
    let square = l11 * l22 - l12 * l12;
    let linear = l11 * s22 + l22 * s11 - 2.0 * l12 * s12;
    let constant = s11 * s22 - s12 * s12;
    let root = (linear * linear - 4.0 * square * constant).max(0.0).sqrt();
    let scale = (linear + root) / (2.0 * square);
    let size = scale.sqrt();
    // Not for what is no number, either.
    if !(SIZES[0]..SIZES[1]).contains(&size) {
        return None;
    }
    let up1 = (scale * l11 - s11).max(0.0).sqrt();
    let up2 = (scale * l22 - s22).max(0.0).sqrt();
    let up2 = up2 * (scale * l12 - s12).signum();
    Some([1.0, -1.0].map(|side| {
        let seen = [
            &Vec3::new(d1.x, d1.y, side * up1),
            &Vec3::new(d2.x, d2.y, side * up2),
        ];
        let rotation = pair_rotation([&e1, &e2], seen)?;
        let shift = a - (rotation * p).xy() * size;
        let faces = [p, q, r].map(|dot| (rotation * dot).z > LEAST_FACING);
        let is_near = shift.norm() < MAX_SHIFT && faces == [true; 3];
        is_near.then_some(Aligned {
            rotation,
            size,
            shift,
        })
    }))
}

/// Triples of places, the largest triangles first.
fn triples(seen: &[Vector2<f64>]) -> [Option<[usize; 3]>; TRIPLES] {
    let mut largest = [(LEAST_AREA, None); TRIPLES];
    for a in 0..seen.len() {
        for b in a + 1..seen.len() {
            for c in b + 1..seen.len() {
                let area = 0.5 * (seen[b] - seen[a]).perp(&(seen[c] - seen[a])).abs();
                if area > largest[TRIPLES - 1].0 {
                    largest[TRIPLES - 1] = (area, Some([a, b, c]));
                    largest.sort_unstable_by(|a, b| b.0.total_cmp(&a.0));
                }
            }
        }
    }
    largest.map(|(_, triple)| triple)
}

/// All dots three by three, the first two at least so far apart. Those with a dot twice are no ball's.
fn threes(dots: &[Vec3], apart: f64) -> impl Iterator<Item = [&Vec3; 3]> {
    dots.iter().flat_map(move |p| {
        let seconds = dots.iter().filter(move |q| (*q - p).norm() >= apart);
        seconds.flat_map(move |q| dots.iter().map(move |r| [p, q, r]))
    })
}

/// The ball that explains most of the places.
fn align(dots: &[Vec3], seen: &[Vector2<f64>]) -> Option<(Aligned, Names)> {
    let (mut best, mut most) = (None, LEAST_SCORE);
    let each = dots.len().pow(3).max(1);
    let count = (MOST_NAMED / each).clamp(1, TRIPLES);
    for triple in triples(seen).into_iter().take(count).flatten() {
        let places = triple.map(|k| &seen[k]);
        let apart = (places[1] - places[0]).norm() / SIZES[1];
        let balls = threes(dots, apart).filter_map(|names| by_three(places, names));
        for found in balls.flatten().flatten() {
            let (score, names) = found.score(dots, seen);
            if score > most {
                (best, most) = (Some((found, names)), score);
            }
        }
    }
    best
}

impl Estimator {
    /// The outline that the likely dots of a frame ask for, in its pixels. The frame loses its names.
    pub(crate) fn outline_by_dots(
        &self,
        ws: &mut EstimatorWorkspace,
        out: &mut FrameEstimate,
    ) -> Option<Outline> {
        let outline = out.outline?;
        let circle = outline.circle;
        let (mut seen, mut likely, mut count) = ([Vector2::zeros(); MAX_DOTS], [0; MAX_DOTS], 0);
        let dots = out.dots.iter().enumerate();
        for (i, dot) in dots
            .filter(|(_, dot)| dot.probability >= LIKELY_DOT)
            .take(MAX_DOTS)
        {
            let (right, down) = (dot.pixel.u - circle.center.u, dot.pixel.v - circle.center.v);
            (seen[count], likely[count]) = (Vector2::new(right, -down) / circle.radius, i);
            count += 1;
        }
        if count < MIN_DOTS {
            return None;
        }
        let (found, names) = align(self.pattern().dots(), &seen[..count])?;
        out.assignment.fill(None);
        for (i, name) in likely[..count].iter().zip(&names) {
            out.assignment[*i] = *name;
        }
        let center = Pixel {
            u: circle.center.u + circle.radius * found.shift.x,
            v: circle.center.v - circle.radius * found.shift.y,
        };
        let around = |circle: BallCircle, sigma: f64| Outline {
            circle,
            covariance: Matrix3::from_diagonal_element((sigma * circle.radius).powi(2)),
            ..outline
        };
        let open = around(BallCircle::new(center, circle.radius * found.size), OPEN);
        let rotation = to_rotation(&found.rotation);
        let camera = self.config.camera.hypotheses()[0]?;
        let refined = self.refined(&rotation, camera, (&open, None), Drawn::AsSeen, ws, out);
        let named = out.matched();
        out.assignment.fill(None);
        let refined = refined.filter(|_| named >= MIN_DOTS)?;
        Some(around(*refined.view.circle(), FITTED))
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::geometry::{random_rotation, spiral_directions};

    /// A ball that is seen by parallel rays, about an outline that is off by up to a quarter of its radius.
    #[test]
    fn dots_show_where_the_ball_is() {
        let dots: Vec<Vec3> = spiral_directions(18).collect();
        let rng = &mut ChaCha8Rng::seed_from_u64(6_470_001);
        for trial in 0..20 {
            let rotation = random_rotation(rng);
            let size = rng.random_range(0.85..1.3);
            let shift = Vector2::new(rng.random_range(-0.2..0.2), rng.random_range(-0.2..0.2));
            let turned = dots.iter().map(|dot| rotation * dot);
            let seen: Vec<Vector2<f64>> = turned
                .filter(|dot| dot.z > 0.3)
                .map(|dot| dot.xy() * size + shift)
                .collect();
            let (found, names) = align(&dots, &seen).expect("a ball");
            assert!(names[..seen.len()].iter().all(Option::is_some), "{trial}");
            assert!((found.size - size).abs() < 1e-3, "{trial}: {found:?}");
            assert!((found.shift - shift).norm() < 1e-3, "{trial}: {found:?}");
        }
    }
}
