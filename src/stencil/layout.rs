//! The layout of the stencil on the pattern: seam, hinge, and which parts each hole cuts.
//!
//! The seam is the plane farthest from all dots along which hinge and tab keep clear of the holes;
//! the hinge then goes where it is farthest from them. Distances between a hole and hinge or tab
//! are measured from points on their surfaces to the hole's cone, which is taken to go on outside
//! the shell as a cylinder: there the pen stands.

use std::f64::consts::FRAC_PI_2;

use crate::concurrency;
use crate::error::{Error, Result};
use crate::geometry::{Rotation, Vec3, tangent_frame};
use crate::pattern::{KeepOut, Pattern};

use super::joint::Joint;
use super::seam::{Seam, seam_candidates};
use super::windows::{self, ClosedZone, Window};
use super::{HalfName, StencilConfig, shapes};

/// Seams tried for one that leaves every zone a window.
const MAX_SHUT: usize = 40;
/// Hinge positions tried along a seam.
const AZIMUTHS: usize = 120;
/// Distance of the points that stand for a surface, mm.
const SPACING_MM: f64 = 1.0;
/// Rounding of a distance, mm.
const ROUNDING_MM: f64 = 1e-9;
/// A hole that misses a rim's edge by less than this counts as cutting it, mm: tangent circles have
/// no certain topology.
const TANGENT_MM: f64 = 0.05;

/// What a hole does to a half.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Cut {
    /// Nothing.
    None,
    /// It goes through the wall.
    Through,
    /// It cuts the rim: a half-hole.
    Notch,
}

/// Where everything lies.
#[derive(Debug, Clone)]
pub(super) struct Layout {
    /// The parting plane, in the pattern's frame.
    pub seam: Seam,
    /// Pattern's frame to stencil's frame.
    pub rotation: Rotation,
    /// The dots in the stencil's frame.
    pub dots: Vec<Vec3>,
    /// For each dot what its hole does to half A and to half B.
    pub cuts: Vec<[Cut; 2]>,
    /// Minimum distance of a hole from hinge or tab, mm.
    pub clearance_mm: f64,
    /// The zones without dots, in the stencil's frame.
    pub zones: Vec<KeepOut>,
    /// Openings over the zones without dots.
    pub windows: Vec<Window>,
    /// Zones for which there is none.
    pub closed: Vec<ClosedZone>,
}

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

/// Lowest and highest point above the bed of the circle that the hole of `dot` (a half's own frame,
/// dome up) makes on the sphere of `radius`, mm.
fn reach(dot: &Vec3, radius: f64, config: &StencilConfig, joint: &Joint) -> [f64; 2] {
    // A point of the circle is at `height` along the hole's axis and at the hole's radius there
    // from it.
    let mut height = radius;
    for _ in 0..4 {
        let r = config.hole_radius_mm(height);
        height = (radius * radius - r * r).max(0.0).sqrt();
    }
    let middle = height * dot.z + joint.lip_mm;
    let half = config.hole_radius_mm(height) * (1.0 - dot.z * dot.z).max(0.0).sqrt();
    [middle - half, middle + half]
}

/// [`reach`] on spheres between two radii: their ends, and where the hole begins to widen.
fn reaches(
    dot: &Vec3,
    [from, to]: [f64; 2],
    config: &StencilConfig,
    joint: &Joint,
) -> Vec<[f64; 2]> {
    let throat = config.inner_radius_mm() + config.throat_mm;
    let corner = throat.hypot(0.5 * config.hole_diameter_mm).clamp(from, to);
    [from, corner, to]
        .iter()
        .map(|&radius| reach(dot, radius, config, joint))
        .collect()
}

/// What the hole of `dot` (a half's own frame, dome up) does to that half; an error where it leaves
/// a web of the given thickness, mm, too thin to print.
fn cut(
    dot: &Vec3,
    name: HalfName,
    config: &StencilConfig,
    joint: &Joint,
) -> std::result::Result<Cut, f64> {
    let inner = config.inner_radius_mm();
    let lip = match name {
        HalfName::A => [
            joint.cone_wide_mm.hypot(joint.lip_mm),
            config.outer_radius_mm(),
        ],
        HalfName::B => [inner, inner + joint.lip_thickness_mm],
    };
    let circles = reaches(dot, lip, config, joint);
    let web = circles.iter().map(|c| c[0]).fold(f64::INFINITY, f64::min);
    let highest = circles
        .iter()
        .map(|c| c[1])
        .fold(f64::NEG_INFINITY, f64::max);
    if web >= config.min_web_mm {
        Ok(Cut::Through)
    } else if highest < -TANGENT_MM {
        Ok(Cut::None)
    } else if web < -TANGENT_MM && highest > TANGENT_MM {
        Ok(Cut::Notch)
    } else {
        Err(web.max(0.0))
    }
}

/// Thickness of what the hole of `dot` (a half's own frame) leaves of that half's ledge, mm:
/// infinite where it clearly misses or cuts the ledge, zero where it grazes it.
fn ledge_web(dot: &Vec3, name: HalfName, config: &StencilConfig, joint: &Joint) -> f64 {
    let ledge = 2.0 * joint.lip_mm + joint.ledge_gap_mm;
    let radii = match name {
        HalfName::A => {
            let edge = joint.cone_narrow_mm + joint.half_gap_mm;
            [config.inner_radius_mm(), edge.hypot(joint.lip_mm)]
        }
        HalfName::B => {
            let edge = joint.cone_wide_mm - joint.half_gap_mm;
            [edge.hypot(joint.lip_mm), config.outer_radius_mm()]
        }
    };
    let circles = reaches(dot, radii, config, joint);
    let above = |end: usize, by: f64| circles.iter().all(|c| c[end] - ledge > by);
    let below = |end: usize, by: f64| circles.iter().all(|c| c[end] - ledge < -by);
    if above(0, TANGENT_MM) {
        let lowest = circles.iter().map(|c| c[0]).fold(f64::INFINITY, f64::min);
        lowest - ledge
    } else if below(0, TANGENT_MM) && (above(1, TANGENT_MM) || below(1, TANGENT_MM)) {
        f64::INFINITY
    } else {
        0.0
    }
}

/// A seam with its best hinge position, which is the same whatever the holes' diameter.
struct Place {
    seam: Seam,
    rotation: Rotation,
    /// The dots in the stencil's frame.
    dots: Vec<Vec3>,
    /// Minimum distance of a hole from hinge or tab were its throat a line, mm: every hole is nearer by
    /// the throat's radius.
    bare_mm: f64,
}

/// What holes do at a place.
struct Trial {
    layout: Layout,
    /// The thinnest web that a hole leaves at a rim and its dot, where one is too thin.
    thin: Option<(f64, usize)>,
    /// The thinnest part of a ledge that a hole leaves, mm.
    ledge_mm: f64,
}

/// A surface that holes must stay clear of, as points within a cone about an axis.
struct Obstacle {
    points: Vec<Vec3>,
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
struct Obstacles {
    hinge: Obstacle,
    tab: Obstacle,
    /// The stencil with holes whose throats are lines.
    bare: StencilConfig,
}

impl Obstacles {
    fn new(config: &StencilConfig, joint: &Joint) -> Self {
        Self {
            hinge: Obstacle::new(hinge_points(config, joint), Vec3::x()),
            tab: Obstacle::new(tab_points(config, joint), -Vec3::x()),
            bare: StencilConfig {
                hole_diameter_mm: 0.0,
                ..config.clone()
            },
        }
    }

    /// [`Place::bare_mm`] of dots in the stencil's frame, those nearest to hinge and tab first. Stops early at or
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
    /// [`Place::bare_mm`] counts.
    fn place(&self, seam: Seam, pattern: &[Vec3], enough: f64) -> Option<Place> {
        let [u, v] = tangent_frame(&seam.normal);
        let mut best = (enough, None);
        let mut dots: Vec<Vec3> = Vec::with_capacity(pattern.len());
        for i in 0..AZIMUTHS {
            let (sin, cos) = (std::f64::consts::TAU * i as f64 / AZIMUTHS as f64).sin_cos();
            let x = cos * u + sin * v;
            let y = seam.normal.cross(&x);
            let rows = [x.transpose(), y.transpose(), seam.normal.transpose()];
            let matrix = nalgebra::Matrix3::from_rows(&rows);
            let turn = nalgebra::Rotation3::from_matrix_unchecked(matrix);
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
        Some(Place {
            seam,
            rotation: Rotation::from_rotation_matrix(&turn),
            dots: pattern.iter().map(|d| turn * d).collect(),
            bare_mm,
        })
    }
}

/// What the holes of this diameter do at a place.
fn judged(place: &Place, config: &StencilConfig, joint: &Joint) -> Trial {
    let dots = &place.dots;
    let mut thin: Option<(f64, usize)> = None;
    let mut cuts = Vec::with_capacity(dots.len());
    let mut ledge_mm = f64::INFINITY;
    for (i, d) in dots.iter().enumerate() {
        let both = HalfName::BOTH.map(|name| (name, name.own_frame(d)));
        for (name, own) in &both {
            ledge_mm = ledge_mm.min(ledge_web(own, *name, config, joint));
        }
        cuts.push(both.map(|(name, own)| {
            cut(&own, name, config, joint).unwrap_or_else(|web| {
                if thin.is_none_or(|(thinnest, _)| web < thinnest) {
                    thin = Some((web, i));
                }
                Cut::Through
            })
        }));
    }
    Trial {
        layout: Layout {
            seam: place.seam,
            rotation: place.rotation,
            dots: dots.clone(),
            cuts,
            clearance_mm: place.bare_mm - 0.5 * config.hole_diameter_mm,
            zones: Vec::new(),
            windows: Vec::new(),
            closed: Vec::new(),
        },
        thin,
        ledge_mm,
    }
}

impl Layout {
    /// The layout with the windows that it has space for.
    fn with_windows(
        mut self,
        zones: &[KeepOut],
        obstacles: &Obstacles,
        config: &StencilConfig,
        joint: &Joint,
    ) -> Self {
        let turned: Vec<KeepOut> = zones
            .iter()
            .map(|zone| KeepOut {
                axis: self.rotation * zone.axis,
                ..*zone
            })
            .collect();
        let around = windows::Around {
            dots: &self.dots,
            hinge: &obstacles.hinge.points,
            tab: &obstacles.tab.points,
        };
        let (open, closed) = windows::windows(&turned, &around, config, joint);
        (self.zones, self.windows, self.closed) = (turned, open, closed);
        self
    }

    /// Lays seam and hinge out: of the planes that keep holes clear of the hinge and leave no web
    /// too thin to print, the one farthest from the dots. A plane where no hole leaves a sliver of
    /// a ledge goes first, unless it comes nearer to the dots than the margin asked for and another
    /// does not. Of the planes in this order the first is chosen that leaves every zone of the pattern a
    /// window, else the first.
    ///
    /// # Errors
    /// [`Error::Argument`] with the value of the best attempt where no plane will do.
    pub fn choose(pattern: &Pattern, config: &StencilConfig, joint: &Joint) -> Result<Self> {
        let (dots, zones) = (pattern.dots(), pattern.keep_out());
        let obstacles = Obstacles::new(config, joint);
        let needed = config.min_web_mm + 0.5 * config.hole_diameter_mm;
        let mut clearest = f64::NEG_INFINITY;
        let mut thickest: Option<(f64, usize)> = None;
        let mut second: Option<Self> = None;
        let far = |margin_rad: f64| margin_rad >= config.seam_margin_rad;
        // The first plane that will do, where it leaves some zone without a window.
        let mut shut: Option<Self> = None;
        let mut tried = 0;
        for seam in seam_candidates(dots) {
            if let Some(second) =
                second.take_if(|s| far(s.seam.margin_rad) && !far(seam.margin_rad))
            {
                return Ok(
                    shut.unwrap_or_else(|| second.with_windows(zones, &obstacles, config, joint))
                );
            }
            for sign in [1.0, -1.0] {
                let normal = sign * seam.normal;
                let seam = Seam { normal, ..seam };
                // What is neither wide enough nor the widest so far is of no interest.
                let enough = clearest.min(needed - ROUNDING_MM);
                let Some(place) = obstacles.place(seam, dots, enough) else {
                    continue;
                };
                clearest = clearest.max(place.bare_mm);
                if place.bare_mm < needed {
                    continue;
                }
                let trial = judged(&place, config, joint);
                if let Some(thin) = trial.thin {
                    if thickest.is_none_or(|t| thin.0 > t.0) {
                        thickest = Some(thin);
                    }
                } else if trial.ledge_mm >= config.nozzle_mm {
                    let layout = trial.layout.with_windows(zones, &obstacles, config, joint);
                    tried += 1;
                    if layout.closed.is_empty() || tried > MAX_SHUT {
                        return Ok(match shut {
                            Some(first) if !layout.closed.is_empty() => first,
                            _ => layout,
                        });
                    }
                    shut.get_or_insert(layout);
                } else if trial.ledge_mm > 0.0 && second.is_none() {
                    second = Some(trial.layout);
                }
            }
        }
        if let Some(layout) = shut {
            return Ok(layout);
        }
        if let Some(second) = second {
            return Ok(second.with_windows(zones, &obstacles, config, joint));
        }
        Err(match thickest {
            Some((web, dot)) => Error::argument(
                "seam_margin_rad",
                format!(
                    "whichever plane parts the halves, a hole lies too near a rim: at best that of \
                     dot {dot} leaves {web:.2} mm, expected at least {} mm",
                    config.min_web_mm
                ),
            ),
            None => Error::argument(
                "hinge_length_mm",
                format!(
                    "wherever it lies, a hole goes through hinge or thumb tab: the best place leaves \
                     {:.2} mm between them, expected at least {} mm",
                    clearest - 0.5 * config.hole_diameter_mm,
                    config.min_web_mm
                ),
            ),
        })
    }

    /// Of these hole diameters, descending, the first with which [`Layout::choose`] succeeds. Every seam's hinge is
    /// placed once: its clearance bounds the holes, and what they do to the rims is quickly found.
    pub fn largest_hole_mm(
        dots: &[Vec3],
        diameters_mm: &[f64],
        config: &StencilConfig,
        joint: &Joint,
    ) -> Option<f64> {
        let smallest = diameters_mm.last()?;
        let obstacles = Obstacles::new(config, joint);
        let enough = config.min_web_mm + 0.5 * smallest - ROUNDING_MM;
        let both = |seam: Seam| {
            [1.0, -1.0].map(|sign| Seam {
                normal: sign * seam.normal,
                ..seam
            })
        };
        let seams: Vec<Seam> = seam_candidates(dots).into_iter().flat_map(both).collect();
        let places = concurrency::map(&seams, |seam| obstacles.place(*seam, dots, enough));
        let places: Vec<Place> = places.into_iter().flatten().collect();
        diameters_mm.iter().copied().find(|&hole_diameter_mm| {
            let sized = StencilConfig {
                hole_diameter_mm,
                ..config.clone()
            };
            let needed = config.min_web_mm + 0.5 * hole_diameter_mm;
            let mut clear = places.iter().filter(|place| place.bare_mm >= needed);
            clear.any(|place| {
                let trial = judged(place, &sized, joint);
                trial.thin.is_none() && trial.ledge_mm > 0.0
            })
        })
    }
}
