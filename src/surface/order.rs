//! Whether poses follow one another as those of a ball do.
//!
//! Frames of unrelated balls under one light agree, too: light that is left in them is the same in all, and each is placed where it fits the
//! light best. Such poses have no order. A ball's have: the next is near the last, or where the last turn leads. Over frames `k` that follow
//! each other, the median of `angle(R_k, R_k+1)` or that of `angle(R_k+1 R_k^-1, R_k+2 R_k+1^-1)`, whichever is less, is compared with the
//! median angle between any two frames, which is what poses without an order have between neighbors as well, and with itself over the same
//! poses in other orders: poses of two or three heaps are near each other in any order.

use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;

use super::laid::{Laid, few, numbers};
use crate::geometry::{Rotation, rotation_angle};
use crate::stats::median;

/// Fewer frames that follow each other have no order to speak of.
const ROW: usize = 8;
/// By so much of the spread of all poses the next pose differs from what the last ones predict, at most.
const PREDICTED: f64 = 0.6;
/// Frames of which all pairs are compared, at most.
const COMPARED: usize = 100;
/// Poses that are spread by no more, radians, are a ball at rest.
const AT_REST: f64 = 0.02;
/// Other orders of the same poses, none of which may predict as well: by chance one in 40 does.
const SHUFFLES: usize = 39;

/// Whether the poses of frames, in the order of time, have an order. A clip of very few frames is believed to.
pub(crate) fn have_order(laid: &[Option<Laid>]) -> bool {
    let compared = few(&numbers(laid), COMPARED).into_iter();
    let compared: Vec<Rotation> = compared.filter_map(|k| Some(laid[k]?.rotation)).collect();
    let mut spread = Vec::new();
    for (k, one) in compared.iter().enumerate() {
        let later = compared[k + 1..].iter();
        spread.extend(later.map(|other| rotation_angle(one, other)));
    }
    let spread = median(&mut spread);
    if laid.len() < ROW || spread < AT_REST {
        return true;
    }
    let rows: Vec<[Rotation; 3]> = laid
        .windows(3)
        .filter_map(|row| match row {
            [Some(a), Some(b), Some(c)] => Some([a, b, c].map(|l| l.rotation)),
            _ => None,
        })
        .collect();
    if rows.len() + 2 < ROW {
        return false;
    }
    let predicted = off(rows.iter());
    predicted < PREDICTED * spread && predicted < by_chance(&compared, rows.len())
}

/// By how much the next pose differs from the last or from where the last turn leads, whichever is less, in the median.
fn off<'a>(rows: impl Iterator<Item = &'a [Rotation; 3]>) -> f64 {
    let (mut stay, mut go_on): (Vec<f64>, Vec<f64>) = rows
        .map(|[a, b, c]| {
            let (before, step) = (b * a.inverse(), c * b.inverse());
            (step.angle(), rotation_angle(&before, &step))
        })
        .unzip();
    median(&mut stay).min(median(&mut go_on))
}

/// The least of that over so many rows of the same poses in [`SHUFFLES`] other orders.
fn by_chance(poses: &[Rotation], rows: usize) -> f64 {
    let mut rng = ChaCha8Rng::seed_from_u64(0);
    let mut shuffled = poses.to_vec();
    let shuffles = (0..SHUFFLES).map(|_| {
        shuffled.shuffle(&mut rng);
        let all: Vec<[Rotation; 3]> = shuffled.windows(3).map(|w| [w[0], w[1], w[2]]).collect();
        off(all.iter().take(rows))
    });
    shuffles.fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use rand_distr::{Distribution, StandardNormal};

    use super::*;
    use rand::RngExt;

    use crate::geometry::{Vec3, random_rotation};
    use crate::stats::Proportion;

    const FRAMES: usize = 24;

    fn ordered(rotations: impl Iterator<Item = Rotation>) -> bool {
        let laid: Vec<Option<Laid>> = rotations.map(|r| Some(Laid::at(r))).collect();
        have_order(&laid)
    }

    fn normal(sigma_rad: f64, rng: &mut ChaCha8Rng) -> Vec3 {
        Vec3::from_fn(|_, _| {
            sigma_rad * <StandardNormal as Distribution<f64>>::sample(&StandardNormal, rng)
        })
    }

    #[test]
    fn poses_by_chance_have_none() {
        for seed in 0..300 {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            let anywhere = (0..FRAMES).map(|_| random_rotation(&mut rng));
            assert!(!ordered(anywhere), "{seed}");
            // Placed by the light, which stays.
            let by_light = (0..FRAMES).map(|_| Rotation::from_scaled_axis(normal(0.1, &mut rng)));
            assert!(!ordered(by_light), "{seed}");
        }
    }

    /// By the light, which shows itself in one of two ways: one order in 40 predicts better than 39 others.
    #[test]
    fn poses_of_two_heaps_hardly_have_one() {
        let found = (0..400).filter(|seed| {
            let mut rng = ChaCha8Rng::seed_from_u64(*seed);
            let turned = Rotation::from_scaled_axis(Vec3::z() * 0.6);
            let heaps = (0..FRAMES).map(|_| {
                let about = Rotation::from_scaled_axis(normal(0.03, &mut rng));
                match rng.random_bool(0.7) {
                    true => about * turned,
                    false => about,
                }
            });
            ordered(heaps)
        });
        let found = Proportion::new(found.count() as u64, 400);
        assert!(found.high < 0.08, "{found}");
    }

    #[test]
    fn what_turns_wanders_or_rests_has_one() {
        for seed in 0..300 {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            let first = random_rotation(&mut rng);
            // From half a degree a frame to half a turn.
            let step =
                normal(1.0, &mut rng).normalize() * (0.01 * 314f64.powf(seed as f64 / 299.0));
            let evenly = (0..FRAMES).map(|k| Rotation::from_scaled_axis(step * k as f64) * first);
            let noisy: Vec<Rotation> = evenly
                .map(|r| Rotation::from_scaled_axis(normal(0.002, &mut rng)) * r)
                .collect();
            assert!(ordered(noisy.into_iter()), "{seed}");
            let rests =
                (0..FRAMES).map(|_| Rotation::from_scaled_axis(normal(0.004, &mut rng)) * first);
            assert!(ordered(rests), "{seed}");
            let mut now = first;
            let wanders: Vec<Rotation> = (0..4 * FRAMES)
                .map(|_| {
                    now = Rotation::from_scaled_axis(normal(0.1, &mut rng)) * now;
                    now
                })
                .collect();
            assert!(ordered(wanders.into_iter()), "{seed}");
        }
    }

    #[test]
    fn scattered_frames_have_none_and_few_frames_say_nothing() {
        let mut rng = ChaCha8Rng::seed_from_u64(0);
        let turned = |k: usize| Rotation::from_scaled_axis(Vec3::x() * 0.3 * k as f64);
        let mut laid: Vec<Option<Laid>> = (0..FRAMES).map(|k| Some(Laid::at(turned(k)))).collect();
        assert!(have_order(&laid));
        laid.iter_mut().step_by(2).for_each(|l| *l = None);
        assert!(!have_order(&laid));
        let few: Vec<_> = (0..5)
            .map(|_| Some(Laid::at(random_rotation(&mut rng))))
            .collect();
        assert!(have_order(&few));
    }
}
