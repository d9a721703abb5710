//! The two half shells as solids: sphere, rims, holes, hinge, tab and marks put together.
//!
//! Everything is built in the half's *own frame*: dome up, ball's center in the origin, hinge
//! towards +x. Half A's own frame is the stencil's; half B's is turned by half a turn about x. In
//! both, the bed is the plane `z = -lip`.

use std::f64::consts::PI;

use crate::error::Result;
use crate::geometry::Vec3;

use super::joint::Joint;
use super::layout::Cut;
use super::marks::floor;
use super::mesh::Mesh;
use super::obstacles::arm_outline;
use super::segments::HalfCuts;
use super::solid::Solid;
use super::{HalfName, StencilConfig, shapes};

/// Corners of the tab are rounded with this radius, mm.
const TAB_CORNER_MM: f64 = 3.0;
/// Distance of the sections that shape the relief of half B's lip, mm.
const RELIEF_SLICE_MM: f64 = 0.5;
/// The part of the gap between shell and knuckles that half A's lip gets from half B's arms.
const SLOT_FRACTION: f64 = 0.75;
/// How far cutting tools reach beyond what they cut, mm.
const BEYOND_MM: f64 = 1.0;

/// What a half is made of.
pub(super) struct Shell<'a> {
    /// Sizes.
    pub config: &'a StencilConfig,
    /// Sizes of rims and hinge.
    pub joint: &'a Joint,
    /// Which half it is.
    pub name: HalfName,
    /// The dots in its own frame, and what their holes do to it.
    pub holes: Vec<(Vec3, Cut)>,
    /// Windows over zones without dots: axis in its own frame, and radius, mm.
    pub windows: Vec<(Vec3, f64)>,
    /// Prisms over its engraved marks, which end at the engraving's [`floor`].
    pub marks: Vec<Mesh>,
    /// Where it is cut into pieces.
    pub cuts: Option<&'a HalfCuts>,
}

impl Shell<'_> {
    /// The finished solid, in its own frame.
    pub fn solid(&self) -> Result<Solid> {
        let config = self.config;
        let chord = config.chord_error_mm;
        let body = Solid::new(&shapes::sphere(config.outer_radius_mm(), chord))?;
        let mut added: Vec<Mesh> = self
            .knuckles()
            .map(|(from, to)| self.knuckle(from, to))
            .collect();
        if self.name == HalfName::A {
            added.push(self.tab());
        }
        added.extend(self.cuts.iter().flat_map(|cuts| cuts.ribs(config)));
        let body = body.plus(&solids(&added)?)?;
        let mut tools = vec![shapes::sphere(config.inner_radius_mm(), chord), self.bore()];
        tools.extend(self.rim());
        tools.extend(self.ceiling());
        if self.name == HalfName::B {
            tools.push(self.relief());
        }
        let cuts = self.holes.iter().filter(|(_, cut)| *cut != Cut::None);
        tools.extend(cuts.map(|(dot, _)| self.drill(dot)));
        tools.extend(self.windows.iter().map(|(axis, r)| self.window(axis, *r)));
        tools.extend(self.cuts.iter().flat_map(|cuts| cuts.bores(config)));
        let mut tools = solids(&tools)?;
        if !self.marks.is_empty() {
            tools.push(Solid::union(&solids(&self.marks)?)?.minus(&[Solid::new(&floor(config))?])?);
        }
        body.minus(&tools)
    }

    /// How many holes lead through the finished half: those of dots, its windows, its knuckles and its
    /// ribs' screws.
    pub fn through_holes(&self) -> usize {
        let screws = self.cuts.map_or(0, |cuts| cuts.screw_count(self.config));
        self.openings().count() + self.knuckles().count() + screws
    }

    /// Directions of the holes through the wall: those of dots, and windows.
    fn openings(&self) -> impl Iterator<Item = &Vec3> {
        let dots = self.holes.iter().filter(|(_, cut)| *cut == Cut::Through);
        let windows = self.windows.iter().map(|(axis, _)| axis);
        dots.map(|(dot, _)| dot).chain(windows)
    }

    /// How many holes lead through the wedge `piece` of the finished half.
    pub fn through_holes_of(&self, piece: usize, cuts: &HalfCuts) -> usize {
        let is_here = |direction: &&Vec3| cuts.piece_of(direction) == piece;
        let hinge = match cuts.piece_of(&Vec3::x()) == piece {
            true => self.knuckles().count(),
            false => 0,
        };
        self.openings().filter(is_here).count() + hinge + cuts.screws_of(piece, self.config)
    }

    /// Extents along y of its knuckles.
    fn knuckles(&self) -> impl Iterator<Item = (f64, f64)> + '_ {
        let first = self.name as usize;
        (first..self.config.knuckles)
            .step_by(2)
            .map(|k| self.joint.knuckle_range(k, self.config))
    }

    /// A prism over a polygon in the plane y = 0 (x, z), all of it seen from `kernel`, between two
    /// values of y.
    fn along_y(polygon: &[(f64, f64)], kernel: (f64, f64), ends: [f64; 2]) -> Mesh {
        // z cross x points along +y.
        let swapped: Vec<(f64, f64)> = polygon.iter().rev().map(|&(x, z)| (z, x)).collect();
        let kernel = (kernel.1, kernel.0);
        shapes::prism(
            &Vec3::zeros(),
            [&Vec3::z(), &Vec3::x()],
            &swapped,
            kernel,
            ends,
        )
    }

    /// A knuckle and the arm that joins it to the shell. Half A's arms reach down to the bed; half
    /// B's end at the axis' height, where half A's lip passes.
    fn knuckle(&self, from: f64, to: f64) -> Mesh {
        let joint = self.joint;
        let mut outline = arm_outline(self.config, joint);
        if self.name == HalfName::B {
            let root = outline.iter().map(|p| p.0).fold(f64::INFINITY, f64::min);
            let left = joint.axis_mm - joint.knuckle_radius_mm;
            // Counter-clockwise: the knuckle's lower half, its right, the arm's top and root.
            let chord = self.config.chord_error_mm;
            let segments = shapes::circle_segments(joint.knuckle_radius_mm, chord);
            let circle = shapes::circle((joint.axis_mm, 0.0), joint.knuckle_radius_mm, segments);
            let lower = circle[segments / 2 + 1..].iter().copied();
            outline.retain(|p| p.1 >= 0.0 && p.0 > left - 1e-9);
            outline.sort_by(|a, b| {
                let angle = |p: &(f64, f64)| p.1.atan2(p.0 - joint.axis_mm);
                angle(a).total_cmp(&angle(b))
            });
            outline = std::iter::once((left, 0.0))
                .chain(lower)
                .chain(outline)
                .collect();
            outline.extend([(root, joint.arm_mm), (root, 0.0)]);
        }
        let kernel = (joint.axis_mm, 0.25 * joint.knuckle_radius_mm);
        Self::along_y(&outline, kernel, [from, to])
    }

    /// The bore for the screw, through all knuckles.
    fn bore(&self) -> Mesh {
        let joint = self.joint;
        let segments = shapes::circle_segments(joint.bore_radius_mm, self.config.chord_error_mm);
        let end = 0.5 * self.config.hinge_length_mm + BEYOND_MM;
        let circle = shapes::circle((joint.axis_mm, 0.0), joint.bore_radius_mm, segments);
        Self::along_y(&circle, (joint.axis_mm, 0.0), [-end, end])
    }

    /// What half B's lip leaves free so that half A's passes it when the halves open: at each y the
    /// part of a disc about the hinge's axis that lies beneath the ledge and within the rim.
    fn relief(&self) -> Mesh {
        let joint = self.joint;
        // Between the edge of half A's lip and the ledge above it, in no plane with either; and as
        // far out as the middle of half A's lip.
        let top = joint.lip_mm + 0.5 * joint.ledge_gap_mm;
        let out = 0.5 * (joint.cone_wide_mm + self.config.outer_radius_mm());
        let half = joint.relief_half_width(self.config).min(0.9 * out);
        let slices = (2.0 * half / RELIEF_SLICE_MM).ceil().max(2.0) as usize;
        let segments = shapes::circle_segments(joint.axis_mm, self.config.chord_error_mm) / 2;
        let sections: Vec<_> = (0..=slices)
            .map(|i| {
                let y = half * (2.0 * i as f64 / slices as f64 - 1.0);
                let r = joint.relief_mm(y, self.config).max(top + RELIEF_SLICE_MM);
                let side = (out * out - y * y).sqrt();
                let high = PI - (top / r).asin();
                let low = PI + ((joint.axis_mm - side) / r).clamp(0.0, 1.0).acos();
                let arc = (0..=segments).map(|s| low + (high - low) * s as f64 / segments as f64);
                let points =
                    arc.map(|angle| Vec3::new(joint.axis_mm + r * angle.cos(), y, r * angle.sin()));
                points.chain([Vec3::new(side, y, top)]).collect()
            })
            .collect();
        shapes::loft(&sections)
    }

    /// The thumb tab, opposite to the hinge and flat on the bed.
    fn tab(&self) -> Mesh {
        let (config, joint) = (self.config, self.joint);
        let half = 0.5 * joint.tab_width_mm;
        let r = TAB_CORNER_MM.min(0.5 * half).min(0.5 * config.tab_mm);
        let reach = config.outer_radius_mm() + config.tab_mm;
        let segments = shapes::circle_segments(r, config.chord_error_mm);
        let mut points = shapes::circle((-reach + r, half - r), r, segments);
        points.extend(shapes::circle((-reach + r, r - half), r, segments));
        // It starts inside the wall; what reaches the cavity is cut away.
        let root = (config.inner_radius_mm().powi(2) - half * half)
            .max(1.0)
            .sqrt();
        points.extend([(-root, half), (-root, -half)]);
        let outline = shapes::convex_hull(&points);
        let top = joint.tab_thickness_mm - joint.lip_mm;
        let bottom = -joint.lip_mm - BEYOND_MM;
        let axes = [&Vec3::x(), &Vec3::y()];
        let kernel = shapes::middle(&outline);
        shapes::prism(&Vec3::zeros(), axes, &outline, kernel, [bottom, top])
    }

    /// What is cut away below the rim: all beneath the bed, and the other half's lip with its gap.
    fn rim(&self) -> Vec<Mesh> {
        let (config, joint) = (self.config, self.joint);
        let outer = config.outer_radius_mm();
        let far = joint.axis_mm + outer;
        let lip = joint.lip_mm;
        let ledge = lip + joint.ledge_gap_mm;
        let segments = shapes::circle_segments(outer, config.chord_error_mm);
        let (wide, narrow) = (joint.cone_wide_mm, joint.cone_narrow_mm);
        let gap = joint.half_gap_mm;
        if self.name == HalfName::A {
            let outline = [
                (-far, 0.0),
                (-far, far),
                (-lip, far),
                (-lip, wide + gap),
                (lip, narrow + gap),
                (ledge, narrow + gap),
                (ledge, 0.0),
            ];
            vec![shapes::revolve(&Vec3::z(), &outline, segments)]
        } else {
            let bed = [(-far, 0.0), (-far, far), (-lip, far), (-lip, 0.0)];
            // Short of the knuckles, which it would touch along a line.
            let slot = outer + SLOT_FRACTION * config.knuckle_clearance_mm;
            // Beneath the bed the cone goes on as it is.
            let below = narrow - gap - (wide - narrow) / (2.0 * lip) * BEYOND_MM;
            let other_lip = [
                (-lip - BEYOND_MM, slot),
                (ledge, slot),
                (ledge, wide - gap),
                (lip, wide - gap),
                (-lip - BEYOND_MM, below),
            ];
            vec![
                shapes::revolve(&Vec3::z(), &bed, segments),
                shapes::ring(&Vec3::z(), &other_lip, segments),
            ]
        }
    }

    /// What relieves the dome's inside around its top, where a printer lays lines on air: a cylinder with
    /// a cap parallel to the inner sphere.
    fn ceiling(&self) -> Option<Mesh> {
        let config = self.config;
        let depth = config.ceiling_depth_mm();
        if depth <= 0.0 {
            return None;
        }
        let cap = config.inner_radius_mm() + depth;
        let side = config.ceiling_radius_mm();
        let half_angle = (side / cap).asin();
        let steps = shapes::circle_segments(cap, config.chord_error_mm).div_ceil(8);
        // From within the ball to the cap's edge, and along the cap to the axis.
        let mut outline = vec![(0.5 * cap, 0.0), (0.5 * cap, side)];
        outline.extend((0..=steps).rev().map(|k| {
            let (sin, cos) = (half_angle * k as f64 / steps as f64).sin_cos();
            (cap * cos, cap * sin)
        }));
        let segments = shapes::circle_segments(side, config.chord_error_mm).max(32);
        Some(shapes::revolve(&Vec3::z(), &outline, segments))
    }

    /// The tool that cuts a window.
    fn window(&self, axis: &Vec3, radius: f64) -> Mesh {
        let inner = self.config.inner_radius_mm();
        let start = 0.5 * (inner * inner - radius * radius).max(0.0).sqrt();
        let end = self.config.outer_radius_mm() + BEYOND_MM;
        let outline = [(start, 0.0), (start, radius), (end, radius), (end, 0.0)];
        let segments = shapes::circle_segments(radius, self.config.chord_error_mm).max(32);
        shapes::revolve(axis, &outline, segments)
    }

    /// The tool that cuts a dot's hole: a throat of the dot's diameter, then a cone.
    fn drill(&self, dot: &Vec3) -> Mesh {
        let config = self.config;
        let r = 0.5 * config.hole_diameter_mm;
        let throat_end = config.inner_radius_mm() + config.throat_mm;
        let end = config.outer_radius_mm() + BEYOND_MM;
        let end_radius = config.hole_radius_mm(end);
        let start = 0.6 * config.inner_radius_mm();
        let outline = [
            (start, 0.0),
            (start, r),
            (throat_end, r),
            (end, end_radius),
            (end, 0.0),
        ];
        let segments = shapes::circle_segments(end_radius, config.chord_error_mm).max(32);
        shapes::revolve(dot, &outline, segments)
    }
}

/// Each mesh as a solid.
fn solids(meshes: &[Mesh]) -> Result<Vec<Solid>> {
    meshes.iter().map(Solid::new).collect()
}
