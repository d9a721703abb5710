//! The material between holes: whether it is enough, and which holes, webs and balls would do.

use crate::error::{Error, Result};
use crate::geometry::{Vec3, angle_between};

use super::StencilConfig;
use super::config::{MIN_HOLE_MM, MIN_WEB_MM};

/// Rejects holes that leave too little material between them; names the pair that leaves least.
pub(super) fn check_overlaps(dots: &[Vec3], config: &StencilConfig) -> Result<()> {
    let mut worst = (f64::INFINITY, 0, 0);
    for (i, a) in dots.iter().enumerate() {
        for (j, b) in dots[..i].iter().enumerate() {
            let sine = (0.5 * angle_between(a, b)).sin();
            // Along the chord, which is the shortest way, at both ends of the hole.
            let web = |radius: f64, hole: f64| 2.0 * radius * sine - 2.0 * hole;
            let inner = web(config.inner_radius_mm(), 0.5 * config.hole_diameter_mm);
            let outer = web(config.outer_radius_mm(), config.opening_radius_mm());
            let thinnest = inner.min(outer);
            if thinnest < worst.0 {
                worst = (thinnest, j, i);
            }
        }
    }
    let (thinnest, j, i) = worst;
    if thinnest >= config.min_web_mm {
        return Ok(());
    }
    let problem = format!(
        "the holes of dots {j} and {i} ({:.1} degrees apart) leave {thinnest:.2} mm between them, \
         expected at least {} mm; {}",
        angle_between(&dots[i], &dots[j]).to_degrees(),
        config.min_web_mm,
        fitting(dots, config, thinnest),
    );
    Err(Error::argument("hole_diameter_mm", problem))
}

/// The hole diameter at which the thinnest web between two holes is as thick as asked for, mm;
/// negative where no hole is small enough.
pub(super) fn widest_holes(dots: &[Vec3], config: &StencilConfig) -> f64 {
    // How much wider a hole is at its outer end.
    let widening = 2.0 * config.opening_radius_mm() - config.hole_diameter_mm;
    let mut widest = f64::INFINITY;
    for (i, a) in dots.iter().enumerate() {
        for b in &dots[..i] {
            let chord = |radius: f64| 2.0 * radius * (0.5 * angle_between(a, b)).sin();
            let inner = chord(config.inner_radius_mm());
            let outer = chord(config.outer_radius_mm()) - widening;
            widest = widest.min(inner.min(outer) - config.min_web_mm);
        }
    }
    widest
}

/// Which holes, webs and balls fit, in words, where the thinnest web is `thinnest_mm`.
fn fitting(dots: &[Vec3], config: &StencilConfig, thinnest_mm: f64) -> String {
    let tenths = (10.0 * widest_holes(dots, config) + 1e-6).floor();
    let holes = if tenths < 10.0 * MIN_HOLE_MM {
        "no hole fits".to_owned()
    } else {
        format!("holes of at most {:.1} mm fit", 0.1 * tenths)
    };
    let web = (10.0 * thinnest_mm + 1e-6).floor();
    let webs = if web < 10.0 * MIN_WEB_MM {
        String::new()
    } else {
        format!(", or a web of at most {:.1} mm", 0.1 * web)
    };
    let ball = (10.0 * smallest_ball(dots, config) - 1e-6).ceil();
    format!("{holes}{webs}, or a ball of at least {:.1} mm", 0.1 * ball)
}

/// The ball's diameter from which all webs are as thick as asked for, mm.
fn smallest_ball(dots: &[Vec3], config: &StencilConfig) -> f64 {
    let mut radius = 0.0f64;
    for (i, a) in dots.iter().enumerate() {
        for b in &dots[..i] {
            let sine = (0.5 * angle_between(a, b)).sin();
            let at = |hole: f64| 0.5 * (hole + config.min_web_mm) / sine;
            // How far inner and outer surface lie beyond the ball.
            let beyond = [config.clearance_mm, config.clearance_mm + config.wall_mm];
            let inner = at(config.hole_diameter_mm) - beyond[0];
            let outer = at(2.0 * config.opening_radius_mm()) - beyond[1];
            radius = radius.max(inner).max(outer);
        }
    }
    2.0 * radius
}
