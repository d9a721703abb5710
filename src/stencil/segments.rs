//! Cuts that part a half into pieces, for printers whose bed holds no whole half.
//!
//! A cut is a half-plane that ends in an axis through the ball's center, near the dome's top: N cuts
//! make N wedges. On the dome each cut splits a rib into two flanges, through which screws go. The axis
//! and the cuts are chosen so that no hole, window, hinge or tab is met, and the widest wedge is as
//! narrow as possible.
//!
//! Guaranteed: as for a half, of every piece. Not guaranteed: that pieces are glued in their rims, which
//! no screw holds.
//!
//! Frame: the half's own (dome up).

use std::f64::consts::TAU;

use crate::error::{Error, Result, require};
use crate::geometry::{Vec3, spiral_directions, tangent_frame};

use super::joint::Joint;
use super::layout::{Cut, Layout};
use super::mesh::Mesh;
use super::{HalfName, StencilConfig, shapes};

/// Maximum number of pieces of a half.
pub(super) const MAX_PIECES: usize = 6;
/// Axes tried, over the whole sphere, and their maximum angle to the dome's top.
const AXES: usize = 6000;
const MAX_TILT_DEG: f64 = 30.0;
/// Half-planes tried about an axis.
const AZIMUTHS: usize = 180;
/// How much wider than an equal share a wedge may be, as steps of azimuth, and the narrowest as a part of it.
const MAX_WIDER: usize = 15;
const MIN_SHARE: f64 = 0.5;
/// Material beside a rib, as multiples of the thinnest web: tried in this order.
const SPARE: [f64; 3] = [4.0, 2.0, 1.0];
/// Height of a rib above the shell, in diameters of its screws; a flange is as thick as one.
const REACH: f64 = 3.0;
/// Distance of screws from the axis, and from the rib's lower end, in their diameters.
const FROM_AXIS: f64 = 5.0;
const FROM_END: f64 = 2.0;
/// Maximum distance of screws, mm.
const SCREWS_APART_MM: f64 = 45.0;
/// Half the gap between two pieces, mm: a layer of glue.
const HALF_GAP_MM: f64 = 0.05;
/// Distance of the points that stand for a rib, mm.
const SPACING_MM: f64 = 1.0;

/// Where a half is cut.
#[derive(Debug, Clone)]
pub(super) struct HalfCuts {
    /// The line that all cuts end in goes through the ball's center along this direction.
    axis: Vec3,
    /// Direction of each cut from there, square to the axis, counter-clockwise.
    along: Vec<Vec3>,
    /// Thickness of a flange, mm.
    flange_mm: f64,
    /// Radius of a rib's edge, mm.
    edge_mm: f64,
    /// Height above the seam at which a rib begins on the shell, mm.
    foot_mm: f64,
}

/// A round opening that cuts keep clear of: its direction, and radii at distances from the center, mm.
struct Opening {
    axis: Vec3,
    radii: [(f64, f64); 3],
}

/// All cuts through one axis.
struct Surveyed {
    /// Without any cut.
    cuts: HalfCuts,
    along: Vec<Vec3>,
    /// The clearance of each, mm.
    clear: Vec<f64>,
}

impl Surveyed {
    /// The cuts with this clearance whose widest gap is as narrow as possible, with its width in azimuths.
    fn even(
        &self,
        least_mm: f64,
        name: HalfName,
        config: &StencilConfig,
        joint: &Joint,
    ) -> Option<(usize, HalfCuts)> {
        let is_free = |k: &usize| {
            let is_off = |m| self.cuts.is_off_joint(m, name, config, joint);
            self.clear[*k] >= least_mm && is_off(&self.along[*k])
        };
        let free: Vec<usize> = (0..AZIMUTHS).filter(is_free).collect();
        let (width, chosen) = even(&free, config.segments)?;
        let cuts = HalfCuts {
            along: chosen.into_iter().map(|k| self.along[k]).collect(),
            ..self.cuts.clone()
        };
        Some((width, cuts))
    }
}

impl HalfCuts {
    /// The cuts of a half into [`StencilConfig::segments`] pieces; `None` where it stays whole.
    ///
    /// # Errors
    /// [`Error::Argument`] where there is no place for so many.
    pub fn choose(
        layout: &Layout,
        name: HalfName,
        config: &StencilConfig,
        joint: &Joint,
    ) -> Result<Option<Self>> {
        if config.segments == 1 {
            return Ok(None);
        }
        let outer = config.outer_radius_mm();
        let template = Self {
            axis: Vec3::z(),
            along: Vec::new(),
            flange_mm: config.screw_diameter_mm,
            edge_mm: outer + REACH * config.screw_diameter_mm,
            foot_mm: joint.arm_mm,
        };
        let found = template.surveyed(&template.openings(layout, name, config));
        for spare in SPARE {
            let least = spare * config.min_web_mm;
            let of_axis = |axis: &Surveyed| axis.even(least, name, config, joint);
            // The narrowest; of equals the first.
            let narrowest = |best: (usize, Self), next: (usize, Self)| match next.0 < best.0 {
                true => next,
                false => best,
            };
            if let Some((_, cuts)) = found.iter().filter_map(of_axis).reduce(narrowest) {
                cuts.require_screws(config)?;
                return Ok(Some(cuts));
            }
        }
        let clearest = found.iter().flat_map(|axis| &axis.clear);
        let widest = clearest.fold(f64::NEG_INFINITY, |a, b| a.max(*b));
        Err(Error::argument(
            "segments",
            format!(
                "{name} has no place for {} cuts that keep {} mm from all holes, hinge and tab; the best \
                 single one keeps {widest:.1} mm: take fewer or smaller dots",
                config.segments, config.min_web_mm
            ),
        ))
    }

    /// The clearances of all cuts through each of a cap of axes.
    fn surveyed(&self, openings: &[Opening]) -> Vec<Surveyed> {
        let axes = spiral_directions(AXES).filter(|d| d.z > MAX_TILT_DEG.to_radians().cos());
        let survey = |axis: Vec3| {
            let [u, v] = tangent_frame(&axis);
            let angles = (0..AZIMUTHS).map(|k| TAU * k as f64 / AZIMUTHS as f64);
            let along = angles.map(f64::sin_cos).map(|(sin, cos)| cos * u + sin * v);
            let along: Vec<Vec3> = along.collect();
            let cuts = Self {
                axis,
                ..self.clone()
            };
            let clear = along.iter().map(|m| cuts.clearance(m, openings)).collect();
            Surveyed { cuts, along, clear }
        };
        axes.map(survey).collect()
    }

    /// The holes and windows of the half.
    fn openings(&self, layout: &Layout, name: HalfName, config: &StencilConfig) -> Vec<Opening> {
        let (inner, outer) = (config.inner_radius_mm(), config.outer_radius_mm());
        let (narrow, wide) = (0.5 * config.hole_diameter_mm, config.opening_radius_mm());
        let holes = layout.dots.iter().zip(&layout.cuts);
        let holes = holes.filter(|(_, cuts)| cuts[name as usize] != Cut::None);
        let holes = holes.map(|(dot, _)| Opening {
            axis: name.own_frame(dot),
            radii: [(inner, narrow), (outer, wide), (self.edge_mm, wide)],
        });
        let windows = layout.windows.iter().filter(|w| w.half == name);
        let windows = windows.map(|w| Opening {
            axis: name.own_frame(&w.axis),
            radii: [inner, outer, self.edge_mm].map(|radius| (radius, w.radius_mm)),
        });
        holes.chain(windows).collect()
    }

    /// Minimum distance of the rib along `m` from an opening, mm.
    fn clearance(&self, m: &Vec3, openings: &[Opening]) -> f64 {
        let normal = self.axis.cross(m);
        let mut least = f64::INFINITY;
        for opening in openings {
            let d = &opening.axis;
            let aside = d.dot(&normal).abs();
            let tilt = (1.0 - aside * aside).max(0.0).sqrt();
            let from_axis = d.cross(&self.axis).norm();
            for (radius, hole) in opening.radii {
                let distance = if d.dot(m) >= 0.0 {
                    radius * aside - hole * tilt - self.flange_mm
                } else {
                    // Beyond the axis only the rib's end is near.
                    radius * from_axis - hole - 2f64.sqrt() * self.flange_mm
                };
                least = least.min(distance);
            }
        }
        least
    }

    /// Whether the cut along `m` and its rib keep clear of hinge and tab, also when the halves open.
    fn is_off_joint(
        &self,
        m: &Vec3,
        name: HalfName,
        config: &StencilConfig,
        joint: &Joint,
    ) -> bool {
        let normal = self.axis.cross(m);
        let margin = self.flange_mm;
        let hinge = 0.5 * config.hinge_length_mm + margin;
        let tab = 0.5 * joint.tab_width_mm + margin;
        let tab_top = joint.tab_thickness_mm - joint.lip_mm + margin;
        let radii = [
            config.inner_radius_mm(),
            config.outer_radius_mm(),
            self.edge_mm,
        ];
        (45..=150).all(|degrees| {
            let (sin, cos) = f64::from(degrees).to_radians().sin_cos();
            let direction = cos * self.axis + sin * m;
            let points = radii.iter().flat_map(|radius| {
                [-1.0, 1.0].map(|side| *radius * direction + side * self.flange_mm * normal)
            });
            points.filter(|p| p.z >= -joint.lip_mm).all(|p| {
                let meets_hinge = p.x > 0.0 && p.y.abs() < hinge && p.z < joint.arm_mm + margin;
                let meets_tab =
                    name == HalfName::A && p.x < 0.0 && p.y.abs() < tab && p.z < tab_top;
                // Open by half a turn, the halves stand side by side.
                !meets_hinge && !meets_tab && p.x < joint.axis_mm
            })
        })
    }

    /// Angle from the axis at which the cut along `m` has a height of `z` on the sphere of `radius`.
    fn angle_at(&self, m: &Vec3, z: f64, radius: f64) -> f64 {
        // cos a axis.z + sin a m.z = z / radius, on the way down.
        let (a, b) = (self.axis.z, m.z);
        b.atan2(a) + (z / radius / a.hypot(b)).clamp(-1.0, 1.0).acos()
    }

    /// Angles from the axis at which screws go through the rib along `m`, and the radius there.
    fn screws(&self, m: &Vec3, config: &StencilConfig) -> (Vec<f64>, f64) {
        let radius = 0.5 * (config.outer_radius_mm() + self.edge_mm);
        let diameter = config.screw_diameter_mm;
        let first = FROM_AXIS * diameter / radius;
        let rise = radius - config.outer_radius_mm() + FROM_END * diameter;
        let last = self.angle_at(m, self.foot_mm + rise, radius);
        let length = radius * (last - first);
        if length < 0.0 {
            return (Vec::new(), radius);
        }
        let gaps = (length / SCREWS_APART_MM).ceil().max(1.0) as usize;
        let angles = (0..=gaps).map(|k| first + (last - first) * k as f64 / gaps as f64);
        (angles.collect(), radius)
    }

    fn require_screws(&self, config: &StencilConfig) -> Result<()> {
        let has_screws = |m: &Vec3| !self.screws(m, config).0.is_empty();
        let expected = "1 for a ball so small: its ribs have no place for screws";
        require(
            self.along.iter().all(has_screws),
            "segments",
            expected,
            config.segments,
        )
    }

    /// How many screws hold the half together.
    pub fn screw_count(&self, config: &StencilConfig) -> usize {
        self.along
            .iter()
            .map(|m| self.screws(m, config).0.len())
            .sum()
    }

    /// The ribs, which reach into the cavity.
    pub fn ribs(&self, config: &StencilConfig) -> Vec<Mesh> {
        let (inner, outer) = (config.inner_radius_mm(), config.outer_radius_mm());
        let (edge, thick) = (self.edge_mm, self.flange_mm);
        let rib = |m: &Vec3| {
            // Its lower end leans out by 45 degrees, so that it prints on air.
            let low = self.angle_at(m, self.foot_mm + edge - outer, edge);
            let foot = self.angle_at(m, self.foot_mm, outer);
            let steps = shapes::circle_segments(edge, config.chord_error_mm).div_ceil(4);
            let at = |radius: f64, angle: f64| (radius * angle.sin(), radius * angle.cos());
            let mut outline = vec![at(0.8 * inner, foot), at(outer, foot)];
            let first = (-thick / edge).asin();
            let arc = (0..=steps)
                .rev()
                .map(|k| first + (low - first) * k as f64 / steps as f64);
            outline.extend(arc.map(|angle| at(edge, angle)));
            outline.push((-thick, 0.5 * inner));
            // `m` x axis points to the other side than axis x `m`: both flanges are as thick.
            let kernel = at(0.75 * inner, 0.5 * foot);
            let axes = [m, &self.axis];
            shapes::prism(&Vec3::zeros(), axes, &outline, kernel, [-thick, thick])
        };
        self.along.iter().map(rib).collect()
    }

    /// The bores for the screws.
    pub fn bores(&self, config: &StencilConfig) -> Vec<Mesh> {
        let bore = 0.5 * (config.screw_diameter_mm + config.bore_allowance_mm);
        let segments = shapes::circle_segments(bore, config.chord_error_mm);
        let ends = [-2.0 * self.flange_mm, 2.0 * self.flange_mm];
        let mut all = Vec::new();
        for m in &self.along {
            let (angles, radius) = self.screws(m, config);
            for angle in angles {
                let middle = (radius * angle.sin(), radius * angle.cos());
                let circle = shapes::circle(middle, bore, segments);
                let axes = [m, &self.axis];
                all.push(shapes::prism(&Vec3::zeros(), axes, &circle, middle, ends));
            }
        }
        all
    }

    /// The wedges between the cuts, less half the gap at each: what a piece is within.
    pub fn wedges(&self) -> Vec<Mesh> {
        let far = 4.0 * self.edge_mm;
        let wedge = |(from, to): (&Vec3, &Vec3)| {
            let normal = self.axis.cross(from);
            let width = to.dot(&normal).atan2(to.dot(from)).rem_euclid(TAU);
            let (sin, cos) = (0.5 * width).sin_cos();
            let tip = HALF_GAP_MM / sin;
            let tip = (tip * cos, tip * sin);
            let steps = (width / 0.2).ceil() as usize;
            let mut outline = vec![tip];
            outline.extend((0..=steps).map(|k| {
                let (s, c) = (width * k as f64 / steps as f64).sin_cos();
                (tip.0 + far * c, tip.1 + far * s)
            }));
            let kernel = (tip.0 + 0.5 * far * cos, tip.1 + 0.5 * far * sin);
            let axes = [from, &normal];
            shapes::prism(&Vec3::zeros(), axes, &outline, kernel, [-far, far])
        };
        self.pairs().map(wedge).collect()
    }

    /// Each cut with the next one.
    fn pairs(&self) -> impl Iterator<Item = (&Vec3, &Vec3)> {
        self.along.iter().zip(self.along.iter().cycle().skip(1))
    }

    /// Number of screws in both ribs of the wedge `piece`.
    pub fn screws_of(&self, piece: usize, config: &StencilConfig) -> usize {
        let next = (piece + 1) % self.along.len();
        let count = |k: usize| self.screws(&self.along[k], config).0.len();
        count(piece) + count(next)
    }

    /// The wedge that a direction lies in.
    pub fn piece_of(&self, direction: &Vec3) -> usize {
        let holds = |(from, to): (&Vec3, &Vec3)| {
            let normal = self.axis.cross(from);
            let angle = |d: &Vec3| d.dot(&normal).atan2(d.dot(from)).rem_euclid(TAU);
            angle(direction) < angle(to)
        };
        self.pairs().position(holds).unwrap_or(0)
    }

    /// Points on ribs and cuts outside the ball, which marks keep clear of.
    pub fn points(&self, config: &StencilConfig) -> Vec<Vec3> {
        let outer = config.outer_radius_mm();
        let rows = (self.flange_mm / SPACING_MM).ceil();
        let mut points = Vec::new();
        for m in &self.along {
            let normal = self.axis.cross(m);
            let last = self.angle_at(m, 0.0, outer);
            let steps = (outer * last / SPACING_MM).ceil();
            for step in 0..=steps as usize {
                let (sin, cos) = (last * step as f64 / steps).sin_cos();
                let middle = cos * self.axis + sin * m;
                for row in 0..=2 * rows as usize {
                    let side = self.flange_mm * (row as f64 / rows - 1.0);
                    points.push(outer * middle + side * normal);
                }
            }
        }
        points
    }
}

/// Of these azimuths `count` between which the widest gap is as narrow as possible, with its width.
fn even(free: &[usize], count: usize) -> Option<(usize, Vec<usize>)> {
    let share = AZIMUTHS.div_ceil(count);
    let narrowest = (MIN_SHARE * share as f64) as usize;
    let first = *free.first()?;
    for width in share..=share + MAX_WIDER {
        for &start in free.iter().take_while(|&&k| k <= first + width) {
            let mut chosen = vec![start];
            let mut at = start;
            while chosen.len() < count {
                // The next one as far on as possible, around the circle.
                let next = (at + narrowest..=at + width)
                    .rev()
                    .find(|k| free.binary_search(&(k % AZIMUTHS)).is_ok());
                let Some(next) = next else { break };
                chosen.push(next);
                at = next;
            }
            let left = (start + AZIMUTHS).saturating_sub(at);
            if chosen.len() == count && (narrowest..=width).contains(&left) {
                return Some((width, chosen.into_iter().map(|k| k % AZIMUTHS).collect()));
            }
        }
    }
    None
}

/// Checks the number of pieces.
pub(super) fn check(segments: usize) -> Result<()> {
    let inside = (1..=MAX_PIECES).contains(&segments);
    require(inside, "segments", &format!("1 to {MAX_PIECES}"), segments)
}
