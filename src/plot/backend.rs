//! Where plots are drawn: pixels for PNG files, or shapes for SVG files.
//!
//! Both are plotters' own. Shaded surfaces are set pixel by pixel; an SVG keeps these in one picture
//! beneath its shapes.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use plotters::backend::{BitMapBackend, DrawingBackend, SVGBackend};
use plotters_backend::{
    BackendColor, BackendCoord, BackendStyle, BackendTextStyle, DrawingErrorKind, FontTransform,
};

/// A failure of either backend, in words.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub(super) struct BackendError(String);

type Outcome<T = ()> = Result<T, DrawingErrorKind<BackendError>>;

fn unified<E: std::error::Error + Send + Sync>(
    error: DrawingErrorKind<E>,
) -> DrawingErrorKind<BackendError> {
    match error {
        DrawingErrorKind::DrawingError(e) => {
            DrawingErrorKind::DrawingError(BackendError(e.to_string()))
        }
        DrawingErrorKind::FontError(e) => DrawingErrorKind::FontError(e),
    }
}

/// Pixels or shapes.
pub(super) enum Backend<'a> {
    /// Pixels, RGB.
    Bitmap(BitMapBackend<'a>),
    /// Shapes, and beneath them pixels, RGBA.
    Svg(SVGBackend<'a>, &'a mut [u8]),
}

/// Calls the same method of either backend.
macro_rules! either {
    ($self:expr, $backend:ident => $call:expr) => {
        match $self {
            Backend::Bitmap($backend) => $call.map_err(unified),
            Backend::Svg($backend, _) => $call.map_err(unified),
        }
    };
}

/// How far the SVG backend sets text lower than the bitmap one, as a fraction of its size: their
/// sizes of an em differ as well.
const SVG_TEXT_LOWER: f64 = 0.132;

impl DrawingBackend for Backend<'_> {
    type ErrorType = BackendError;

    fn get_size(&self) -> (u32, u32) {
        match self {
            Backend::Bitmap(backend) => backend.get_size(),
            Backend::Svg(backend, _) => backend.get_size(),
        }
    }

    fn ensure_prepared(&mut self) -> Outcome {
        either!(self, backend => backend.ensure_prepared())
    }

    fn present(&mut self) -> Outcome {
        either!(self, backend => backend.present())
    }

    fn draw_pixel(&mut self, (x, y): BackendCoord, color: BackendColor) -> Outcome {
        let (width, height) = self.get_size();
        match self {
            Backend::Bitmap(backend) => backend.draw_pixel((x, y), color).map_err(unified),
            Backend::Svg(_, pixels) => {
                if (0..width as i32).contains(&x) && (0..height as i32).contains(&y) {
                    let at = 4 * (y as usize * width as usize + x as usize);
                    let (r, g, b) = color.rgb;
                    let alpha = (255.0 * color.alpha).round() as u8;
                    pixels[at..at + 4].copy_from_slice(&[r, g, b, alpha]);
                }
                Ok(())
            }
        }
    }

    fn draw_line<S: BackendStyle>(
        &mut self,
        from: BackendCoord,
        to: BackendCoord,
        style: &S,
    ) -> Outcome {
        either!(self, backend => backend.draw_line(from, to, style))
    }

    fn draw_rect<S: BackendStyle>(
        &mut self,
        upper_left: BackendCoord,
        bottom_right: BackendCoord,
        style: &S,
        fill: bool,
    ) -> Outcome {
        either!(self, backend => backend.draw_rect(upper_left, bottom_right, style, fill))
    }

    fn draw_path<S: BackendStyle, I: IntoIterator<Item = BackendCoord>>(
        &mut self,
        path: I,
        style: &S,
    ) -> Outcome {
        either!(self, backend => backend.draw_path(path, style))
    }

    fn draw_circle<S: BackendStyle>(
        &mut self,
        center: BackendCoord,
        radius: u32,
        style: &S,
        fill: bool,
    ) -> Outcome {
        either!(self, backend => backend.draw_circle(center, radius, style, fill))
    }

    fn fill_polygon<S: BackendStyle, I: IntoIterator<Item = BackendCoord>>(
        &mut self,
        vertices: I,
        style: &S,
    ) -> Outcome {
        either!(self, backend => backend.fill_polygon(vertices, style))
    }

    fn draw_text<S: BackendTextStyle>(
        &mut self,
        text: &str,
        style: &S,
        pos: BackendCoord,
    ) -> Outcome {
        let lower = (SVG_TEXT_LOWER * style.size()).round() as i32;
        match self {
            Backend::Bitmap(backend) => backend.draw_text(text, style, pos).map_err(unified),
            Backend::Svg(backend, _) => {
                let pos = match style.transform() {
                    FontTransform::None => (pos.0, pos.1 - lower),
                    _ => pos,
                };
                backend.draw_text(text, style, pos).map_err(unified)
            }
        }
    }
}

/// What plotters wrote as an SVG file of `size` (width, height; pixels) whose text is set in `fonts`,
/// with `png` beneath its shapes where there is one.
pub(super) fn svg_file(
    drawn: &str,
    size: (u32, u32),
    own_font: &str,
    fonts: &str,
    png: Option<&[u8]>,
) -> Option<String> {
    // <svg width="2000" height="1280" viewBox="0 0 2000 1280" xmlns="...">
    let (head, body) = drawn.split_once('>')?;
    let view = &head[head.find("viewBox")?..];
    let (width, height) = size;
    let mut file = format!("<svg width=\"{width}\" height=\"{height}\" {view}>\n");
    file.push_str("<rect width=\"100%\" height=\"100%\" fill=\"#FFFFFF\"/>\n");
    if let Some(png) = png {
        file.push_str("<image width=\"100%\" height=\"100%\" href=\"data:image/png;base64,");
        STANDARD.encode_string(png, &mut file);
        file.push_str("\"/>\n");
    }
    file.push_str(body.trim_start());
    Some(file.replace(own_font, fonts))
}
