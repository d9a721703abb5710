//! What is kept of an image: the pixels about the ball.

use std::sync::Arc;

use crate::image::{GrayImage, ImageView, Roi};
use crate::vision::frame::outline::Outline;
use crate::vision::optics::camera::BallCircle;
use crate::vision::optics::grid::Grid;

/// Pixels so far from the center are kept, radii: the outline may turn out to lie elsewhere.
const MARGIN: f64 = 1.25;
/// Balls of a larger radius, pixels, are halved: no face has more values.
const MAX_RADIUS: f64 = 128.0;

/// What a frame shows of a painted ball; nothing by default.
#[derive(Debug, Clone, Default)]
pub struct PaintedFrame(Option<Arc<KeptFrame>>);

#[derive(Debug, Clone)]
struct KeptFrame {
    values: Vec<u8>,
    size: [usize; 2],
    grid: Grid,
    circle: BallCircle,
    /// Standard deviation of the circle's center, pixels.
    sigma_px: f64,
}

impl PaintedFrame {
    /// Of an image (values 0 to 1) and the ball's outline in it.
    pub fn take<'a>(image: impl Into<ImageView<'a>>, outline: &Outline) -> Self {
        let image = image.into();
        let circle = outline.circle;
        let mut level = 0;
        while circle.radius / f64::from(1u32 << level) > MAX_RADIUS && level < 8 {
            level += 1;
        }
        let side = 1usize << level;
        let reach = MARGIN * circle.radius;
        let range = |center: f64, length: usize| {
            let low = (center - reach).floor().clamp(0.0, length as f64) as usize;
            let high = (center + reach).ceil().clamp(0.0, length as f64) as usize;
            (low, high.saturating_sub(low) / side)
        };
        let (left, width) = range(circle.center.u, image.width());
        let (top, height) = range(circle.center.v, image.height());
        if width < 8 || height < 8 {
            return Self::default();
        }
        let part = Roi {
            left,
            top,
            width: width * side,
            height: height * side,
        };
        let mut gray = GrayImage::default();
        image.shrink_into(&part, level, &mut gray);
        let values = gray.values().iter();
        let values = values.map(|value| (255.0 * value).round().clamp(0.0, 255.0) as u8);
        let center = outline.covariance.fixed_view::<2, 2>(0, 0);
        Self(Some(Arc::new(KeptFrame {
            values: values.collect(),
            size: [width, height],
            grid: Grid::of(&part, level),
            circle,
            sigma_px: (0.5 * center.trace()).max(0.0).sqrt(),
        })))
    }

    /// Bytes that it takes.
    pub fn bytes(&self) -> usize {
        let pixels = self.0.as_ref().map_or(0, |kept| kept.values.len());
        size_of::<Self>() + pixels
    }

    /// The ball's diameter, pixels of the image, where it was found.
    pub fn diameter_px(&self) -> Option<f64> {
        self.0.as_ref().map(|kept| 2.0 * kept.circle.radius)
    }

    /// The outline, and the standard deviation of its center, pixels of the image.
    pub(crate) fn circle(&self) -> Option<(BallCircle, f64)> {
        self.0.as_ref().map(|kept| (kept.circle, kept.sigma_px))
    }

    /// The pixels, 0 to 1, and where they lie in the image.
    pub(crate) fn image(&self) -> Option<(GrayImage, Grid)> {
        let kept = self.0.as_ref()?;
        let [width, height] = kept.size;
        let values = kept.values.iter().map(|value| f32::from(*value) / 255.0);
        let image = GrayImage::new(width, height, values.collect()).ok()?;
        Some((image, kept.grid))
    }
}
