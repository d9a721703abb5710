//! Text as outlines of a font: DejaVu Sans Condensed Bold. Its strokes are wider than a nozzle at
//! the sizes used here, and its 1 and 7 are distinct from ticks.

use ttf_parser::{Face, OutlineBuilder};

use crate::error::{Error, Result};
use crate::pattern::reads_upside_down;

/// Facets of a curve of the font, which spans about 45 degrees.
const CURVE_FACETS: usize = 3;
/// Space between characters beyond the font's own, as a fraction of their height.
const TRACKING: f64 = 0.06;
/// Thickness of the line beneath a number and its distance, as fractions of the number's height: at
/// the smallest size, 2.2 mm, both are as wide as a nozzle.
const UNDERLINE: (f64, f64) = (0.18, 0.18);

/// Words in the plane, their box centered at the origin, mm.
pub(super) struct Words {
    /// Outlines: outer ones counter-clockwise, holes clockwise.
    pub outlines: Vec<Vec<(f64, f64)>>,
    pub half_width: f64,
    pub half_height: f64,
}

/// The font that engraves, and draws bold words.
pub(crate) static BOLD_FONT: &[u8] = include_bytes!("../fonts/DejaVuSansCondensed-Bold.ttf");

impl Words {
    /// Sets `text` with capitals and digits `height` high.
    ///
    /// # Errors
    /// [`Error::Internal`] where the built-in font lacks a character.
    pub fn new(text: &str, height: f64) -> Result<Self> {
        let internal = |what: &str| Error::Internal(format!("built-in font: {what}"));
        let face = Face::parse(BOLD_FONT, 0).map_err(|e| internal(&e.to_string()))?;
        let capital = face
            .glyph_index('H')
            .and_then(|glyph| face.glyph_bounding_box(glyph))
            .ok_or_else(|| internal("no capital H"))?;
        let scale = height / f64::from(capital.y_max);
        let mut pen = 0.0;
        let mut outlines = Vec::new();
        for c in text.chars() {
            let missing = || internal(&format!("no {c:?}"));
            let glyph = face.glyph_index(c).ok_or_else(missing)?;
            let mut flat = Flattened {
                scale,
                shift: pen,
                ..Flattened::default()
            };
            // A space has no outline.
            let drawn = face.outline_glyph(glyph, &mut flat);
            if drawn.is_none() && !c.is_whitespace() {
                return Err(missing());
            }
            outlines.append(&mut flat.outlines);
            let advance = face.glyph_hor_advance(glyph).ok_or_else(missing)?;
            pen += scale * f64::from(advance) + TRACKING * height;
        }
        Ok(Self::centered(outlines))
    }

    /// Sets a dot's number, with a line beneath where it would read as another upside down.
    ///
    /// # Errors
    /// As [`Words::new`].
    pub fn number(dot: usize, height: f64) -> Result<Self> {
        let mut words = Self::new(&dot.to_string(), height)?;
        if !reads_upside_down(dot) {
            return Ok(words);
        }
        let (w, foot) = (words.half_width, -words.half_height - UNDERLINE.1 * height);
        let below = foot - UNDERLINE.0 * height;
        // Reversed as the font's outlines are, which `centered` turns.
        let line = vec![(-w, foot), (w, foot), (w, below), (-w, below)];
        for outline in &mut words.outlines {
            outline.reverse();
        }
        words.outlines.push(line);
        Ok(Self::centered(words.outlines))
    }

    /// An arrow that points upwards, `height` high.
    pub fn arrow(height: f64) -> Self {
        let h = 0.5 * height;
        let corners = [
            (-0.22, -1.0),
            (0.22, -1.0),
            (0.22, 0.15),
            (0.65, 0.15),
            (0.0, 1.0),
            (-0.65, 0.15),
            (-0.22, 0.15),
        ];
        Self {
            outlines: vec![corners.map(|(x, y)| (h * x, h * y)).to_vec()],
            half_width: 0.65 * h,
            half_height: h,
        }
    }

    /// A bar across, `width` by `height`.
    pub fn bar(width: f64, height: f64) -> Self {
        let (w, h) = (0.5 * width, 0.5 * height);
        Self {
            outlines: vec![vec![(-w, -h), (w, -h), (w, h), (-w, h)]],
            half_width: w,
            half_height: h,
        }
    }

    fn centered(mut outlines: Vec<Vec<(f64, f64)>>) -> Self {
        let (mut low, mut high) = ((f64::MAX, f64::MAX), (f64::MIN, f64::MIN));
        for p in outlines.iter().flatten() {
            low = (low.0.min(p.0), low.1.min(p.1));
            high = (high.0.max(p.0), high.1.max(p.1));
        }
        let middle = (0.5 * (low.0 + high.0), 0.5 * (low.1 + high.1));
        for outline in &mut outlines {
            // The font's outer outlines turn clockwise.
            outline.reverse();
            for p in outline {
                *p = (p.0 - middle.0, p.1 - middle.1);
            }
        }
        Self {
            outlines,
            half_width: 0.5 * (high.0 - low.0),
            half_height: 0.5 * (high.1 - low.1),
        }
    }
}

/// Outlines with curves as chords.
#[derive(Default)]
struct Flattened {
    scale: f64,
    shift: f64,
    outlines: Vec<Vec<(f64, f64)>>,
}

impl Flattened {
    fn add(&mut self, x: f64, y: f64) {
        let point = (self.shift + self.scale * x, self.scale * y);
        if let Some(outline) = self.outlines.last_mut() {
            outline.push(point);
        }
    }

    /// The last point, in the font's units.
    fn last(&self) -> (f64, f64) {
        let last = self.outlines.last().and_then(|o| o.last());
        last.map_or((0.0, 0.0), |p| {
            ((p.0 - self.shift) / self.scale, p.1 / self.scale)
        })
    }
}

impl OutlineBuilder for Flattened {
    fn move_to(&mut self, x: f32, y: f32) {
        self.outlines.push(Vec::new());
        self.add(x.into(), y.into());
    }

    fn line_to(&mut self, x: f32, y: f32) {
        self.add(x.into(), y.into());
    }

    fn quad_to(&mut self, x1: f32, y1: f32, x: f32, y: f32) {
        let a = self.last();
        let (b, c) = ((f64::from(x1), f64::from(y1)), (f64::from(x), f64::from(y)));
        for i in 1..=CURVE_FACETS {
            let t = i as f64 / CURVE_FACETS as f64;
            let s = 1.0 - t;
            let mix = |a: f64, b: f64, c: f64| s * s * a + 2.0 * s * t * b + t * t * c;
            self.add(mix(a.0, b.0, c.0), mix(a.1, b.1, c.1));
        }
    }

    fn curve_to(&mut self, x1: f32, y1: f32, x2: f32, y2: f32, x: f32, y: f32) {
        let a = self.last();
        let to = |x: f32, y: f32| (f64::from(x), f64::from(y));
        let (b, c, d) = (to(x1, y1), to(x2, y2), to(x, y));
        for i in 1..=CURVE_FACETS {
            let t = i as f64 / CURVE_FACETS as f64;
            let s = 1.0 - t;
            let mix = |a: f64, b: f64, c: f64, d: f64| {
                s * s * s * a + 3.0 * s * t * (s * b + t * c) + t * t * t * d
            };
            self.add(mix(a.0, b.0, c.0, d.0), mix(a.1, b.1, c.1, d.1));
        }
    }

    fn close(&mut self) {
        // The last point of a closed outline repeats the first.
        if let Some(outline) = self.outlines.last_mut()
            && outline.len() > 1
            && let (Some(first), Some(last)) = (outline.first(), outline.last())
            && (first.0 - last.0).hypot(first.1 - last.1) < 1e-9
        {
            outline.pop();
        }
    }
}
