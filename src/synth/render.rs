//! Renders a scene to an image with its truth.
//!
//! Each pixel is the mean over a grid of rays. Motion is integrated: the exposure is cut into
//! instants, no more than about a pixel of motion (or the lens' blur) apart, at each of which the
//! turned surface is painted anew, and the moved image is added up. The cost grows with the image's
//! pixels, and for the ball with its own pixels times the instants.
//!
//! Under a rolling shutter the same is done row by row, with the ball as it is turned and where it is when the row is exposed.
//!
//! The truth is exact for the scene: no detector, fit or estimate enters it. The perspective of a
//! moved ball is that of mid-exposure.

use super::canvas::{Canvas, Exposure};
use super::color::{Color, luma, mix, scaled};
use super::config::SynthKind;
use super::scene::Scene;
use super::several::{BallImage, ImageOf};
use super::view::{Ellipse, View};
use crate::error::{Error, Result};
use crate::geometry::{Rotation, Vec3};
use crate::image::RgbImage;
use crate::vision::optics::camera::{BallCircle, Camera, Pixel};

/// Maximum number of instants of an exposure.
const MAX_INSTANTS: usize = 24;
/// Motion below this needs one instant, pixels.
const STILL_PX: f64 = 0.3;
/// Steps to the row in which a spot is seen.
const ROW_STEPS: usize = 20;
/// Points of the outline at which its visibility is looked up.
const RIM_POINTS: usize = 360;

/// Minimum cosine at which the surface of a dot to be found is seen.
const MIN_FACING: f64 = 0.12;
/// Minimum contrast of a dot to be found.
const MIN_CONTRAST: f64 = 0.25;

/// A dot as it was drawn, on the part of the ball that is in the camera's sight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrueDot {
    /// Its index in the pattern.
    pub index: usize,
    /// Its middle at the mid-exposure of its row, unit vector, view frame.
    pub direction: Vec3,
    /// Its middle at the mid-exposure of its row, image.
    pub pixel: Pixel,
    /// Its angular radius, radians.
    pub radius_rad: f64,
    /// The cosine at which the surface is seen there: 1 face on, 0 at the horizon.
    pub facing: f64,
    /// How much darker it is than the surface about it, over the ball's own brightness: near 0 for
    /// a dot on a dark logo.
    pub contrast: f64,
    /// Whether its middle lies within the image.
    pub inside: bool,
    /// Whether something before the ball hides its middle.
    pub occluded: bool,
}

impl TrueDot {
    /// Whether a detector should find it: within the image, not hidden, not edge-on, and not on ink
    /// as dark as its own.
    pub fn is_visible(&self) -> bool {
        self.inside && !self.occluded && self.facing >= MIN_FACING && self.contrast >= MIN_CONTRAST
    }
}

/// An image with its truth.
///
/// The *view frame* is the camera's frame, turned by the smallest rotation that lets its z point
/// from the ball's center to the camera: the frame of an observer who does not know where the
/// optical axis is.
///
/// Of a mirrored image, pixels, outline and mask are those of the flipped image; rotations and
/// directions are those of the ball.
#[derive(Debug, Clone, PartialEq)]
pub struct Rendering {
    /// The image.
    pub image: RgbImage,
    /// What is shown.
    pub kind: SynthKind,
    /// The circle nearest to the outline: the same center, the same area.
    pub circle: BallCircle,
    /// The ball's outline at mid-exposure.
    pub outline: Ellipse,
    /// Where the ball's center is seen.
    pub center: Pixel,
    /// The camera.
    pub camera: Camera,
    /// Its distance from the ball's center, ball radii; `None` for parallel rays.
    pub distance: Option<f64>,
    /// Orientation at mid-exposure, pattern to view frame.
    pub rotation: Rotation,
    /// Orientation at mid-exposure, pattern to camera frame.
    pub camera_rotation: Rotation,
    /// Spin, camera frame, rad/s.
    pub spin: Vec3,
    /// The pattern's dots on the part of the ball in the camera's sight, hidden or not.
    pub dots: Vec<TrueDot>,
    /// Maximum of the surface's motion in the image during the exposure, pixels.
    pub blur_px: f64,
    /// Whether the ball has a logo.
    pub has_logo: bool,
    /// Share of each pixel that shows the ball, over the exposure, 0 to 255, row after row.
    pub mask: Vec<u8>,
    /// Share of the outline that is within the image and not hidden.
    pub rim_visible: f64,
    /// Share of the ball's area that is within the image and not hidden.
    pub area_visible: f64,
    /// The further images of balls.
    pub others: Vec<BallRendering>,
}

/// One of several images of balls in a frame; the fields are as in [`Rendering`].
#[derive(Debug, Clone, PartialEq)]
pub struct BallRendering {
    /// Which it is.
    pub of: ImageOf,
    /// Its time after that of the frame's first one, s.
    pub late_s: f64,
    /// The circle nearest to the outline.
    pub circle: BallCircle,
    /// The ball's outline.
    pub outline: Ellipse,
    /// Where the ball's center is seen.
    pub center: Pixel,
    /// Distance of the camera, ball radii.
    pub distance: Option<f64>,
    /// Orientation, pattern to view frame.
    pub rotation: Rotation,
    /// Orientation, pattern to camera frame.
    pub camera_rotation: Rotation,
    /// Spin, camera frame, rad/s.
    pub spin: Vec3,
    /// The pattern's dots on the part of the ball in the camera's sight.
    pub dots: Vec<TrueDot>,
    /// Share of the outline that is within the image and not hidden.
    pub rim_visible: f64,
    /// Share of the area that is within the image and not hidden.
    pub area_visible: f64,
}

impl Scene {
    /// Takes the image.
    ///
    /// # Errors
    /// [`crate::Error::Argument`] where the circle or the camera is not finite or not positive.
    pub fn render(&self) -> Result<Rendering> {
        let seen = |image: Self| Ok((View::new(&image.camera, image.circle)?, image));
        let images: Vec<(View, Self)> =
            self.images().into_iter().map(seen).collect::<Result<_>>()?;
        let (light, shown) = self.expose(&images);
        let image = self.sensor.take(light, self.size, self.noise_seed)?;
        let all = images.iter().zip(&shown);
        let mut balls = all.map(|((view, image), shown)| image.ball_rendering(view, shown));
        let (Some(own), Some((view, _)), Some(shown)) =
            (balls.next(), images.first(), shown.first())
        else {
            return Err(Error::Internal("a scene without a ball".into()));
        };
        let rendering = Rendering {
            image,
            kind: self.kind,
            circle: own.circle,
            outline: own.outline,
            center: own.center,
            camera: self.camera,
            distance: view.distance(),
            rotation: own.rotation,
            camera_rotation: own.camera_rotation,
            spin: own.spin,
            dots: own.dots,
            blur_px: self.blur_px(),
            has_logo: !self.surface.marks.is_empty(),
            mask: shown.iter().map(|s| (255.0 * s).round() as u8).collect(),
            rim_visible: own.rim_visible,
            area_visible: own.area_visible,
            others: balls.collect(),
        };
        if self.mirrored {
            rendering.flipped(self.size[0])
        } else {
            Ok(rendering)
        }
    }

    /// The truth of the scene's own image, of whose pixels the shares `shown` are seen.
    fn ball_rendering(&self, view: &View, shown: &[f32]) -> BallRendering {
        let outline = view.outline();
        let [a, b] = outline.half_axes_px;
        let area: f64 = shown.iter().map(|s| f64::from(*s)).sum();
        BallRendering {
            of: self.image,
            late_s: self.late_s,
            circle: outline.circle(),
            outline,
            center: self.circle.center,
            distance: view.distance(),
            rotation: view.to_view() * self.rotation,
            camera_rotation: self.rotation,
            spin: self.spin,
            dots: self.true_dots(view),
            rim_visible: match self.kind.has_ball() {
                true => self.rim(&outline),
                false => 0.0,
            },
            area_visible: (area / (std::f64::consts::PI * a * b)).min(1.0),
        }
    }

    /// The light on every pixel over the exposure, and for each image of a ball the share that shows it.
    fn expose(&self, images: &[(View, Self)]) -> (Vec<Color>, Vec<Vec<f32>>) {
        let flashes = 1 + images.iter().map(|(_, s)| s.image.flash).max().unwrap_or(0);
        let mut shown = vec![Vec::new(); images.len()];
        let mut light = self.expose_flash(images, 0, flashes, &mut shown);
        for flash in 1..flashes {
            let more = self.expose_flash(images, flash, flashes, &mut shown);
            for (sum, more) in light.iter_mut().flatten().zip(more.iter().flatten()) {
                *sum += more;
            }
        }
        let width = self.size[0];
        for (i, light) in light.iter_mut().enumerate() {
            let (hidden, before) = self.hidden((i % width) as f64, (i / width) as f64);
            if hidden > 0.0 {
                *light = mix(*light, before, hidden);
                for shown in &mut shown {
                    shown[i] *= 1.0 - hidden;
                }
            }
        }
        (light, shown)
    }

    /// The light of one flash of several, which is the whole exposure where there is one.
    fn expose_flash(
        &self,
        images: &[(View, Self)],
        flash: usize,
        flashes: usize,
        shown: &mut [Vec<f32>],
    ) -> Vec<Color> {
        let of_flash = images.iter().enumerate();
        let mut lit: Vec<_> = of_flash
            .filter(|(_, (_, image))| image.image.flash == flash)
            .collect();
        // The nearest ball has the largest outline.
        lit.sort_by(|(_, (_, a)), (_, (_, b))| b.circle.radius.total_cmp(&a.circle.radius));
        let mut front: Option<Exposure> = None;
        for (k, (view, image)) in lit {
            let mut sum = image.expose_alone(view);
            if let Some(front) = &mut front {
                put_behind(front, &mut sum);
                shown[k] = sum.covered;
            } else {
                shown[k].clone_from(&sum.covered);
                front = Some(sum);
            }
        }
        let Exposure { mut light, covered } = front.unwrap_or_else(|| Canvas::blank(self.size));
        let (width, share) = (self.size[0], 1.0 / flashes as f32);
        for (i, (light, covered)) in light.iter_mut().zip(&covered).enumerate() {
            if *covered < 1.0 {
                let behind = self.background.at(i % width, i / width);
                for (l, b) in light.iter_mut().zip(behind) {
                    *l += (1.0 - *covered) * share * b;
                }
            }
        }
        light
    }

    /// The light of the scene's own ball alone.
    fn expose_alone(&self, view: &View) -> Exposure {
        let mut sum = Canvas::blank(self.size);
        if self.kind.has_ball() {
            self.expose_ball(view, &mut sum);
        }
        let width = self.size[0];
        for (i, (light, covered)) in sum.light.iter_mut().zip(&mut sum.covered).enumerate() {
            *covered = covered.min(1.0);
            if *covered > 0.0
                && let Some(occluder) = &self.occluder
            {
                let left = occluder.leaves(self.about_ball((i % width) as f64, (i / width) as f64));
                *light = scaled(*light, left);
            }
        }
        sum
    }

    fn expose_ball(&self, view: &View, sum: &mut Exposure) {
        let blur = self.blur_px();
        let instants = if blur < STILL_PX {
            1
        } else {
            // What the lens blurs needs no finer steps.
            let step = self.sensor.defocus_px.max(1.0);
            (1 + (blur / step).ceil() as usize).min(MAX_INSTANTS)
        };
        let weight = 1.0 / instants as f32;
        let instants = (0..instants).map(|k| (k as f64 + 0.5) / instants as f64 - 0.5);
        let mut canvas = Canvas::new(self, view);
        if self.row_s > 0.0 {
            for row in 0..self.size[1] {
                for t in instants.clone() {
                    let late_s = self.late_s(row as f64) + self.exposure_s * t;
                    let shift = self.velocity_px_s.map(|v| v * late_s);
                    let rows = canvas.rows_of(row, shift[1]);
                    if !rows.is_empty() {
                        canvas.paint(rows.clone(), self, view, &self.turned(late_s));
                        canvas.add(rows, shift, weight, self.size, sum);
                    }
                }
            }
            return;
        }
        for t in instants {
            let rows = canvas.all_rows();
            canvas.paint(rows.clone(), self, view, &self.turned(self.exposure_s * t));
            let shift = self.shift_px.map(|s| s * t);
            canvas.add(rows, shift, weight, self.size, sum);
        }
    }

    /// How much later than that of the ball's center a row is exposed, s.
    fn late_s(&self, row: f64) -> f64 {
        self.row_s * (row - self.circle.center.v)
    }

    /// The orientation so much later.
    fn turned(&self, late_s: f64) -> Rotation {
        Rotation::from_scaled_axis(self.spin * late_s) * self.rotation
    }

    /// The middle of a spot (camera frame) and its pixel when its own row is exposed.
    fn seen(&self, view: &View, middle: &Vec3) -> (Vec3, Pixel) {
        let at = |late_s: f64| {
            let n = self.turned(late_s) * middle;
            let pixel = view.project(&n);
            let [u, v] = self.velocity_px_s.map(|v| v * late_s);
            (
                n,
                Pixel {
                    u: pixel.u + u,
                    v: pixel.v + v,
                },
            )
        };
        // A fixed point: the surface is slower than the shutter.
        let steps = if self.row_s > 0.0 { ROW_STEPS } else { 0 };
        (0..steps).fold(at(0.0), |(_, pixel), _| at(self.late_s(pixel.v)))
    }

    /// How much of a pixel is hidden by what is before the ball, and by which light.
    fn hidden(&self, u: f64, v: f64) -> (f32, Color) {
        let Some(occluder) = &self.occluder else {
            return (0.0, [0.0; 3]);
        };
        occluder.at(self.about_ball(u, v), (1.0 / self.circle.radius) as f32)
    }

    /// A pixel about the ball's center, ball radii.
    fn about_ball(&self, u: f64, v: f64) -> [f32; 2] {
        let BallCircle { center, radius, .. } = self.circle;
        [(u - center.u) / radius, (v - center.v) / radius].map(|x| x as f32)
    }

    /// Whether a point of the image lies within it, and whether it is hidden.
    pub(super) fn inside_and_hidden(&self, Pixel { u, v }: Pixel) -> [bool; 2] {
        let within = |x: f64, side: usize| (-0.5..=side as f64 - 0.5).contains(&x);
        let inside = within(u, self.size[0]) && within(v, self.size[1]);
        let hides = |other: &BallImage| {
            let BallCircle { center, radius, .. } = other.circle;
            other.hides(self.image, &self.circle) && (u - center.u).hypot(v - center.v) < radius
        };
        let is_hidden = self.hidden(u, v).0 > 0.5 || self.others.iter().any(hides);
        [inside, is_hidden]
    }

    pub(super) fn rim(&self, outline: &Ellipse) -> f64 {
        let seen = (0..RIM_POINTS).filter(|k| {
            let t = std::f64::consts::TAU * *k as f64 / RIM_POINTS as f64;
            self.inside_and_hidden(outline.point(t)) == [true, false]
        });
        seen.count() as f64 / RIM_POINTS as f64
    }

    pub(super) fn true_dots(&self, view: &View) -> Vec<TrueDot> {
        let ball = luma(self.surface.ball);
        let to_view = view.to_view();
        let dots = self.surface.dots.iter().enumerate();
        dots.filter_map(|(index, spot)| {
            let spot = (*spot)?;
            let (n, pixel) = self.seen(view, &spot.middle);
            let facing = view.facing(&n);
            if facing <= 0.0 {
                return None;
            }
            let under = luma(self.surface.under(&spot.middle));
            let over = under + spot.darkness * (luma(self.surface.ink) - under);
            let [inside, occluded] = self.inside_and_hidden(pixel);
            Some(TrueDot {
                index,
                direction: to_view * n,
                pixel,
                radius_rad: spot.radius,
                facing,
                contrast: f64::from((under - over) / ball),
                inside,
                occluded,
            })
        })
        .collect()
    }
}

/// Adds the light of a ball behind others, and leaves of it what is seen.
fn put_behind(front: &mut Exposure, behind: &mut Exposure) {
    let seen = front.light.iter_mut().zip(&mut front.covered);
    let hidden = behind.light.iter().zip(&mut behind.covered);
    for ((light, covered), (more, share)) in seen.zip(hidden) {
        let left = 1.0 - *covered;
        for (l, m) in light.iter_mut().zip(more) {
            *l += left * m;
        }
        *share *= left;
        *covered += *share;
    }
}

impl Rendering {
    /// The image flipped left to right.
    fn flipped(mut self, width: usize) -> Result<Self> {
        let flip = |p: Pixel| Pixel {
            u: width as f64 - 1.0 - p.u,
            v: p.v,
        };
        let mut values = self.image.values().to_vec();
        values.chunks_exact_mut(width).for_each(<[_]>::reverse);
        self.mask.chunks_exact_mut(width).for_each(<[_]>::reverse);
        self.image = RgbImage::new(width, self.image.height(), values)?;
        self.circle.center = flip(self.circle.center);
        self.outline.center = flip(self.outline.center);
        self.outline.angle_rad = std::f64::consts::PI - self.outline.angle_rad;
        self.center = flip(self.center);
        if let Camera::Perspective(k) = &mut self.camera {
            k.cx = width as f64 - 1.0 - k.cx;
        }
        for dot in &mut self.dots {
            dot.pixel = flip(dot.pixel);
        }
        for ball in &mut self.others {
            ball.circle.center = flip(ball.circle.center);
            ball.outline.center = flip(ball.outline.center);
            ball.outline.angle_rad = std::f64::consts::PI - ball.outline.angle_rad;
            ball.center = flip(ball.center);
            for dot in &mut ball.dots {
                dot.pixel = flip(dot.pixel);
            }
        }
        Ok(self)
    }
}
