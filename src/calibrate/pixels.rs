//! The dots of a clip by the pixels of all its frames.
//!
//! A detector misses dots and is misled where two are near each other. Where frames and dots are known about, each dot's cap is fitted in every
//! frame that it faces, detected there or not, and dots, frames and camera are fitted to what the pixels show ([`find_dots`],
//! [`Bundle`]).

use super::bundle::{Bundle, BundleFrame, DotFit, FrameView, Observation};
use super::result::rms_sigma_rad;
use crate::concurrency;
use crate::geometry::{Rotation, Vec3};
use crate::stats::median;
use crate::surface::{ExpectedDot, FoundDot, PaintedFrame, find_dots};
use crate::vision::frame::config::CameraModel;
use crate::vision::frame::estimate::PrincipalPointPrior;
use crate::vision::frame::outline::Outline;

/// A view faces a dot well enough for its pixels to be looked at from this depth on, and its radius, radians, more: of a dot at the limb a part is out
/// of sight.
const LOOKED_AT: f64 = 0.2;
/// Dots found and all fitted so often.
const ROUNDS: usize = 3;
/// Dots that the pixels of so many frames show need no detections, which lie up to a degree off where dots are large and near each other.
const ENOUGH: usize = 8;
/// What a dot that is not round is off where only the side shows it, over its radius and how far it is turned away: dots are drawn by hand.
const UNEVEN: f64 = 0.05;
/// Fewer views in which the pixels show a dot do not fix its place.
const MIN_FOUND: usize = 2;

/// A frame whose orientation is known, and what it shows.
pub(super) struct PosedFrame<'a> {
    pub paint: &'a PaintedFrame,
    pub view: FrameView,
    pub outline: Outline,
    /// Where its picture expects the camera's axis.
    pub axis: Option<PrincipalPointPrior>,
    /// The dots' frame to that of the orientations.
    pub rotation: Rotation,
    pub time_s: Option<f64>,
    /// Its detections that are dots.
    pub detected: Vec<Observation>,
}

/// A dot by its pixels.
#[derive(Debug, Clone, Copy)]
pub(super) struct Landmark {
    pub direction: Vec3,
    /// Its angular radius, radians.
    pub radius: f64,
    /// Standard deviation of its place per tangent axis, radians.
    sigma_rad: f64,
    /// Views in which its pixels show it, and their mean depth.
    pub found: usize,
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

/// A dot about where it is.
#[derive(Debug, Clone, Copy)]
struct Sized {
    direction: Vec3,
    radius: f64,
    /// Whether the radius is measured.
    is_measured: bool,
}

/// The dots by the pixels of these frames; `None` where they do not fix them. `dots` are about their places and angular radii, radians. `smooth`
/// expects a smooth rotation where the frames have times.
pub(super) fn by_pixels(
    mut frames: Vec<PosedFrame<'_>>,
    dots: impl Iterator<Item = (Vec3, f64)>,
    camera: &CameraModel,
    smooth: bool,
) -> Option<Vec<Landmark>> {
    let sized = |(direction, radius)| Sized {
        direction,
        radius,
        is_measured: false,
    };
    let mut dots: Vec<Sized> = dots.map(sized).collect();
    let mut landmarks = None;
    for _ in 0..ROUNDS {
        let seen = concurrency::map(&frames, |frame| sightings(frame, &dots));
        let mut found: Vec<Vec<&Sighting>> = vec![Vec::new(); dots.len()];
        for sighting in seen.iter().flatten() {
            found[sighting.dot].push(sighting);
        }
        for (dot, found) in dots.iter_mut().zip(&found) {
            if !found.is_empty() {
                dot.radius = median(&mut found.iter().map(|s| s.found.radius).collect::<Vec<_>>());
                dot.is_measured = true;
            }
        }
        let fitted = observed(&frames, &seen, &dots, &found);
        let directions = dots.iter().map(|d| d.direction);
        let (mut bundle, which) = Bundle::of_free_dots(directions, fitted.enumerate(), camera);
        bundle.fit(smooth);
        for (k, fitted) in which.into_iter().zip(&bundle.frames) {
            let frame = &mut frames[k];
            frame.rotation = fitted.rotation;
            frame.view = bundle.view_of(&fitted.circle).unwrap_or(frame.view);
        }
        for (dot, fitted) in dots.iter_mut().zip(&bundle.dots) {
            dot.direction = *fitted;
        }
        let fits = bundle.dot_fits()?.into_iter().zip(&dots).zip(&found);
        let landmark = |((fit, dot), found): ((DotFit, &Sized), &Vec<&Sighting>)| Landmark {
            direction: fit.direction,
            radius: dot.radius,
            sigma_rad: rms_sigma_rad(&fit.covariance),
            found: found.len(),
            depth: found.iter().map(|s| s.depth).sum::<f64>() / found.len().max(1) as f64,
        };
        landmarks = Some(fits.map(landmark).collect());
    }
    landmarks
}

/// What the pixels of a frame show of the dots that face it.
fn sightings(frame: &PosedFrame<'_>, dots: &[Sized]) -> Vec<Sighting> {
    let at = |dot: &Sized| frame.rotation * dot.direction;
    let faced: Vec<(usize, f64)> = dots
        .iter()
        .map(|dot| frame.view.depth(&at(dot)))
        .enumerate()
        .filter(|(j, depth)| *depth >= LOOKED_AT + dots[*j].radius)
        .collect();
    let expected: Vec<ExpectedDot> = faced
        .iter()
        .map(|(j, _)| ExpectedDot {
            direction: frame.view.to_view * at(&dots[*j]),
            radius: dots[*j].radius,
            is_sized: dots[*j].is_measured,
        })
        .collect();
    let found = find_dots(frame.paint, &frame.view.view, &expected);
    let sightings = faced.into_iter().zip(found);
    let sightings = sightings.filter_map(|((dot, depth), found)| {
        Some(Sighting {
            dot,
            depth,
            found: found?,
        })
    });
    sightings.collect()
}

/// What fixes the dots in the frames: their pixels, and for dots that few frames' pixels show, their detections.
fn observed<'a>(
    frames: &'a [PosedFrame<'_>],
    seen: &'a [Vec<Sighting>],
    dots: &'a [Sized],
    found: &'a [Vec<&Sighting>],
) -> impl Iterator<Item = BundleFrame> + 'a {
    let of_frame = move |(frame, seen): (&PosedFrame<'_>, &Vec<Sighting>)| {
        let by_pixels = seen.iter().map(|s| Observation {
            dot: s.dot,
            pixel: s.found.pixel,
            covariance: s.found.covariance,
        });
        let is_needed = |o: &&Observation| {
            let is_faced =
                || frame.view.depth(&(frame.rotation * dots[o.dot].direction)) >= LOOKED_AT;
            found[o.dot].len() < ENOUGH && seen.iter().all(|s| s.dot != o.dot) && is_faced()
        };
        let detected = frame.detected.iter().filter(is_needed).copied();
        let observations: Vec<Observation> = by_pixels.chain(detected).collect();
        BundleFrame {
            time_s: frame.time_s,
            rotation: frame.rotation,
            circle: *frame.view.view.circle(),
            outline: frame.outline,
            axis: frame.axis,
            observations,
        }
    };
    frames.iter().zip(seen).map(of_frame)
}
