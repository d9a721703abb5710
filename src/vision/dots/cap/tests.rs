use nalgebra::Vector2;

use super::*;
use crate::image::GrayImage;
use crate::vision::optics::camera::{BallCircle, Camera};
use crate::vision::optics::grid::Grid;

const SIDE: usize = 70;

fn view() -> BallView {
    let camera = Camera::Near {
        inverse_distance: 0.1,
    };
    let center = Pixel { u: 34.3, v: 35.1 };
    BallView::new(&camera, BallCircle::new(center, 30.0)).expect("a value")
}

/// A ball with one dot as sRGB, 8 x 8 rays a pixel, blurred by `blur` pixels.
fn drawn(view: &BallView, middle: &Vec3, radius: f64, blur: f64) -> GrayImage {
    const FINE: usize = 8;
    let side = SIDE * FINE;
    let lamp = Vec3::new(0.5, 0.3, 0.8).normalize();
    let light = GrayImage::from_fn(side, side, |u, v| {
        let place = |x: usize| (x as f64 + 0.5) / FINE as f64 - 0.5;
        let at = Pixel {
            u: place(u),
            v: place(v),
        };
        let Some(direction) = view.direction(at).filter(|d| d.z > view.horizon()) else {
            return 0.05;
        };
        let ink = if direction.dot(middle) > radius.cos() {
            0.1
        } else {
            1.0
        };
        ink * (0.3 + 0.5 * direction.dot(&lamp).max(0.0)) as f32
    });
    let reach = (3.5 * blur * FINE as f64).ceil() as isize;
    let weights: Vec<f32> = (-reach..=reach)
        .map(|k| (-0.5 * (k as f64 / (blur * FINE as f64)).powi(2)).exp() as f32)
        .collect();
    let total: f32 = weights.iter().sum();
    let along = |image: &GrayImage, step: [isize; 2]| {
        GrayImage::from_fn(side, side, |u, v| {
            let near = weights.iter().zip(-reach..).map(|(weight, k)| {
                weight * image.at(u as isize + k * step[0], v as isize + k * step[1])
            });
            near.sum::<f32>() / total
        })
    };
    let blurred = along(&along(&light, [1, 0]), [0, 1]);
    GrayImage::from_fn(SIDE, SIDE, |u, v| {
        let fine = (0..FINE * FINE).map(|k| {
            blurred.at(
                (FINE * u + k % FINE) as isize,
                (FINE * v + k / FINE) as isize,
            )
        });
        let light = fine.sum::<f32>() / (FINE * FINE) as f32;
        1.055 * light.powf(1.0 / 2.4) - 0.055
    })
}

fn fitted(gray: &GrayImage, view: &BallView, near: Pixel) -> Option<Cap> {
    let grid = Grid::halved(0);
    CapFitter::default().fit(&BallPixels { gray, grid, view }, near, None)
}

/// The value of a pixel, and its derivatives.
fn shown_by(state: &DiscState, disc: &Disc, pixel: &CapPixels) -> (f64, [f64; STRETCHED]) {
    #[inline(always)]
    fn each<S: Simd>(
        simd: S,
        state: &DiscState,
        disc: &Disc,
        pixel: &CapPixels,
    ) -> (f64, [f64; STRETCHED]) {
        let (shown, by) = state.shown::<S, STRETCHED>(simd, disc, pixel);
        (shown[0], by.map(|by| by[0]))
    }
    dispatch!(Level::new(), simd => each(simd, state, disc, pixel))
}

/// To a twentieth: how the blur's width changes around the dot is left out, which moves no fit without residuals.
#[test]
fn derivatives_are_those_of_finite_differences() {
    let (view, step) = (view(), 1e-6);
    let middle = Vec3::new(0.45, -0.2, 0.87).normalize();
    let tangents = tangent_frame(&middle);
    let state = DiscState {
        middle,
        radius: 0.09,
        blur: 0.8,
        bend: 0.8,
        ink: 0.7,
        light: 0.6,
        slope: Vector2::new(0.3, -0.2),
        // The stretched blur's width changes around the dot, which the derivatives by the middle leave out.
        stretch: Vector2::zeros(),
    };
    let mut disc = Disc::new(&view, &state, &tangents).expect("a value");
    let at = view.project(&middle);
    for (du, dv) in [(2.0, 0.5), (-1.5, 2.0), (0.3, -2.6), (4.0, 4.0), (0.2, 0.1)] {
        let place = Pixel {
            u: at.u + du,
            v: at.v + dv,
        };
        let direction = view.direction(place).expect("a value");
        let pixel = CapPixels::one(&cap_pixel(&direction, 0.0));
        let (shown, by) = shown_by(&state, &disc, &pixel);
        for (k, by) in by.into_iter().enumerate() {
            let mut change = SVector::<f64, STRETCHED>::zeros();
            change[k] = step;
            let moved = state.moved(&change, &tangents);
            let (before, spread) = (disc.by_pixel, disc.spread);
            // The blur's width in the plane is held.
            disc = Disc {
                by_pixel: before,
                spread,
                ..Disc::new(&view, &moved, &tangents).expect("a value")
            };
            let difference = (shown_by(&moved, &disc, &pixel).0 - shown) / step;
            assert!(
                (difference - by).abs() < 0.05 * (1.0 + by.abs()),
                "{k}: {difference} {by}"
            );
            disc = Disc {
                by_pixel: before,
                spread,
                ..Disc::new(&view, &state, &tangents).expect("a value")
            };
        }
    }
}

#[test]
fn a_drawn_cap_is_found_to_a_fiftieth_of_a_pixel() {
    let view = view();
    for (x, y) in [(0.02, 0.1), (0.4, -0.3), (-0.6, 0.35), (0.1, 0.75)] {
        let middle = Vec3::new(x, y, f64::sqrt(1.0 - x * x - y * y));
        let image = drawn(&view, &middle, 0.1, 0.8);
        let at = view.project(&middle);
        let near = Pixel {
            u: at.u + 0.3,
            v: at.v - 0.2,
        };
        let found = fitted(&image, &view, near).expect("a value");
        let off = (found.pixel.u - at.u).hypot(found.pixel.v - at.v);
        assert!(off < 0.02, "{off} px at {middle:?}");
        assert!((found.shape.radius - 0.1).abs() < 0.01, "{:?}", found.shape);
    }
}

#[test]
fn where_no_dot_is_there_is_none() {
    let view = view();
    let elsewhere = Vec3::new(-0.6, -0.5, 0.6).normalize();
    let image = drawn(&view, &elsewhere, 0.1, 0.8);
    let near = view.project(&Vec3::new(0.3, 0.2, 0.9).normalize());
    let found = fitted(&image, &view, near);
    assert!(found.is_none(), "{found:?}");
}
