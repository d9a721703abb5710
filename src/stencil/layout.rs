//! The layout of the stencil on the pattern: seam, hinge, and which parts each hole cuts.
//!
//! The seam is the plane farthest from all dots along which hinge and tab keep clear of the holes;
//! the hinge then goes where it is farthest from them.

use crate::concurrency;
use crate::error::{Error, Result};
use crate::geometry::{Rotation, Vec3};
use crate::pattern::{KeepOut, Pattern};

use super::joint::Joint;
use super::obstacles::{HingePlace, Obstacles};
use super::seam::{Seam, seam_candidates};
use super::windows::{self, ClosedZone, Window};
use super::{HalfName, StencilConfig};

/// Seams tried for one that leaves every zone a window.
const MAX_SHUT: usize = 40;
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

/// What holes do at a place.
struct HoleTrial {
    layout: Layout,
    /// The thinnest web that a hole leaves at a rim and its dot, where one is too thin.
    thin: Option<(f64, usize)>,
    /// The thinnest part of a ledge that a hole leaves, mm.
    ledge_mm: f64,
}

/// What the holes of this diameter do at a place.
fn judged(place: &HingePlace, config: &StencilConfig, joint: &Joint) -> HoleTrial {
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
    HoleTrial {
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

/// The choice among seams: what was found so far.
struct Choice<'a> {
    zones: &'a [KeepOut],
    obstacles: &'a Obstacles,
    config: &'a StencilConfig,
    joint: &'a Joint,
    /// The largest [`HingePlace::bare_mm`] of any, mm.
    clearest_mm: f64,
    /// The thickest of the webs that are too thin, mm, and its dot.
    thickest: Option<(f64, usize)>,
    /// The first plane that will do but for slivers of a ledge.
    second: Option<Layout>,
    /// The first plane that will do, where it leaves some zone without a window.
    shut: Option<Layout>,
    /// Planes that will do, but leave some zone without a window.
    tried: usize,
}

impl Choice<'_> {
    /// Whether a plane with slivers keeps the margin that was asked for, and this one does not.
    fn prefers_another_to(&self, seam: &Seam) -> bool {
        let is_far = |seam: &Seam| seam.margin_rad >= self.config.seam_margin_rad;
        let second = self.second.as_ref();
        second.is_some_and(|second| is_far(&second.seam) && !is_far(seam))
    }

    /// The layout of a plane or the first one, where no further plane need be considered.
    fn consider(&mut self, seam: Seam, dots: &[Vec3]) -> Option<Layout> {
        let needed = self.config.min_web_mm + 0.5 * self.config.hole_diameter_mm;
        // What is neither wide enough nor the widest so far is of no interest.
        let enough = self.clearest_mm.min(needed - ROUNDING_MM);
        let place = self.obstacles.place(seam, dots, enough)?;
        self.clearest_mm = self.clearest_mm.max(place.bare_mm);
        if place.bare_mm < needed {
            return None;
        }
        let trial = judged(&place, self.config, self.joint);
        if let Some(thin) = trial.thin {
            if self.thickest.is_none_or(|t| thin.0 > t.0) {
                self.thickest = Some(thin);
            }
        } else if trial.ledge_mm >= self.config.nozzle_mm {
            let layout = self.with_windows(trial.layout);
            self.tried += 1;
            if layout.closed.is_empty() {
                return Some(layout);
            }
            let is_last = self.tried > MAX_SHUT;
            let first = self.shut.get_or_insert(layout);
            return is_last.then(|| first.clone());
        } else if trial.ledge_mm > 0.0 && self.second.is_none() {
            self.second = Some(trial.layout);
        }
        None
    }

    fn with_windows(&self, layout: Layout) -> Layout {
        layout.with_windows(self.zones, self.obstacles, self.config, self.joint)
    }

    /// The best of the planes considered.
    fn settle(mut self) -> Result<Layout> {
        if let Some(layout) = self.shut {
            return Ok(layout);
        }
        if let Some(second) = self.second.take() {
            return Ok(self.with_windows(second));
        }
        let config = self.config;
        Err(match self.thickest {
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
                    self.clearest_mm - 0.5 * config.hole_diameter_mm,
                    config.min_web_mm
                ),
            ),
        })
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
        let dots = pattern.dots();
        let obstacles = Obstacles::new(config, joint);
        let mut choice = Choice {
            zones: pattern.keep_out(),
            obstacles: &obstacles,
            config,
            joint,
            clearest_mm: f64::NEG_INFINITY,
            thickest: None,
            second: None,
            shut: None,
            tried: 0,
        };
        for seam in seam_candidates(dots) {
            if choice.prefers_another_to(&seam) {
                break;
            }
            for sign in [1.0, -1.0] {
                let normal = sign * seam.normal;
                if let Some(layout) = choice.consider(Seam { normal, ..seam }, dots) {
                    return Ok(layout);
                }
            }
        }
        choice.settle()
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
        let places: Vec<HingePlace> = places.into_iter().flatten().collect();
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
