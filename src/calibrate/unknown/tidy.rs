//! The map and all placed frames fitted together, and the map tidied: dots that are one are merged, those
//! that are not there leave it.

use nalgebra::Matrix2;

use super::ESTABLISHED;
use super::map::{DotMap, MATCH_RAD, MapDot, Placed};
use super::seen::SeenDot;
use crate::calibrate::bundle::{Bundle, BundleFrame, Observation};
use crate::geometry::angle_between;
use crate::surface::{MappedClip, MappedFrame, PaintMapper, PaintedFrame};

/// Dots of the map this near, never seen together, are one.
const MERGE_RAD: f64 = 0.12;
/// Depth from which a view faces a dot well, and minimum share of these views in which it is found.
pub(super) const FACING: f64 = 0.35;
const MIN_RATE: f64 = 0.4;

impl DotMap<'_> {
    /// What the detections of a frame show of the map's dots.
    pub fn detected(&self, k: usize) -> Vec<Observation> {
        let Some(placed) = &self.placed[k] else {
            return Vec::new();
        };
        let seen = &self.frames[k];
        let dots = &self.estimates[seen.index].dots;
        let named = seen.dots.iter().zip(&placed.names);
        let observation = |(dot, name): (&SeenDot, &Option<usize>)| {
            Some(Observation {
                dot: (*name)?,
                pixel: dots[dot.detection].pixel,
                covariance: with_floor(&dots[dot.detection].covariance),
            })
        };
        named.filter_map(observation).collect()
    }

    /// Lays all frames on the surface that the placed ones make, each of them by what it shows; those that it shows the place of are placed.
    pub fn lay_out(&mut self, shown: &[PaintedFrame]) -> MappedClip {
        let mut frames: Vec<MappedFrame<'_>> = (self.frames.iter().zip(&self.placed))
            .map(|(seen, placed)| MappedFrame {
                paint: &shown[seen.index],
                view: seen.view(),
                rotation: placed.as_ref().map(|p| seen.to_view() * p.rotation),
            })
            .collect();
        let clip = PaintMapper::default().lay_out(&mut frames);
        for ((seen, placed), frame) in self.frames.iter().zip(&mut self.placed).zip(&frames) {
            *placed = frame.rotation.map(|rotation| Placed {
                rotation: seen.to_view().inverse() * rotation,
                names: vec![None; seen.dots.len()],
            });
        }
        self.rename();
        clip
    }

    /// Fits the map and all placed frames together.
    pub fn fit(&mut self) -> Bundle {
        let placed = |k: usize| {
            let (seen, rotation) = (&self.frames[k], self.placed[k].as_ref()?.rotation);
            let frame = BundleFrame {
                time_s: None,
                rotation,
                circle: seen.outline.circle,
                outline: seen.outline,
                axis: self.estimates[seen.index].axis,
                observations: self.detected(k),
            };
            Some((k, frame))
        };
        let frames = (0..self.frames.len()).filter_map(placed);
        let dots = self.dots.iter().map(|d| d.direction);
        let (mut bundle, which) = Bundle::of_free_dots(dots, frames, &self.config.estimator.camera);
        bundle.fit(false);
        for (dot, fitted) in self.dots.iter_mut().zip(&bundle.dots) {
            dot.direction = *fitted;
        }
        self.look(&bundle);
        for (k, fitted) in which.into_iter().zip(&bundle.frames) {
            if let Some(view) = bundle.view_of(&fitted.circle) {
                let seen = &mut self.frames[k];
                seen.look(view, &self.estimates[seen.index]);
            }
            if let Some(placed) = &mut self.placed[k] {
                placed.rotation = fitted.rotation;
            }
        }
        bundle
    }

    /// Sees all frames as the fitted camera does, their outlines shifted as the fitted ones are.
    fn look(&mut self, bundle: &Bundle) {
        let shift = bundle.outline_shift();
        for seen in &mut self.frames {
            let circle = seen.outline.circle.shifted(&shift);
            if let Some(view) = bundle.view_of(&circle) {
                seen.look(view, &self.estimates[seen.index]);
            }
        }
    }

    /// Merges dots that are one, names the placed frames' detections anew, drops dots that are not there.
    pub fn tidy(&mut self) {
        while let Some((a, b)) = self.twins() {
            let (keep, gone) = if self.dots[a].found >= self.dots[b].found {
                (a, b)
            } else {
                (b, a)
            };
            let (first, second) = (self.dots[keep], self.dots[gone]);
            let sum = first.direction * first.weight + second.direction * second.weight;
            self.dots[keep] = MapDot {
                direction: sum.normalize(),
                found: first.found + second.found,
                weight: first.weight + second.weight,
            };
            self.remove(gone, Some(keep));
        }
        self.rename();
        let weak: Vec<usize> = (0..self.dots.len()).filter(|&j| self.is_weak(j)).collect();
        for j in weak.into_iter().rev() {
            self.remove(j, None);
        }
    }

    /// Two dots near each other that no frame sees both.
    fn twins(&self) -> Option<(usize, usize)> {
        let together = |a: usize, b: usize| {
            let mut frames = self.placed.iter().flatten();
            frames.any(|p| p.names.contains(&Some(a)) && p.names.contains(&Some(b)))
        };
        for a in 0..self.dots.len() {
            for b in 0..a {
                let angle = angle_between(&self.dots[a].direction, &self.dots[b].direction);
                if angle < MERGE_RAD && !together(a, b) {
                    return Some((b, a));
                }
            }
        }
        None
    }

    /// Whether a dot is found too seldom in the frames that face it.
    fn is_weak(&self, j: usize) -> bool {
        let (found, views) = self.rate(j);
        views >= ESTABLISHED && (found as f64) < MIN_RATE * views as f64
    }

    fn remove(&mut self, gone: usize, instead: Option<usize>) {
        self.dots.remove(gone);
        let moved = |j: usize| j - usize::from(j > gone);
        for name in self.placed.iter_mut().flatten().flat_map(|p| &mut p.names) {
            *name = match *name {
                Some(j) if j == gone => instead.map(moved),
                other => other.map(moved),
            };
        }
    }

    /// Names the placed frames' detections by the nearest dot of the map, each dot once a frame.
    pub fn rename(&mut self) {
        for dot in &mut self.dots {
            dot.found = 0;
        }
        for k in 0..self.placed.len() {
            let Some(mut placed) = self.placed[k].take() else {
                continue;
            };
            let back = placed.rotation.inverse();
            let mut links: Vec<(f64, usize, usize)> = Vec::new();
            for (i, dot) in self.frames[k].dots.iter().enumerate() {
                let at = back * dot.direction;
                let near = self.dots.iter().enumerate();
                let near = near.map(|(j, d)| (angle_between(&d.direction, &at), i, j));
                links.extend(near.filter(|l| l.0 < MATCH_RAD));
            }
            links.sort_by(|a, b| a.0.total_cmp(&b.0));
            placed.names.fill(None);
            for (_, i, j) in links {
                if placed.names[i].is_none() && !placed.names.contains(&Some(j)) {
                    placed.names[i] = Some(j);
                    self.dots[j].found += 1;
                }
            }
            self.placed[k] = Some(placed);
        }
    }
}

/// A detection of a map that is not settled is less certain than the detector says.
fn with_floor(covariance: &Matrix2<f64>) -> Matrix2<f64> {
    covariance * 2.0
}
