//! The dots of a map by the pixels of all its frames.
//!
//! Once the surface shows what is a dot, each is looked for in every frame that it faces, detected there or not, and map, frames and camera
//! are fitted to what the pixels show ([`find_dots`], [`Bundle`](crate::calibrate::bundle::Bundle)).

use super::map::Map;
use crate::calibrate::bundle::{DotFit, Observation};
use crate::calibrate::result::rms_sigma_rad;
use crate::concurrency;
use crate::geometry::Vec3;
use crate::stats::median;
use crate::vision::painted::{ExpectedDot, FoundDot, PaintedFrame, find_dots};

/// A view faces a dot well enough for its pixels to be looked at from this depth on, and its radius, radians, more: of a dot at the limb a part is out
/// of sight.
const LOOKED_AT: f64 = 0.2;
/// Dots found and map fitted so often.
const ROUNDS: usize = 3;
/// Dots that the pixels of so many frames show need no detections, which lie up to a degree off where dots are large and near each other.
const ENOUGH: usize = 8;
/// What a dot that is not round is off where only the side shows it, over its radius and how far it is turned away: dots are drawn by hand.
const UNEVEN: f64 = 0.05;
/// Fewer views in which the pixels show a dot do not fix its place.
const MIN_FOUND: usize = 2;

/// A dot by its pixels.
#[derive(Debug, Clone, Copy)]
pub(super) struct Landmark {
    pub direction: Vec3,
    /// Standard deviation of its place per tangent axis, radians.
    pub sigma_rad: f64,
    /// Its angular radius, radians.
    radius: f64,
    /// Views in which its pixels show it, and their mean depth.
    found: usize,
    depth: f64,
}

impl Landmark {
    /// The standard deviation of its place, with what is due to its shape, infinite where its pixels do not fix it.
    pub fn known_to(&self) -> f64 {
        match self.found < MIN_FOUND {
            true => f64::INFINITY,
            false => self
                .sigma_rad
                .hypot(UNEVEN * self.radius * (1.0 - self.depth)),
        }
    }
}

/// A dot that a frame's pixels show.
struct Sighting {
    dot: usize,
    depth: f64,
    found: FoundDot,
}

impl Map<'_> {
    /// Fits the map to the pixels of its dots; `None` where they do not fix it. `radii` are about their angular radii, radians.
    pub fn fit_to_pixels(
        &mut self,
        shown: &[&PaintedFrame],
        radii: &[f64],
    ) -> Option<Vec<Landmark>> {
        let mut radii: Vec<(f64, bool)> = radii.iter().map(|r| (*r, false)).collect();
        let mut landmarks = None;
        for _ in 0..ROUNDS {
            let seen = self.seen_by_pixels(shown, &radii);
            let mut sizes: Vec<Vec<f64>> = vec![Vec::new(); self.dots.len()];
            for sighting in seen.iter().flatten() {
                sizes[sighting.dot].push(sighting.found.radius);
            }
            let found: Vec<usize> = sizes.iter().map(Vec::len).collect();
            let mut depths = vec![0.0; self.dots.len()];
            for sighting in seen.iter().flatten() {
                depths[sighting.dot] += sighting.depth / found[sighting.dot] as f64;
            }
            for (radius, sizes) in radii.iter_mut().zip(&mut sizes) {
                if !sizes.is_empty() {
                    *radius = (median(sizes), true);
                }
            }
            self.rename();
            let observed = seen.iter().enumerate();
            let observed = observed.map(|(k, seen)| self.observed(k, seen, &found));
            let observed = observed.collect();
            let bundle = self.fit_to(observed);
            let fits = bundle.dot_fits()?.into_iter().enumerate();
            let landmark = |(j, fit): (usize, DotFit)| Landmark {
                direction: fit.direction,
                sigma_rad: rms_sigma_rad(&fit.covariance),
                radius: radii[j].0,
                found: found[j],
                depth: depths[j],
            };
            landmarks = Some(fits.map(landmark).collect());
        }
        landmarks
    }

    /// What the pixels of each frame show of the dots that face it.
    fn seen_by_pixels(&self, shown: &[&PaintedFrame], radii: &[(f64, bool)]) -> Vec<Vec<Sighting>> {
        let frames: Vec<usize> = (0..self.frames.len()).collect();
        concurrency::map(&frames, |&k| {
            let seen = &self.frames[k];
            let Some(placed) = &self.placed[k] else {
                return Vec::new();
            };
            let directions = self.dots.iter().map(|d| placed.rotation * d.direction);
            let faced: Vec<(usize, Vec3, f64)> = directions
                .enumerate()
                .map(|(j, at)| (j, at, seen.depth(&at)))
                .filter(|(j, _, depth)| *depth >= LOOKED_AT + radii[*j].0)
                .collect();
            let expected: Vec<ExpectedDot> = faced
                .iter()
                .map(|(j, at, _)| ExpectedDot {
                    direction: seen.to_view() * at,
                    radius: radii[*j].0,
                    is_sized: radii[*j].1,
                })
                .collect();
            let found = find_dots(shown[seen.index], &seen.view(), &expected);
            let sightings = faced.iter().zip(found);
            let sightings = sightings.filter_map(|((j, _, depth), found)| {
                Some(Sighting {
                    dot: *j,
                    depth: *depth,
                    found: found?,
                })
            });
            sightings.collect()
        })
    }

    /// What fixes the dots in a frame: their pixels, and for dots that few frames' pixels show, their detections. `found` is the number of these
    /// frames for each dot.
    fn observed(&self, k: usize, seen: &[Sighting], found: &[usize]) -> Vec<Observation> {
        let by_pixels = seen.iter().map(|s| Observation {
            dot: s.dot,
            pixel: s.found.pixel,
            covariance: s.found.covariance,
        });
        let mut observed: Vec<Observation> = by_pixels.collect();
        for (depth, detected) in self.detected(k) {
            let is_seen = || seen.iter().any(|s| s.dot == detected.dot);
            if depth >= LOOKED_AT && found[detected.dot] < ENOUGH && !is_seen() {
                observed.push(detected);
            }
        }
        observed
    }
}
