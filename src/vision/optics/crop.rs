//! Parts of a frame that are searched, converted.

use super::camera::Pixel;
use super::grid::Grid;
use crate::image::{GrayImage, ImageView, RgbImage, Roi};

/// A part of a frame, converted.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Crop<'a> {
    pub image: ImageView<'a>,
    pub gray: &'a GrayImage,
    /// Where its pixels lie in the frame.
    pub grid: Grid,
    /// Columns and rows of the frame.
    pub size: [usize; 2],
}

impl Crop<'_> {
    /// The middle of the frame, in pixels of the crop.
    pub fn middle(&self) -> Pixel {
        let [width, height] = self.size.map(|s| 0.5 * (s as f64 - 1.0));
        self.grid.pixel_to_part(Pixel {
            u: width,
            v: height,
        })
    }
}

/// The images that a frame is converted into; their memory is reused.
#[derive(Debug, Default)]
pub(crate) struct Images {
    /// A part of the frame, or the frame itself where it came as bytes.
    part_gray: GrayImage,
    part_color: RgbImage,
    /// Gray of a part in colors.
    pub gray: GrayImage,
}

impl Images {
    /// Hands a part of a frame, halved so often, to `work`, converted.
    pub fn view<T>(
        &mut self,
        image: ImageView<'_>,
        part: &Roi,
        level: u32,
        work: impl FnOnce(Crop<'_>) -> T,
    ) -> T {
        let is_whole = *part == Roi::whole(image.width(), image.height());
        let (gray, color) = (&mut self.part_gray, &mut self.part_color);
        let seen = match image {
            _ if level > 0 => image.shrunk(part, level, gray, color),
            ImageView::Gray(_) | ImageView::Color(_) if is_whole => image,
            _ => image.part(part, gray, color),
        };
        if let ImageView::Color(color) = seen {
            color.to_gray_into(&mut self.gray);
        }
        work(Crop {
            image: seen,
            gray: match seen {
                ImageView::Gray(gray) => gray,
                _ => &self.gray,
            },
            grid: Grid::of(part, level),
            size: [image.width(), image.height()],
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Pixels are counted from their middles: of 9 x 5 the middle is that of the pixel (4, 2).
    #[test]
    fn the_middle_of_a_frame_is_that_of_its_middle_pixel() {
        let frame = GrayImage::new(9, 5, vec![0.5; 45]).expect("an image");
        let part = Roi {
            left: 2,
            top: 1,
            width: 6,
            height: 4,
        };
        let middle = |level| {
            let seen = ImageView::Gray(&frame);
            Images::default().view(seen, &part, level, |crop| crop.middle())
        };
        assert_eq!(middle(0), Pixel { u: 2.0, v: 1.0 });
        // A pixel of the half image has its middle between two of the whole one.
        assert_eq!(middle(1), Pixel { u: 0.75, v: 0.25 });
    }
}
