//! The surface of a ball by all frames of a clip: what is drawn on it, place by place.
//!
//! Every placed frame says how bright each place that faces the camera is over the bare ball ([`Albedo`]). The median over views
//! from different sides is the ball's: noise, glints, shadows and fingers do not turn with it and leave.

use kiddo::{ImmutableKdTree, SquaredEuclidean};

use super::map::Map;
use crate::error::{Error, Result};
use crate::geometry::{Rotation, Vec3, rotation_angle, spiral_directions};
use crate::stats::{SIGMA_PER_MAD, median};
use crate::vision::albedo::Albedo;

/// Places, 1.9 degrees apart.
const PLACES: usize = 12_000;
/// Depth from which a view shows a place well enough.
const FACING: f64 = 0.2;
/// The ball turns by so much, radians, between two views that count: in a pause the fingers do not move on it.
const TURNED: f64 = 0.05;
/// Fewer views of a place may be of a finger.
const SHOWN: usize = 2;
/// Steps of brightness, up to twice the bare ball's.
const STEPS: usize = 64;
/// Places so near, radians, are neighbors, and are averaged.
const NEIGHBORS: f64 = 0.055;
/// The bare ball about a place: this share of the places so near, radians, is no brighter.
const BARE: f64 = 0.7;
const ABOUT: f64 = 0.35;

type Tree = ImmutableKdTree<f64, 3>;

/// The ball's surface, in the map's frame.
pub(super) struct Surface {
    pub places: Vec<Place>,
    /// Standard deviation of a place's darkness.
    pub noise: f32,
    tree: Tree,
}

/// A place of the surface.
#[derive(Debug, Clone, Copy)]
pub(super) struct Place {
    pub direction: Vec3,
    /// How much darker it is than the ball about it, over the bare ball's brightness; 0 where it is brighter or not seen.
    pub darkness: f32,
    /// Views that show it.
    pub views: usize,
    /// Share of these that show it dark: nearer to the median than to the bare ball.
    pub steady: f32,
}

impl Surface {
    /// By the placed frames of a map. `albedos` are those of the map's estimates.
    pub fn new(map: &Map<'_>, albedos: &[Albedo]) -> Result<Self> {
        let directions: Vec<Vec3> = spiral_directions(PLACES).collect();
        let points: Vec<[f64; 3]> = directions.iter().map(|d| [d.x, d.y, d.z]).collect();
        let tree = Tree::new_from_slice(&points)
            .map_err(|e| Error::argument("surface", format!("no search tree: {e}")))?;
        let counts = count(map, albedos, &directions);
        let raw: Vec<f32> = counts.iter().map(middle).collect();
        let views: Vec<usize> = counts.iter().map(views).collect();
        let mean = |k: usize| -> f32 {
            let (mut sum, mut weight) = (0.0, 0.0);
            near(&tree, &directions[k], NEIGHBORS, |j| {
                if views[j] > 0 {
                    sum += raw[j];
                    weight += 1.0;
                }
            });
            if weight > 0.0 { sum / weight } else { 1.0 }
        };
        let smooth: Vec<f32> = (0..PLACES).map(mean).collect();
        let mut off: Vec<f64> = (0..PLACES)
            .filter(|k| views[*k] > 0)
            .map(|k| f64::from((raw[k] - smooth[k]).abs()))
            .collect();
        let noise = SIGMA_PER_MAD as f32 * median(&mut off) as f32;
        let mut around = Vec::new();
        let mut place = |k: usize| {
            let mut place = Place {
                direction: directions[k],
                darkness: 0.0,
                views: views[k],
                steady: 0.0,
            };
            if place.views > 0 {
                around.clear();
                near(&tree, &directions[k], ABOUT, |j| {
                    if views[j] > 0 {
                        around.push(smooth[j]);
                    }
                });
                let nth = ((around.len() - 1) as f64 * BARE) as usize;
                let (_, bare, _) = around.select_nth_unstable_by(nth, f32::total_cmp);
                place.darkness = (*bare - smooth[k]).max(0.0);
                let halfway = 0.5 * (*bare + smooth[k]);
                let dark = (0.5 * halfway * STEPS as f32).round() as usize;
                let dark = counts[k][..dark.min(STEPS)].iter().map(|n| usize::from(*n));
                place.steady = dark.sum::<usize>() as f32 / place.views as f32;
            }
            place
        };
        let places = (0..PLACES).map(&mut place).collect();
        Ok(Self {
            places,
            noise,
            tree,
        })
    }

    /// Calls `take` with every place nearer to a direction than `within`, radians.
    pub fn near(&self, direction: &Vec3, within: f64, take: impl FnMut(usize)) {
        near(&self.tree, direction, within, take);
    }

    /// Solid angle of a place.
    pub fn area(&self) -> f64 {
        4.0 * std::f64::consts::PI / self.places.len() as f64
    }

    /// Share of the surface about which no view shows anything as near as `within`, radians.
    pub fn unseen(&self, within: f64) -> f64 {
        let is_unseen = |place: &&Place| {
            let mut seen = false;
            self.near(&place.direction, within, |k| {
                seen |= self.places[k].views >= SHOWN
            });
            !seen
        };
        let unseen = self.places.iter().filter(|p| p.views < SHOWN);
        unseen.filter(is_unseen).count() as f64 / self.places.len() as f64
    }
}

fn near(tree: &Tree, about: &Vec3, within: f64, mut take: impl FnMut(usize)) {
    let chord = 2.0 * (0.5 * within).sin();
    let point = [about.x, about.y, about.z];
    let found = tree
        .query(&point)
        .within::<SquaredEuclidean<f64>>(chord * chord)
        .execute();
    found.iter().for_each(|n| take(n.item as usize));
}

/// For each place how many views show it how bright.
fn count(map: &Map<'_>, albedos: &[Albedo], directions: &[Vec3]) -> Vec<[u16; STEPS]> {
    let mut counts = vec![[0u16; STEPS]; directions.len()];
    let mut last: Option<Rotation> = None;
    for (seen, placed) in map.frames.iter().zip(&map.placed) {
        let Some(placed) = placed else { continue };
        if last.is_some_and(|last| rotation_angle(&last, &placed.rotation) < TURNED) {
            continue;
        }
        let circle = map.estimates[seen.index].outline.map(|o| o.circle);
        let (Some(circle), Some(albedo)) = (circle, albedos.get(seen.index)) else {
            continue;
        };
        last = Some(placed.rotation);
        for (direction, counts) in directions.iter().zip(&mut counts) {
            let in_camera = placed.rotation * direction;
            if seen.depth(&in_camera) < FACING {
                continue;
            }
            if let Some(ratio) = albedo.at(&circle, seen.pixel(&in_camera)) {
                let step = (ratio * 0.5 * STEPS as f32) as usize;
                let count = &mut counts[step.min(STEPS - 1)];
                *count = count.saturating_add(1);
            }
        }
    }
    counts
}

fn views(counts: &[u16; STEPS]) -> usize {
    counts.iter().map(|n| usize::from(*n)).sum()
}

/// The median of counted brightnesses; that of the bare ball where there is none.
fn middle(counts: &[u16; STEPS]) -> f32 {
    let half = 0.5 * views(counts) as f32;
    let mut below = 0.0;
    for (step, count) in counts.iter().enumerate() {
        let count = f32::from(*count);
        if count > 0.0 && below + count >= half {
            return 2.0 * (step as f32 + (half - below) / count) / STEPS as f32;
        }
        below += count;
    }
    1.0
}
