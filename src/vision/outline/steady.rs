//! Outlines made steady over the frames of a clip.
//!
//! Blotches at the rim draw outlines found in single frames aside, and an outline's shift feigns a turn. A ball in a cup stays in place,
//! and has one outline in all frames; one that flies or is carried moves evenly for some frames: its center and radius are fitted by lines
//! over the frames about each. Tukey's biweight stands against outlines that are far off.

use super::path::{Degree, OutlineAtZero};
use crate::fit::Reweighting;
use crate::stats::{SIGMA_PER_MAD, median};
use crate::vision::optics::camera::BallCircle;

/// Frames before and after one that take part.
const WINDOW: usize = 12;
/// Frames with an outline that it takes.
const MIN_FRAMES: usize = 6;
/// Outlines three standard deviations off do not count.
const REWEIGHTING: Reweighting = Reweighting {
    fits: 4,
    reach: 3.0 * SIGMA_PER_MAD,
    least: 1e-3 / SIGMA_PER_MAD,
    starts_level: true,
};
/// A ball is at rest, or moves evenly, where its outlines scatter about one, or a line, by no more than so many times their scatter about
/// lines through those near each.
const EVEN: f64 = 2.0;
/// Outlines that scatter by more of their radius about the line are of a ball that moves otherwise.
const SCATTER: f64 = 0.08;

/// The outline of each frame that has one, steadied, with the standard deviation of its center, pixels: one for all where the ball is at
/// rest, on a line through all where it moves evenly, else on lines through those about each.
pub(crate) fn steady(circles: &[Option<(BallCircle, f64)>]) -> Vec<Option<(BallCircle, f64)>> {
    let each = |of: &dyn Fn(usize) -> Option<Steadied>| -> Vec<Option<Steadied>> {
        (0..circles.len()).map(|k| circles[k].and(of(k))).collect()
    };
    let scatter = |all: &[Option<Steadied>]| {
        let mut scatters: Vec<f64> = all.iter().flatten().map(|s| s.scatter).collect();
        median(&mut scatters)
    };
    let mut steadied = each(&|k| {
        let first = k.saturating_sub(WINDOW);
        let range = first..(k + WINDOW + 1).min(circles.len());
        about(&circles[range], (k - first) as f64, true)
    });
    let limit = EVEN * scatter(&steadied);
    for moves in [false, true] {
        let all = each(&|k| about(circles, k as f64, moves));
        if all.iter().any(Option::is_some) && scatter(&all) <= limit {
            steadied = all;
            break;
        }
    }
    let one = |(own, steadied): (&Option<(BallCircle, f64)>, Option<Steadied>)| {
        let (mut circle, sigma_px) = (*own)?;
        let Some(steadied) = steadied else {
            return Some((circle, sigma_px));
        };
        (circle.center, circle.radius) = (steadied.circle.center, steadied.circle.radius);
        Some((circle, steadied.sigma_px))
    };
    circles.iter().zip(steadied).map(one).collect()
}

/// An outline by several.
struct Steadied {
    circle: BallCircle,
    /// How far the outlines scatter about it, pixels.
    scatter: f64,
    /// Standard deviation of the center, pixels.
    sigma_px: f64,
}

/// The outline at a place among others, by lines through them, or by one for all.
fn about(circles: &[Option<(BallCircle, f64)>], at: f64, moves: bool) -> Option<Steadied> {
    let near = circles.iter().enumerate();
    let near: Vec<(f64, BallCircle)> = near
        .filter_map(|(j, c)| Some((j as f64 - at, (*c)?.0)))
        .collect();
    if near.len() < MIN_FRAMES {
        return None;
    }
    let degree = match moves {
        true => Degree::Line,
        false => Degree::Level,
    };
    let path = OutlineAtZero::fit(&near, [degree; 2], &REWEIGHTING)?;
    let [of_u, of_v, of_radius] = path.scatters.map(|scatter| SIGMA_PER_MAD * scatter);
    let scatter = of_u.max(of_v).max(of_radius);
    let [u, v] = path.variances.map(f64::sqrt);
    (scatter <= SCATTER * path.circle.radius).then_some(Steadied {
        circle: path.circle,
        scatter,
        sigma_px: (of_u * u).max(of_v * v),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::optics::camera::Pixel;

    /// A ball at rest whose outlines scatter along the rows alone: its center is as uncertain as there.
    #[test]
    fn a_center_is_as_uncertain_as_along_its_worse_axis() {
        let off = |k: usize| [0.0, 1.2, -0.8, 0.4, -1.6, 0.8, -0.4, 1.6, -1.2][k % 9];
        let circle = |u: f64, v: f64| Some((BallCircle::new(Pixel { u, v }, 50.0), 0.1));
        let sigma = |of: &dyn Fn(usize) -> Option<(BallCircle, f64)>| {
            let circles: Vec<_> = (0..36).map(of).collect();
            steady(&circles)[18].expect("an outline").1
        };
        let along_rows = sigma(&|k| circle(80.0 + off(k), 60.0));
        let along_columns = sigma(&|k| circle(80.0, 60.0 + off(k)));
        // A deviation of about 1 px over the root of 36 outlines.
        assert!((0.08..0.4).contains(&along_rows), "{along_rows}");
        assert!((along_rows - along_columns).abs() < 1e-12);
    }

    #[test]
    fn a_ball_on_a_straight_path_is_found_in_spite_of_outlines_that_are_far_off() {
        let truth = |k: usize| (100.0 + 1.5 * k as f64, 60.0 - 0.5 * k as f64);
        let circles: Vec<Option<(BallCircle, f64)>> = (0..40)
            .map(|k| {
                let (mut u, mut v) = truth(k);
                // A scatter of 1 px that is not even, and every seventh outline elsewhere.
                u += (k as f64 * 2.4).sin();
                v += (k as f64 * 1.7).cos();
                if k % 7 == 3 {
                    u += 15.0;
                }
                (k % 11 != 5).then(|| (BallCircle::new(Pixel { u, v }, 50.0), 0.1))
            })
            .collect();
        for (k, found) in steady(&circles).into_iter().enumerate() {
            assert_eq!(found.is_some(), circles[k].is_some(), "{k}");
            if let Some((circle, sigma)) = found {
                let (u, v) = truth(k);
                let off = (circle.center.u - u).hypot(circle.center.v - v);
                assert!(off < 0.9, "frame {k}: {off:.2} px off");
                assert!(sigma < 0.9, "frame {k}: {sigma:.2} px");
            }
        }
    }
}
