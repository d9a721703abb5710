//! Balls off the optical axis, with known intrinsics and with none: images made by ray casting, which shares nothing
//! with the projection under test.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use spindoe::clip::{LiveCheck, SeenOval, focal_doubt};
use spindoe::geometry::{Rotation, Vec3, random_rotation};
use spindoe::image::{GrayImage, RgbImage};
use spindoe::pattern::Pattern;
use spindoe::vision::frame::CameraModel;
use spindoe::vision::{
    BallCircle, Budget, Camera, DetectorName, Estimator, EstimatorConfig, FrameEstimate,
    Intrinsics, Lens, OutlinePrior, Pixel, Prior,
};

use crate::common::ball::blur;

/// Seen across the direction to the principal point, the ball's radius, pixels.
const RADIUS_PX: f64 = 30.0;
/// Side of the images, pixels.
const SIDE: usize = 96;
/// Angular radius of the dots, radians.
const DOT_RAD: f64 = 0.1;
const TRIALS: usize = 40;

/// How many are drawn.
fn trials() -> usize {
    crate::common::few_or_all(20, TRIALS)
}
/// By how much a background like the ball is brighter and darker than its rim, in turns around it.
const STRIPES: f64 = 0.3;

/// What is seen beyond the ball.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Behind {
    /// A dark wall: the edges show the outline.
    Dark,
    /// What is as bright as the ball's rim, but for stripes: the edges show no outline.
    Alike,
}

/// A sphere of radius 1 before a pinhole at the origin, which looks along -z (x right, y up).
pub(super) struct Cast {
    pub(super) intrinsics: Intrinsics,
    pub(super) center: Vec3,
    /// Pattern to camera frame.
    pub(super) rotation: Rotation,
    /// OpenCV's k1, k2, p1, p2.
    distortion: [f64; 4],
}

/// Where a lens shows a point at unit depth, y down.
pub(super) fn distorted([k1, k2, p1, p2]: [f64; 4], [x, y]: [f64; 2]) -> [f64; 2] {
    let r2 = x * x + y * y;
    let g = 1.0 + k1 * r2 + k2 * r2 * r2;
    [
        x * g + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
        y * g + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
    ]
}

impl Cast {
    pub(super) fn random(distance: f64, off_axis_rad: f64, rng: &mut ChaCha8Rng) -> Self {
        Self::through([0.0; 4], distance, off_axis_rad, rng)
    }

    pub(super) fn through(
        distortion: [f64; 4],
        distance: f64,
        off_axis_rad: f64,
        rng: &mut ChaCha8Rng,
    ) -> Self {
        let (sin, cos) = off_axis_rad.sin_cos();
        let (y, x) = (std::f64::consts::TAU * rng.random::<f64>()).sin_cos();
        let center = Vec3::new(sin * x, sin * y, -cos) * distance;
        // A sphere of the half angle a, off the axis by t, has the minor half-axis f tan a / cos t.
        let focal = RADIUS_PX * cos / (1.0 / distance).asin().tan();
        let middle = 0.5 * (SIDE as f64 - 1.0);
        let shift = |rng: &mut ChaCha8Rng| 4.0 * rng.random::<f64>() - 2.0;
        // The ball near the middle of the image, wherever the lens shows it.
        let [u, v] = distorted(distortion, [sin / cos * x, -sin / cos * y]);
        let intrinsics = Intrinsics {
            lens: Lens::polynomial(&distortion).expect("a lens"),
            ..Intrinsics::pinhole(
                focal,
                focal,
                middle + shift(rng) - focal * u,
                middle + shift(rng) - focal * v,
            )
        };
        Self {
            intrinsics,
            center,
            rotation: random_rotation(rng),
            distortion,
        }
    }

    /// The light on a point of the image.
    fn light(&self, dots: &[Vec3], behind: Behind, u: f64, v: f64) -> f64 {
        let k = &self.intrinsics;
        let seen = [(u - k.cx) / k.fx, (v - k.cy) / k.fy];
        let mut at = seen;
        for _ in 0..30 {
            let shown = distorted(self.distortion, at);
            let off = [seen[0] - shown[0], seen[1] - shown[1]];
            at = [at[0] + off[0], at[1] + off[1]];
            if off[0].abs() + off[1].abs() < 1e-14 {
                break;
            }
        }
        let ray = Vec3::new(at[0], -at[1], -1.0).normalize();
        let along = ray.dot(&self.center);
        let inside = 1.0 - (self.center.norm_squared() - along * along);
        let lamp = Vec3::new(-0.4, 0.6, 0.7).normalize();
        let lit = |normal: &Vec3| 0.5 + 0.5 * normal.dot(&lamp).max(0.0);
        if inside < 0.0 {
            let rim = (ray * along - self.center).normalize();
            let stripes = || (7.0 * rim.y.atan2(rim.x)).sin();
            return match behind {
                Behind::Dark => 0.08,
                Behind::Alike => 0.75 * lit(&rim) * (1.0 + STRIPES * stripes()),
            };
        }
        let normal = ray * (along - inside.sqrt()) - self.center;
        let is_dot = dots.iter().any(|d| d.dot(&normal) > DOT_RAD.cos());
        let albedo = if is_dot { 0.1 } else { 0.75 };
        albedo * lit(&normal)
    }

    /// What a camera stores: the light through its tone curve, and noise.
    pub(super) fn image(
        &self,
        pattern: &[Vec3],
        behind: Behind,
        tone: fn(f32) -> f32,
        rng: &mut ChaCha8Rng,
    ) -> GrayImage {
        let dots: Vec<Vec3> = pattern.iter().map(|d| self.rotation * d).collect();
        let fine = 4;
        let sub = |i: usize| (i as f64 + 0.5) / fine as f64 - 0.5;
        let sharp = GrayImage::from_fn(SIDE, SIDE, |u, v| {
            let at = |k: usize| (u as f64 + sub(k % fine), v as f64 + sub(k / fine));
            let sum: f64 = (0..fine * fine)
                .map(|k| self.light(&dots, behind, at(k).0, at(k).1))
                .sum();
            (sum / (fine * fine) as f64) as f32
        });
        let soft = blur(&sharp, 0.7);
        let noisy = soft.values().iter().map(|v| {
            let normal: f32 = (0..12).map(|_| rng.random::<f32>()).sum::<f32>() - 6.0;
            (tone(*v) + 0.01 * normal).clamp(0.0, 1.0)
        });
        GrayImage::new(SIDE, SIDE, noisy.collect()).expect("as many values")
    }

    /// Camera frame to view frame.
    fn to_view(&self) -> Rotation {
        Rotation::rotation_between(&-self.center, &Vec3::z()).expect("before the camera")
    }

    /// The outline as `BallCircle` has it under perspective: where the center is seen, and the half-axis across the direction
    /// to the principal point.
    fn circle(&self) -> BallCircle {
        let (k, c) = (&self.intrinsics, &self.center);
        BallCircle::new(
            Pixel {
                u: k.cx - k.fx * c.x / c.z,
                v: k.cy + k.fy * c.y / c.z,
            },
            RADIUS_PX,
        )
    }

    /// The same as the image shows it.
    fn shown_circle(&self) -> BallCircle {
        self.intrinsics.shown_of_ball(&self.circle())
    }
}

/// What an estimator that knows so much of the camera, and of the outline, makes of an image.
fn estimated(
    pattern: &Pattern,
    camera: CameraModel,
    image: &GrayImage,
    outline: Option<OutlinePrior>,
) -> FrameEstimate {
    let config = EstimatorConfig {
        camera,
        ..EstimatorConfig::default()
    };
    let detector = DetectorName::Cnn.build().expect("weights");
    let estimator = Estimator::new(pattern, config, detector).expect("valid settings");
    let prior = Prior {
        outline,
        ..Prior::default()
    };
    let (mut ws, mut out) = (estimator.workspace(), FrameEstimate::default());
    estimator.estimate(image, &prior, &Budget::default(), &mut ws, &mut out);
    out
}

/// What the estimator is told.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Told {
    Nothing,
    Intrinsics,
    IntrinsicsAndOutline,
}

/// Errors of the answers, sorted, degrees.
fn errors(distance: f64, off_axis_deg: f64, told: Told) -> Vec<f64> {
    errors_before(Behind::Dark, distance, off_axis_deg, told)
}

/// As [`errors`]; with edges hidden, of the answers whose outline is the net's alone.
fn errors_before(behind: Behind, distance: f64, off_axis_deg: f64, told: Told) -> Vec<f64> {
    let pattern = crate::common::random_pattern(20, 5);
    let mut rng = ChaCha8Rng::seed_from_u64(12);
    let mut errors = Vec::new();
    // Few of the balls whose edge is hidden are answered.
    let trials = match behind {
        Behind::Alike => crate::common::few_or_all(24, TRIALS),
        Behind::Dark => trials(),
    };
    for _ in 0..trials {
        let cast = Cast::random(distance, off_axis_deg.to_radians(), &mut rng);
        let image = cast.image(pattern.dots(), behind, |light| light, &mut rng);
        let camera = match told {
            Told::Nothing => CameraModel::default(),
            _ => Camera::Perspective(cast.intrinsics).into(),
        };
        let circle = (told == Told::IntrinsicsAndOutline).then(|| cast.shown_circle());
        let out = estimated(&pattern, camera, &image, circle.map(OutlinePrior::given));
        if behind == Behind::Alike && out.fit.is_some() {
            continue;
        }
        if let Some(pose) = out.pose() {
            let expected = match told {
                Told::Nothing => cast.to_view() * cast.rotation,
                _ => cast.rotation,
            };
            errors.push(pose.rotation.angle_to(&expected).to_degrees());
        }
    }
    errors.sort_by(f64::total_cmp);
    let median = errors.get(errors.len() / 2).copied().unwrap_or(f64::NAN);
    let most = errors.last().copied().unwrap_or(f64::NAN);
    println!(
        "{distance} radii, {off_axis_deg} deg off axis, told {told:?}: {} of {trials} answered, median {median:.2}, at most {most:.2} deg",
        errors.len()
    );
    errors
}

/// Errors of the answers through a lens, sorted, degrees; with its distortion told or left out.
fn errors_through(distortion: [f64; 4], is_told: bool) -> Vec<f64> {
    let pattern = crate::common::random_pattern(20, 5);
    let mut rng = ChaCha8Rng::seed_from_u64(341);
    let mut errors = Vec::new();
    for k in 0..TRIALS {
        let off_axis = [12.0, 24.0][k % 2];
        let cast = Cast::through(distortion, 12.0, f64::to_radians(off_axis), &mut rng);
        let image = cast.image(pattern.dots(), Behind::Dark, |light| light, &mut rng);
        let known = match is_told {
            true => cast.intrinsics,
            false => Intrinsics {
                lens: Lens::Ideal,
                ..cast.intrinsics
            },
        };
        let out = estimated(&pattern, Camera::Perspective(known).into(), &image, None);
        if let Some(pose) = out.pose() {
            errors.push(pose.rotation.angle_to(&cast.rotation).to_degrees());
        }
    }
    errors.sort_by(f64::total_cmp);
    let median = errors.get(errors.len() / 2).copied().unwrap_or(f64::NAN);
    println!(
        "{distortion:?}, told {is_told}: {} answered, median {median:.3} deg",
        errors.len()
    );
    errors
}

#[test]
fn distortion_costs_nothing_where_it_is_known() {
    let plain = errors_through([0.0; 4], true);
    let middle = |errors: &[f64]| errors[errors.len() / 2];
    let lenses = [
        [-0.25, 0.05, 0.001, -0.002],
        [-0.1, 0.0, 0.0, 0.0],
        [-0.4, 0.15, 0.0, 0.0],
    ];
    for distortion in lenses.into_iter().take(crate::common::few_or_all(2, 3)) {
        let known = errors_through(distortion, true);
        assert!(
            known.len() + 1 >= plain.len(),
            "{} of {}",
            known.len(),
            plain.len()
        );
        assert!(
            middle(&known) < 1.1 * middle(&plain) + 0.02,
            "{distortion:?}"
        );
        let unknown = errors_through(distortion, false);
        assert!(middle(&unknown) > 2.0 * middle(&known), "{distortion:?}");
    }
}

#[test]
fn balls_off_the_axis_are_as_well_estimated_as_on_it() {
    for distance in [8.0, 15.0, 30.0] {
        for told in [Told::Intrinsics, Told::IntrinsicsAndOutline] {
            let on_axis = errors(distance, 0.0, told);
            for off_axis_deg in [10.0, 25.0] {
                let off_axis = errors(distance, off_axis_deg, told);
                assert!(off_axis.len() + 2 >= on_axis.len());
                assert!(off_axis.last().is_some_and(|e| *e < 20.0));
                let [on, off] = [&on_axis, &off_axis].map(|e| e[e.len() / 2]);
                assert!(off < 1.3 * on + 0.1, "{off}, on the axis {on}");
                // By the dots of the net, not of the pixels, and outlines to 1 %: 0.3.
                assert!(off < 0.3, "{off}");
            }
        }
    }
}

/// The tone curve of IEC 61966-2-1.
pub(super) fn srgb(light: f32) -> f32 {
    match light < 0.003_130_8 {
        true => 12.92 * light,
        false => 1.055 * light.powf(1.0 / 2.4) - 0.055,
    }
}

#[test]
fn dots_lie_where_the_images_own_pixels_show_them() {
    let pattern = crate::common::random_pattern(20, 5);
    let mut rng = ChaCha8Rng::seed_from_u64(32);
    let (mut inwards, mut across, mut turns) = (Vec::new(), Vec::new(), Vec::new());
    for k in 0..trials() {
        let off_axis: f64 = [0.0, 0.2][k % 2];
        let cast = Cast::random(12.0, off_axis, &mut rng);
        let image = cast.image(pattern.dots(), Behind::Dark, srgb, &mut rng);
        let outline = OutlinePrior {
            sigma_px: 1e-3,
            ..OutlinePrior::given(cast.shown_circle())
        };
        let camera = Camera::Perspective(cast.intrinsics).into();
        let out = estimated(&pattern, camera, &image, Some(outline));
        let Some(pose) = out.pose() else { continue };
        turns.push(pose.rotation.angle_to(&cast.rotation).to_degrees());
        for (dot, name) in out.dots.iter().zip(&out.assignment) {
            let Some(name) = name else { continue };
            let normal = cast.rotation * pattern.dots()[usize::from(*name)];
            let at = cast.center + normal;
            if normal.dot(&-at.normalize()) < 0.65 {
                continue;
            }
            let (k, c) = (&cast.intrinsics, cast.circle().center);
            let (u, v) = (k.cx - k.fx * at.x / at.z, k.cy + k.fy * at.y / at.z);
            let out = nalgebra::Vector2::new(u - c.u, v - c.v).normalize();
            let off = nalgebra::Vector2::new(dot.pixel.u - u, dot.pixel.v - v);
            inwards.push(-out.dot(&off));
            across.push(out.perp(&off).abs());
        }
    }
    assert!(turns.len() + 1 >= trials(), "{} answered", turns.len());
    let middle = |values: &mut Vec<f64>| spindoe::stats::median(values);
    let (inwards, across, turn) = (
        middle(&mut inwards),
        middle(&mut across),
        middle(&mut turns),
    );
    println!("inwards {inwards:.4} px, across {across:.4} px, turn {turn:.3} deg");
    // A net that sees the ball in 64 x 64 cells is off by 0.07 px, and the pose by 0.2 deg.
    assert!(inwards.abs() < 0.015, "{inwards}");
    assert!(across < 0.03, "{across}");
    assert!(turn < 0.1, "{turn}");
}

#[test]
fn an_ellipse_makes_up_for_unknown_intrinsics() {
    for distance in [8.0, 15.0, 30.0] {
        let on_axis = errors(distance, 0.0, Told::Nothing);
        for off_axis_deg in [20.0, 30.0] {
            let off_axis = errors(distance, off_axis_deg, Told::Nothing);
            assert!(off_axis.len() + 4 >= on_axis.len());
            assert!(off_axis.last().is_some_and(|e| *e < 20.0));
            let [on, off] = [&on_axis, &off_axis].map(|e| e[e.len() / 2]);
            // To which side of the ball the camera looks, a crop does not say: the dots do.
            assert!(off < 1.5 * on + 0.2, "{off}, on the axis {on}");
        }
    }
}

#[test]
fn outlines_by_the_net_alone_are_as_good_off_the_axis() {
    // Known intrinsics; few of the balls are seen so well that they have an answer.
    let of = |angles: &[f64]| {
        let distances = [8.0, 15.0];
        let each = distances
            .iter()
            .flat_map(|d| angles.iter().map(|a| (*d, *a)));
        let all = each.flat_map(|(d, a)| errors_before(Behind::Alike, d, a, Told::Intrinsics));
        let (mut right, wrong): (Vec<f64>, Vec<f64>) = all.partition(|e| *e < 20.0);
        let least = crate::common::few_or_all(12, 20);
        assert!(
            right.len() >= least && wrong.len() <= 3,
            "{right:?} {wrong:?}"
        );
        spindoe::stats::median(&mut right)
    };
    let (on, off) = (of(&[0.0]), of(&[20.0, 27.0, 35.0]));
    println!("by the net alone: median {off:.2} deg, on the axis {on:.2} deg");
    // A circle through the ellipse makes it three times as large.
    assert!(off < 1.5 * on + 0.2, "{off}, on the axis {on}");
}

/// A ball that turns at one place, by intrinsics whose focal lengths are so many times the right ones.
#[test]
fn outlines_contradict_focal_lengths_that_are_far_off() {
    let pattern = crate::common::random_pattern(20, 5);
    let mut rng = ChaCha8Rng::seed_from_u64(60);
    // What a rim shows that is off by more than two pixels, as by half the right focal length at 22 degrees, is not asked.
    for (distortion, off_axis_deg, factors) in [
        ([0.0; 4], 22.0, &[1.0, 2.0, 3.0][..]),
        ([-0.25, 0.05, 0.001, -0.002], 22.0, &[1.0]),
        ([0.0; 4], 3.0, &[1.0, 0.5, 2.0]),
    ] {
        let mut cast = Cast::through(distortion, 12.0, f64::to_radians(off_axis_deg), &mut rng);
        let images: Vec<GrayImage> = (0..8)
            .map(|_| {
                cast.rotation = random_rotation(&mut rng);
                cast.image(pattern.dots(), Behind::Dark, srgb, &mut rng)
            })
            .collect();
        for &factor in factors {
            let k = Intrinsics {
                fx: factor * cast.intrinsics.fx,
                fy: factor * cast.intrinsics.fy,
                ..cast.intrinsics
            };
            let camera = Camera::Perspective(k).into();
            // As a stream is asked, which never says that it ends.
            let mut live = LiveCheck::new(&camera);
            let (mut seen, mut said) = (Vec::new(), Vec::new());
            for (number, image) in images.iter().enumerate() {
                let out = estimated(&pattern, camera, image, None);
                seen.extend(out.pose().and_then(|_| SeenOval::of(&out, 0.0)));
                said.extend(live.push(SIDE, [&out]).map(|_| number));
            }
            let doubt = focal_doubt(&k, &seen);
            let is_far = factor != 1.0 && off_axis_deg > 10.0;
            println!(
                "{off_axis_deg} deg, f x {factor}: {} outlines, {doubt:?}",
                seen.len()
            );
            assert_eq!(
                doubt.is_some(),
                is_far,
                "{off_axis_deg} deg, f x {factor}: {doubt:?}"
            );
            // A short stream says it, too, and once.
            let soon = said.iter().filter(|number| **number < 5).count();
            assert_eq!(
                (soon, said.len()),
                (usize::from(is_far), soon),
                "f x {factor}: {said:?}"
            );
            if let Some(doubt) = doubt {
                assert!(
                    (doubt.ratio * factor).ln().abs() < 0.25,
                    "f x {factor}: {doubt}"
                );
                let words = doubt.to_string();
                assert!(words.len() < 200 && words.lines().count() == 1, "{words}");
            }
        }
    }
}

/// Whatever reads a clip says that a camera is twice too long.
#[test]
fn every_mode_says_that_outlines_contradict_the_camera() {
    let dir = tempfile::tempdir().unwrap();
    let pattern = crate::common::random_pattern(20, 5);
    pattern.write_csv(&dir.path().join("pattern.csv")).unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(60);
    let mut cast = Cast::through([0.0; 4], 12.0, f64::to_radians(22.0), &mut rng);
    let folder = dir.path().join("images");
    std::fs::create_dir(&folder).unwrap();
    let mut raw = Vec::new();
    for k in 0..12 {
        cast.rotation = Rotation::from_scaled_axis(Vec3::new(0.1, 0.25, 0.1)) * cast.rotation;
        let gray = cast.image(pattern.dots(), Behind::Dark, srgb, &mut rng);
        let values = gray.values().iter().map(|v| [*v; 3]).collect();
        let image = RgbImage::new(SIDE, SIDE, values).unwrap();
        image.write_png(&folder.join(format!("{k}.png"))).unwrap();
        raw.extend(image.to_bytes());
    }
    std::fs::write(dir.path().join("clip.raw"), raw).unwrap();
    let Intrinsics { fx, fy, cx, cy, .. } = cast.intrinsics;
    let size = format!("{SIDE}x{SIDE},rgb");
    let live = ["live", "clip.raw", "--raw", &size, "--fps", "120"];
    let modes: [&[&str]; 5] = [
        &["estimate", "images", "--fps", "120"],
        &["estimate", "images", "--balls", "1", "--fps", "120"],
        &["estimate", "images", "--no-sequence"],
        &live,
        &[&live[..], &["--balls", "1"]].concat(),
    ];
    for mode in modes {
        for factor in [1.0, 2.0] {
            let k = format!("{},{},{cx},{cy}", factor * fx, factor * fy);
            let given = ["--table", "pattern.csv", "--intrinsics", &k];
            let done = crate::common::spindoe(dir.path(), &[mode, &given[..]].concat());
            let words = String::from_utf8_lossy(&done.stderr);
            assert!(done.status.success(), "{mode:?}: {words}");
            let said = words.matches("outlines contradict the intrinsics").count();
            let expected = usize::from(factor == 2.0);
            assert_eq!(said, expected, "{mode:?}, f x {factor}: {words}");
        }
    }
}
