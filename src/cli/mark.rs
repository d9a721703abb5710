//! `spindoe mark`: paper lobes, stickers and plotter files that mark a pattern on a ball.

use std::path::{Path, PathBuf};

use clap::{ArgMatches, Args, ValueEnum};

use super::design::cone;
use super::output::reject_foreign;
use super::pattern::{PatternSource, warn_of_small_dots};
use super::print_json;
use crate::ball::Ball;
use crate::design::KeepOut;
use crate::error::{Error, Result};
use crate::files;
use crate::mark::{
    Drawing, GoreConfig, MarkConfig, PageSize, PlotterConfig, StickerConfig, dxf_text, gores,
    pdf_bytes, plotter_drawing, plotter_program, stickers, svg_text,
};
use crate::pattern::Pattern;

#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  spindoe mark dots20 --as gores -o lobes.pdf --sheet letter
  spindoe mark dots20 --as gores -o lobes.dxf --config lobes=24
  spindoe mark dots20 --as stickers -o stickers.pdf --ball-diameter-mm 220
  spindoe mark dots20 --as plotter -o egg.svg
  spindoe mark dots20 --as plotter -o ball.gcode --config pen_diameter_mm=0.8")]
pub struct Arguments {
    #[command(flatten)]
    pattern: PatternSource,
    /// The marking method.
    #[arg(long = "as", value_enum, value_name = "METHOD")]
    method: MarkingMethod,
    /// The file to write; its extension selects the format: .svg, .pdf or .dxf for gores and
    /// stickers, .svg or .gcode for a plotter.
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Diameter of the ball. Table-tennis balls are 40.0 to 40.6 mm: measure yours with a caliper
    /// [default: that of the design, else 40].
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    ball_diameter_mm: Option<f64>,
    /// Diameter of a dot [default: that of the design, else a tenth of the ball].
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    dot_diameter_mm: Option<f64>,
    /// A cone without dots, such as a logo, whose outline is drawn: its axis and half angle in
    /// degrees. No dot may lie within it. May be repeated. By default the zones that stand beside the
    /// pattern.
    #[arg(long, value_name = "X,Y,Z,DEG", value_parser = cone, allow_hyphen_values = true)]
    keep_out: Vec<KeepOut>,
    /// Number of lobes, 12 to 24.
    #[arg(hide = true, long, value_name = "N", default_value_t = GoreConfig::default().lobes)]
    lobes: usize,
    /// Margin of color beyond a sticker's cut.
    #[arg(
        hide = true,
        long,
        value_name = "MM",
        default_value_t = 0.0,
        allow_negative_numbers = true
    )]
    bleed_mm: f64,
    /// Omit the dots' numbers beside the lobes.
    #[arg(hide = true, long)]
    no_numbers: bool,
    /// Sheet of a PDF.
    #[arg(long, value_enum, default_value_t = Sheet::A4)]
    sheet: Sheet,
    /// Width of the plotter's pen on the ball.
    #[arg(hide = true, long, value_name = "MM", default_value_t = PlotterConfig::default().pen_diameter_mm, allow_negative_numbers = true)]
    pen_diameter_mm: f64,
    /// Motor steps per revolution of the ball, the width of the plotter's SVG.
    #[arg(hide = true, long, value_name = "N", default_value_t = PlotterConfig::default().steps_per_turn, allow_negative_numbers = true)]
    steps_per_turn: f64,
    /// Speed of the pen on the ball, for G-code.
    #[arg(hide = true, long, value_name = "MM/MIN", default_value_t = PlotterConfig::default().feed_mm_per_min, allow_negative_numbers = true)]
    feed_mm_per_min: f64,
    /// G-code that lifts the pen.
    #[arg(hide = true, long, value_name = "GCODE", default_value_t = PlotterConfig::default().pen_up)]
    pen_up: String,
    /// G-code that lowers the pen.
    #[arg(hide = true, long, value_name = "GCODE", default_value_t = PlotterConfig::default().pen_down)]
    pen_down: String,
    /// Time that the pen takes to move, seconds.
    #[arg(hide = true, long, value_name = "S", default_value_t = PlotterConfig::default().pen_delay_s, allow_negative_numbers = true)]
    pen_delay_s: f64,
    /// Print the file's note, which says how to apply it to the ball, as one JSON object on
    /// standard output.
    #[arg(long)]
    json: bool,
}

/// Marking methods.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum MarkingMethod {
    /// Flat lobes that cover the ball, for decal paper and vinyl cutters.
    Gores,
    /// Single dots to stick on, with maps of where each goes.
    Stickers,
    /// Longitude and latitude for a machine that rotates the ball under a pen.
    Plotter,
}

/// Sheets of paper.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum Sheet {
    /// 210 x 297 mm.
    A4,
    /// 8.5 x 11 inches.
    Letter,
}

impl From<Sheet> for PageSize {
    fn from(sheet: Sheet) -> Self {
        match sheet {
            Sheet::A4 => Self::A4,
            Sheet::Letter => Self::Letter,
        }
    }
}

/// File formats.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum SheetFormat {
    Svg,
    Pdf,
    Dxf,
    Gcode,
}

impl SheetFormat {
    /// The format that a file's extension selects.
    fn of(path: &Path, method: MarkingMethod) -> Result<Self> {
        let ending = path
            .extension()
            .and_then(|e| e.to_str())
            .unwrap_or_default();
        let format = match ending.to_ascii_lowercase().as_str() {
            "svg" => Some(Self::Svg),
            "pdf" if method != MarkingMethod::Plotter => Some(Self::Pdf),
            "dxf" if method != MarkingMethod::Plotter => Some(Self::Dxf),
            "gcode" | "nc" | "ngc" if method == MarkingMethod::Plotter => Some(Self::Gcode),
            _ => None,
        };
        format.ok_or_else(|| {
            let expected = match method {
                MarkingMethod::Plotter => ".svg or .gcode",
                _ => ".svg, .pdf or .dxf",
            };
            let problem = format!(
                "expected a name that ends in {expected}, found {}",
                path.display()
            );
            Error::argument("out", problem)
        })
    }
}

impl Arguments {
    /// Zones that are asked for, else those of the pattern.
    fn config(&self, ball: &Ball) -> MarkConfig {
        let zones = match self.keep_out.is_empty() {
            true => ball.pattern().keep_out().to_vec(),
            false => self.keep_out.clone(),
        };
        let [ball_diameter_mm, dot_diameter_mm] =
            ball.sizes_mm(self.ball_diameter_mm, self.dot_diameter_mm);
        MarkConfig {
            ball_diameter_mm,
            dot_diameter_mm,
            keep_out: zones,
            date: Some(super::output::today()),
        }
    }

    fn plotter(&self) -> PlotterConfig {
        PlotterConfig {
            pen_diameter_mm: self.pen_diameter_mm,
            steps_per_turn: self.steps_per_turn,
            feed_mm_per_min: self.feed_mm_per_min,
            pen_up: self.pen_up.clone(),
            pen_down: self.pen_down.clone(),
            pen_delay_s: self.pen_delay_s,
        }
    }

    /// Paper has bounds; other formats take one sheet.
    fn page(&self, format: SheetFormat) -> PageSize {
        match (format, self.sheet) {
            (SheetFormat::Pdf, sheet) => sheet.into(),
            _ => PageSize::Sheet,
        }
    }

    fn drawing(
        &self,
        pattern: &Pattern,
        config: &MarkConfig,
        format: SheetFormat,
    ) -> Result<Drawing> {
        let page = self.page(format);
        match self.method {
            MarkingMethod::Gores => {
                let lobes = GoreConfig {
                    lobes: self.lobes,
                    numbers: !self.no_numbers,
                    page,
                };
                gores(pattern, config, &lobes)
            }
            MarkingMethod::Stickers => {
                let sheet = StickerConfig {
                    bleed_mm: self.bleed_mm,
                    page,
                };
                stickers(pattern, config, &sheet)
            }
            MarkingMethod::Plotter => plotter_drawing(pattern, config, &self.plotter()),
        }
    }
}

/// The flags that only some methods have, by their ids.
const OWN: [(&str, &[MarkingMethod]); 10] = [
    ("lobes", &[MarkingMethod::Gores]),
    ("no_numbers", &[MarkingMethod::Gores]),
    ("bleed_mm", &[MarkingMethod::Stickers]),
    ("sheet", &[MarkingMethod::Gores, MarkingMethod::Stickers]),
    ("pen_diameter_mm", &[MarkingMethod::Plotter]),
    ("steps_per_turn", &[MarkingMethod::Plotter]),
    ("feed_mm_per_min", &[MarkingMethod::Plotter]),
    ("pen_up", &[MarkingMethod::Plotter]),
    ("pen_down", &[MarkingMethod::Plotter]),
    ("pen_delay_s", &[MarkingMethod::Plotter]),
];

pub fn run(arguments: &Arguments, given: Option<&ArgMatches>) -> Result<()> {
    given.map_or(Ok(()), |given| {
        reject_foreign(given, &OWN, arguments.method)
    })?;
    let format = SheetFormat::of(&arguments.output, arguments.method)?;
    let ball = arguments.pattern.ball()?;
    let (pattern, config) = (ball.pattern(), arguments.config(&ball));
    let drawing = arguments.drawing(pattern, &config, format)?;
    let bytes = match format {
        SheetFormat::Svg => svg_text(&drawing).concat().into_bytes(),
        SheetFormat::Pdf => pdf_bytes(&drawing),
        SheetFormat::Dxf => dxf_text(&drawing).into_bytes(),
        SheetFormat::Gcode => plotter_program(pattern, &config, &arguments.plotter())?.into_bytes(),
    };
    files::write_bytes(&arguments.output, &bytes)?;
    warn_of_small_dots(config.ball_diameter_mm, config.dot_diameter_mm);
    if arguments.json {
        return print_json(&drawing.note);
    }
    outln!("{}", drawing.title);
    if format == SheetFormat::Pdf {
        outln!(
            "number of pages: {}; print at 100 % and measure the check line",
            drawing.pages.len()
        );
    }
    outln!("written to {}", arguments.output.display());
    Ok(())
}
