//! `spindoe stencil`: two printable halves that draw a pattern on a ball.

use std::path::PathBuf;

use clap::Args;

use crate::ball::Ball;
use crate::error::{Error, Result};
use crate::files::{self, Replacement};
use crate::pattern::Pattern;
use crate::stencil::coupon::coupon;
use crate::stencil::{
    Bed, COMMON_BEDS, Closure, HalfName, HoleSide, Stencil, StencilConfig, piece_files, stl_bytes,
};

#[cfg(feature = "mark")]
use super::mark::Sheet;
use super::output::{Counter, one_of};
use super::pattern::{PatternSource, warn_of_small_dots};

#[derive(Debug, Args)]
pub struct Arguments {
    #[command(flatten)]
    pattern: PatternSource,
    /// Folder for the files; made if it does not exist.
    #[arg(short, long, value_name = "DIR", default_value = "stencil")]
    output: PathBuf,
    /// Also write coupon.stl: rings with clearances of 0.0 to 0.5 mm, to print first; that takes about as long as a half.
    #[arg(long)]
    coupon: bool,
    /// Replace a stencil that the folder holds already, with all its files.
    #[arg(long)]
    overwrite: bool,
    /// Engrave nothing: no dots' numbers, no names of the halves.
    #[arg(hide = true, long)]
    no_numbers: bool,
    /// Sheet of drawing.pdf.
    #[cfg(feature = "mark")]
    #[arg(long, value_enum, default_value_t = Sheet::A4)]
    sheet: Sheet,
    /// What holds the hinge together: an M3 screw (or by the setting screw_diameter_mm), or a printed pin.
    #[arg(hide = true, long, value_parser = one_of(&Closure::ALL, Closure::as_str), default_value = "screw")]
    closure: Closure,
    /// Cut each half into so many pieces, screwed together by ribs, for a bed that holds no whole half.
    #[arg(long, value_name = "N", default_value_t = 1)]
    segments: usize,
    /// Number of interleaved knuckles of the hinge, odd [default: 3].
    #[arg(hide = true, long, value_name = "N")]
    knuckles: Option<usize>,
    /// Diameter of a dot on the ball, or auto for the largest that fits [default: that of
    /// the design, else a tenth of the ball].
    #[arg(long, value_name = "MM|auto", value_parser = hole, allow_negative_numbers = true, help_heading = "Sizes")]
    dot_diameter_mm: Option<Hole>,
    /// Diameter of the pen's tip: holes are at least 0.4 mm wider, so that the tip passes through.
    #[arg(
        long,
        value_name = "MM",
        allow_negative_numbers = true,
        help_heading = "Sizes"
    )]
    pen_diameter_mm: Option<f64>,
    #[command(flatten)]
    sizes: Sizes,
}

/// A hole's diameter.
#[derive(Debug, Clone, Copy)]
enum Hole {
    /// The largest that fits.
    Auto,
    /// Millimeters.
    Mm(f64),
}

/// Parses `MM` or `auto`.
fn hole(text: &str) -> std::result::Result<Hole, String> {
    if text == "auto" {
        return Ok(Hole::Auto);
    }
    let number = text.parse().map(Hole::Mm);
    number.map_err(|_| "expected millimeters or auto".to_owned())
}

/// Names of the files that this command writes.
const FILES: [&str; 9] = [
    "pin.stl",
    DRAWING,
    "half_a.stl",
    "half_b.stl",
    "stencil.3mf",
    "stencil.json",
    "stencil.png",
    "stencil.svg",
    COUPON,
];
#[cfg(feature = "plot")]
const PICTURE: &str = "stencil";
const DRAWING: &str = "drawing.pdf";
const COUPON: &str = "coupon.stl";

/// Declares the sizes that can be set: flag or setting, unit, and the library's field, converted where units
/// differ.
macro_rules! sizes {
    (@hide setting) => { true };
    (@hide) => { false };
    ($($(#[doc = $doc:literal])+ $flag:ident $($hidden:ident)?: $unit:literal => $field:ident $(. $convert:ident ())?,)+) => {
        /// Every size has the library's default.
        #[derive(Debug, Args)]
        #[command(next_help_heading = "Sizes")]
        struct Sizes {
            $(
                $(#[doc = $doc])+
                #[arg(long, value_name = $unit, allow_negative_numbers = true, hide = sizes!(@hide $($hidden)?))]
                $flag: Option<f64>,
            )+
        }

        impl Sizes {
            /// Sets the values that were given.
            fn apply(&self, config: &mut StencilConfig) {
                $(if let Some(value) = self.$flag {
                    config.$field = value $(. $convert ())?;
                })+
            }
        }
    };
}

sizes! {
    /// Diameter of the ball, 10 to 400. Table-tennis balls are 40.0 to 40.6 mm: measure yours with a caliper
    /// [default: that of the design, else 40].
    ball_diameter_mm: "MM" => ball_diameter_mm,
    /// Gap between ball and shell, per side; print the coupon to find yours [default: 0.2].
    clearance_mm: "MM" => clearance_mm,
    /// Thickness of the shell [default: 2.8, less for balls under 40 mm, as all sizes of the
    /// shell and its hinge].
    wall_mm setting: "MM" => wall_mm,
    /// How much farther from the ball the dome's inside lies within 25 degrees of its top, where it is
    /// printed on air and comes out rough [default: 0.3].
    ceiling_relief_mm setting: "MM" => ceiling_relief_mm,
    /// Length of a hole's throat at the ball, before it widens for the pen [default: 0.8].
    throat_mm setting: "MM" => throat_mm,
    /// Half-angle of the cone by which a hole widens outwards [default: 30, less for balls under 40 mm].
    taper_deg setting: "DEG" => taper_rad.to_radians(),
    /// Minimum material between holes, and between a hole and rim, hinge or tab [default: 0.8,
    /// less for balls under 40 mm].
    min_web_mm setting: "MM" => min_web_mm,
    /// Target distance of the dots' centers from the seam [default: 10].
    seam_margin_deg setting: "DEG" => seam_margin_rad.to_radians(),
    /// Gap between the two rims [default: 0.2].
    seam_gap_mm setting: "MM" => seam_gap_mm,
    /// Nominal diameter of the hinge's screw [default: 3.0, M3; M2.5, M2 or M1.6 for balls under 40 mm].
    screw_diameter_mm setting: "MM" => screw_diameter_mm,
    /// Clearance between the hinge's bore and its screw [default: 0.2].
    bore_allowance_mm setting: "MM" => bore_allowance_mm,
    /// Length of the hinge along its screw [default: 15, less for balls under 40 mm].
    hinge_length_mm setting: "MM" => hinge_length_mm,
    /// Gap between knuckles [default: 0.4].
    knuckle_clearance_mm setting: "MM" => knuckle_clearance_mm,
    /// Material around the screw's bore [default: 1.2, less for balls under 40 mm].
    knuckle_wall_mm setting: "MM" => knuckle_wall_mm,
    /// Reach of the thumb tab [default: 6, less for balls under 40 mm].
    tab_mm setting: "MM" => tab_mm,
    /// Width of the printer's nozzle [default: 0.4].
    nozzle_mm setting: "MM" => nozzle_mm,
    /// Distance of a facet from the surface that it approximates, at most; up to a fifth more where slivers are removed
    /// [default: 0.02].
    chord_error_mm setting: "MM" => chord_error_mm,
}

impl Arguments {
    fn config(&self, ball: &Ball) -> Result<StencilConfig> {
        let [ball_diameter_mm, hole_diameter_mm] = ball.sizes_mm(self.sizes.ball_diameter_mm, None);
        let mut config = StencilConfig {
            hole_diameter_mm,
            numbers: !self.no_numbers,
            closure: self.closure,
            segments: self.segments,
            ..StencilConfig::for_ball(ball_diameter_mm)
        };
        config.knuckles = self.knuckles.unwrap_or(config.knuckles);
        self.sizes.apply(&mut config);
        match self.dot_diameter_mm {
            None => {}
            Some(Hole::Mm(diameter)) => config.hole_diameter_mm = diameter,
            Some(Hole::Auto) => {
                config.validate()?;
                match Stencil::largest_hole_mm(ball.pattern(), &config) {
                    Some(diameter) => config.hole_diameter_mm = diameter,
                    // The reason why not even the smallest fits.
                    None => {
                        config.hole_diameter_mm = 0.5;
                        Stencil::check(ball.pattern(), &config)?;
                    }
                }
            }
        }
        self.widen_for_pen(&mut config)?;
        Ok(config)
    }

    /// Widens the holes to what the pen's tip needs, unless their size was given.
    fn widen_for_pen(&self, config: &mut StencilConfig) -> Result<()> {
        let Some(pen) = self.pen_diameter_mm else {
            return Ok(());
        };
        let refused = |problem: String| Err(Error::argument("pen_diameter_mm", problem));
        if !(pen.is_finite() && pen > 0.0) {
            return refused(format!("expected more than 0 mm, found {pen}"));
        }
        let needed = StencilConfig::hole_for_pen_mm(pen);
        if needed > config.hole_diameter_mm {
            if self.dot_diameter_mm.is_some() {
                let holes = config.hole_diameter_mm;
                return refused(format!(
                    "needs holes of {needed:.2} mm, found {holes:.2} mm (--dot-diameter-mm)"
                ));
            }
            config.hole_diameter_mm = needed;
        }
        Ok(())
    }

    /// The flag that set the holes' size, by its id.
    fn hole_parameter(&self, config: &StencilConfig) -> &'static str {
        let is_by_pen = |pen: f64| StencilConfig::hole_for_pen_mm(pen) == config.hole_diameter_mm;
        match self.pen_diameter_mm {
            Some(pen) if is_by_pen(pen) => "pen_diameter_mm",
            _ => "hole_diameter_mm",
        }
    }
}

/// How much of the work the plan and each half are, percent; pictures and drawing are the rest: of `dots40` 0.5, 2.0, 2.0 and 0.5 s.
const SHARES: [u64; 3] = [10, 40, 40];

pub fn run(arguments: &Arguments) -> Result<()> {
    let ball = arguments.pattern.ball()?;
    let (pattern, config) = (ball.pattern(), arguments.config(&ball)?);
    let dir = &arguments.output;
    if !arguments.overwrite {
        let advice = "choose another folder, or --overwrite it";
        files::reject_taken(dir, &FILES, "a stencil", advice)?;
    }
    // Before the work: what cannot be written costs none.
    let set = Replacement::begin(dir)?;
    let counter = Counter::new(100, "% of the stencil");
    let done = |step: usize| counter.add(SHARES[step]);
    let stencil = Stencil::build_with(pattern, &config, &done).map_err(|error| {
        counter.finish();
        with_largest(error, pattern, &config, arguments.hole_parameter(&config))
    })?;
    let rings = arguments.coupon.then(|| coupon(&config)).transpose()?;
    stencil.write(set.path())?;
    if let Some(rings) = rings {
        files::write_bytes(&set.path().join(COUPON), &stl_bytes(&rings)?)?;
    }
    #[cfg(feature = "plot")]
    {
        let title = format!("Stencil of pattern {:.8}", stencil.pattern_sha256());
        let formats = &crate::report::plots::PictureFormat::ALL;
        crate::report::plots::in_each_format(set.path(), PICTURE, formats, |path| {
            crate::plot::stencil_views(path, &stencil, &title)
        })?;
    }
    #[cfg(feature = "mark")]
    {
        let date = super::output::today();
        let sheet = crate::mark::stencil_sheet(&stencil, arguments.sheet.into(), Some(&date));
        files::write_bytes(&set.path().join(DRAWING), &crate::mark::pdf_bytes(&sheet))?;
    }
    counter.finish();
    let pieces = piece_files();
    let replaced = FILES.into_iter().chain(pieces.iter().map(String::as_str));
    set.publish(&replaced.collect::<Vec<_>>(), "stencil.json")?;
    warn_of_small_dots(config.ball_diameter_mm, config.hole_diameter_mm);
    print_words(&stencil);
    outln!("written to {}", dir.display());
    Ok(())
}

/// A rejection because of the holes, with the largest that fits, named by what set their size.
fn with_largest(error: Error, pattern: &Pattern, config: &StencilConfig, of_size: &str) -> Error {
    let of_holes = ["hole_diameter_mm", "seam_margin_rad", "hinge_length_mm"];
    match error {
        Error::Argument { parameter, problem } if of_holes.contains(&parameter.as_str()) => {
            let fits = match Stencil::largest_hole_mm(pattern, config) {
                Some(mm) => format!("holes of at most {mm:.1} mm fit"),
                None => "no hole fits".to_owned(),
            };
            let problem = match problem.contains(&fits) {
                true => problem,
                false => format!("{problem}; beside hinge and rims {fits}"),
            };
            let name = match parameter.as_str() {
                "hole_diameter_mm" => of_size,
                other => other,
            };
            Error::argument(name.to_owned(), problem)
        }
        other => other,
    }
}

fn print_words(stencil: &Stencil) {
    let count = |side| stencil.sides().iter().filter(|s| **s == side).count();
    outln!(
        "{} holes of {} mm: {} in half A alone, {} in half B alone, {} through both rims; nearest dot {:.1} deg from the seam",
        stencil.sides().len(),
        stencil.config().hole_diameter_mm,
        count(HoleSide::A),
        count(HoleSide::B),
        count(HoleSide::Both),
        stencil.seam().margin_rad.to_degrees()
    );
    for (half, name) in stencil.halves().iter().zip(HalfName::BOTH) {
        outln!(
            "{name}: {} triangles, {:.0} mm^3",
            half.check.triangles,
            half.check.volume_mm3
        );
        if !half.pieces.is_empty() {
            let screw = stencil.config().screw_diameter_mm;
            outln!(
                "  {} pieces, held by {} M{screw} screws of {:.0} mm and by glue in the rim",
                half.pieces.len(),
                half.screws,
                4.0 * screw
            );
        }
        if !half.unnumbered.is_empty() {
            outln!("  no place for the numbers of dots {:?}", half.unnumbered);
        }
    }
    print_bed(stencil);
    for window in stencil.windows() {
        outln!(
            "zone {} is {:.1} mm wide: a window of {:.1} mm in {}",
            window.zone,
            2.0 * window.zone_radius_mm,
            2.0 * window.radius_mm,
            window.half
        );
    }
    for zone in stencil.closed_zones() {
        outln!(
            "zone {} is {:.1} mm wide: no space for a window beside holes and rims; an arrow points to it",
            zone.zone,
            2.0 * zone.zone_radius_mm
        );
    }
}

/// Which beds hold the halves, or their pieces.
fn print_bed(stencil: &Stencil) {
    let [width, depth, height] = stencil.print_size_mm();
    let area = |bed: &Bed| format!("{} x {} mm", bed.size_mm[0], bed.size_mm[1]);
    let holding: Vec<&Bed> = stencil.beds().collect();
    let fits = match holding.first() {
        Some(_) if holding.len() == COMMON_BEDS.len() => "fits all common beds".to_owned(),
        Some(first) => format!(
            "fits a bed of {} ({}) and larger ones",
            area(first),
            first.printers
        ),
        None => format!(
            "fits no common bed, up to {}",
            COMMON_BEDS.last().map(area).unwrap_or_default()
        ),
    };
    let is_whole = stencil.config().segments == 1;
    let part = if is_whole { "half" } else { "piece" };
    outln!("a {part} takes {width:.0} x {depth:.0} mm, {height:.0} mm high: {fits}");
    if is_whole && holding.len() < COMMON_BEDS.len() {
        outln!(
            "For a smaller bed, --segments 2 or 4 cuts each half into so many pieces; `spindoe mark` needs no printer."
        );
    }
}
