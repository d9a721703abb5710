//! What is dark on the surface of a ball, place by place, by all frames of a clip.
//!
//! The frames that the detections placed make the first map ([`AlbedoMap`]); those that showed too few dots are then laid on it by
//! their pixels, and all make the next. What detections placed stays: on 8 clips (`bench calibration-unknown --seed 35100001 --plain`)
//! their poses were within 0.2 to 0.5 deg.

use std::borrow::Borrow;

use super::map::{Map, Placed};
use crate::concurrency;
use crate::error::Result;
use crate::geometry::{Rotation, Vec3};
use crate::stats::median;
use crate::vision::albedo::Albedo;
use crate::vision::albedo::map::{AlbedoMap, PosedAlbedo, SHOWN};

/// Maps made one from the other.
const ROUNDS: usize = 2;
/// A frame laid on the map that agrees with it by less than this part of the middle frame is not placed.
const AGREES: f64 = 0.6;
/// The bare ball about a place: this share of the places so near, radians, is no brighter.
const BARE: f64 = 0.7;
const ABOUT: f64 = 0.35;
/// Places so near, radians, and views of them that tell whether there is nothing.
const NEAR: f64 = 0.03;
const FEW_VIEWS: usize = 8;
/// Of the places about one, every so many-th is looked at.
const STRIDE: usize = 3;

/// The ball's surface, in the map's frame.
pub(super) struct Surface {
    pub places: Vec<Place>,
    /// Standard deviation of a place's darkness.
    pub noise: f32,
    /// The darkness of the bare ball, which is no more than its noise.
    pub floor: f32,
    map: AlbedoMap,
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
    /// By the frames of a map, which it places anew. `albedos` are those of the map's estimates.
    pub fn new<A: Borrow<Albedo> + Sync>(map: &mut Map<'_>, albedos: &[A]) -> Result<Self> {
        let mut poses: Vec<Option<Rotation>> = (0..map.frames.len())
            .map(|k| Some(map.frames[k].to_view() * map.placed[k].as_ref()?.rotation))
            .collect();
        let mut surface = AlbedoMap::new(&posed(map, albedos, &poses))?;
        for _ in 0..ROUNDS {
            // The same frames make the same map.
            if !lay(&surface, map, albedos, &mut poses) {
                break;
            }
            surface = AlbedoMap::new(&posed(map, albedos, &poses))?;
        }
        for (k, pose) in poses.iter().enumerate() {
            let to_view = map.frames[k].to_view();
            map.placed[k] = pose.map(|rotation| Placed {
                rotation: to_view.inverse() * rotation,
                names: vec![None; map.frames[k].dots.len()],
            });
        }
        map.rename();
        Ok(Self::of(surface))
    }

    fn of(map: AlbedoMap) -> Self {
        let directions = map.directions();
        let (values, views) = (map.values(), map.views());
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
                map.near(&directions[k], ABOUT, |j| {
                    if views[j] > 0 && j % STRIDE == 0 {
                        around.push(values[j]);
                    }
                });
                around.push(values[k]);
                let nth = ((around.len() - 1) as f64 * BARE) as usize;
                let (_, bare, _) = around.select_nth_unstable_by(nth, f32::total_cmp);
                place.darkness = (*bare - values[k]).max(0.0);
                place.steady = map.darker(k, 0.5 * (*bare + values[k]));
            }
            place
        };
        let places: Vec<Place> = (0..directions.len()).map(&mut place).collect();
        let seen = places.iter().filter(|p| p.views > 0);
        let mut darkness: Vec<f64> = seen.map(|p| f64::from(p.darkness)).collect();
        Self {
            places,
            floor: median(&mut darkness) as f32,
            noise: map.noise(),
            map,
        }
    }

    /// Share of the surface that the frames show.
    pub fn shown(&self) -> f64 {
        let shown = self.places.iter().filter(|p| p.views >= SHOWN).count();
        shown as f64 / self.places.len() as f64
    }

    /// Calls `take` with every place nearer to a direction than `within`, radians.
    pub fn near(&self, direction: &Vec3, within: f64, take: impl FnMut(usize)) {
        self.map.near(direction, within, take);
    }

    /// Whether the places about a direction are all less dark than `darkness`, in enough views to tell.
    pub fn is_bare(&self, direction: &Vec3, darkness: f64) -> bool {
        let mut is_bare = true;
        self.near(direction, NEAR, |k| {
            let place = &self.places[k];
            is_bare &= place.views >= FEW_VIEWS && f64::from(place.darkness) < darkness;
        });
        is_bare
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

/// A frame of the map, under a rotation from the map to the view.
fn posed_frame<'a, A: Borrow<Albedo>>(
    map: &Map<'_>,
    albedos: &'a [A],
    k: usize,
    rotation: Rotation,
) -> Option<PosedAlbedo<'a>> {
    let seen = &map.frames[k];
    Some(PosedAlbedo {
        albedo: albedos.get(seen.index)?.borrow(),
        view: seen.view(),
        rotation,
    })
}

/// The frames that are placed.
fn posed<'a, A: Borrow<Albedo>>(
    map: &Map<'_>,
    albedos: &'a [A],
    poses: &[Option<Rotation>],
) -> Vec<PosedAlbedo<'a>> {
    let posed = poses.iter().enumerate();
    let posed = posed.filter_map(|(k, pose)| posed_frame(map, albedos, k, (*pose)?));
    posed.collect()
}

/// Lays the frames that are not placed on the surface, from their neighbors on, and says whether one is placed by that.
fn lay<A: Borrow<Albedo> + Sync>(
    surface: &AlbedoMap,
    map: &Map<'_>,
    albedos: &[A],
    poses: &mut [Option<Rotation>],
) -> bool {
    if poses.iter().all(Option::is_some) {
        return false;
    }
    let laid = |k: usize, start: Rotation| {
        let mut frame = posed_frame(map, albedos, k, start)?;
        frame.rotation = surface.align(&frame)?;
        Some((frame.rotation, surface.agreement(&frame)))
    };
    let placed = posed(map, albedos, poses);
    let mut agreements = concurrency::map(&placed, |frame| surface.agreement(frame));
    let least = AGREES * median(&mut agreements);
    let mut has_new = false;
    // Outwards from the placed ones.
    loop {
        let open: Vec<usize> = (0..poses.len()).filter(|k| poses[*k].is_none()).collect();
        let found = concurrency::map(&open, |k| {
            let starts = starts(*k, poses);
            let tried = starts.into_iter().filter_map(|start| laid(*k, start));
            let best = tried.max_by(|a, b| a.1.total_cmp(&b.1));
            best.filter(|l| l.1 >= least)
        });
        if found.iter().all(Option::is_none) {
            return has_new;
        }
        has_new = true;
        for (k, found) in open.into_iter().zip(found) {
            poses[k] = found.map(|f| f.0);
        }
    }
}

/// Where a frame may lie: as its neighbors, and where their turns lead.
fn starts(k: usize, poses: &[Option<Rotation>]) -> Vec<Rotation> {
    let at = |k: Option<usize>| *poses.get(k?)?;
    let sides = [
        [k.checked_sub(1), k.checked_sub(2)],
        [Some(k + 1), Some(k + 2)],
    ];
    let mut starts = Vec::new();
    for [one, two] in sides {
        starts.extend(at(one));
        if let (Some(one), Some(two)) = (at(one), at(two)) {
            starts.push(one * two.inverse() * one);
        }
    }
    starts
}
