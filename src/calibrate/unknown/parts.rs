//! Dots that run into one mark.
//!
//! Where dots lie near each other, or the ball has few pixels, the surface shows several as one mark. It is shared out among `k` middles, each
//! place to the nearest (Lloyd's algorithm, begun along its length); it is `k` dots for the smallest `k` of which each part is a disc of about the size
//! of the ball's other dots, and between one and the next it is less dark: a bar is dark all along. What hardly faces the camera
//! stays one: seen from the side alone a dot is as long as two.

use nalgebra::Matrix3;

use super::map::DotMap;
use super::marks::{DarkMark, MiddleDisc, mark, marks};
use crate::geometry::Vec3;
use crate::surface::Darkness;

/// A mark is no more dots than this.
const MOST: usize = 4;
/// Radius of a part over that of the middle disc.
const SIZE: [f64; 2] = [0.7, 1.5];
/// Halfway between two parts the surface, as the mean of what is so near, radians, is at most so dark over the less dark one's middle. Between dots that
/// ran into one on three balls of 52 to 74 pixels (`bench calibration-unknown --plain --seed 36100001`) it was 0.64 to 0.85.
const NEAR: f64 = 0.03;
const DIP: f64 = 0.9;
/// Steps in which places are shared out.
const STEPS: usize = 12;
/// So many views that face a mark by so much show how long it is, else as many dots of the map must lie in it. Of long marks with fewer than eight such
/// views and one dot, on 61 plain balls (`bench calibration-unknown`, seed 36100001), most were one dot; of those with twenty views all were several.
const WELL: f64 = 0.5;
const MIN_WELL: usize = 10;

impl DotMap<'_> {
    /// The marks of a surface, those that are several dots as these, and the radius of the middle disc, radians; `None` without a
    /// disc.
    pub fn marks(&self, surface: &Darkness) -> Option<(Vec<DarkMark>, f64)> {
        let whole = marks(surface);
        let radius = MiddleDisc::of(&whole)?.radius;
        let parted = whole.iter().map(|(mark, members)| {
            let is_long = |parts: &Vec<DarkMark>| {
                let views = self.facing(&mark.direction, WELL).count();
                views >= MIN_WELL || self.within_mark(mark) >= parts.len()
            };
            let parts = (!mark.is_disc()).then(|| parts(surface, members, radius));
            let parts = parts.flatten().filter(is_long);
            parts.unwrap_or_else(|| vec![*mark])
        });
        Some((parted.flatten().collect(), radius))
    }
}

/// The dots that these places of one mark are, where they are several. `radius` is that of the ball's middle disc, radians.
fn parts(surface: &Darkness, members: &[usize], radius: f64) -> Option<Vec<DarkMark>> {
    let is_dot = |m: &DarkMark| m.is_round() && (SIZE[0]..=SIZE[1]).contains(&(m.radius / radius));
    (2..=MOST).find_map(|count| {
        let shared = shared_out(surface, members, count)?;
        let marks = shared.iter().map(|part| {
            let darkness = |k: &usize| surface.places[*k].darkness;
            let top = *part
                .iter()
                .max_by(|a, b| darkness(a).total_cmp(&darkness(b)))?;
            Some(mark(surface, top, part)).filter(is_dot)
        });
        let marks: Option<Vec<DarkMark>> = marks.collect();
        marks.filter(|marks| (0..count).all(|part| stands_apart(surface, marks, part)))
    })
}

/// Whether the surface is less dark between a part and the next one.
fn stands_apart(surface: &Darkness, parts: &[DarkMark], part: usize) -> bool {
    let middle = parts[part].direction;
    let others = parts.iter().enumerate().filter(|(k, _)| *k != part);
    let others = others.map(|(_, other)| other.direction);
    let next = others.max_by(|a, b| a.dot(&middle).total_cmp(&b.dot(&middle)));
    next.is_some_and(|next| {
        let [here, there] = [middle, next].map(|at| surface.darkness(&at, NEAR));
        let between = surface.darkness(&(middle + next).normalize(), NEAR);
        between <= DIP * here.min(there)
    })
}

/// The places of a mark, shared out among so many middles.
fn shared_out(surface: &Darkness, members: &[usize], count: usize) -> Option<Vec<Vec<usize>>> {
    let at = |k: usize| surface.places[k].direction;
    let weighted = |k: &usize| at(*k) * f64::from(surface.places[*k].darkness);
    let middle = members.iter().map(weighted).sum::<Vec3>().normalize();
    let mut moments = Matrix3::zeros();
    for &k in members {
        let off = at(k) - middle;
        moments += off * off.transpose();
    }
    let spread = moments.symmetric_eigen();
    let along = spread
        .eigenvectors
        .column(spread.eigenvalues.imax())
        .into_owned();
    let mut sorted = members.to_vec();
    sorted.sort_by(|a, b| at(*a).dot(&along).total_cmp(&at(*b).dot(&along)));
    let nth = |part: usize| at(sorted[(2 * part + 1) * sorted.len() / (2 * count)]);
    let mut middles: Vec<Vec3> = (0..count).map(nth).collect();
    let mut parts = Vec::new();
    for _ in 0..STEPS {
        parts = vec![Vec::new(); count];
        for &k in members {
            let off = |part: &usize| (at(k) - middles[*part]).norm_squared();
            let nearest = (0..count).min_by(|a, b| off(a).total_cmp(&off(b)))?;
            parts[nearest].push(k);
        }
        for (middle, part) in middles.iter_mut().zip(&parts) {
            *middle = part
                .iter()
                .map(weighted)
                .sum::<Vec3>()
                .try_normalize(1e-12)?;
        }
    }
    Some(parts)
}
