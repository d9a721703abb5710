//! An image as it is there: gray, in colors, or the samples of a camera.

use super::{GrayImage, RawImage, RawPixel, RgbImage, Roi, luma};

/// A frame as it comes from the camera.
#[derive(Debug, Clone, Copy)]
pub enum ImageView<'a> {
    /// Brightness alone.
    Gray(&'a GrayImage),
    /// Colors: where brightness does not show the ball's outline, they may.
    Color(&'a RgbImage),
    /// Samples as they came: what is not looked at is not converted.
    Raw(RawImage<'a>),
}

impl ImageView<'_> {
    /// Columns.
    pub fn width(&self) -> usize {
        match self {
            Self::Gray(image) => image.width(),
            Self::Color(image) => image.width(),
            Self::Raw(image) => image.width(),
        }
    }

    /// Rows.
    pub fn height(&self) -> usize {
        match self {
            Self::Gray(image) => image.height(),
            Self::Color(image) => image.height(),
            Self::Raw(image) => image.height(),
        }
    }

    /// A part of it, in colors where it has some, copied into the memory at hand.
    pub(crate) fn part<'b>(
        &self,
        part: &Roi,
        gray: &'b mut GrayImage,
        color: &'b mut RgbImage,
    ) -> ImageView<'b> {
        let Roi {
            left,
            top,
            width,
            height,
        } = *part;
        match self {
            Self::Gray(image) => gray.fill_rows(width, height, |v, values| {
                values.extend_from_slice(image.row(top + v, left, width));
            }),
            Self::Color(image) => {
                color.fill_rows(width, height, |v, values| {
                    values.extend_from_slice(image.row(top + v, left, width));
                });
                return ImageView::Color(color);
            }
            Self::Raw(image) if image.pixel() == RawPixel::Gray => image.gray_into(part, gray),
            Self::Raw(image) => {
                image.color_into(part, color);
                return ImageView::Color(color);
            }
        }
        ImageView::Gray(gray)
    }

    /// A part of it in gray, each value the mean of a square of `2^level` pixels; what does not fill a square at the
    /// right and at the bottom is left out.
    pub(crate) fn shrink_into(&self, part: &Roi, level: u32, out: &mut GrayImage) {
        let side = 1usize << level;
        let (width, height) = (part.width >> level, part.height >> level);
        let area = 1.0 / (side * side) as f32;
        out.fill_rows(width, height, |v, values| {
            let from = values.len();
            values.resize(from + width, 0.0);
            let sums = &mut values[from..];
            let top = part.top + side * v;
            match self {
                Self::Gray(image) => {
                    for row in (top..top + side).map(|v| image.row(v, part.left, width * side)) {
                        for (sum, cell) in sums.iter_mut().zip(row.chunks_exact(side)) {
                            *sum += cell.iter().sum::<f32>();
                        }
                    }
                }
                Self::Color(image) => {
                    for row in (top..top + side).map(|v| image.row(v, part.left, width * side)) {
                        for (sum, cell) in sums.iter_mut().zip(row.chunks_exact(side)) {
                            *sum += cell.iter().map(|c| luma(*c)).sum::<f32>();
                        }
                    }
                }
                // Summed as integers: samples of 8 and of 16 bits with the same values have the same mean.
                Self::Raw(image) => return image.cell_row(top, part.left, level, sums),
            }
            sums.iter_mut().for_each(|sum| *sum *= area);
        });
    }

    /// A part of it, each value the mean of a square of `2^level` pixels, in colors where it has some, written into the
    /// memory at hand.
    pub(crate) fn shrunk<'b>(
        &self,
        part: &Roi,
        level: u32,
        gray: &'b mut GrayImage,
        color: &'b mut RgbImage,
    ) -> ImageView<'b> {
        let side = 1usize << level;
        let white = match self {
            Self::Color(_) => 1.0,
            Self::Raw(image) if image.pixel() != RawPixel::Gray => image.white(),
            Self::Raw(_) | Self::Gray(_) => {
                self.shrink_into(part, level, gray);
                return ImageView::Gray(gray);
            }
        };
        let area = 1.0 / ((side * side) as f32 * white);
        let (width, height) = (part.width >> level, part.height >> level);
        color.fill_rows(width, height, |v, values| {
            let from = values.len();
            values.resize(from + width, [0.0; 3]);
            let sums = &mut values[from..];
            for row in (0..side).map(|k| part.top + side * v + k) {
                match self {
                    Self::Color(image) => {
                        let row = image.row(row, part.left, width * side);
                        for (sum, cell) in sums.iter_mut().zip(row.chunks_exact(side)) {
                            for color in cell {
                                (0..3).for_each(|c| sum[c] += color[c]);
                            }
                        }
                    }
                    Self::Raw(image) => image.add_colors(row, part.left, level, sums),
                    Self::Gray(_) => {}
                }
            }
            for value in sums.iter_mut().flatten() {
                *value *= area;
            }
        });
        ImageView::Color(color)
    }
}

impl<'a> From<RawImage<'a>> for ImageView<'a> {
    fn from(image: RawImage<'a>) -> Self {
        Self::Raw(image)
    }
}

impl<'a> From<&'a GrayImage> for ImageView<'a> {
    fn from(image: &'a GrayImage) -> Self {
        Self::Gray(image)
    }
}

impl<'a> From<&'a RgbImage> for ImageView<'a> {
    fn from(image: &'a RgbImage) -> Self {
        Self::Color(image)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whatever the samples are, a value is the mean of the colors of four pixels.
    #[test]
    fn shrunk_colors_are_means() {
        let (width, height) = (6, 4);
        let bytes: Vec<u8> = (0..3 * width * height)
            .map(|k| (k * 37 % 256) as u8)
            .collect();
        let words: Vec<u16> = bytes.iter().map(|b| 257 * u16::from(*b)).collect();
        let part = Roi {
            left: 1,
            top: 1,
            width: 4,
            height: 2,
        };
        for pixel in [RawPixel::Rgb, RawPixel::Bgr] {
            let eight = RawImage::new(width, height, pixel, &bytes).expect("an image");
            let sixteen = RawImage::new(width, height, pixel, &words).expect("an image");
            let color = eight.to_rgb();
            for view in [eight.into(), sixteen.into(), ImageView::Color(&color)] {
                let (mut gray, mut shrunk) = (GrayImage::default(), RgbImage::default());
                let view: ImageView<'_> = view;
                view.shrunk(&part, 1, &mut gray, &mut shrunk);
                assert_eq!((shrunk.width(), shrunk.height()), (2, 1));
                for (u, found) in shrunk.row(0, 0, 2).iter().enumerate() {
                    let near = [0, 1, 2, 3].map(|k| color.row(1 + k / 2, 1 + 2 * u + k % 2, 1)[0]);
                    for c in 0..3 {
                        let mean = near.iter().map(|color| color[c]).sum::<f32>() / 4.0;
                        assert!((found[c] - mean).abs() < 1e-6, "{} for {mean}", found[c]);
                    }
                }
            }
        }
    }
}
