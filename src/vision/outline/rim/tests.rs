use super::*;
use crate::image::GrayImage;
use crate::vision::dots::cap::Tone;
use crate::vision::optics::camera::{BallView, Camera};
use crate::vision::optics::grid::Grid;

const SIDE: usize = 80;
const BLUR: f64 = 0.8;

/// A ball before a dark background, lit by a lamp, as a camera stores it. Its outline is drawn out by so much along u.
fn drawn(circle: &BallCircle, lamp: Vec3, stretch_px: f64) -> GrayImage {
    drawn_by(circle, (lamp, [0.15, 0.4]), stretch_px)
}

/// The same by the light that all of it has, and the lamp's.
fn drawn_by(
    circle: &BallCircle,
    (lamp, [even, lit]): (Vec3, [f64; 2]),
    stretch_px: f64,
) -> GrayImage {
    let lamp = lamp.normalize();
    let light = |u: f64, v: f64| {
        let (du, dv) = (u - circle.center.u, v - circle.center.v);
        let square = du * du + dv * dv;
        let twice = (du * du - dv * dv) / square.max(1e-12);
        let radius = circle.radius + stretch_px * twice;
        let z = 1.0 - square / (radius * radius);
        if z < 0.0 {
            return 0.04;
        }
        let toward = Vec3::new(du / radius, -dv / radius, z.sqrt());
        even + lit * toward.dot(&lamp).max(0.0)
    };
    // Places within the blur, a third of its deviation apart.
    let near: Vec<[f64; 2]> = (-9..=9)
        .map(|k| f64::from(k) / 3.0)
        .map(|x| [x * BLUR, (-0.5 * x * x).exp()])
        .collect();
    GrayImage::from_fn(SIDE, SIDE, |u, v| {
        let (mut sum, mut weights) = (0.0, 0.0);
        for [du, by_u] in &near {
            for [dv, by_v] in &near {
                sum += by_u * by_v * light(u as f64 + du, v as f64 + dv);
                weights += by_u * by_v;
            }
        }
        f64::sqrt(sum / weights) as f32
    })
}

fn fitted(gray: &GrayImage, circle: BallCircle, shape: RimShape) -> Option<RimFit> {
    let view = BallView::new(&Camera::Orthographic, circle).expect("a value");
    let grid = Grid::halved(0);
    let of_dots = CapShape {
        radius: 0.1,
        // Dots are smeared.
        blur: 2.5 * BLUR,
        tone: Tone::of_root(),
        is_known: true,
    };
    let pixels = BallPixels {
        gray,
        grid,
        view: &view,
    };
    RimFitter::default().fit(&pixels, (shape, &of_dots), std::iter::empty())
}

const CIRCLE: BallCircle = BallCircle::new(Pixel { u: 40.2, v: 38.7 }, 30.0);

#[test]
fn an_outline_that_is_off_is_corrected() {
    // The lamp in front, and one that leaves a side dark.
    for lamp in [Vec3::new(0.3, 0.2, 0.9), Vec3::new(0.8, 0.3, 0.5)] {
        let image = drawn(&CIRCLE, lamp, 0.0);
        for off in [
            [0.0, 0.0, 0.0],
            [0.3, -0.2, 0.4],
            [-0.4, 0.1, -0.5],
            [1.0, 0.8, -1.2],
        ] {
            let off = Vec3::from(off);
            for shape in [RimShape::AsViewed, RimShape::DrawnOut] {
                let fit = fitted(&image, moved(&CIRCLE, &off), shape).expect("a rim");
                let left = fit.change + off;
                assert!(left.xy().amax() < 0.15, "{off} {shape:?}: {left}");
                assert!(left.z.abs() < 0.2, "{off} {shape:?}: {left}");
            }
        }
    }
}

#[test]
fn an_outline_in_even_light_is_exact() {
    let image = drawn_by(&CIRCLE, (Vec3::new(0.6, 0.3, 0.75), [0.29, 0.3]), 0.0);
    for off in [[0.0, 0.0, 0.0], [0.3, -0.2, 0.4], [-0.4, 0.1, -0.5]] {
        let off = Vec3::from(off);
        let fit = fitted(&image, moved(&CIRCLE, &off), RimShape::AsViewed).expect("a rim");
        let left = fit.change + off;
        assert!(left.xy().amax() < 0.03, "{off}: {left}");
        assert!(left.z.abs() < 0.1, "{off}: {left}");
    }
}

#[test]
fn an_outline_that_is_drawn_out_is_measured() {
    let image = drawn(&CIRCLE, Vec3::new(0.3, 0.2, 0.9), 0.8);
    for shape in [RimShape::AsViewed, RimShape::DrawnOut] {
        let fit = fitted(&image, CIRCLE, shape).expect("a rim");
        let oval = fit.oval.expect("an oval");
        assert!((oval.stretch_px.x - 0.8).abs() < 0.15, "{oval:?}");
        assert!(oval.stretch_px.y.abs() < 0.15, "{oval:?}");
    }
    let fit = fitted(&image, CIRCLE, RimShape::DrawnOut).expect("a rim");
    let outline = Outline::given(CIRCLE, Matrix3::identity());
    let (seen, _) = fit.correct_drawn_out(&CIRCLE, &outline);
    let longer = seen.circle.rim(0.0).u - seen.circle.center.u;
    assert!((longer.abs() - 30.8).abs() < 0.2, "{seen:?}");
    assert!((seen.circle.radius - 29.2).abs() < 0.2, "{seen:?}");
    // A circle stays one.
    let image = drawn(&CIRCLE, Vec3::new(0.3, 0.2, 0.9), 0.0);
    let fit = fitted(&image, CIRCLE, RimShape::DrawnOut).expect("a rim");
    let outline = Outline::given(CIRCLE, Matrix3::identity());
    assert!(
        !fit.correct_drawn_out(&CIRCLE, &outline)
            .0
            .circle
            .is_ellipse()
    );
}

#[test]
fn what_hides_the_rim_is_not_read() {
    let mut image = drawn(&CIRCLE, Vec3::new(0.3, 0.2, 0.9), 0.0);
    let finger = BallCircle::new(Pixel { u: 68.0, v: 40.0 }, 9.0);
    let clean = image.clone();
    image.fill_with(SIDE, SIDE, |u, v| {
        let off = (u as f64 - finger.center.u).hypot(v as f64 - finger.center.v);
        if off < finger.radius - 1.0 {
            0.9
        } else {
            clean.at(u as isize, v as isize)
        }
    });
    let view = BallView::new(&Camera::Orthographic, CIRCLE).expect("a value");
    let pixels = BallPixels {
        gray: &image,
        grid: Grid::halved(0),
        view: &view,
    };
    let of_dots = CapShape {
        radius: 0.1,
        blur: BLUR,
        tone: Tone::of_root(),
        is_known: true,
    };
    let fit = RimFitter::default().fit(
        &pixels,
        (RimShape::AsViewed, &of_dots),
        std::iter::once(finger),
    );
    let fit = fit.expect("a rim");
    assert!(fit.change.amax() < 0.1, "{fit:?}");
}

/// Of nine fingers one after the other, each over a tenth of the rim, which nothing says.
#[test]
fn what_hides_the_rim_unknown_is_within_its_covariance() {
    let clean = drawn(&CIRCLE, Vec3::new(0.3, 0.2, 0.9), 0.0);
    let fit = |image: &GrayImage| fitted(image, CIRCLE, RimShape::DrawnOut);
    let (mut squares, mut count) = (0.0, 0.0);
    for k in 0..9 {
        let angle = 0.7 * f64::from(k);
        let finger = Pixel {
            u: CIRCLE.center.u + CIRCLE.radius * angle.cos(),
            v: CIRCLE.center.v + CIRCLE.radius * angle.sin(),
        };
        let image = GrayImage::from_fn(SIDE, SIDE, |u, v| {
            let off = (u as f64 - finger.u).hypot(v as f64 - finger.v);
            let covers = (0.5 + 9.0 - off).clamp(0.0, 1.0) as f32;
            let behind = clean.at(u as isize, v as isize);
            behind + covers * (0.55 - behind)
        });
        let Some(found) = fit(&image) else { continue };
        let inverse = found.covariance.try_inverse().expect("regular");
        squares += found.change.dot(&(inverse * found.change));
        count += 1.0;
    }
    // Three of each are expected.
    assert!(
        count >= 6.0 && squares < 2.0 * 3.0 * count,
        "{squares} {count}"
    );
}

#[test]
fn an_even_image_has_no_rim() {
    let image = GrayImage::from_fn(SIDE, SIDE, |u, v| {
        0.5 + 0.001 * ((7 * u + 13 * v) % 5) as f32
    });
    let found = fitted(&image, CIRCLE, RimShape::AsViewed);
    assert!(found.is_none(), "{found:?}");
}
