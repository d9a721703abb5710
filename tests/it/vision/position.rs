//! Where the ball is, by images that are cast by rays, which share nothing with the projection under test, and by the limb of a sphere.

use nalgebra::{Matrix3, Matrix6, Vector6};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use spindoe::geometry::{CameraFrame, Position, Vec3};
use spindoe::stats::Proportion;
use spindoe::vision::frame::CameraModel;
use spindoe::vision::{
    BallCircle, BallView, Budget, Camera, DetectorName, Estimator, EstimatorConfig, FrameEstimate,
    Intrinsics, Lens, OutlinePrior, Pixel, Prior,
};

use super::off_axis::{Behind, Cast, distorted, srgb};

/// The ball's radius, m.
const RADIUS_M: f64 = 0.02;
/// 95 % of chi-squared lie below, of three degrees of freedom and of six.
const WITHIN: [f64; 2] = [7.815, 12.592];
const DISTORTION: [f64; 4] = [-0.28, 0.08, 0.001, -0.002];

/// Where OpenCV's model shows a point of the camera's frame, which has y up and looks along -z.
fn shown(k: &Intrinsics, distortion: [f64; 4], point: &Vec3) -> Pixel {
    let [x, y] = distorted(distortion, [-point.x / point.z, point.y / point.z]);
    Pixel {
        u: k.fx * x + k.cx,
        v: k.fy * y + k.cy,
    }
}

/// Points of a sphere that its tangents from the origin touch: a circle in the plane `p . c = |c|^2 - r^2`.
fn limb(center: &Vec3, radius: f64, count: usize) -> impl Iterator<Item = Vec3> {
    let squared = center.norm_squared();
    let middle = center * (1.0 - radius * radius / squared);
    let around = radius * (1.0 - radius * radius / squared).sqrt();
    let [a, b] = spindoe::geometry::tangent_frame(&center.normalize());
    (0..count).map(move |k| {
        let (s, c) = (std::f64::consts::TAU * k as f64 / count as f64).sin_cos();
        middle + (a * c + b * s) * around
    })
}

/// The axis and the half angle of the cone of these rays from the origin: of all cones `x^T Q x = 0` the one that fits, whose axis is
/// the eigenvector of the odd sign, and `tan^2 a = -l_odd / l_even`.
fn cone(rays: &[Vec3]) -> (Vec3, f64) {
    let mut sums = Matrix6::<f64>::zeros();
    for ray in rays {
        let (x, y, z) = (ray.x, ray.y, ray.z);
        let row = Vector6::new(x * x, y * y, z * z, 2.0 * x * y, 2.0 * x * z, 2.0 * y * z);
        sums += row * row.transpose();
    }
    let eigen = sums.symmetric_eigen();
    let least = eigen.eigenvalues.imin();
    let q = eigen.eigenvectors.column(least);
    let q = Matrix3::new(q[0], q[3], q[4], q[3], q[1], q[5], q[4], q[5], q[2]);
    let eigen = q.symmetric_eigen();
    let negative = eigen.eigenvalues.iter().filter(|l| **l < 0.0).count();
    let sign = if negative == 1 { 1.0 } else { -1.0 };
    let values = eigen.eigenvalues * sign;
    let odd = values.imin();
    let even = 0.5 * (values.sum() - values[odd]);
    let axis: Vec3 = eigen.eigenvectors.column(odd).into();
    let axis = axis * -axis.z.signum();
    (axis, (-values[odd] / even).sqrt().atan())
}

/// The outline of a sphere as [`BallView::new`] has it, by its documented formula; the lens' magnification by differences.
fn outline(k: &Intrinsics, distortion: [f64; 4], center: &Vec3, half_rad: f64) -> BallCircle {
    let at = [-center.x / center.z, center.y / center.z];
    let step = 1e-5;
    let slope = |axis: usize| {
        let mut ends = [at, at];
        ends[0][axis] += step;
        ends[1][axis] -= step;
        let [a, b] = ends.map(|end| distorted(distortion, end));
        [(a[0] - b[0]) / (2.0 * step), (a[1] - b[1]) / (2.0 * step)]
    };
    let (x, y) = (slope(0), slope(1));
    let magnified = (x[0] * y[1] - x[1] * y[0]).abs().sqrt();
    let length = at[0].hypot(at[1]).hypot(1.0);
    let radius = (k.fx * k.fy).sqrt() * length * magnified * half_rad.tan();
    BallCircle::new(shown(k, distortion, center), radius)
}

/// What an estimator makes of an image in which this outline is given, if any.
fn estimated(
    pattern: &spindoe::pattern::Pattern,
    camera: CameraModel,
    image: &spindoe::image::GrayImage,
    outline: Option<OutlinePrior>,
) -> FrameEstimate {
    let config = EstimatorConfig {
        camera,
        ball_radius_m: Some(RADIUS_M),
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

/// The limb of a sphere, seen through a lens, leads back to its center: by the cone of the rays, which is a closed form, and by the view.
#[test]
fn the_limb_of_a_sphere_leads_to_its_center() {
    let pattern = crate::common::random_pattern(20, 5);
    let blank = spindoe::image::GrayImage::from_fn(64, 64, |_, _| 0.5);
    let mut rng = ChaCha8Rng::seed_from_u64(65_001);
    for distortion in [[0.0; 4], DISTORTION] {
        let k = Intrinsics {
            lens: Lens::polynomial(&distortion).expect("a lens"),
            ..Intrinsics::pinhole(1400.0, 1380.0, 640.5, 511.0)
        };
        for _ in 0..20 {
            let distance = rng.random_range(0.15..3.0);
            let mut side = || rng.random_range(-0.4..0.4);
            let center = Vec3::new(side(), side(), -1.0).normalize() * distance;
            let pixels: Vec<Pixel> = limb(&center, RADIUS_M, 60)
                .map(|p| shown(&k, distortion, &p))
                .collect();
            let rays: Vec<Vec3> = pixels.iter().filter_map(|p| k.ray(*p)).collect();
            assert_eq!(rays.len(), 60);
            let (axis, half_rad) = cone(&rays);
            let by_cone = axis * (RADIUS_M / half_rad.sin());
            assert!((by_cone - center).norm() < 1e-6, "{by_cone} {center}");
            let circle = outline(&k, distortion, &by_cone, half_rad);
            let view = BallView::new(&Camera::Perspective(k), circle).expect("a view");
            let found = view.center().expect("intrinsics") * RADIUS_M;
            assert!((found - center).norm() < 1e-6, "{found} {center}");
            // The same limb: where the view shows the points at its horizon.
            for (point, pixel) in limb(&center, RADIUS_M, 60).zip(&pixels) {
                let direction = view.to_camera().inverse() * ((point - center) / RADIUS_M);
                assert!((direction.z - view.horizon()).abs() < 1e-6);
                let seen = view.project(&direction);
                assert!((seen.u - pixel.u).hypot(seen.v - pixel.v) < 1e-4);
            }
            // So it comes out of an estimate, without an orientation, too.
            let given = OutlinePrior {
                sigma_px: 0.1,
                ..OutlinePrior::given(k.shown_of_ball(&circle))
            };
            let camera = Camera::Perspective(k).into();
            let out = estimated(&pattern, camera, &blank, Some(given));
            let position = out.position().expect("an outline");
            assert!(out.pose().is_none());
            assert!((position.center_m - center).norm() < 1e-6);
            // A pixel's deviation is that of the ray's angle across it, and along it of the size.
            let ray = center.normalize();
            let along = ray.dot(&(position.covariance * ray)).sqrt();
            let expected = center.norm() * 0.1 / circle.radius;
            assert!(
                (along / expected - 1.0).abs() < 0.3,
                "{along} m, {expected} m"
            );
        }
    }
}

#[test]
fn without_intrinsics_there_is_no_position() {
    let pattern = crate::common::random_pattern(20, 5);
    let mut rng = ChaCha8Rng::seed_from_u64(65_002);
    let cast = Cast::random(20.0, 0.1, &mut rng);
    let image = cast.image(pattern.dots(), Behind::Dark, srgb, &mut rng);
    let near = Camera::Near {
        inverse_distance: 0.05,
    };
    for camera in [
        CameraModel::default(),
        near.into(),
        Camera::Orthographic.into(),
    ] {
        let out = estimated(&pattern, camera, &image, None);
        assert!(out.pose().is_some());
        assert_eq!(out.position(), None);
        let named = spindoe::clip::NamedFrame::of(0.0, &out);
        let file = spindoe::clip::orientations(&[named], CameraFrame::View, false);
        assert!(!file.to_csv().contains("x_m"), "{}", file.to_csv());
    }
}

/// By how much centers are off, along the ray and across it, m, and their chi-squared; the last is of center and orientation.
fn deviations(cast: &Cast, out: &FrameEstimate) -> Option<([f64; 2], f64, Option<f64>)> {
    let Position {
        center_m,
        covariance,
        with_rotation,
    } = out.position()?;
    let truth = cast.center * RADIUS_M;
    let off = truth - center_m;
    let along = off.dot(&truth.normalize());
    let joint = out.pose().zip(with_rotation).map(|(pose, both)| {
        let turn = (cast.rotation * pose.rotation.inverse()).scaled_axis();
        let mut all = Matrix6::zeros();
        all.fixed_view_mut::<3, 3>(0, 0).copy_from(&covariance);
        all.fixed_view_mut::<3, 3>(0, 3).copy_from(&both);
        all.fixed_view_mut::<3, 3>(3, 0)
            .copy_from(&both.transpose());
        all.fixed_view_mut::<3, 3>(3, 3).copy_from(&pose.covariance);
        let off = Vector6::new(off.x, off.y, off.z, turn.x, turn.y, turn.z);
        off.dot(&(all.try_inverse().expect("a covariance") * off))
    });
    let chi2 = off.dot(&(covariance.try_inverse()? * off));
    let across = (off.norm_squared() - along * along).max(0.0).sqrt();
    Some(([along, across], chi2, joint))
}

/// Centers are as well known as their covariances say: 20 to 150 radii away, on the axis and off it, through lenses.
#[test]
fn centers_lie_within_their_covariances() {
    let pattern = crate::common::random_pattern(20, 5);
    let mut rng = ChaCha8Rng::seed_from_u64(65_003);
    let trials = crate::common::few_or_all(40, 300);
    let (mut within, mut together, mut answered) = (0, 0, 0);
    let (mut along, mut across) = (Vec::new(), Vec::new());
    for k in 0..trials {
        let distance = 20.0 * 7.5f64.powf(rng.random());
        let off_axis = [0.0, 12.0, 24.0][k % 3];
        let distortion = [[0.0; 4], DISTORTION][k % 2];
        let cast = Cast::through(distortion, distance, f64::to_radians(off_axis), &mut rng);
        let image = cast.image(pattern.dots(), Behind::Dark, srgb, &mut rng);
        let camera = Camera::Perspective(cast.intrinsics).into();
        let out = estimated(&pattern, camera, &image, None);
        let Some(([off_along, off_across], chi2, joint)) = deviations(&cast, &out) else {
            continue;
        };
        answered += 1;
        within += u64::from(chi2 < WITHIN[0]);
        together += u64::from(joint.is_none_or(|joint| joint < WITHIN[1]));
        // Over the distance, and over a pixel at it.
        let truth_m = RADIUS_M * cast.center.norm();
        along.push(off_along.abs() / truth_m);
        across.push(off_across / RADIUS_M * 30.0);
    }
    let rate = Proportion::new(within, answered);
    let both = Proportion::new(together, answered);
    let (along, across) = (
        spindoe::stats::median(&mut along),
        spindoe::stats::median(&mut across),
    );
    println!(
        "{answered} of {trials}: within {rate}, with the orientation {both}; along {along:.5} of the distance, across {across:.3} px"
    );
    assert!(answered + 2 >= trials as u64);
    // 95 % would lie within an exact covariance.
    assert!(rate.high >= 0.95 && rate.rate > 0.85, "{rate}");
    assert!(both.high >= 0.95 && both.rate > 0.8, "{both}");
    assert!(along < 0.01 && across < 0.2, "{along} {across}");
}

/// The center that a mode gives of its frames, by JSON.
#[cfg(feature = "cli")]
fn centers(frames: &[serde_json::Value]) -> Vec<[f64; 3]> {
    let all = frames.iter().map(|frame| {
        let ball = frame["balls"].get(0).unwrap_or(frame);
        let covariance: [[f64; 3]; 3] =
            serde_json::from_value(ball["position_covariance_m2"].clone()).expect("a covariance");
        assert!(covariance.iter().flatten().all(|c| c.is_finite()));
        let is_posed = ball.get("orientation_wxyz").is_some();
        let both = ball.get("position_rotation_covariance_m_rad");
        assert_eq!(both.is_some(), is_posed);
        serde_json::from_value(ball["position_m"].clone()).expect("a center")
    });
    all.collect()
}

/// Every mode writes the center, and what is written is read.
#[cfg(feature = "cli")]
#[test]
fn every_mode_says_where_the_ball_is() {
    use spindoe::image::RgbImage;
    use spindoe::spin::orientations::Orientations;

    let dir = tempfile::tempdir().unwrap();
    let pattern = crate::common::random_pattern(20, 5);
    pattern.write_csv(&dir.path().join("pattern.csv")).unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(65_004);
    let mut cast = Cast::through(DISTORTION, 20.0, f64::to_radians(15.0), &mut rng);
    let folder = dir.path().join("images");
    std::fs::create_dir(&folder).unwrap();
    let (mut raw, mut side) = (Vec::new(), 0);
    for k in 0..4 {
        cast.rotation = spindoe::geometry::Rotation::from_scaled_axis(Vec3::new(0.1, 0.25, 0.1))
            * cast.rotation;
        // The last ball has no dots: its orientation is rejected.
        let dots = if k < 3 { pattern.dots() } else { &[] };
        let gray = cast.image(dots, Behind::Dark, srgb, &mut rng);
        side = gray.width();
        let values = gray.values().iter().map(|v| [*v; 3]).collect();
        let image = RgbImage::new(side, side, values).unwrap();
        image.write_png(&folder.join(format!("{k}.png"))).unwrap();
        raw.extend(image.to_bytes());
    }
    std::fs::write(dir.path().join("clip.raw"), raw).unwrap();
    let Intrinsics { fx, fy, cx, cy, .. } = cast.intrinsics;
    let [k1, k2, p1, p2] = DISTORTION;
    let intrinsics = format!("{fx},{fy},{cx},{cy},{k1},{k2},{p1},{p2}");
    let size = format!("{side}x{side},rgb");
    let run = |mode: &[&str]| {
        let given = ["--table", "pattern.csv", "--intrinsics", &intrinsics];
        crate::common::done(dir.path(), &[mode, &given[..]].concat())
    };
    let frames = |mode: &[&str]| -> Vec<[f64; 3]> {
        let text = run(mode);
        match mode[0] {
            "live" => {
                let lines = text.lines().map(|l| serde_json::from_str(l).unwrap());
                centers(&lines.collect::<Vec<_>>())
            }
            _ => {
                let json: serde_json::Value = serde_json::from_str(&text).unwrap();
                centers(json["frames"].as_array().unwrap())
            }
        }
    };
    let alone = frames(&["estimate", "images", "--no-sequence", "--json"]);
    let truth = cast.center * RADIUS_M;
    assert_eq!(alone.len(), 4);
    for center in &alone {
        assert!((Vec3::from(*center) - truth).norm() < 0.02 * truth.norm());
    }
    let several = [
        "estimate",
        "images",
        "--no-sequence",
        "--balls",
        "1",
        "--json",
    ];
    let live = ["live", "clip.raw", "--raw", &size, "--fps", "120"];
    for mode in [&several[..], &live] {
        let found = frames(mode);
        assert_eq!(found.len(), 4);
        for (a, b) in found.iter().zip(&alone) {
            assert!((Vec3::from(*a) - Vec3::from(*b)).norm() < 0.01 * truth.norm());
        }
    }
    // A ball twice as large is twice as far; the optical frame has y down and z forward.
    let large = [
        "estimate",
        "images",
        "--no-sequence",
        "--json",
        "--ball-diameter-mm",
        "80",
    ];
    let optical = [
        "estimate",
        "images",
        "--no-sequence",
        "--json",
        "--frame",
        "optical",
    ];
    for ((a, b), c) in frames(&large).iter().zip(&alone).zip(frames(&optical)) {
        let half = Vec3::from(*a) * 0.5;
        assert!((half - Vec3::from(*b)).norm() < 1e-12);
        assert!((Vec3::new(c[0], -c[1], -c[2]) - Vec3::from(*b)).norm() < 1e-12);
    }
    // The file has the same, also of the frame without an orientation; it is read again, bit by bit.
    let timed = run(&["estimate", "images", "--fps", "120"]);
    let header = timed.lines().next().unwrap();
    assert!(
        header.ends_with(
            "cov_zz,x_m,y_m,z_m,cov_m2_xx,cov_m2_xy,cov_m2_xz,cov_m2_yy,cov_m2_yz,cov_m2_zz"
        ),
        "{header}"
    );
    let file = Orientations::read("o.csv".as_ref(), timed.as_bytes()).unwrap();
    let last = &file.rows[3];
    assert!(last.orientation.is_none() && last.position.is_some());
    let again = Orientations::read("o.csv".as_ref(), file.to_csv().as_bytes()).unwrap();
    for (a, b) in file.rows.iter().zip(&again.rows) {
        assert!(a.position.is_some() && a.position == b.position);
    }
    let broken = timed.replacen(&last.position.unwrap().center_m.x.to_string(), "", 1);
    let refused = Orientations::read("o.csv".as_ref(), broken.as_bytes()).unwrap_err();
    assert!(refused.to_string().contains("x_m to z_m"), "{refused}");
    let wrong = [
        "estimate",
        "images",
        "--table",
        "pattern.csv",
        "--ball-diameter-mm",
        "0",
    ];
    crate::common::refused(dir.path(), &wrong, 2, "1 to 1000 mm");
}
