//! From a scene to an image.
//!
//! Each pixel is the mean over a grid of rays. A ray that meets the ball gives the normal there; the light is
//!
//! `albedo (ambient + diffuse max(0, n . l)) (1 - 0.25 (1 - n_z)) + gloss max(0, n . h)^m`,
//!
//! (Lambert, a little darker towards the limb, and Blinn's highlight, J. F. Blinn, SIGGRAPH 1977). Motion is integrated: the exposure
//! is cut into instants, no more than about a pixel of motion apart, at each of which the turned surface is painted
//! anew, and the moved image is added up.

use super::scene::{Background, Light, Scene, luma};
use super::surface::{Mark, Spot};
use crate::error::Result;
use crate::geometry::{Rotation, Vec3};
use crate::vision::camera::{BallCircle, BallView, Pixel};
use crate::vision::image::RgbImage;

/// Most instants of an exposure.
const MAX_INSTANTS: usize = 24;
/// Motion below this needs one instant, pixels.
const STILL_PX: f64 = 0.3;
/// Darkening at the limb.
const LIMB: f32 = 0.25;

/// Least z of a dot that must be found.
const MIN_DEPTH: f64 = 0.12;
/// Least contrast of a dot that must be found.
const MIN_CONTRAST: f64 = 0.25;

/// A dot as it was drawn, on the side that faces the camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrueDot {
    /// Its index in the pattern.
    pub index: usize,
    /// Its middle at mid-exposure, unit vector, view frame.
    pub direction: Vec3,
    /// Its middle at mid-exposure, image.
    pub pixel: Pixel,
    /// Its angular radius, radians.
    pub radius_rad: f64,
    /// How much darker it is than the surface about it, over the ball's own brightness: near 0 for a dot on a dark logo.
    pub contrast: f64,
}

impl TrueDot {
    /// Whether a detector should find it: nearer to the limb, or on ink as dark as its own, nobody can say.
    pub fn is_visible(&self) -> bool {
        self.direction.z >= MIN_DEPTH && self.contrast >= MIN_CONTRAST
    }
}

/// An image with its truth.
#[derive(Debug, Clone, PartialEq)]
pub struct Rendering {
    /// The image.
    pub image: RgbImage,
    /// The ball's outline at mid-exposure.
    pub circle: BallCircle,
    /// Orientation at mid-exposure, pattern to view frame.
    pub rotation: Rotation,
    /// Spin, view frame, rad/s.
    pub spin: Vec3,
    /// The dots on the side that faces the camera.
    pub dots: Vec<TrueDot>,
    /// Most that the surface moved in the image during the exposure, pixels.
    pub blur_px: f64,
    /// Whether the ball has a logo.
    pub has_logo: bool,
}

impl Scene {
    /// Takes the image.
    ///
    /// # Errors
    /// [`crate::Error::Argument`] where the circle is not finite or empty.
    pub fn render(&self) -> Result<Rendering> {
        let view = BallView::new(&self.camera(), self.circle)?;
        let light = Canvas::new(self, &view).expose(self, &view);
        let image = self.sensor.take(&light, self.size, self.noise_seed)?;
        Ok(Rendering {
            image,
            circle: self.circle,
            rotation: self.rotation,
            spin: self.spin,
            dots: self.true_dots(&view),
            blur_px: self.blur_px(),
            has_logo: self.surface.mark.is_some(),
        })
    }

    fn true_dots(&self, view: &BallView) -> Vec<TrueDot> {
        let ball = luma(self.surface.ball);
        let dots = self.surface.dots.iter().enumerate();
        dots.filter_map(|(index, spot)| {
            let spot = (*spot)?;
            let direction = self.rotation * spot.middle;
            if direction.z <= view.horizon() {
                return None;
            }
            let under = match &self.surface.mark {
                Some(mark) => {
                    let ink = mark.ink(&spot.middle);
                    ball + ink * (luma(mark.color) - ball)
                }
                None => ball,
            };
            let over = under + spot.darkness * (luma(self.surface.ink) - under);
            Some(TrueDot {
                index,
                direction,
                pixel: view.project(&direction),
                radius_rad: spot.radius,
                contrast: f64::from((under - over) / ball),
            })
        })
        .collect()
    }
}

impl Mark {
    /// Ink at a direction (pattern's frame), in [0, 1].
    fn ink(&self, direction: &Vec3) -> f32 {
        ink_at(
            self,
            direction.dot(&self.middle) as f32,
            direction.dot(&self.axes[0]) as f32,
            direction.dot(&self.axes[1]) as f32,
        )
    }
}

/// Ink of a mark where a direction has these components along its middle and its axes.
fn ink_at(mark: &Mark, along: f32, a: f32, b: f32) -> f32 {
    let across = (a * a + b * b).sqrt();
    let angle = across.atan2(along);
    let scale = if across > 1e-6 { angle / across } else { 1.0 } / mark.radius as f32;
    mark.logo.ink(a * scale, b * scale)
}

/// Rays, a grid of `fine` x `fine` a pixel, with a margin for the ball's motion.
struct Canvas {
    fine: usize,
    /// Margin, pixels.
    margin: usize,
    columns: usize,
    rows: usize,
    /// Normals where a ray meets the ball; z is 0 elsewhere.
    normals: Vec<[f32; 3]>,
    /// Factor on the albedo, and highlight.
    shade: Vec<[f32; 2]>,
    albedo: Vec<[f32; 3]>,
}

impl Canvas {
    fn new(scene: &Scene, view: &BallView) -> Self {
        let fine = if scene.circle.radius < 25.0 { 3 } else { 2 };
        let [du, dv] = scene.shift_px;
        let margin = (0.5 * du.abs().max(dv.abs())).ceil() as usize + 1;
        let [width, height] = scene.size;
        let (columns, rows) = ((width + 2 * margin) * fine, (height + 2 * margin) * fine);
        let mut canvas = Self {
            fine,
            margin,
            columns,
            rows,
            normals: vec![[0.0; 3]; columns * rows],
            shade: vec![[0.0; 2]; columns * rows],
            albedo: vec![[0.0; 3]; columns * rows],
        };
        let half = (scene.light.from + Vec3::z()).normalize();
        for row in 0..rows {
            for column in 0..columns {
                let pixel = Pixel {
                    u: canvas.position(column),
                    v: canvas.position(row),
                };
                if let Some(n) = normal_at(view, pixel) {
                    let at = row * columns + column;
                    canvas.normals[at] = [n.x as f32, n.y as f32, n.z as f32];
                    canvas.shade[at] = shade(&scene.light, &half, &n);
                }
            }
        }
        canvas
    }

    /// Position of a ray's column or row in the image.
    fn position(&self, ray: usize) -> f64 {
        (ray as f64 + 0.5) / self.fine as f64 - 0.5 - self.margin as f64
    }

    /// The light on every pixel over the exposure.
    fn expose(&mut self, scene: &Scene, view: &BallView) -> Vec<[f32; 3]> {
        let blur = scene.blur_px();
        let instants = if blur < STILL_PX {
            1
        } else {
            (1 + blur.ceil() as usize).min(MAX_INSTANTS)
        };
        let [width, height] = scene.size;
        let mut sum = vec![[0.0f32; 3]; width * height];
        let background: Vec<[f32; 3]> = (0..width * height)
            .map(|i| scene.background.at(i % width, i / width, width, height))
            .collect();
        for instant in 0..instants {
            let t = (instant as f64 + 0.5) / instants as f64 - 0.5;
            let turn = Rotation::from_scaled_axis(scene.spin * (scene.exposure_s * t));
            self.paint(scene, view, &(turn * scene.rotation));
            let shift = scene
                .shift_px
                .map(|s| (s * t * self.fine as f64).round() as isize);
            self.add(&background, shift, [width, height], &mut sum);
        }
        let weight = 1.0 / (instants * self.fine * self.fine) as f32;
        for pixel in &mut sum {
            *pixel = pixel.map(|c| c * weight);
        }
        sum
    }

    /// Adds the painted ball, moved by `shift` rays, to the image.
    fn add(
        &self,
        background: &[[f32; 3]],
        shift: [isize; 2],
        [width, height]: [usize; 2],
        sum: &mut [[f32; 3]],
    ) {
        let start = (self.margin * self.fine) as isize;
        for v in 0..height {
            for u in 0..width {
                let behind = background[v * width + u];
                let total = &mut sum[v * width + u];
                for j in 0..self.fine {
                    let row = start + (v * self.fine + j) as isize - shift[1];
                    for i in 0..self.fine {
                        let column = start + (u * self.fine + i) as isize - shift[0];
                        let at = row as usize * self.columns + column as usize;
                        if self.normals[at][2] > 0.0 {
                            let [factor, gloss] = self.shade[at];
                            for (sum, albedo) in total.iter_mut().zip(self.albedo[at]) {
                                *sum += albedo * factor + gloss;
                            }
                        } else {
                            for (sum, light) in total.iter_mut().zip(behind) {
                                *sum += light;
                            }
                        }
                    }
                }
            }
        }
    }

    /// Paints the surface, turned, over all rays.
    fn paint(&mut self, scene: &Scene, view: &BallView, rotation: &Rotation) {
        self.albedo.fill(scene.surface.ball);
        if let Some(mark) = &scene.surface.mark {
            self.paint_mark(mark, view, rotation);
        }
        for stain in &scene.surface.stains {
            self.paint_spot(stain, [0.1, 0.08, 0.06], view, rotation);
        }
        for spot in scene.surface.dots.iter().flatten() {
            self.paint_spot(spot, scene.surface.ink, view, rotation);
        }
    }

    fn paint_spot(&mut self, spot: &Spot, ink: [f32; 3], view: &BallView, rotation: &Rotation) {
        let middle = rotation * spot.middle;
        let m = [middle.x as f32, middle.y as f32, middle.z as f32];
        let outer = spot.radius + spot.softness;
        let low = outer.cos() as f32;
        let inner = (spot.radius - spot.softness).max(0.0).cos() as f32;
        let scale = 1.0 / (inner - low).max(1e-6);
        let [us, vs] = self.window(&middle, outer, view);
        for row in vs {
            for column in us.clone() {
                let at = row * self.columns + column;
                let n = self.normals[at];
                let cos = n[0] * m[0] + n[1] * m[1] + n[2] * m[2];
                if cos > low {
                    let covered = spot.darkness * ((cos - low) * scale).min(1.0);
                    for (albedo, ink) in self.albedo[at].iter_mut().zip(ink) {
                        *albedo += covered * (ink - *albedo);
                    }
                }
            }
        }
    }

    fn paint_mark(&mut self, mark: &Mark, view: &BallView, rotation: &Rotation) {
        let middle = rotation * mark.middle;
        let reach = 1.45 * mark.radius;
        let axes = mark.axes.map(|a| rotation * a);
        let part =
            |n: [f32; 3], v: &Vec3| n[0] * v.x as f32 + n[1] * v.y as f32 + n[2] * v.z as f32;
        let low = reach.min(3.0).cos() as f32;
        let [us, vs] = self.window(&middle, reach, view);
        for row in vs {
            for column in us.clone() {
                let at = row * self.columns + column;
                let n = self.normals[at];
                let along = part(n, &middle);
                if along > low && n[2] > 0.0 {
                    let covered = ink_at(mark, along, part(n, &axes[0]), part(n, &axes[1]));
                    for (albedo, ink) in self.albedo[at].iter_mut().zip(mark.color) {
                        *albedo += covered * (ink - *albedo);
                    }
                }
            }
        }
    }

    /// Columns and rows of rays that may meet the cap of the given angular radius.
    fn window(&self, middle: &Vec3, angle: f64, view: &BallView) -> [std::ops::Range<usize>; 2] {
        // A cap wholly on the far side is not seen.
        if middle.z < -angle.sin() {
            return [0..0, 0..0];
        }
        let at = view.project(middle);
        // Perspective enlarges what is near, by a third at most.
        let reach = 1.4 * angle.min(1.6) * view.circle().radius + 1.0;
        let range = |x: f64, most: usize| {
            let ray = |x: f64| (x + 0.5 + self.margin as f64) * self.fine as f64;
            let low = ray(x - reach).max(0.0) as usize;
            let high = (ray(x + reach).max(0.0) as usize + 1).min(most);
            low.min(high)..high
        };
        [range(at.u, self.columns), range(at.v, self.rows)]
    }
}

/// The surface's normal (view frame) where a pixel's ray meets the ball.
fn normal_at(view: &BallView, pixel: Pixel) -> Option<Vec3> {
    let BallCircle { center, radius } = *view.circle();
    let out = (pixel.u - center.u).hypot(pixel.v - center.v);
    // Outlines are circles here: the optical axis goes through the ball's center.
    if out >= radius {
        return None;
    }
    view.direction(pixel).filter(|n| n.z > 0.0)
}

fn shade(light: &Light, half: &Vec3, n: &Vec3) -> [f32; 2] {
    let lambert = n.dot(&light.from).max(0.0) as f32;
    let limb = 1.0 - LIMB * (1.0 - n.z as f32);
    let gloss = if light.gloss > 0.0 {
        light.gloss * (n.dot(half).max(0.0) as f32).powf(light.sharpness)
    } else {
        0.0
    };
    [(light.ambient + light.diffuse * lambert) * limb, gloss]
}

impl Background {
    /// Light of the background at a pixel.
    fn at(&self, u: usize, v: usize, width: usize, height: usize) -> [f32; 3] {
        let (x, y) = (u as f32 / width as f32, v as f32 / height as f32);
        let tilt = 1.0 + self.slope[0] * (x - 0.5) + self.slope[1] * (y - 0.5);
        let [strength, angle, frequency] = self.waves;
        let wave = if strength > 0.0 {
            1.0 + strength * (frequency * (x * angle.cos() + y * angle.sin())).sin()
        } else {
            1.0
        };
        let mut color = self.color;
        for (at, radius, disc) in &self.discs {
            let out = (x - at[0]).hypot(y - at[1]) / radius;
            let covered = ((1.15 - out) / 0.3).clamp(0.0, 1.0);
            for (c, d) in color.iter_mut().zip(disc) {
                *c += covered * (d - *c);
            }
        }
        color.map(|c| (c * tilt * wave).max(0.0))
    }
}
