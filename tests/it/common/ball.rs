//! A plain renderer of dotted balls with an exact truth: shaded disc, dots as true ellipses, blur, noise.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use spindoe::geometry::{Rotation, Vec3};
use spindoe::image::GrayImage;
use spindoe::vision::{BallCircle, BallView, Camera, Pixel};

/// A ball to draw.
#[derive(Debug, Clone)]
pub struct Scene {
    pub width: usize,
    pub height: usize,
    pub circle: BallCircle,
    pub camera: Camera,
    /// View frame.
    pub rotation: Rotation,
    pub dots: Vec<Vec3>,
    pub dot_radius: f64,
    pub ball: f64,
    pub dot: f64,
    pub background: f64,
    /// Part of the light that is directed; the rest is even.
    pub directed: f64,
    pub light: Vec3,
    /// Standard deviations: blur in pixels, noise in brightness.
    pub blur: f64,
    pub noise: f64,
}

impl Scene {
    pub fn new(side: usize, radius: f64, dots: &[Vec3], rotation: Rotation) -> Self {
        let middle = 0.5 * (side as f64 - 1.0);
        Self {
            width: side,
            height: side,
            circle: BallCircle::new(
                Pixel {
                    u: middle,
                    v: middle,
                },
                radius,
            ),
            camera: Camera::Orthographic,
            rotation,
            dots: dots.to_vec(),
            dot_radius: 0.11,
            ball: 0.75,
            dot: 0.1,
            background: 0.08,
            directed: 0.5,
            light: Vec3::new(-0.4, 0.6, 0.7).normalize(),
            blur: 0.8,
            noise: 0.015,
        }
    }

    pub fn render(&self, rng: &mut ChaCha8Rng) -> GrayImage {
        let view = BallView::new(&self.camera, self.circle).expect("a valid ball");
        let placed: Vec<Vec3> = self.dots.iter().map(|d| self.rotation * d).collect();
        let fine = 4;
        let sharp = GrayImage::from_fn(self.width, self.height, |u, v| {
            let mut sum = 0.0;
            for k in 0..fine * fine {
                let sub = |i: usize| (i as f64 + 0.5) / fine as f64 - 0.5;
                let pixel = Pixel {
                    u: u as f64 + sub(k % fine),
                    v: v as f64 + sub(k / fine),
                };
                sum += self.shade(&view, &placed, pixel);
            }
            (sum / (fine * fine) as f64) as f32
        });
        let blurred = blur(&sharp, self.blur);
        let noise: Vec<f32> = blurred
            .values()
            .iter()
            .map(|v| {
                // The sum of twelve uniform numbers is normal enough.
                let n: f64 = (0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0;
                (f64::from(*v) + self.noise * n).clamp(0.0, 1.0) as f32
            })
            .collect();
        GrayImage::new(self.width, self.height, noise).expect("as many values")
    }

    fn shade(&self, view: &BallView, placed: &[Vec3], pixel: Pixel) -> f64 {
        // Rays beside the ball are laid on its limb: they come out elsewhere than they went in.
        let back = |n: &Vec3| {
            let p = view.project(n);
            (p.u - pixel.u).hypot(p.v - pixel.v) < 1e-3
        };
        let Some(n) = view.direction(pixel).filter(back) else {
            return self.background;
        };
        let on_dot = placed.iter().any(|d| d.dot(&n) > self.dot_radius.cos());
        let albedo = if on_dot { self.dot } else { self.ball };
        let lit = 1.0 - self.directed + self.directed * n.dot(&self.light).max(0.0);
        albedo * lit
    }
}

pub fn blur(image: &GrayImage, sigma: f64) -> GrayImage {
    if sigma <= 0.0 {
        return image.clone();
    }
    let half = (3.0 * sigma).ceil() as isize;
    let weight = |k: isize| (-0.5 * (k as f64 / sigma).powi(2)).exp() as f32;
    let sum: f32 = (-half..=half).map(weight).sum();
    let (w, h) = (image.width(), image.height());
    let pass = |image: &GrayImage, du: isize, dv: isize| {
        GrayImage::from_fn(w, h, |u, v| {
            let at = |k: isize| image.at(u as isize + k * du, v as isize + k * dv);
            (-half..=half).map(|k| weight(k) * at(k)).sum::<f32>() / sum
        })
    };
    pass(&pass(image, 1, 0), 0, 1)
}
