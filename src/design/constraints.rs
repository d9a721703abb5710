//! Constraints on a pattern that is to be printed, drawn and read, as values and as linear
//! inequalities.
//!
//! A design works on the dots and, where a stencil's seam must stay clear, on the seam's normal as
//! one more unit vector. Every constraint is written as `g(x) <= 0` in cosines or heights on the
//! unit sphere:
//!
//! - separation, each pair: `p_i . p_j - cos(separation)`,
//! - visibility, for each viewing direction v and each of the `min_visible` highest dots:
//!   `limit - p_i . v`,
//! - seam, each dot: `sin(margin) - sign_i (p_i . normal)`, the dot stays on its side,
//! - keep-out, each dot and cone: `p_i . axis - cos(half angle + a dot's radius)`.
//!
//! Dots that are drawn already ([`Constraints::drawn`]) stay: a constraint that only they violate is none.
//!
//! A pattern must also be possible to apply, so this module asks [`crate::stencil`] for two
//! results: the seam of maximum margin, and whether a stencil is possible ([`Stencil::check`]).
//! Nothing else in the design depends on the stencil.

use crate::error::{Error, Result, require};
use crate::geometry::{Vec3, angle_between, spiral_directions};
pub use crate::pattern::KeepOut;
use crate::pattern::Pattern;
use crate::stencil::{Stencil, StencilConfig, max_margin_seam};

/// Viewing directions that sample the visibility constraint during the search.
const VIEWS: usize = 600;
/// Required height above the limit, since directions between the samples count too.
const VISIBILITY_RESERVE: f64 = 0.02;
/// Directions by which the area outside all cones is measured.
const AREA_SAMPLES: usize = 4_000;
/// An angle may miss its bound by this much, radians (0.06 degrees: 0.02 mm on a ball of 40 mm).
const ANGLE_TOLERANCE: f64 = 1e-3;

/// The beginning of what a pattern misses that has no stencil.
pub(super) const NO_STENCIL: &str = "no stencil";

/// The constraints of a pattern.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Constraints {
    /// Minimum angle between two dots, radians.
    pub min_separation_rad: f64,
    /// Minimum number of dots in view from any direction.
    pub min_visible: usize,
    /// Minimum z of a dot that counts as in view.
    pub visibility_limit: f64,
    /// Minimum angle between a dot and the seam's great circle, radians; 0 sets no limit.
    pub seam_margin_rad: f64,
    /// Cones without dots.
    pub keep_out: Vec<KeepOut>,
    /// A stencil that must be possible: holes apart, clear of rims, hinge and thumb tab. It is not
    /// one of the inequalities; a pattern without a possible stencil is never chosen.
    pub stencil: Option<StencilConfig>,
    /// The first so many dots are on the ball already. A descent leaves them where they are, and what they alone
    /// violate counts for nothing.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub drawn: usize,
}

fn is_zero(count: &usize) -> bool {
    *count == 0
}

impl Default for Constraints {
    /// 18 degrees apart (6.3 mm on a 40 mm ball: holes of 4 mm with a wall between them), 6 dots
    /// with z > 0 from anywhere, 10 degrees off the seam, no cone, any stencil.
    fn default() -> Self {
        Self {
            min_separation_rad: 18f64.to_radians(),
            min_visible: 6,
            visibility_limit: 0.0,
            seam_margin_rad: 10f64.to_radians(),
            keep_out: Vec::new(),
            stencil: None,
            drawn: 0,
        }
    }
}

/// A linear inequality on a small move: `violation + sum_k gradient_k . move(dot_k) <= 0`. Index
/// `n` (the number of dots) is the seam's normal.
#[derive(Debug, Clone)]
pub(super) struct ConstraintRow {
    /// Which constraint this is, the same at every point. The dots that must be in view of one direction share a
    /// number: together they are one constraint, and the largest violation is its value.
    pub number: usize,
    pub terms: [(usize, Vec3); 2],
    pub violation: f64,
}

impl ConstraintRow {
    /// The same inequality on the vectors from number `first` on; those before it do not move.
    pub fn leave_out(&mut self, first: usize) {
        for (index, gradient) in &mut self.terms {
            match index.checked_sub(first) {
                Some(rest) => *index = rest,
                None => (*index, *gradient) = (0, Vec3::zeros()),
            }
        }
    }
}

impl Constraints {
    /// Rejects constraints that no pattern of `dots` dots can satisfy.
    ///
    /// By L. Fejes Toth, n points cannot all be farther apart than `acos((cot^2 w - 1) / 2)`,
    /// `w = pi n / (6 (n - 2))`. A view and its opposite share the dots, so at most half of them can be
    /// visible from everywhere. The stencil's holes need a separation, whatever less is asked for. The
    /// caps of half the separation around the dots do not overlap, so they must fit beside the seam
    /// and outside the cones.
    ///
    /// # Errors
    /// [`Error::Argument`] with the nearest value that might work.
    pub fn check_demand(&self, dots: usize) -> Result<()> {
        if self.drawn > 0 {
            // What is possible beside them depends on where they are: the search finds out.
            return self.check_domains();
        }
        let limit = max_separation(dots);
        if !(self.min_separation_rad >= 0.0 && self.min_separation_rad < limit) {
            let fitting = (4..=dots)
                .take_while(|&n| max_separation(n) > self.min_separation_rad)
                .last();
            let fewer = fitting.map_or(String::new(), |n| format!("; at most {n} dots fit"));
            let problem = format!(
                "expected 0 to {:.1} degrees (no {dots} points on a sphere are farther apart), found {:.1}{fewer}",
                limit.to_degrees(),
                self.min_separation_rad.to_degrees()
            );
            return Err(Error::argument("min_separation_rad", problem));
        }
        self.check_holes()?;
        let maximum = dots / 2;
        let expected = format!("at most {maximum} of {dots} dots (opposite views share them)");
        require(
            self.min_visible <= maximum,
            "min_visible",
            &expected,
            self.min_visible,
        )?;
        self.check_domains()?;
        self.check_space(dots)
    }

    fn check_domains(&self) -> Result<()> {
        let separation = self.min_separation_rad.to_degrees();
        let inside = (0.0..180.0).contains(&separation);
        require(inside, "min_separation_rad", "0 to 180 degrees", separation)?;
        let margin = self.seam_margin_rad.to_degrees();
        let inside = (0.0..60.0).contains(&margin);
        require(inside, "seam_margin_rad", "0 to 60 degrees", margin)?;
        self.keep_out.iter().try_for_each(KeepOut::check)
    }

    /// Rejects a separation below that of the stencil's holes: no pattern that uses it has a stencil.
    fn check_holes(&self) -> Result<()> {
        let Some(stencil) = &self.stencil else {
            return Ok(());
        };
        let needed = stencil.min_separation_rad();
        if self.min_separation_rad >= needed - ANGLE_TOLERANCE {
            return Ok(());
        }
        let fitting = (5..(10.0 * stencil.hole_diameter_mm) as u32)
            .rev()
            .map(|tenths| f64::from(tenths) / 10.0)
            .find(|&hole_diameter_mm| {
                let smaller = StencilConfig {
                    hole_diameter_mm,
                    ..stencil.clone()
                };
                smaller.min_separation_rad() <= self.min_separation_rad
            })
            .map_or(String::new(), |mm| {
                format!(", or for holes of at most {mm:.1} mm")
            });
        let problem = format!(
            "holes of {} mm on a ball of {} mm, with the wall that the stencil needs between them, are at least \
             {:.1} degrees apart, found {:.1}; ask for more{fitting}",
            stencil.hole_diameter_mm,
            stencil.ball_diameter_mm,
            // Rounded up: the figure itself must be accepted.
            (10.0 * needed.to_degrees()).ceil() / 10.0,
            self.min_separation_rad.to_degrees(),
        );
        Err(Error::argument("min_separation_rad", problem))
    }

    /// Rejects a seam margin or cones that leave less area than the dots' caps have.
    fn check_space(&self, dots: usize) -> Result<()> {
        let cap = 0.5 * self.min_separation_rad;
        // Areas as parts of the sphere.
        let needed = dots as f64 * 0.5 * (1.0 - cap.cos());
        let beside_seam = |margin: f64| 1.0 - (margin - cap).max(0.0).sin();
        if beside_seam(self.seam_margin_rad) < needed {
            let most = (1.0 - needed).clamp(0.0, 1.0).asin() + cap;
            let problem = format!(
                "{dots} dots that are {:.1} degrees apart need {:.0} % of the ball, and beside this seam there is \
                 {:.0} %; ask for at most {:.1} degrees",
                self.min_separation_rad.to_degrees(),
                100.0 * needed,
                100.0 * beside_seam(self.seam_margin_rad),
                (10.0 * most.to_degrees()).floor() / 10.0,
            );
            return Err(Error::argument("seam_margin_rad", problem));
        }
        let outside = |v: &Vec3| {
            let free = |cone: &KeepOut| angle_between(v, &cone.axis) > cone.half_angle_rad - cap;
            self.keep_out.iter().all(free)
        };
        let free = spiral_directions(AREA_SAMPLES).filter(outside).count() as f64;
        let free = free / AREA_SAMPLES as f64;
        // The samples' own error is below half a percent of the sphere.
        if free + 0.005 < needed {
            let problem = format!(
                "{dots} dots that are {:.1} degrees apart need {:.0} % of the ball, and the cones leave {:.0} %; \
                 ask for smaller cones, fewer dots or less separation",
                self.min_separation_rad.to_degrees(),
                100.0 * needed,
                100.0 * free,
            );
            return Err(Error::argument("keep_out", problem));
        }
        Ok(())
    }

    /// The constraint that a pattern violates, or `None`.
    pub fn missed(&self, pattern: &Pattern) -> Option<String> {
        self.missed_but_stencil(pattern).or_else(|| {
            let rejected = Stencil::check(pattern, self.stencil.as_ref()?).err()?;
            Some(format!("{NO_STENCIL} ({rejected})"))
        })
    }

    /// As [`Self::missed`], whether or not the pattern has a stencil.
    pub(super) fn missed_but_stencil(&self, pattern: &Pattern) -> Option<String> {
        let separation = self.separation(pattern);
        let deg = f64::to_degrees;
        if separation < self.min_separation_rad - ANGLE_TOLERANCE {
            let found = deg(separation);
            return Some(format!("minimum separation {found:.2} deg"));
        }
        let seen = pattern.min_visible(self.visibility_limit);
        if seen < self.min_visible {
            return Some(format!("{seen} dots in view at worst"));
        }
        if self.seam_margin_rad > 0.0 {
            let margin = max_margin_seam(pattern.dots()).margin_rad;
            if margin < self.seam_margin_rad - ANGLE_TOLERANCE {
                return Some(format!("seam margin {:.2} deg", deg(margin)));
            }
        }
        for cone in &self.keep_out {
            for dot in pattern.dots().iter().skip(self.drawn) {
                let angle = angle_between(dot, &cone.axis);
                if angle < self.min_angle_rad(cone) - ANGLE_TOLERANCE {
                    return Some(format!("a dot {:.2} deg from a keep-out axis", deg(angle)));
                }
            }
        }
        None
    }

    /// Minimum angle between two dots of which one is not drawn yet, radians.
    pub(super) fn separation(&self, pattern: &Pattern) -> f64 {
        let dots = pattern.dots();
        let free = dots.iter().enumerate().skip(self.drawn);
        let pairs = free.flat_map(|(i, a)| dots[..i].iter().map(move |b| angle_between(a, b)));
        pairs.fold(f64::INFINITY, f64::min)
    }

    /// Whether a new dot at `direction` keeps the separation from `dots`, and clear of all cones.
    pub fn has_room(&self, dots: &[Vec3], direction: &Vec3) -> bool {
        let apart = |d: &Vec3| angle_between(d, direction) >= self.min_separation_rad;
        let outside =
            |cone: &KeepOut| angle_between(&cone.axis, direction) >= self.min_angle_rad(cone);
        dots.iter().all(apart) && self.keep_out.iter().all(outside)
    }

    /// Angle that a dot's center keeps from a cone's axis: where the dots' size is known, no dot
    /// reaches into the cone.
    fn min_angle_rad(&self, cone: &KeepOut) -> f64 {
        let dot = self.stencil.as_ref().map_or(0.0, |s| {
            (s.hole_diameter_mm / s.ball_diameter_mm).min(1.0).asin()
        });
        cone.half_angle_rad + dot
    }

    /// The number of constraints of `dots` dots: [`ConstraintRow::number`] stays below it.
    pub(super) fn count(&self, dots: usize) -> usize {
        dots * dots + dots * (1 + self.keep_out.len()) + VIEWS
    }

    /// The largest violation at `x`: the dots, and the seam's normal after them.
    pub(super) fn violation(&self, x: &[Vec3]) -> f64 {
        let mut worst = 0.0f64;
        self.rows(x, 0.0, &mut |row| worst = worst.max(row.violation));
        worst
    }

    /// All inequalities that a move of each vector by at most `reach` radians may violate.
    pub(super) fn rows(&self, x: &[Vec3], reach: f64, each: &mut dyn FnMut(ConstraintRow)) {
        let Some((normal, dots)) = x.split_last() else {
            return;
        };
        let none = (0, Vec3::zeros());
        let n = dots.len();
        // A move of two vectors changes a scalar product by at most twice the reach.
        let mut add = |number, terms, violation: f64| {
            if violation > -2.0 * reach - 1e-9 {
                each(ConstraintRow {
                    number,
                    terms,
                    violation,
                });
            }
        };
        let bound = self.min_separation_rad.cos();
        for i in self.drawn..n {
            for j in 0..i {
                let violation = dots[i].dot(&dots[j]) - bound;
                add(i * n + j, [(i, dots[j]), (j, dots[i])], violation);
            }
        }
        let mut first = n * n;
        if self.seam_margin_rad > 0.0 {
            let bound = self.seam_margin_rad.sin();
            for (i, d) in dots.iter().enumerate().skip(self.drawn) {
                let height = d.dot(normal);
                let side = height.signum();
                let terms = [(i, -side * normal), (n, -side * d)];
                add(first + i, terms, bound - side * height);
            }
        }
        for cone in &self.keep_out {
            first += n;
            let bound = self.min_angle_rad(cone).cos();
            for (i, d) in dots.iter().enumerate().skip(self.drawn) {
                add(first + i, [(i, cone.axis), none], d.dot(&cone.axis) - bound);
            }
        }
        first += n;
        if self.min_visible > 0 {
            let limit = self.visibility_limit + VISIBILITY_RESERVE;
            let mut heights: Vec<(f64, usize)> = Vec::with_capacity(n);
            for (view, v) in spiral_directions(VIEWS).enumerate() {
                heights.clear();
                heights.extend(dots.iter().enumerate().map(|(i, d)| (d.dot(&v), i)));
                let kth = self.min_visible.min(n) - 1;
                heights.select_nth_unstable_by(kth, |a, b| b.0.total_cmp(&a.0));
                for &(height, i) in &heights[..=kth] {
                    add(first + view, [(i, -v), none], limit - height);
                }
            }
        }
    }
}

/// The separation that `n` points on a sphere cannot exceed, radians (L. Fejes Toth, "Uber die
/// Abschatzung des kurzesten Abstandes zweier Punkte eines auf einer Kugelflache liegenden
/// Punktsystems", Jber. DMV 53, 1943). Exact for 3, 4, 6 and 12.
pub fn max_separation(n: usize) -> f64 {
    let n = n as f64;
    let w = std::f64::consts::PI * n / (6.0 * (n - 2.0));
    (0.5 * (w.tan().powi(-2) - 1.0)).clamp(-1.0, 1.0).acos()
}
