//! The check of a certificate: short, and independent of the search.
//!
//! Every unit quaternion, up to its sign, is a multiple of a point `(1, x, y, z)` or of one with the 1
//! in another place, with `x, y, z` in [-1, 1]: four cubes hold all rotations. Two points of a cube that
//! are `h` apart are seen from the origin under an angle of at most `h`, so their rotations differ by at
//! most `2 h`. A part of a cube is done where at its center no confusion is within twice the guaranteed
//! angle and this difference.

use std::collections::BTreeSet;

use nalgebra::{Matrix3, Quaternion, UnitQuaternion};

use super::{Certificate, Guarantee, MAX_COUNT, MIN_COUNT};
use crate::error::{Error, Result};
use crate::geometry::{Vec3, angle_between};
use crate::pattern::Pattern;

/// Rounding of angles, radians.
const ROUNDING: f64 = 1e-9;
/// Parts smaller than this prove nothing.
const MIN_HALF: f64 = 1e-7;

impl Certificate {
    /// Verifies all guarantees for a pattern.
    ///
    /// # Errors
    /// [`Error::Argument`] that names the guarantee and what is wrong with it.
    pub fn check(&self, pattern: &Pattern) -> Result<()> {
        let refuse = |problem: String| Err(Error::argument("certificate", problem));
        if self.pattern_sha256 != pattern.sha256() {
            return refuse("belongs to another pattern: its SHA-256 differs".to_owned());
        }
        if !(0.0..1.0).contains(&self.visibility_limit) {
            return refuse(format!("visibility limit of {}", self.visibility_limit));
        }
        if self.min_visible != pattern.min_visible(self.visibility_limit) {
            return refuse(format!(
                "{} dots are not visible from everywhere",
                self.min_visible
            ));
        }
        for g in &self.guarantees {
            if let Err(problem) = check(g, pattern.dots(), self.visibility_limit) {
                return refuse(format!(
                    "{:?}, {} detected dots: {problem}",
                    g.taken_for, g.detected
                ));
            }
        }
        Ok(())
    }
}

fn check(g: &Guarantee, dots: &[Vec3], limit: f64) -> std::result::Result<(), String> {
    let n = dots.len();
    let k = g.detected;
    if !(MIN_COUNT..=MAX_COUNT).contains(&k) || g.guaranteed_rad.is_nan() || g.guaranteed_rad < 0.0
    {
        return Err("no such guarantee".to_owned());
    }
    let sign = if g.taken_for.is_mirrored() { -1.0 } else { 1.0 };
    let others: Vec<Vec3> = dots.iter().map(|d| sign * d).collect();
    // The example.
    let distinct = |of: &[usize]| (0..of.len()).all(|x| of[x] < n && !of[..x].contains(&of[x]));
    if g.seen.len() != k || g.other.len() != k || !distinct(&g.seen) || !distinct(&g.other) {
        return Err("its example is no set of pairs of dots".to_owned());
    }
    if g.seen == g.other && sign > 0.0 {
        return Err("its example takes every dot for itself".to_owned());
    }
    let [w, x, y, z] = g.rotation;
    let norm = g.rotation.iter().map(|c| c * c).sum::<f64>();
    if norm.is_nan() || (norm - 1.0).abs() > 1e-6 {
        return Err("its example's rotation is no unit quaternion".to_owned());
    }
    let rotation = UnitQuaternion::new_normalize(Quaternion::new(w, x, y, z));
    let worst = g
        .seen
        .iter()
        .zip(&g.other)
        .map(|(&s, &o)| angle_between(&(rotation * dots[s]), &others[o]));
    let stated = 2.0 * g.confused_rad + ROUNDING;
    if stated.is_nan() || worst.fold(0.0, f64::max) > stated {
        return Err("its example's dots are farther apart than stated".to_owned());
    }
    let views = views(dots, limit);
    let seen = g.seen.iter().fold(0u64, |bits, &i| bits | 1 << i);
    if !views.iter().any(|view| view & seen == seen) {
        return Err("no view shows its example's dots together".to_owned());
    }
    if g.guaranteed_rad == 0.0 {
        return Ok(());
    }
    // All rotations.
    let cover = Cover {
        dots,
        others: &others,
        views: &views,
        count: k,
        foreign: sign < 0.0,
        angle: 2.0 * g.guaranteed_rad,
    };
    for place in 0..4 {
        if !cover.holds(place, Vec3::zeros(), 1.0) {
            return Err(format!(
                "a confusion is nearer than {:.4} degrees",
                g.guaranteed_rad.to_degrees()
            ));
        }
    }
    Ok(())
}

/// The dots at or above the limit, dot `i` as bit `i`, in views that look straight at a dot, or have two
/// of them at the limit: where any view shows some dots, one of these shows them all.
fn views(dots: &[Vec3], limit: f64) -> BTreeSet<u64> {
    let mut views = BTreeSet::new();
    let mut add = |v: Vec3| {
        let visible = |d: &Vec3| d.dot(&v) >= limit - ROUNDING;
        let bits = dots
            .iter()
            .enumerate()
            .fold(0, |bits, (i, d)| bits | u64::from(visible(d)) << i);
        views.insert(bits);
    };
    for (i, a) in dots.iter().enumerate() {
        add(*a);
        for b in &dots[..i] {
            let across = a.cross(b);
            let toward = (a + b) * (limit / (1.0 + a.dot(b)));
            let rest = (1.0 - toward.norm_squared()) / across.norm_squared();
            if rest >= 0.0 && rest.is_finite() {
                add(toward + rest.sqrt() * across);
                add(toward - rest.sqrt() * across);
            }
        }
    }
    views
}

/// The claim that nowhere in a region of rotations `count` dots lie within `angle` of others.
struct Cover<'a> {
    dots: &'a [Vec3],
    others: &'a [Vec3],
    views: &'a BTreeSet<u64>,
    count: usize,
    /// Every dot of the mirror image is another one.
    foreign: bool,
    angle: f64,
}

impl Cover<'_> {
    /// Whether it holds in the part of a cube around `center`.
    fn holds(&self, place: usize, center: Vec3, half: f64) -> bool {
        let mut q = [center.x, center.y, center.z, 0.0];
        q[3] = std::mem::replace(&mut q[place.min(3)], 1.0);
        if place == 3 {
            q[3] = 1.0;
        }
        let rotation = UnitQuaternion::new_normalize(Quaternion::new(q[0], q[1], q[2], q[3]));
        let rotation = rotation.to_rotation_matrix().into_inner();
        if !self.is_confused(&rotation, self.angle + 2.0 * 3f64.sqrt() * half) {
            return true;
        }
        let part = 0.5 * half;
        half > MIN_HALF
            && (0..8).all(|k| {
                let step = |bit: usize| if k >> bit & 1 == 0 { part } else { -part };
                self.holds(place, center + Vec3::new(step(0), step(1), step(2)), part)
            })
    }

    /// Whether dots that a view shows together lie within `reach` of others under a rotation.
    fn is_confused(&self, rotation: &Matrix3<f64>, reach: f64) -> bool {
        // For each dot the others near it, as bits.
        let near: Vec<u64> = self
            .dots
            .iter()
            .map(|d| {
                let at = rotation * d;
                let near = |o: &Vec3| angle_between(&at, o) < reach;
                let others = self.others.iter().enumerate();
                others.fold(0, |bits, (j, o)| bits | u64::from(near(o)) << j)
            })
            .collect();
        let any = near
            .iter()
            .enumerate()
            .fold(0u64, |bits, (i, n)| bits | u64::from(*n != 0) << i);
        let shown = self.views.iter().map(|view| view & any);
        let mut enough = shown.filter(|dots| dots.count_ones() as usize >= self.count);
        enough.any(|dots| self.extend(&near, dots, 0, 0, self.foreign))
    }

    /// Takes further dots for others, one after another.
    fn extend(&self, near: &[u64], mut rest: u64, count: usize, taken: u64, foreign: bool) -> bool {
        if count == self.count {
            return foreign;
        }
        while count + rest.count_ones() as usize >= self.count {
            let i = rest.trailing_zeros() as usize;
            rest &= rest - 1;
            let mut free = near[i] & !taken;
            while free != 0 {
                let j = free.trailing_zeros() as usize;
                free &= free - 1;
                if self.extend(near, rest, count + 1, taken | 1 << j, foreign || j != i) {
                    return true;
                }
            }
        }
        false
    }
}
