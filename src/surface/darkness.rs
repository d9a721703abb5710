//! What is dark on the surface of a ball, place by place, by all frames of a clip.
//!
//! By a clip that is laid out ([`PaintMapper`](super::PaintMapper)): how much darker each place is than the ball about it. Fingers, which are larger than
//! marks, are left out where other views show what is beneath them.

use kiddo::{ImmutableKdTree, SquaredEuclidean};

use super::mapper::MappedClip;
use crate::concurrency;
use crate::error::{Error, Result};
use crate::geometry::Vec3;
use crate::stats::{SIGMA_PER_MAD, median};

type Tree = ImmutableKdTree<f64, 3>;

/// Fewer views of a place may be of a finger.
const SHOWN: usize = 2;
/// Places so near, radians, are averaged.
const NEIGHBORS: f64 = 0.03;
/// The bare ball about a place: this share of the places so near, radians, is no brighter.
const BARE: f64 = 0.7;
const ABOUT: f64 = 0.35;
/// Places so near, radians, and views of them that decide whether there is nothing.
const NEAR: f64 = 0.03;
const FEW_VIEWS: usize = 8;
/// Where a smaller share of the places is dark it is not all dark.
const WHOLE: f64 = 0.9;
/// Of the places about one, every so many-th is looked at.
const STRIDE: usize = 3;
/// Places that a thread works on at once.
const AT_ONCE: usize = 1000;

/// How dark a ball's surface is, in the frame that the clip is laid out in.
pub(crate) struct Darkness {
    pub places: Vec<SurfacePlace>,
    /// Standard deviation of a place's darkness.
    pub noise: f32,
    /// The darkness of the bare ball, which is no more than its noise.
    pub floor: f32,
    tree: Tree,
    clip: MappedClip,
}

/// A place of a ball's surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfacePlace {
    /// Where it is.
    pub direction: Vec3,
    /// How much darker it is than the ball about it, over the bare ball's brightness; 0 where it is brighter or not seen.
    pub darkness: f32,
    /// Views that show it.
    pub views: usize,
    /// Share of these that show it dark: nearer to the median than to the bare ball.
    pub steady: f32,
}

impl SurfacePlace {
    /// Whether enough views show it.
    pub fn is_shown(&self) -> bool {
        self.views >= SHOWN
    }
}

impl Darkness {
    /// Of a clip.
    ///
    /// # Errors
    /// [`Error::Argument`] where no search tree can be made.
    pub fn of(clip: MappedClip) -> Result<Self> {
        let map = clip.map();
        let (directions, views) = (map.directions(), map.views());
        let tree = search_tree(directions.iter())?;
        let raw: Vec<f32> = map.values().iter().map(|v| v.exp()).collect();
        let values = each_place(directions.len(), |k, _| {
            let (mut sum, mut count) = (0.0, 0.0);
            near(&tree, &directions[k], NEIGHBORS, |j| {
                if views[j] > 0 {
                    sum += raw[j];
                    count += 1.0;
                }
            });
            if count > 0.0 { sum / count } else { 1.0 }
        });
        let seen = || (0..directions.len()).filter(|k| views[*k] > 0);
        let mut off: Vec<f64> = seen()
            .map(|k| f64::from((raw[k] - values[k]).abs()))
            .collect();
        let sparse: Vec<usize> = seen().filter(|k| k % STRIDE == 0).collect();
        let sparse_tree = search_tree(sparse.iter().map(|k| &directions[*k]))?;
        let places = each_place(directions.len(), |k, around: &mut Vec<f32>| {
            let mut place = SurfacePlace {
                direction: directions[k],
                darkness: 0.0,
                views: views[k] as usize,
                steady: 0.0,
            };
            if place.views > 0 {
                around.clear();
                near(&sparse_tree, &directions[k], ABOUT, |j| {
                    around.push(values[sparse[j]]);
                });
                around.push(values[k]);
                let nth = ((around.len() - 1) as f64 * BARE) as usize;
                let (_, bare, _) = around.select_nth_unstable_by(nth, f32::total_cmp);
                place.darkness = (*bare - values[k]).max(0.0);
                place.steady = map.darker(k, (0.5 * (*bare + values[k])).ln());
            }
            place
        });
        let mut darkness: Vec<f64> = seen().map(|k| f64::from(places[k].darkness)).collect();
        Ok(Self {
            floor: median(&mut darkness) as f32,
            noise: (SIGMA_PER_MAD * median(&mut off)) as f32,
            places,
            tree,
            clip,
        })
    }

    /// The same without what is so dark and larger than a disc of so many radians, in views of places that others show without it.
    ///
    /// # Errors
    /// [`Error::Argument`] where no search tree can be made.
    pub fn uncovered(mut self, darkness: f64, radius: f64) -> Result<Self> {
        self.clip.find_cover(darkness, radius);
        Self::of(self.clip)
    }

    /// Whether something hides the ball in a frame of the map, at a direction of its view frame.
    pub fn is_covered(&self, frame: usize, direction: &Vec3) -> bool {
        self.clip.is_covered(frame, direction)
    }

    /// Share of the surface that the frames show.
    pub fn shown(&self) -> f64 {
        let shown = self.places.iter().filter(|p| p.is_shown()).count();
        shown as f64 / self.places.len() as f64
    }

    /// Calls `take` with every place nearer to a direction than `within`, radians.
    pub fn near(&self, direction: &Vec3, within: f64, take: impl FnMut(usize)) {
        near(&self.tree, direction, within, take);
    }

    /// The mean darkness of the places nearer to a direction than `within`, radians.
    pub fn darkness(&self, direction: &Vec3, within: f64) -> f64 {
        let (mut sum, mut count) = (0.0, 0.0);
        self.near(direction, within, |k| {
            sum += f64::from(self.places[k].darkness);
            count += 1.0;
        });
        sum / f64::max(count, 1.0)
    }

    /// Whether the places about a direction are all less dark than `darkness`, in enough views to decide.
    pub fn is_bare(&self, direction: &Vec3, darkness: f64) -> bool {
        let mut is_bare = true;
        self.near(direction, NEAR, |k| {
            let place = &self.places[k];
            is_bare &= place.views >= FEW_VIEWS && f64::from(place.darkness) < darkness;
        });
        is_bare
    }

    /// The places that are darker than `darkness`, nearly all of it within so many radians, beyond these directions and what is so near each.
    pub fn dark(
        &self,
        beyond: impl Iterator<Item = (Vec3, f64)>,
        darkness: f64,
        within: f64,
    ) -> Vec<Vec3> {
        let mut is_dark: Vec<bool> = (self.places.iter())
            .map(|p| f64::from(p.darkness) > darkness)
            .collect();
        let dark = is_dark.clone();
        for (direction, near) in beyond {
            self.near(&direction, near, |k| is_dark[k] = false);
        }
        let is_whole = |k: &usize| {
            let (mut count, mut of) = (0.0, 0.0);
            self.near(&self.places[*k].direction, within, |j| {
                count += 1.0;
                of += f64::from(u8::from(dark[j]));
            });
            of >= WHOLE * count
        };
        let whole = (0..is_dark.len()).filter(|k| is_dark[*k]).filter(is_whole);
        whole.map(|k| self.places[k].direction).collect()
    }

    /// Solid angle of a place.
    pub fn area(&self) -> f64 {
        4.0 * std::f64::consts::PI / self.places.len() as f64
    }

    /// Share of the surface about which no view shows anything as near as `within`, radians.
    pub fn unseen(&self, within: f64) -> f64 {
        let is_unseen = |place: &&SurfacePlace| {
            let mut seen = false;
            self.near(&place.direction, within, |k| {
                seen |= self.places[k].is_shown()
            });
            !seen
        };
        let unseen = self.places.iter().filter(|p| !p.is_shown());
        unseen.filter(is_unseen).count() as f64 / self.places.len() as f64
    }
}

/// Finds the directions that are near to one.
///
/// # Errors
/// [`Error::Argument`] where no tree can be made.
fn search_tree<'a>(directions: impl Iterator<Item = &'a Vec3>) -> Result<Tree> {
    let points: Vec<[f64; 3]> = directions.map(|d| [d.x, d.y, d.z]).collect();
    Tree::new_from_slice(&points)
        .map_err(|e| Error::argument("surface", format!("no search tree: {e}")))
}

/// What `work` makes of each of so many places, with room that it uses again.
fn each_place<R: Send>(
    count: usize,
    work: impl Fn(usize, &mut Vec<f32>) -> R + Sync + Send,
) -> Vec<R> {
    let parts = concurrency::map_range(0..count.div_ceil(AT_ONCE) as u64, |part| {
        let start = part as usize * AT_ONCE;
        let mut room = Vec::new();
        let places = start..count.min(start + AT_ONCE);
        places.map(|k| work(k, &mut room)).collect::<Vec<R>>()
    });
    parts.into_iter().flatten().collect()
}

/// Calls `take` with every place nearer to a direction than `within`, radians.
fn near(tree: &Tree, direction: &Vec3, within: f64, mut take: impl FnMut(usize)) {
    let chord = 2.0 * (0.5 * within).sin();
    let point = [direction.x, direction.y, direction.z];
    let query = tree.query(&point);
    let found = query
        .within::<SquaredEuclidean<f64>>(chord * chord)
        .unsorted()
        .execute();
    found.iter().for_each(|n| take(n.item as usize));
}
