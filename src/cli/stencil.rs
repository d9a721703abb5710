//! `spindoe stencil`.

use std::path::PathBuf;

use clap::Args;

use crate::error::Result;
use crate::pattern::Pattern;
use crate::stencil::{HoleSide, Stencil, StencilConfig};

#[derive(Debug, Args)]
pub struct Arguments {
    /// The pattern, a CSV of unit vectors x,y,z.
    pattern: PathBuf,
    /// Folder for the files; made if it does not exist.
    #[arg(short, long = "out", value_name = "DIR")]
    output: PathBuf,
    #[command(flatten)]
    sizes: Sizes,
}

/// Every size has the library's default.
#[derive(Debug, Args)]
#[command(next_help_heading = "Sizes")]
struct Sizes {
    /// Diameter of the ball. Table-tennis balls are 40.0 to 40.6 mm: measure yours with a caliper
    /// [default: 40.0].
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    ball_diameter_mm: Option<f64>,
    /// Gap between ball and shell, per side [default: 0.2].
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    clearance_mm: Option<f64>,
    /// Thickness of the shell [default: 2.4].
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    wall_mm: Option<f64>,
    /// Diameter of a dot on the ball [default: 4.0].
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    hole_diameter_mm: Option<f64>,
    /// Greatest distance of a facet from the surface that it stands for [default: 0.02].
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    chord_error_mm: Option<f64>,
}

impl Sizes {
    fn config(&self) -> StencilConfig {
        let d = StencilConfig::default();
        StencilConfig {
            ball_diameter_mm: self.ball_diameter_mm.unwrap_or(d.ball_diameter_mm),
            clearance_mm: self.clearance_mm.unwrap_or(d.clearance_mm),
            wall_mm: self.wall_mm.unwrap_or(d.wall_mm),
            hole_diameter_mm: self.hole_diameter_mm.unwrap_or(d.hole_diameter_mm),
            chord_error_mm: self.chord_error_mm.unwrap_or(d.chord_error_mm),
            ..d
        }
    }
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let pattern = Pattern::read_csv(&arguments.pattern)?;
    let stencil = Stencil::build(&pattern, &arguments.sizes.config())?;
    stencil.write(&arguments.output)?;
    print_words(&stencil);
    println!("written to {}", arguments.output.display());
    Ok(())
}

fn print_words(stencil: &Stencil) {
    let count = |side| stencil.sides().iter().filter(|s| **s == side).count();
    println!(
        "{} holes in half A, {} in half B, {} on the seam; nearest dot {:.1} deg from the seam",
        count(HoleSide::A),
        count(HoleSide::B),
        count(HoleSide::Seam),
        stencil.seam().margin_rad.to_degrees()
    );
    for (half, name) in stencil.halves().iter().zip(["A", "B"]) {
        println!(
            "half {name}: {} triangles, {:.0} mm^3",
            half.check.triangles, half.check.volume_mm3
        );
    }
}
