//! The stencil on random patterns: closed halves with the right holes and volume, that open without
//! touching; clear refusals; files that say what they hold.
//!
//! A thousand patterns go through other people's tools with `bench stencils` and
//! `tests/python/check_stencils.py`.

use std::path::Path;
use std::process::Command;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use spindoe::ball::{Ball, DesignRecord};
use spindoe::geometry::{Rotation, Vec3, angle_between, random_direction, spiral_directions};
use spindoe::pattern::Pattern;
use spindoe::stencil::coupon::coupon;
use spindoe::stencil::{
    Bed, COMMON_BEDS, HalfName, HoleSide, Mesh, Stencil, StencilConfig, max_margin_seam, shapes,
};

/// `n` dots at least `separation_deg` apart, by rejection.
fn random_pattern(n: usize, separation_deg: f64, seed: u64) -> Pattern {
    crate::common::spread_pattern(n, separation_deg.to_radians(), seed)
}

/// How often the ray from `origin` along `direction` crosses a mesh (T. Möller, B. Trumbore, "Fast,
/// minimum storage ray/triangle intersection", 1997).
fn crossings(mesh: &Mesh, origin: &Vec3, direction: &Vec3) -> usize {
    (0..mesh.triangles.len())
        .filter(|&t| {
            let [a, b, c] = mesh.corners(t);
            let (e, f) = (b - a, c - a);
            let h = direction.cross(&f);
            let det = e.dot(&h);
            if det.abs() < 1e-14 {
                return false;
            }
            let s = origin - a;
            let u = s.dot(&h) / det;
            let q = s.cross(&e);
            let v = direction.dot(&q) / det;
            u >= 0.0 && v >= 0.0 && u + v <= 1.0 && f.dot(&q) / det > 0.0
        })
        .count()
}

/// Volume of the dome of half A or B above hinge and rims, by quadrature along rays from the ball's
/// center, mm^3: of the ideal shell with its holes, and of the mesh.
fn dome_volumes(stencil: &Stencil, i: usize) -> (f64, f64) {
    let (config, joint) = (stencil.config(), stencil.joint());
    let (inner, outer) = (config.inner_radius_mm(), config.outer_radius_mm());
    let mesh = stencil.placed_half(HalfName::BOTH[i], 0.0);
    let up = if i == 0 { 1.0 } else { -1.0 };
    let low = (joint.arm_mm / outer + 0.02).max(joint.lip_mm / inner + 0.02);
    // Turned, so that no ray runs along the mesh's edges in the coordinate planes.
    let askew = Rotation::from_euler_angles(0.3, 0.2, 0.1);
    let (mut ideal, mut meshed) = (0.0, 0.0);
    let n = 1000;
    let rays = spiral_directions(n).map(|d| askew * d);
    for d in rays.filter(|d| d.z * up > low) {
        let steps = 60;
        for k in 0..steps {
            let r = inner + (outer - inner) * (k as f64 + 0.5) / f64::from(steps);
            let p = r * d;
            let drilled = stencil.dots().iter().any(|dot| {
                let h = p.dot(dot);
                h > 0.0 && (p - h * dot).norm() < config.hole_radius_mm(h)
            });
            // The ceiling is relieved.
            let flat = p.x.hypot(p.y);
            let relieved =
                r < inner + config.ceiling_depth_mm() && flat < config.ceiling_radius_mm();
            if !drilled && !relieved {
                ideal += r * r * (outer - inner) / f64::from(steps);
            }
        }
        // Entering and leaving radii along the ray: the sum of r^3 / 3 with alternating signs.
        let hits = (0..mesh.triangles.len()).filter_map(|t| {
            let [a, b, c] = mesh.corners(t);
            let (e, f) = (b - a, c - a);
            let normal = e.cross(&f);
            let r = normal.dot(&a) / normal.dot(&d);
            let p = r * d;
            let within = [(a, b), (b, c), (c, a)]
                .iter()
                .all(|(s, t)| (t - s).cross(&(p - s)).dot(&normal) >= 0.0);
            (within && r > 0.0).then(|| normal.dot(&d).signum() * r * r * r / 3.0)
        });
        meshed += hits.sum::<f64>();
    }
    let weight = 4.0 * std::f64::consts::PI / n as f64;
    (weight * ideal, weight * meshed)
}

#[test]
fn random_patterns_give_solids_that_open() {
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    for seed in 0..crate::common::few_or_all(6, 20) as u64 {
        let n = rng.random_range(4..=20);
        let pattern = random_pattern(n, 20.0, seed);
        let config = StencilConfig {
            ball_diameter_mm: [40.0, 40.6, 67.0][seed as usize % 3],
            hole_diameter_mm: rng.random_range(2.5..4.0),
            screw_diameter_mm: [2.0, 3.0][seed as usize % 2],
            numbers: seed % 4 == 0,
            ..StencilConfig::default()
        };
        let stencil = Stencil::build(&pattern, &config)
            .unwrap_or_else(|e| panic!("seed {seed}, {n} dots: {e}"));
        for (i, half) in stencil.halves().iter().enumerate() {
            half.check.require_solid("a half").unwrap();
            assert_eq!(half.check.genus() as usize, half.through_holes);
            assert!(half.check.triangles < 20_000 || config.ball_diameter_mm > 60.0);
            let bounds = half.mesh.bounding_box();
            assert!(bounds.min_mm[2].abs() < 1e-5, "seed {seed}: not on the bed");
            if !config.numbers {
                let (ideal, meshed) = dome_volumes(&stencil, i);
                let off = meshed / ideal - 1.0;
                assert!(
                    off.abs() < 0.005,
                    "seed {seed}, half {i}: volume off by {off}"
                );
            }
        }
        assert_halves_apart(&stencil, seed);
        assert_holes_lead_out(&pattern, &stencil, seed);
    }
}

/// No vertex of half B lies in half A, closed or open.
fn assert_halves_apart(stencil: &Stencil, seed: u64) {
    let a = stencil.placed_half(HalfName::A, 0.0);
    let askew = Vec3::new(0.31, 0.17, 0.93).normalize();
    for opening_deg in [0.0f64, 8.0, 15.0, 30.0, 100.0] {
        let b = stencil.placed_half(HalfName::B, opening_deg.to_radians());
        // Near the hinge, where they could touch.
        let reach = stencil.joint().axis_mm - 12.0;
        let near = b.vertices.iter().filter(|v| v.x > reach && v.z > -6.0);
        for v in near.step_by(11) {
            let inside = crossings(&a, v, &askew) % 2 == 1;
            assert!(
                !inside,
                "seed {seed}: halves collide at {opening_deg} degrees"
            );
        }
    }
}

/// From the ball's center the pattern's dots see out through the closed stencil; beside them is wall.
fn assert_holes_lead_out(pattern: &Pattern, stencil: &Stencil, seed: u64) {
    let config = stencil.config();
    let halves = HalfName::BOTH.map(|name| stencil.placed_half(name, 0.0));
    let met = |d: &Vec3| -> usize {
        let center = Vec3::zeros();
        halves.iter().map(|h| crossings(h, &center, d)).sum()
    };
    let beside = ((0.5 * config.hole_diameter_mm + 0.2) / config.inner_radius_mm()).asin();
    for (i, dot) in pattern.dots().iter().enumerate() {
        let d = stencil.rotation() * dot;
        assert_eq!(met(&d), 0, "seed {seed}: the hole of dot {i} is blocked");
        let [u, v] = spindoe::geometry::tangent_frame(&d);
        for k in 0..4 {
            let (sin, cos) = (f64::from(k) * 1.6 + 0.3).sin_cos();
            let ray = beside.cos() * d + beside.sin() * (cos * u + sin * v);
            assert!(met(&ray) > 0, "seed {seed}: no wall beside dot {i}");
        }
    }
}

#[test]
fn building_blocks_enclose_their_volume() {
    let pi = std::f64::consts::PI;
    let z = Vec3::z();
    let square = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)];
    let axes = [&Vec3::x(), &Vec3::y()];
    let section = |h: f64| -> Vec<Vec3> { square.iter().map(|p| Vec3::new(p.0, p.1, h)).collect() };
    let solids = [
        ("sphere", shapes::sphere(10.0, 0.004), 4000.0 / 3.0 * pi),
        (
            "revolve",
            shapes::revolve(&z, &[(0.0, 0.0), (0.0, 2.0), (3.0, 2.0), (3.0, 0.0)], 200),
            12.0 * pi,
        ),
        (
            "ring",
            shapes::ring(&z, &[(0.0, 3.0), (2.0, 3.0), (2.0, 1.0), (0.0, 1.0)], 200),
            16.0 * pi,
        ),
        (
            "prism",
            shapes::prism(&Vec3::zeros(), axes, &square, (0.0, 0.0), [1.0, 4.0]),
            12.0,
        ),
        (
            "loft",
            shapes::loft(&[section(0.0), section(1.0), section(4.0)]),
            16.0,
        ),
    ];
    for (name, mesh, volume) in solids {
        mesh.check().require_solid(name).unwrap();
        let off = mesh.volume_mm3() / volume - 1.0;
        assert!(
            off.abs() < 2e-3,
            "{name}: {} for {volume}",
            mesh.volume_mm3()
        );
    }
}

#[test]
fn the_seam_has_the_greatest_margin() {
    for seed in 0..10 {
        let pattern = random_pattern(12, 10.0, 100 + seed);
        let seam = max_margin_seam(pattern.dots());
        let margin = |n: &Vec3| {
            let sines = pattern.dots().iter().map(|d| d.dot(n).abs());
            sines.fold(1.0, f64::min).asin()
        };
        assert!((margin(&seam.normal) - seam.margin_rad).abs() < 1e-12);
        let best = spiral_directions(20_000)
            .map(|n| margin(&n))
            .fold(0.0, f64::max);
        assert!(best <= seam.margin_rad + 1e-12, "seed {seed}");
        // 20 000 directions leave gaps of about a degree.
        assert!(best > seam.margin_rad - 0.03, "seed {seed}");
    }
}

#[test]
fn geometry_that_cannot_work_is_refused_with_the_figure() {
    let d = StencilConfig::default;
    let few = random_pattern(6, 40.0, 1);
    let cases = [
        (
            random_pattern(30, 5.0, 1),
            StencilConfig {
                hole_diameter_mm: 6.0,
                ..d()
            },
            "mm between them",
        ),
        (
            few.clone(),
            StencilConfig {
                wall_mm: 1.2,
                ..d()
            },
            "mm thick, expected at least",
        ),
        (
            few.clone(),
            StencilConfig {
                wall_mm: 0.3,
                throat_mm: 0.2,
                ..d()
            },
            "wall_mm: expected",
        ),
        (
            few.clone(),
            StencilConfig { knuckles: 4, ..d() },
            "knuckles: expected 3, 5, 7 or 9",
        ),
        (
            few.clone(),
            StencilConfig { knuckles: 9, ..d() },
            "a knuckle would be 1.31 mm thick",
        ),
        (
            few.clone(),
            StencilConfig {
                clearance_mm: 0.0,
                screw_diameter_mm: 6.0,
                ..d()
            },
            "narrows the ball's way",
        ),
        (
            few.clone(),
            StencilConfig {
                chord_error_mm: f64::NAN,
                ..d()
            },
            "chord_error_mm: expected",
        ),
        (
            few,
            StencilConfig {
                ball_diameter_mm: -40.0,
                ..d()
            },
            "ball_diameter_mm: expected",
        ),
        // Holes all around: wherever the hinge lies it meets one.
        (
            Pattern::new(spiral_directions(60).collect()).unwrap(),
            StencilConfig {
                hole_diameter_mm: 2.0,
                ..d()
            },
            "goes through hinge",
        ),
    ];
    for (pattern, config, expected) in cases {
        let error = Stencil::build(&pattern, &config).expect_err(expected);
        assert!(error.is_usage(), "{error}");
        let message = error.to_string();
        assert!(message.contains(expected), "{message}");
        assert!(!message.contains('\n'));
    }
}

/// The largest hole that a refusal names is possible, the next step is not.
#[test]
fn refusals_name_the_largest_hole_that_fits() {
    for seed in 0..4 {
        let pattern = random_pattern(16, 22.0, seed);
        let with = |hole_diameter_mm: f64| StencilConfig {
            hole_diameter_mm,
            ..StencilConfig::default()
        };
        let largest = Stencil::largest_hole_mm(&pattern, &with(1.0)).unwrap();
        Stencil::check(&pattern, &with(largest)).unwrap();
        let above = Stencil::check(&pattern, &with(largest + 0.1)).expect_err("a larger hole fits");
        // The diameter at which the thinnest web is just right, by bisection on the refusal.
        let overlaps = |mm: f64| {
            let words = Stencil::check(&pattern, &with(mm)).map_err(|e| e.to_string());
            words.is_err_and(|w| w.contains("between them") && w.contains("holes of dots"))
        };
        let (mut fits, mut fails) = (0.5, 15.0);
        while fails - fits > 1e-3 {
            let middle = 0.5 * (fits + fails);
            *(if overlaps(middle) {
                &mut fails
            } else {
                &mut fits
            }) = middle;
        }
        assert!(largest <= fits + 1e-3, "seed {seed}");
        let words = Stencil::check(&pattern, &with(12.0))
            .unwrap_err()
            .to_string();
        let named = format!("at most {:.1} mm fit", (10.0 * fits + 0.005).floor() / 10.0);
        assert!(
            words.contains(&named),
            "seed {seed}: {words}; expected {named}; {above}"
        );
        // The ball named is just large enough, and so is the web named thin enough.
        let words = Stencil::check(&pattern, &with(7.0))
            .unwrap_err()
            .to_string();
        let number = |after: &str| -> Option<f64> {
            let (_, rest) = words.rsplit_once(after)?;
            rest.split_whitespace().next()?.parse().ok()
        };
        let ball = number("a ball of at least ").unwrap();
        let on_ball = |ball_diameter_mm: f64| {
            let config = StencilConfig {
                ball_diameter_mm,
                ..with(7.0)
            };
            let checked = Stencil::check(&pattern, &config).map_err(|e| e.to_string());
            checked.is_err_and(|w| w.contains("holes of dots"))
        };
        assert!(
            on_ball(ball - 0.2) && !on_ball(ball + 0.001),
            "seed {seed}: {words}"
        );
        if let Some(min_web_mm) = number("a web of at most ") {
            let config = StencilConfig {
                min_web_mm,
                ..with(7.0)
            };
            let checked = Stencil::check(&pattern, &config).map_err(|e| e.to_string());
            assert!(
                !checked.is_err_and(|w| w.contains("holes of dots")),
                "{words}"
            );
        }
    }
}

/// The largest hole is that of trying all, from the largest on.
#[test]
fn the_largest_hole_is_the_first_that_fits_of_all() {
    for (dots, seed) in [(12, 1), (24, 2), (40, 3)] {
        let pattern = crate::common::spread_pattern(dots, 2.2 / (dots as f64).sqrt(), seed);
        let with = |tenths: u32| StencilConfig {
            hole_diameter_mm: f64::from(tenths) / 10.0,
            ..StencilConfig::default()
        };
        let fits = |tenths: &u32| Stencil::check(&pattern, &with(*tenths)).is_ok();
        let first = (5..=200)
            .rev()
            .find(fits)
            .map(|tenths| f64::from(tenths) / 10.0);
        assert_eq!(Stencil::largest_hole_mm(&pattern, &with(10)), first);
        println!("{dots} dots: {first:?}");
    }
}

/// From 10 to 400 mm a ball has a stencil, whose solids are sound, of the defaults alone.
#[test]
fn balls_of_all_sizes_have_a_stencil() {
    let pattern = Ball::read("dots20".as_ref()).unwrap().into_pattern();
    for ball_mm in [10.0, 12.0, 15.0, 18.0, 20.0, 24.9, 25.0, 67.0, 240.0, 400.0] {
        let config = StencilConfig::for_ball(ball_mm);
        config.validate().unwrap();
        Stencil::check(&pattern, &config).unwrap_or_else(|e| panic!("{ball_mm} mm: {e}"));
    }
    assert_eq!(StencilConfig::for_ball(40.0), StencilConfig::default());
    for ball_mm in [10.0, 15.0] {
        let config = StencilConfig {
            numbers: false,
            ..StencilConfig::for_ball(ball_mm)
        };
        Stencil::build(&pattern, &config).unwrap_or_else(|e| panic!("{ball_mm} mm: {e}"));
    }
    for ball_mm in [9.9, 400.1, f64::NAN] {
        let refused = StencilConfig::for_ball(ball_mm)
            .validate()
            .unwrap_err()
            .to_string();
        assert!(
            refused.contains("ball_diameter_mm: expected 10 to 400 mm"),
            "{refused}"
        );
    }
}

#[test]
fn dots_that_a_camera_hardly_sees_are_warned_of() {
    let dir = tempfile::tempdir().unwrap();
    write_pattern(dir.path());
    let said = |arguments: &[&str]| {
        let output = spindoe(dir.path(), arguments);
        assert!(output.status.success());
        String::from_utf8_lossy(&output.stderr).into_owned()
    };
    let thin = said(&[
        "pattern.csv",
        "-o",
        "thin",
        "--config=no_numbers=true",
        "--dot-diameter-mm",
        "1.4",
    ]);
    assert!(thin.contains("note: dots of 1.4 mm"), "{thin}");
    let usual = said(&["pattern.csv", "-o", "usual", "--config=no_numbers=true"]);
    assert!(!usual.contains("note: dots"), "{usual}");
}

#[test]
fn holes_are_sized_by_the_pen_or_as_large_as_fits() {
    let dir = tempfile::tempdir().unwrap();
    let pattern = write_pattern(dir.path());
    let hole = |name: &str| -> f64 {
        let text = std::fs::read_to_string(dir.path().join(name).join("stencil.json")).unwrap();
        let json: serde_json::Value = serde_json::from_str(&text).unwrap();
        json["parameters"]["hole_diameter_mm"].as_f64().unwrap()
    };
    // A thin pen draws around the hole's edge; a thick one must enter.
    for (pen, expected) in [("2.5", 4.0), ("4.2", 4.6)] {
        let arguments = [
            "pattern.csv",
            "-o",
            "pen",
            "--overwrite",
            "--pen-diameter-mm",
        ];
        let output = spindoe(dir.path(), &[&arguments[..], &[pen]].concat());
        assert!(output.status.success());
        assert!(
            (hole("pen") - expected).abs() < 1e-12,
            "{pen}: {}",
            hole("pen")
        );
    }
    for (arguments, words) in [
        (&["--pen-diameter-mm", "12"][..], "--pen-diameter-mm: "),
        (
            &["--pen-diameter-mm", "3", "--dot-diameter-mm", "3"],
            "--pen-diameter-mm: needs holes of 3.40 mm",
        ),
    ] {
        let output = spindoe(
            dir.path(),
            &[&["pattern.csv", "-o", "no"], arguments].concat(),
        );
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{said}");
        assert!(said.contains(words), "{said}");
        assert!(!dir.path().join("no").exists());
    }
    let auto = spindoe(
        dir.path(),
        &["pattern.csv", "-o", "auto", "--dot-diameter-mm", "auto"],
    );
    assert!(
        auto.status.success(),
        "{}",
        String::from_utf8_lossy(&auto.stderr)
    );
    let largest = Stencil::largest_hole_mm(&pattern, &StencilConfig::default());
    assert_eq!(Some(hole("auto")), largest);
    assert!(hole("auto") > 4.0);
}

/// Every number lies nearer to its own hole than to any other, clearly so for almost all, and none of an
/// even pattern is left out.
#[test]
fn numbers_lie_beside_their_own_holes() {
    for (dots, hole_diameter_mm) in [(12, 4.0), (20, 4.0), (32, 2.5)] {
        let askew = Rotation::from_euler_angles(0.4, 1.1, 0.2);
        let pattern = Pattern::new(spiral_directions(dots).map(|d| askew * d).collect()).unwrap();
        let config = StencilConfig {
            hole_diameter_mm,
            ..StencilConfig::default()
        };
        let stencil = Stencil::build(&pattern, &config).unwrap();
        let (mut clearly, mut all) = (0, 0);
        for name in HalfName::BOTH {
            let half = stencil.half(name);
            assert!(
                half.unnumbered.is_empty(),
                "{dots} dots: {:?}",
                half.unnumbered
            );
            for number in &half.numbers {
                let d = number.direction;
                let at = if name == HalfName::A {
                    d
                } else {
                    Vec3::new(d.x, -d.y, -d.z)
                };
                let distances: Vec<f64> = stencil.dots().iter().map(|o| (o - at).norm()).collect();
                let own = distances[number.dot];
                let others = distances
                    .iter()
                    .enumerate()
                    .filter(|(i, _)| *i != number.dot);
                let nearest = others.map(|(_, d)| *d).fold(f64::INFINITY, f64::min);
                assert!(
                    own < 0.96 * nearest,
                    "{dots} dots, {}: {own} of {nearest}",
                    number.dot
                );
                clearly += usize::from(own < 0.76 * nearest);
                all += 1;
            }
        }
        assert_eq!(all, dots);
        assert!(10 * clearly >= 9 * all, "{dots} dots: {clearly} of {all}");
    }
}

#[test]
fn the_coupon_has_six_closed_rings() {
    let rings = coupon(&StencilConfig::default()).unwrap();
    let check = rings.check();
    assert_eq!(check.bodies, 6);
    assert_eq!(
        (
            check.unmatched_edges,
            check.pinched_vertices,
            check.degenerate_triangles
        ),
        (0, 0, 0)
    );
    // Each ring is a torus: its Euler characteristic is 0.
    assert_eq!(check.euler_characteristic, 0);
    assert!(rings.bounding_box().min_mm[2].abs() < 1e-6);
}

/// A ring takes a ball that is larger by its number in tenths of a millimeter at its widest, all around.
#[test]
fn a_ring_of_the_coupon_is_as_wide_as_its_number_says() {
    let config = StencilConfig::default();
    let rings = coupon(&config).unwrap();
    let on_bed = || rings.vertices.iter().filter(|v| v.z.abs() < 1e-6);
    let pitch = config.ball_diameter_mm + 2.0 * (0.5 + config.wall_mm) + 4.0;
    for tenths in 0..6 {
        let place = [tenths % 3, tenths / 3].map(|k| pitch * f64::from(k));
        let from_middle = |v: &Vec3| (v.x - place[0]).hypot(v.y - place[1]);
        let own = on_bed().map(from_middle).filter(|r| *r < 0.5 * pitch);
        let inner = own.fold(f64::INFINITY, f64::min);
        let expected = 0.5 * config.ball_diameter_mm + 0.1 * f64::from(tenths);
        // Facets lie on the sphere or within the chord's error of it.
        assert!((inner - expected).abs() < 0.021, "{tenths}: {inner}");
    }
}

/// The upper half of a 5 is open to the right, that of a 2 and of a 3 to the left.
#[test]
fn digits_are_engraved_the_right_way_round() {
    let pattern = Pattern::new(spiral_directions(12).collect()).unwrap();
    let stencil = Stencil::build(&pattern, &StencilConfig::default()).unwrap();
    let mut read = Vec::new();
    for name in HalfName::BOTH {
        let mesh = stencil.placed_half(name, 0.0);
        let seen = seen(&mesh);
        for number in &stencil.half(name).numbers {
            if ![2, 3, 5].contains(&number.dot) {
                continue;
            }
            let own = |v: Vec3| match name {
                HalfName::A => v,
                HalfName::B => Vec3::new(v.x, -v.y, -v.z),
            };
            let d = number.direction;
            let up = (Vec3::z() - d.z * d).normalize();
            let right = up.cross(&d);
            let radius = stencil.config().outer_radius_mm();
            let is_engraved = |side: f64| {
                let off = number.height_mm * (0.2 * up + side * right);
                let p = (radius * d + off).normalize();
                let start = stencil.config().inner_radius_mm() + 0.5;
                start + first_hit(&mesh, &seen, &own(start * p), &own(p)) < radius - 0.2
            };
            let sides = (-12..=12).map(|k| f64::from(k) * 0.03);
            let engraved: Vec<f64> = sides.filter(|side| is_engraved(*side)).collect();
            let middle = engraved.iter().sum::<f64>() / engraved.len() as f64;
            read.push((number.dot, middle));
        }
    }
    read.sort_by_key(|(dot, _)| *dot);
    let dots: Vec<usize> = read.iter().map(|(dot, _)| *dot).collect();
    assert_eq!(dots, [2, 3, 5]);
    let is_right = |(dot, middle): &(usize, f64)| match dot {
        5 => *middle < -0.05,
        _ => *middle > 0.05,
    };
    assert!(read.iter().all(is_right), "{read:?}");
}

fn write_pattern(dir: &Path) -> Pattern {
    let pattern = random_pattern(12, 25.0, 3);
    pattern.write_csv(&dir.join("pattern.csv")).unwrap();
    pattern
}

fn spindoe(dir: &Path, arguments: &[&str]) -> std::process::Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_spindoe"));
    command
        .arg("stencil")
        .args(arguments)
        .current_dir(dir)
        .output()
        .unwrap()
}

/// Much of the picture is in half A's orange, half B's blue and the ball's cream.
fn assert_both_halves_are_drawn(path: &Path) {
    let bytes = std::fs::read(path).unwrap();
    let decoder = png::Decoder::new(std::io::Cursor::new(bytes));
    let mut reader = decoder.read_info().unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().expect("a size")];
    let info = reader.next_frame(&mut pixels).unwrap();
    assert_eq!((info.width, info.height), spindoe::plot::STENCIL_SIZE);
    let share = |test: &dyn Fn(i32, i32, i32) -> bool| {
        let [r, g, b] = [0, 1, 2];
        let seen = pixels
            .chunks(3)
            .filter(|p| test(p[r].into(), p[g].into(), p[b].into()));
        3.0 * seen.count() as f64 / pixels.len() as f64
    };
    let orange = share(&|r, g, b| r - b > 50 && g < 130);
    let blue = share(&|r, _, b| b - r > 50);
    let cream = share(&|r, g, b| r > 90 && r - b > 5 && r - b < 50 && r - g < 12);
    assert!(
        orange > 0.1 && blue > 0.1 && cream > 0.01,
        "{orange} {blue} {cream}"
    );
}

/// The model of a 3MF file, at the path where every reader looks for it.
fn model_part(path: &Path) -> String {
    let mut archive = zip::ZipArchive::new(std::fs::File::open(path).unwrap()).unwrap();
    let mut text = String::new();
    let mut part = archive.by_name("3D/3dmodel.model").unwrap();
    std::io::Read::read_to_string(&mut part, &mut text).unwrap();
    text
}

#[test]
fn a_stencil_is_replaced_only_on_demand_and_whole() {
    let dir = tempfile::tempdir().unwrap();
    write_pattern(dir.path());
    let first = spindoe(dir.path(), &["pattern.csv", "-o", "out", "--coupon"]);
    assert!(first.status.success());
    let half = dir.path().join("out/half_a.stl");
    let before = std::fs::read(&half).unwrap();

    let second = ["pattern.csv", "-o", "out", "--config", "wall_mm=3"];
    let refused = spindoe(dir.path(), &second);
    let words = String::from_utf8(refused.stderr).unwrap();
    assert_eq!(refused.status.code(), Some(2), "{words}");
    assert!(words.contains("holds a stencil already"), "{words}");
    assert_eq!(words.lines().count(), 1, "{words}");
    assert!(before == std::fs::read(&half).unwrap());

    let replaced = spindoe(dir.path(), &[&second[..], &["--overwrite"]].concat());
    assert!(replaced.status.success());
    assert!(before != std::fs::read(&half).unwrap());
    assert!(
        !dir.path().join("out/coupon.stl").exists(),
        "the coupon of another wall is left"
    );
}

/// The cone in which a triangle is seen from the ball's center.
struct Seen {
    middle: Vec3,
    cos_reach: f64,
}

/// The cones of all triangles of a mesh.
fn seen(mesh: &Mesh) -> Vec<Seen> {
    let cone = |t: usize| {
        let corners = mesh.corners(t).map(|c| c.normalize());
        let middle = corners.iter().sum::<Vec3>().normalize();
        let cosines = corners.iter().map(|c| c.dot(&middle));
        let cos_reach = cosines.fold(f64::INFINITY, f64::min) - 1e-9;
        Seen { middle, cos_reach }
    };
    (0..mesh.triangles.len()).map(cone).collect()
}

/// Distance from `origin`, on the ray from the ball's center along a unit vector, to the first triangle of a mesh, mm.
fn first_hit(mesh: &Mesh, seen: &[Seen], origin: &Vec3, direction: &Vec3) -> f64 {
    (0..mesh.triangles.len())
        .filter(|t| seen[*t].middle.dot(direction) >= seen[*t].cos_reach)
        .filter_map(|t| {
            let [a, b, c] = mesh.corners(t);
            let normal = (b - a).cross(&(c - a));
            let along = normal.dot(direction);
            let distance = normal.dot(&(a - origin)) / along;
            let p = origin + distance * direction;
            let within = [(a, b), (b, c), (c, a)]
                .iter()
                .all(|(s, t)| (t - s).cross(&(p - s)).dot(&normal) >= 0.0);
            (along != 0.0 && within && distance > 0.0).then_some(distance)
        })
        .fold(f64::INFINITY, f64::min)
}

/// The web asked for lies between the hinge and the holes near the poles of the halves too.
#[test]
fn the_hinge_keeps_clear_of_steep_dots() {
    // Sizes at which the hinge's arms come within the web of a hole 58 degrees above the seam.
    let config = StencilConfig {
        ball_diameter_mm: 20.0,
        clearance_mm: 0.57,
        wall_mm: 2.28,
        throat_mm: 0.4,
        hole_diameter_mm: 6.4,
        taper_rad: 4.3f64.to_radians(),
        min_web_mm: 4.6,
        screw_diameter_mm: 4.8,
        knuckle_wall_mm: 0.9,
        knuckle_clearance_mm: 1.7,
        hinge_length_mm: 8.4,
        nozzle_mm: 0.1,
        numbers: false,
        ..StencilConfig::default()
    };
    let (sin, cos) = 58.3f64.to_radians().sin_cos();
    for turn_deg in [0.0, 30.0, 60.0] {
        let turn = Rotation::from_axis_angle(&Vec3::z_axis(), f64::to_radians(turn_deg));
        let dots = [
            (cos, 0.0, sin),
            (-cos, 0.0, sin),
            (0.0, cos, -sin),
            (0.0, -cos, -sin),
        ];
        let dots = dots.map(|(x, y, z)| turn * Vec3::new(x, y, z)).to_vec();
        let stencil = Stencil::build(&Pattern::new(dots).unwrap(), &config).unwrap();
        for half in HalfName::BOTH.map(|name| stencil.placed_half(name, 0.0)) {
            // What stands out of the shell is hinge or tab.
            let outside = config.outer_radius_mm() + 0.05;
            let edges = (0..half.triangles.len()).flat_map(|t| {
                let [a, b, c] = half.corners(t);
                [(a, b), (b, c), (c, a)]
            });
            let points =
                edges.flat_map(|(a, b)| (0..20).map(move |i| a.lerp(&b, f64::from(i) / 20.0)));
            for p in points.filter(|p| p.norm() > outside) {
                for d in stencil.dots().iter().filter(|d| p.dot(d) > 0.0) {
                    let height = p.dot(d);
                    let hole = config.hole_radius_mm(height.min(config.outer_radius_mm()));
                    let web = (p - height * d).norm() - hole;
                    assert!(
                        web > config.min_web_mm - 0.1,
                        "turned by {turn_deg}: {web:.2} mm"
                    );
                }
            }
        }
    }
}

/// Wherever a number is engraved, four fifths of the wall stay whole beneath it, on walls just thick
/// enough for their rims too.
#[test]
fn engraving_leaves_four_fifths_of_the_wall() {
    for (ball_diameter_mm, wall_mm) in [(20.0, 0.65), (20.0, 1.6), (40.0, 2.8)] {
        let config = StencilConfig {
            ball_diameter_mm,
            wall_mm,
            nozzle_mm: 0.1,
            throat_mm: 0.2,
            hole_diameter_mm: 2.5,
            screw_diameter_mm: 1.0,
            bore_allowance_mm: 0.0,
            knuckle_wall_mm: 0.8,
            knuckle_clearance_mm: 0.1,
            hinge_length_mm: 11.0,
            seam_gap_mm: 0.05,
            ..StencilConfig::default()
        };
        let pattern = random_pattern(14, 30.0, 2);
        let stencil = Stencil::build(&pattern, &config).unwrap();
        // Under the ceiling's relief the wall is thinner to begin with.
        let least = (0.8 * wall_mm).max(wall_mm - 0.5) - config.ceiling_depth_mm();
        for name in HalfName::BOTH {
            let mesh = stencil.placed_half(name, 0.0);
            let seen = seen(&mesh);
            let up = if name == HalfName::A { 1.0 } else { -1.0 };
            let low = (stencil.joint().arm_mm / config.inner_radius_mm()).min(0.9);
            let (mut engraved, mut thinnest) = (0, f64::INFINITY);
            let askew = Rotation::from_euler_angles(0.3, 0.2, 0.1);
            let places = crate::common::few_or_all(2000, 6000);
            for d in spiral_directions(places).map(|d| askew * d) {
                let clear = stencil.dots().iter().all(|dot| {
                    let edge = (config.opening_radius_mm() + 0.05) / config.inner_radius_mm();
                    angle_between(dot, &d) > edge.asin()
                });
                if d.z * up < low || !clear {
                    continue;
                }
                let start = config.inner_radius_mm() - config.clearance_mm;
                let inner = start + first_hit(&mesh, &seen, &(start * d), &d);
                let outer = inner + first_hit(&mesh, &seen, &((inner + 1e-6) * d), &d);
                let wall = outer - inner;
                thinnest = f64::min(thinnest, wall);
                engraved += usize::from(wall < wall_mm - 0.08);
            }
            assert!(
                thinnest > least - 0.045,
                "{thinnest:.3} mm of {wall_mm} mm are left"
            );
            let numbers = stencil.half(name).unnumbered.len();
            let dots = stencil.dots().iter().filter(|d| d.z * up > 0.0).count();
            assert!(
                numbers == dots || engraved > 3,
                "{name}: nothing is engraved"
            );
        }
    }
}

#[test]
fn the_command_writes_files_that_name_the_pattern() {
    let dir = tempfile::tempdir().unwrap();
    let pattern = write_pattern(dir.path());
    let output = spindoe(
        dir.path(),
        &[
            "pattern.csv",
            "-o",
            "out",
            "--coupon",
            "--dot-diameter-mm",
            "3.5",
        ],
    );
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let out = dir.path().join("out");
    let mut names: Vec<_> = std::fs::read_dir(&out)
        .unwrap()
        .map(|e| e.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    let expected = [
        "coupon.stl",
        "drawing.pdf",
        "half_a.stl",
        "half_b.stl",
        "stencil.3mf",
        "stencil.json",
        "stencil.png",
        "stencil.svg",
    ];
    assert_eq!(names, expected);

    let text = std::fs::read_to_string(out.join("stencil.json")).unwrap();
    let json: serde_json::Value = serde_json::from_str(&text).unwrap();
    let sha = pattern.sha256();
    assert_eq!(json["pattern_sha256"], sha.as_str());
    assert_eq!(json["parameters"]["hole_diameter_mm"], 3.5);
    let q = |k: &str| json["rotation_pattern_to_stencil"][k].as_f64().unwrap();
    let rotation = Rotation::from_quaternion(nalgebra::Quaternion::new(
        q("qw"),
        q("qx"),
        q("qy"),
        q("qz"),
    ));
    for (i, dot) in pattern.dots().iter().enumerate() {
        let found = &json["dots"][i];
        let z = (rotation * dot).z;
        let latitude = found["latitude_deg"].as_f64().unwrap().to_radians();
        assert!((latitude.sin() - z).abs() < 1e-9);
        assert_eq!(found["half"], if z > 0.0 { "a" } else { "b" });
    }
    assert_both_halves_are_drawn(&out.join("stencil.png"));
    let model = model_part(&out.join("stencil.3mf"));
    let objects: Vec<&str> = model.split("<object ").skip(1).collect();
    assert_eq!(objects.len(), 2);
    for (i, name) in ["half_a", "half_b"].iter().enumerate() {
        let bytes = std::fs::read(out.join(format!("{name}.stl"))).unwrap();
        assert!(bytes.len() < 1 << 20);
        assert_eq!(&bytes[16..80], sha.as_bytes());
        let stl = stl_io::read_stl(&mut std::io::Cursor::new(&bytes)).unwrap();
        stl.validate().unwrap();
        let expected = json[name]["check"]["triangles"].as_u64().unwrap() as usize;
        assert_eq!(stl.faces.len(), expected);
        assert_eq!(objects[i].matches("<triangle ").count(), expected);
        assert!(objects[i].contains(&format!("stencil {} half {}", &sha[..8], ["A", "B"][i])));
        // The same corners in the same order, as 32-bit floats.
        let vertices: Vec<[f32; 3]> = objects[i]
            .split("<vertex ")
            .skip(1)
            .map(|v| {
                let fields: Vec<f32> = v
                    .split('"')
                    .skip(1)
                    .step_by(2)
                    .take(3)
                    .map(|f| f.parse().unwrap())
                    .collect();
                fields.try_into().unwrap()
            })
            .collect();
        let corners = |face: &stl_io::IndexedTriangle| face.vertices.map(|k| stl.vertices[k].0);
        for (face, text) in stl.faces.iter().zip(objects[i].split("<triangle ").skip(1)) {
            let found: Vec<[f32; 3]> = text
                .split('"')
                .skip(1)
                .step_by(2)
                .take(3)
                .map(|k| vertices[k.parse::<usize>().unwrap()])
                .collect();
            assert_eq!(corners(face).as_slice(), found);
        }
    }
}

#[test]
fn bad_input_is_one_line_exit_2_and_no_files() {
    let dir = tempfile::tempdir().unwrap();
    write_pattern(dir.path());
    std::fs::write(dir.path().join("bad.csv"), "1,0,0\n0,1\n").unwrap();
    let cases: [(&[&str], &str); 4] = [
        (&["missing.csv", "-o", "out"], "missing.csv"),
        (&["bad.csv", "-o", "out"], "line 2"),
        (
            &["pattern.csv", "-o", "out", "--config", "wall_mm=-1"],
            "wall",
        ),
        (
            &["pattern.csv", "-o", "out", "--dot-diameter-mm", "12"],
            "between them",
        ),
    ];
    for (arguments, expected) in cases {
        let output = spindoe(dir.path(), arguments);
        let words = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{words}");
        assert_eq!(words.lines().count(), 1, "{words}");
        assert!(words.contains(expected), "{words}");
        assert!(!dir.path().join("out").exists());
    }
}

#[test]
fn the_same_pattern_gives_the_same_bytes() {
    let dir = tempfile::tempdir().unwrap();
    let pattern = random_pattern(12, 25.0, 3);
    for name in ["one", "two"] {
        let stencil = Stencil::build(&pattern, &StencilConfig::default()).unwrap();
        stencil.write(&dir.path().join(name)).unwrap();
    }
    for file in ["half_a.stl", "half_b.stl", "stencil.json", "stencil.3mf"] {
        let read = |name: &str| std::fs::read(dir.path().join(name).join(file)).unwrap();
        assert!(read("one") == read("two"), "{file}");
    }
}

/// Windows over zones without dots: open over their whole width, nothing else in their way, and arrows
/// where there is no space.
#[test]
fn zones_become_windows() {
    use spindoe::KeepOut;
    let mut rng = ChaCha8Rng::seed_from_u64(77);
    let mut windows = 0;
    for seed in 0..4 {
        let pattern = random_pattern(12, 24.0, 300 + seed);
        let zones = (0..3).map(|_| {
            let axis = random_direction(&mut rng);
            let free = pattern.dots().iter().map(|d| angle_between(d, &axis));
            KeepOut {
                axis,
                half_angle_rad: 0.95 * free.fold(1.2, f64::min),
            }
        });
        let pattern = pattern.clone().with_keep_out(zones.collect()).unwrap();
        let stencil = Stencil::build(&pattern, &StencilConfig::default()).unwrap();
        let found = stencil.windows();
        assert_eq!(found.len() + stencil.closed_zones().len(), 3);
        windows += found.len();
        for window in found {
            let zone = stencil.zones()[window.zone];
            assert!(window.axis.dot(&zone.axis) > 1.0 - 1e-12);
            // A cone of half the angle a cuts a ball of 20 mm radius in a circle of 20 sin(a).
            let on_ball = 20.0 * zone.half_angle_rad.sin();
            assert!((window.zone_radius_mm - on_ball).abs() < 1e-9);
            let limit = stencil.config().inner_radius_mm() * zone.half_angle_rad.sin();
            assert!(window.radius_mm >= 2.0 && window.radius_mm < limit + 1e-9);
            let [u, v] = spindoe::geometry::tangent_frame(&window.axis);
            for half in HalfName::BOTH {
                let mesh = stencil.placed_half(half, 0.0);
                for k in 0..12 {
                    let (sin, cos) = (f64::from(k) * std::f64::consts::FRAC_PI_6).sin_cos();
                    let from = |r: f64| r * (cos * u + sin * v) + window.axis;
                    let inside = crossings(&mesh, &from(0.98 * window.radius_mm), &window.axis);
                    assert_eq!(inside, 0, "seed {seed}, zone {}", window.zone);
                }
            }
        }
    }
    assert!(windows >= 3, "{windows} windows: nothing was tested");
}

/// Holes and ball are those of the design, whatever form it comes in, unless flags say otherwise.
#[test]
fn a_design_brings_its_sizes_along() {
    let dir = tempfile::tempdir().unwrap();
    let record = DesignRecord {
        ball_diameter_mm: 43.0,
        dot_diameter_mm: 5.2,
        camera: None,
        criterion: None,
    };
    let plain = Ball::new(random_pattern(12, 28.0, 3));
    plain.write_csv(&dir.path().join("plain.csv")).unwrap();
    let ball = plain.with_design(Some(record)).unwrap();
    let folder = dir.path().join("design");
    std::fs::create_dir(&folder).unwrap();
    ball.write_csv(&folder.join("pattern.csv")).unwrap();
    ball.write_npz(&dir.path().join("table.npz")).unwrap();
    // What decides is one function; the command is shown to ask it, from a folder, a table and a bare pattern.
    for (file, stated, sizes) in [
        ("design/pattern.csv", [None, None], [43.0, 5.2]),
        ("design/pattern.csv", [None, Some(3.1)], [43.0, 3.1]),
        ("plain.csv", [None, None], [40.0, 4.0]),
    ] {
        let ball = Ball::read(&dir.path().join(file)).unwrap();
        assert_eq!(ball.sizes_mm(stated[0], stated[1]), sizes, "{file}");
    }
    let cases: [(&[&str], [f64; 2]); 4] = [
        (&["design"], [43.0, 5.2]),
        (&["table.npz", "--dot-diameter-mm", "3.1"], [43.0, 3.1]),
        (&["design", "--ball-diameter-mm", "86"], [86.0, 10.4]),
        (&["plain.csv", "--ball-diameter-mm", "220"], [220.0, 22.0]),
    ];
    for (arguments, sizes) in cases {
        let output = spindoe(
            dir.path(),
            &[arguments, &["-o", "out", "--overwrite"]].concat(),
        );
        let words = String::from_utf8_lossy(&output.stdout).into_owned();
        assert!(
            output.status.success(),
            "{}",
            String::from_utf8_lossy(&output.stderr)
        );
        let text = std::fs::read_to_string(dir.path().join("out/stencil.json")).unwrap();
        let json: serde_json::Value = serde_json::from_str(&text).unwrap();
        let found =
            ["ball_diameter_mm", "hole_diameter_mm"].map(|k| json["parameters"][k].as_f64());
        assert_eq!(found, sizes.map(Some), "{arguments:?}");
        assert!(
            words.contains(&format!("holes of {} mm", sizes[1])),
            "{words}"
        );
        // Shell, tab and hinge stand out by 10 to 20 mm: 220 mm is too large for beds of 220.
        let fits = if sizes[0] > 200.0 {
            "256 x 256"
        } else {
            "all common beds"
        };
        assert!(words.contains(fits), "{words}");
    }
}

/// Beds are rectangles, and halves may stand either way on them.
#[test]
fn beds_hold_what_is_smaller_than_they_are() {
    let bed = Bed {
        printers: "",
        size_mm: [250.0, 210.0, 100.0],
    };
    for (size, holds) in [
        ([240.0, 200.0, 100.0], true),
        ([200.0, 240.0, 90.0], true),
        ([240.0, 212.0, 90.0], false),
        ([249.0, 100.0, 90.0], false),
        ([100.0, 100.0, 101.0], false),
    ] {
        assert_eq!(bed.holds(size), holds, "{size:?}");
    }
    assert!(
        COMMON_BEDS
            .windows(2)
            .all(|b| b[0].size_mm[0] <= b[1].size_mm[0])
    );
}

/// A number that reads as another upside down has a line engraved beneath it, others have none.
#[test]
fn numbers_that_turn_into_others_are_underlined() {
    let turned = |dot: usize| -> Option<String> {
        let digits = dot.to_string();
        let turned = digits
            .chars()
            .rev()
            .map(|c| "01----9-86".chars().nth(c as usize - 48));
        let turned: Option<String> = turned.collect();
        turned.filter(|t| !t.contains('-'))
    };
    for dot in 0..64 {
        let other = turned(dot).filter(|t| !t.starts_with('0'));
        let other = other.and_then(|t| t.parse::<usize>().ok());
        let ambiguous = other.is_some_and(|other| other != dot && other < 64);
        assert_eq!(spindoe::pattern::reads_upside_down(dot), ambiguous, "{dot}");
    }
    let pattern = Pattern::new(spiral_directions(12).collect()).unwrap();
    let stencil = Stencil::build(&pattern, &StencilConfig::default()).unwrap();
    for name in HalfName::BOTH {
        let mesh = stencil.placed_half(name, 0.0);
        let seen = seen(&mesh);
        for number in &stencil.half(name).numbers {
            let own = |v: Vec3| match name {
                HalfName::A => v,
                HalfName::B => Vec3::new(v.x, -v.y, -v.z),
            };
            let d = number.direction;
            let up = (Vec3::z() - d.z * d).normalize();
            let radius = stencil.config().outer_radius_mm();
            // Digits end half their height below their middle; with a line beneath, the middle of both is
            // lower, and the line lies around 0.6 of the height below it.
            let right = up.cross(&d);
            let lined = [-0.1, 0.0, 0.1].iter().all(|side| {
                let off = number.height_mm * (0.6 * up + *side * right);
                let p = (radius * d - off).normalize();
                let start = stencil.config().inner_radius_mm() + 0.5;
                let out = first_hit(&mesh, &seen, &own(start * p), &own(p));
                start + out < radius - 0.2
            });
            assert_eq!(lined, [6, 9].contains(&number.dot), "{}", number.dot);
        }
    }
}

#[test]
fn a_half_says_what_it_is_for() {
    let pattern = random_pattern(10, 30.0, 5);
    let id = format!("#{:.6}", pattern.sha256());
    // A measured diameter is engraved in hundredths, so that the label fits on the half.
    for (diameter, written) in [(40.3, "40.3"), (36.273_611_834, "36.27")] {
        let config = StencilConfig {
            ball_diameter_mm: diameter,
            ..StencilConfig::default()
        };
        let stencil = Stencil::build(&pattern, &config).unwrap();
        for (half, name) in stencil.halves().iter().zip(["A", "B"]) {
            let texts: Vec<&str> = half.labels.iter().map(|l| l.text.as_str()).collect();
            assert_eq!(texts, [&format!("{name} Ø{written}"), &id]);
            for label in &half.labels {
                assert!(label.direction.z > 0.0 && label.height_mm >= 2.4);
            }
        }
    }
}

#[test]
fn the_pin_goes_through_the_bore_and_snaps() {
    for (screw, length) in [(3.0, 15.0), (2.0, 9.0), (4.0, 20.0)] {
        let config = StencilConfig {
            screw_diameter_mm: screw,
            hinge_length_mm: length,
            clearance_mm: 0.3,
            wall_mm: 3.4,
            ..StencilConfig::default()
        };
        let pin = spindoe::stencil::pin(&config).unwrap();
        let check = pin.check();
        assert_eq!((check.bodies, check.euler_characteristic), (1, 2));
        let bounds = pin.bounding_box();
        assert!(bounds.min_mm[2].abs() < 1e-6, "it lies on the bed");
        let bore = 0.5 * (screw + config.bore_allowance_mm);
        let up = 0.7 * 0.5 * screw;
        let radius = |v: &Vec3| v.y.hypot(v.z - up);
        let shaft = pin.vertices.iter().filter(|v| v.x > 2.0 && v.x < length);
        assert!(shaft.map(radius).all(|r| r < bore));
        let barb = pin.vertices.iter().filter(|v| v.x > length + 1.6);
        let barb = barb.map(radius).fold(0.0, f64::max);
        // Wider than the bore, but not when the slot of 0.6 mm is pressed shut.
        assert!(barb > bore && barb - 0.3 < bore, "{barb} mm in {bore} mm");
    }
}

/// The pieces of a large ball's halves are solids that make up the half, none of which cuts a hole.
#[test]
fn a_half_in_pieces_is_the_half() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("designs/dots20/pattern.csv");
    let pattern = Pattern::read_csv(&path).unwrap();
    for segments in [2, 4] {
        let config = StencilConfig {
            ball_diameter_mm: 220.0,
            hole_diameter_mm: 22.0,
            segments,
            numbers: false,
            chord_error_mm: 0.3,
            ..StencilConfig::default()
        };
        let stencil = Stencil::build(&pattern, &config).unwrap();
        let whole = Stencil::build(
            &pattern,
            &StencilConfig {
                segments: 1,
                ..config.clone()
            },
        );
        let whole = whole.unwrap();
        let [width, depth, _] = stencil.print_size_mm();
        let [whole_width, whole_depth, _] = whole.print_size_mm();
        assert!(width * depth < 0.8 * whole_width * whole_depth);
        let askew = Vec3::new(0.31, 0.17, 0.93).normalize();
        for name in HalfName::BOTH {
            let half = stencil.half(name);
            assert_eq!(half.pieces.len(), segments);
            assert!(half.screws >= 2 * segments);
            let placed = half.pieces.iter().map(|piece| {
                piece.check.require_solid("a piece").unwrap();
                assert_eq!(piece.check.genus() as usize, piece.through_holes);
                assert!(piece.mesh.bounding_box().min_mm[2].abs() < 1e-5);
                let back = Rotation::from_axis_angle(&Vec3::z_axis(), -piece.turn_rad);
                piece.mesh.mapped(|v| back * v)
            });
            let placed: Vec<Mesh> = placed.collect();
            let parts: f64 = half.pieces.iter().map(|piece| piece.check.volume_mm3).sum();
            let missing = 1.0 - parts / half.check.volume_mm3;
            assert!(
                (0.0..0.01).contains(&missing),
                "{name}: {missing} of the half is missing"
            );
            let holding = |p: &Vec3| -> Vec<usize> {
                let inside = |mesh: &Mesh| crossings(mesh, p, &askew) % 2 == 1;
                (0..segments).filter(|&k| inside(&placed[k])).collect()
            };
            // Around each hole the wall is one piece's.
            let up = Vec3::new(0.0, 0.0, stencil.joint().lip_mm);
            let radius = config.inner_radius_mm() + 0.3 * config.wall_mm;
            for (dot, side) in stencil.dots().iter().zip(stencil.sides()) {
                let is_own = matches!(
                    (side, name),
                    (HoleSide::A, HalfName::A) | (HoleSide::B, HalfName::B)
                );
                if !is_own {
                    continue;
                }
                let own = if name == HalfName::A {
                    *dot
                } else {
                    Vec3::new(dot.x, -dot.y, -dot.z)
                };
                let [u, v] = spindoe::geometry::tangent_frame(&own);
                let edge = 0.5 * config.hole_diameter_mm + 0.5;
                let around: Vec<_> = (0..8)
                    .map(|k| {
                        let (sin, cos) = (f64::from(k) * std::f64::consts::FRAC_PI_4).sin_cos();
                        let p = (radius * radius - edge * edge).sqrt() * own
                            + edge * (cos * u + sin * v);
                        holding(&(p + up))
                    })
                    .collect();
                assert!(
                    around.iter().all(|k| k.len() == 1 && *k == around[0]),
                    "{name}: {around:?}"
                );
            }
            // Of the half's wall no place is in two pieces, and few are in the gaps.
            let mut rng = ChaCha8Rng::seed_from_u64(4);
            let (mut wall, mut gaps) = (0, 0);
            for _ in 0..300 {
                let direction = random_direction(&mut rng);
                let p = radius * Vec3::new(direction.x, direction.y, direction.z.abs()) + up;
                if crossings(&half.mesh, &p, &askew) % 2 == 1 {
                    wall += 1;
                    let pieces = holding(&p).len();
                    assert!(pieces <= 1);
                    gaps += usize::from(pieces == 0);
                }
            }
            assert!(
                wall > 150 && gaps <= 3,
                "{gaps} of {wall} places are in no piece"
            );
        }
    }
}

/// A stencil in pieces is replaced with its pieces; one for which there is no place says so.
#[test]
fn pieces_come_and_go_with_their_stencil() {
    let dir = tempfile::tempdir().unwrap();
    write_pattern(dir.path());
    let build = |more: &[&str]| {
        let usual = [
            "pattern.csv",
            "-o",
            "s",
            "--overwrite",
            "--ball-diameter-mm",
            "120",
            "--config=no_numbers=true",
        ];
        let coarse = ["--dot-diameter-mm", "6", "--config", "chord_error_mm=0.2"];
        spindoe(dir.path(), &[&usual[..], &coarse, more].concat())
    };
    let done = build(&["--segments", "3"]);
    assert!(
        done.status.success(),
        "{}",
        String::from_utf8_lossy(&done.stderr)
    );
    let words = String::from_utf8(done.stdout).unwrap();
    assert!(
        words.contains("3 pieces") && words.contains("a piece takes"),
        "{words}"
    );
    let pieces = |half: &str| {
        (1..=3)
            .map(|k| format!("half_{half}_{k}.stl"))
            .collect::<Vec<_>>()
    };
    let there = |name: &String| dir.path().join("s").join(name).exists();
    let all = [pieces("a"), pieces("b")].concat();
    assert!(all.iter().all(there));
    assert_eq!(
        model_part(&dir.path().join("s/stencil.3mf"))
            .matches("<object ")
            .count(),
        6
    );
    assert!(build(&[]).status.success());
    assert!(!all.iter().any(there));
    for (segments, words) in [("7", "1 to 6"), ("0", "1 to 6"), ("many", "--segments")] {
        let refused = build(&["--segments", segments]);
        assert_eq!(refused.status.code(), Some(2));
        let line = String::from_utf8(refused.stderr).unwrap();
        assert!(
            line.contains(words) && line.trim().lines().count() == 1,
            "{line}"
        );
    }
}

/// The bore of the printed knuckles is wider than the screw by the allowance, across.
#[test]
fn the_bore_is_as_wide_as_screw_and_allowance() {
    let pattern = Pattern::new(spiral_directions(12).collect()).unwrap();
    let config = StencilConfig {
        screw_diameter_mm: 2.5,
        bore_allowance_mm: 0.4,
        numbers: false,
        ..StencilConfig::default()
    };
    let stencil = Stencil::build(&pattern, &config).unwrap();
    for name in HalfName::BOTH {
        let mesh = stencil.placed_half(name, 0.0);
        let knuckles = mesh
            .vertices
            .iter()
            .filter(|v| v.y.abs() <= 0.5 * config.hinge_length_mm);
        let off_axis = knuckles.map(|v| (v.x - stencil.joint().axis_mm).hypot(v.z));
        let bore = off_axis.fold(f64::INFINITY, f64::min);
        assert!((bore - 1.45).abs() < 0.03, "{bore} mm");
    }
}

/// Each ring states its own clearance, where it can be read: the strokes in the upper and the lower half of a 2, 3 and 5 lie to one side, a
/// 0 is open in its middle, a 1 has its stroke there.
#[test]
fn rings_of_the_coupon_state_their_clearance() {
    let config = StencilConfig::default();
    let rings = coupon(&config).unwrap();
    let pitch = config.ball_diameter_mm + 2.0 * (0.5 + config.wall_mm) + 4.0;
    let mut read = Vec::new();
    for tenths in [0, 1, 2, 3, 5u32] {
        let [x, y] = [tenths % 3, tenths / 3].map(|k| pitch * f64::from(k));
        let own = rings.mapped(|v| v - Vec3::new(x, y, 0.0));
        let seen = seen(&own);
        let inner = 0.5 * config.ball_diameter_mm + 0.1 * f64::from(tenths);
        let outer = inner + config.wall_mm;
        // Rings are 6 mm high, their numbers half of that, in the middle of the front.
        let sine = 3.0 / outer;
        let front = Vec3::new(0.0, -(1.0 - sine * sine).sqrt(), sine);
        let up = (Vec3::z() - front.z * front).normalize();
        let is_engraved = |side: f64, above: f64| {
            let p = (outer * front + 3.0 * (side * Vec3::x() + above * up)).normalize();
            let start = inner + 0.5;
            start + first_hit(&own, &seen, &(start * p), &p) < outer - 0.2
        };
        let middle = |above: f64| {
            let sides = (-12..=12).map(|k| f64::from(k) * 0.03);
            let engraved: Vec<f64> = sides.filter(|side| is_engraved(*side, above)).collect();
            engraved.iter().sum::<f64>() / engraved.len() as f64
        };
        read.push((tenths, [middle(0.2), middle(-0.2)], is_engraved(0.0, 0.0)));
    }
    let side = |x: f64| match x {
        x if x > 0.05 => 'r',
        x if x < -0.05 => 'l',
        x if x.abs() <= 0.05 => 'm',
        _ => '?',
    };
    let words: Vec<String> = read
        .iter()
        .map(|(k, [above, below], inside)| {
            format!("{k}{}{}{}", side(*above), side(*below), u8::from(*inside))
        })
        .collect();
    let is = |k: usize, word: &str| assert!(words[k].starts_with(word), "{words:?} {read:?}");
    is(0, "0mm0");
    is(1, "1");
    assert!(read[1].2, "{words:?}");
    is(2, "2rl");
    is(3, "3rr");
    is(4, "5lr");
}
