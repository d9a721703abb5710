//! Hinge and thumb tab as obstacles: where along a seam they keep clear of the holes.
//!
//! Distances between a hole and hinge or tab are measured from points on their surfaces to the hole's cone, which is taken to go on
//! outside the shell as a cylinder: there the pen stands.

use std::f64::consts::FRAC_PI_2;

use crate::geometry::{Rotation, Vec3, tangent_frame, to_rotation};

use super::joint::Joint;
use super::seam::Seam;
use super::{StencilConfig, shapes};

/// Hinge positions tried along a seam.
const AZIMUTHS: usize = 120;
/// Distance of the points that stand for a surface, mm.
const SPACING_MM: f64 = 1.0;

/// Outline of a hinge arm with its knuckle in the plane y = 0 of a half's own frame (dome up): x,
/// z.
pub(super) fn arm_outline(config: &StencilConfig, joint: &Joint) -> Vec<(f64, f64)> {
    let chord = config.chord_error_mm;
    let segments = shapes::circle_segments(joint.knuckle_radius_mm, chord);
    let mut points = shapes::circle((joint.axis_mm, 0.0), joint.knuckle_radius_mm, segments);
    // Deep enough to end inside the shell's cavity, from where it is cut away.
    let half = 0.5 * config.hinge_length_mm;
    let inner = config.inner_radius_mm();
    let x = (inner * inner - half * half - joint.arm_mm * joint.arm_mm).max(0.25 * inner * inner);
    points.extend([(x.sqrt(), joint.arm_mm), (x.sqrt(), -joint.lip_mm)]);
    shapes::convex_hull(&points)
}

/// Points on the hinge's surface outside the shell, in a half's own frame.
pub(super) fn hinge_points(config: &StencilConfig, joint: &Joint) -> Vec<Vec3> {
    let outline = arm_outline(config, joint);
    let half = 0.5 * config.hinge_length_mm;
    let rows = (config.hinge_length_mm / SPACING_MM).ceil() as usize;
    let mut points = Vec::new();
    for (i, a) in outline.iter().enumerate() {
        let b = outline[(i + 1) % outline.len()];
        let steps = ((b.0 - a.0).hypot(b.1 - a.1) / SPACING_MM).ceil() as usize;
        for s in 0..steps {
            let t = s as f64 / steps as f64;
            for row in 0..=rows {
                let y = half * (2.0 * row as f64 / rows as f64 - 1.0);
                points.push(Vec3::new(a.0 + t * (b.0 - a.0), y, a.1 + t * (b.1 - a.1)));
            }
        }
    }
    points.retain(|p| p.norm() > config.outer_radius_mm() - 0.5 * SPACING_MM);
    points
}

/// Points on the tab's surface outside the shell, in the stencil's frame.
pub(super) fn tab_points(config: &StencilConfig, joint: &Joint) -> Vec<Vec3> {
    let outer = config.outer_radius_mm();
    let half = 0.5 * joint.tab_width_mm;
    let steps = |length: f64| (length / SPACING_MM).ceil() as usize;
    let along = |from: f64, length: f64| {
        (0..=steps(length)).map(move |i| from + length * i as f64 / steps(length) as f64)
    };
    let mut points = Vec::new();
    for z in along(-joint.lip_mm, joint.tab_thickness_mm) {
        for y in along(-half, joint.tab_width_mm) {
            for x in along(outer - config.wall_mm, config.wall_mm + config.tab_mm) {
                points.push(Vec3::new(-x, y, z));
            }
        }
    }
    points.retain(|p| p.norm() > outer - 0.5 * SPACING_MM);
    points
}

/// Minimum distance of `points` from the hole of `dot`, mm; negative inside it.
fn distance_to_hole(dot: &Vec3, points: &[Vec3], config: &StencilConfig) -> f64 {
    let outer = config.outer_radius_mm();
    points
        .iter()
        .map(|p| {
            let height = p.dot(dot);
            let beside = (p - height * dot).norm();
            if height < 0.0 {
                f64::INFINITY
            } else {
                beside - config.hole_radius_mm(height.min(outer))
            }
        })
        .fold(f64::INFINITY, f64::min)
}

/// A seam with its best hinge position, which is the same whatever the holes' diameter.
pub(super) struct HingePlace {
    pub seam: Seam,
    pub rotation: Rotation,
    /// The dots in the stencil's frame.
    pub dots: Vec<Vec3>,
    /// Minimum distance of a hole from hinge or tab were its throat a line, mm: every hole is nearer by
    /// the throat's radius.
    pub bare_mm: f64,
}

/// A surface that holes must stay clear of, as points within a cone about an axis.
pub(super) struct Obstacle {
    pub points: Vec<Vec3>,
    axis: Vec3,
    /// Half angle of the cone, radians.
    half_angle: f64,
    /// Distance of the nearest point from the origin, mm.
    nearest: f64,
}

impl Obstacle {
    fn new(points: Vec<Vec3>, axis: Vec3) -> Self {
        let angles = points.iter().map(|p| p.angle(&axis));
        Self {
            half_angle: angles.fold(0.0, f64::max),
            nearest: points.iter().map(Vec3::norm).fold(f64::INFINITY, f64::min),
            points,
            axis,
        }
    }

    /// Whether the hole of `dot` is certainly farther away than `distance`, mm: no point lies
    /// nearer to the hole's axis than the near end of the cone.
    fn is_beyond(&self, distance: f64, dot: &Vec3, config: &StencilConfig) -> bool {
        let angle = (dot.angle(&self.axis) - self.half_angle).clamp(0.0, FRAC_PI_2);
        self.nearest * angle.sin() - config.opening_radius_mm() > distance
    }
}

/// Surfaces that holes must stay clear of: hinge, in a half's own frame, and tab, in the stencil's.
pub(super) struct Obstacles {
    pub hinge: Obstacle,
    pub tab: Obstacle,
    /// The stencil with holes whose throats are lines.
    bare: StencilConfig,
}

impl Obstacles {
    pub fn new(config: &StencilConfig, joint: &Joint) -> Self {
        Self {
            hinge: Obstacle::new(hinge_points(config, joint), Vec3::x()),
            tab: Obstacle::new(tab_points(config, joint), -Vec3::x()),
            bare: StencilConfig {
                hole_diameter_mm: 0.0,
                ..config.clone()
            },
        }
    }

    /// [`HingePlace::bare_mm`] of dots in the stencil's frame, those nearest to hinge and tab first. Stops early at or
    /// below `enough`.
    fn clearance(&self, dots: &[Vec3], enough: f64) -> f64 {
        let mut clearance = f64::INFINITY;
        for d in dots {
            // The hinge's arms reach up on both sides of the seam.
            let up = Vec3::new(d.x, d.y, d.z.abs());
            for (dot, obstacle) in [(&up, &self.hinge), (d, &self.tab)] {
                if !obstacle.is_beyond(clearance, dot, &self.bare) {
                    let distance = distance_to_hole(dot, &obstacle.points, &self.bare);
                    clearance = clearance.min(distance);
                }
            }
            if clearance <= enough {
                break;
            }
        }
        clearance
    }

    /// The best hinge position along `seam`, where one is clear of the holes by more than `enough`, as
    /// [`HingePlace::bare_mm`] counts.
    pub fn place(&self, seam: Seam, pattern: &[Vec3], enough: f64) -> Option<HingePlace> {
        let [u, v] = tangent_frame(&seam.normal);
        let mut best = (enough, None);
        let mut dots: Vec<Vec3> = Vec::with_capacity(pattern.len());
        for i in 0..AZIMUTHS {
            let (sin, cos) = (std::f64::consts::TAU * i as f64 / AZIMUTHS as f64).sin_cos();
            let x = cos * u + sin * v;
            let y = seam.normal.cross(&x);
            let rows = [x.transpose(), y.transpose(), seam.normal.transpose()];
            let turn = nalgebra::Matrix3::from_rows(&rows);
            dots.clear();
            dots.extend(pattern.iter().map(|d| turn * d));
            // Hinge and tab lie on the x axis: the nearest dots decide, and most positions fail by one.
            dots.sort_unstable_by(|a, b| b.x.abs().total_cmp(&a.x.abs()));
            let clearance = self.clearance(&dots, best.0);
            if clearance > best.0 {
                best = (clearance, Some(turn));
            }
        }
        let (bare_mm, turn) = (best.0, best.1?);
        Some(HingePlace {
            seam,
            rotation: to_rotation(&turn),
            dots: pattern.iter().map(|d| turn * d).collect(),
            bare_mm,
        })
    }
}
