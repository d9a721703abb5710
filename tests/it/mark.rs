//! Lobes, stickers and plotters' files: laid back on the ball, every dot is where the pattern has it.
//!
//! `tests/python/check_marks.py` reads the written files with other people's readers, where Python has them.

use std::f64::consts::{FRAC_PI_2, TAU};
use std::path::Path;
use std::process::{Command, Output};

use spindoe::geometry::{Rotation, Vec3, angle_between, spiral_directions};
use spindoe::mark::{
    Drawing, GoreConfig, Layer, MarkConfig, PageSize, PlotterConfig, Shape, dxf_text, free_axis,
    gores, pdf_bytes, plotter_paths, svg_text,
};
use spindoe::pattern::Pattern;

/// Diameters of balls: squash, table tennis (two), golf, football, mm.
const BALLS_MM: [f64; 5] = [38.0, 40.0, 40.3, 42.67, 220.0];

fn pattern(dots: usize) -> Pattern {
    let askew = Rotation::from_euler_angles(0.4, 1.1, 0.2);
    Pattern::new(spiral_directions(dots).map(|d| askew * d).collect()).unwrap()
}

/// Sizes for a ball, its dots a tenth of it.
fn config(ball_diameter_mm: f64) -> MarkConfig {
    MarkConfig {
        ball_diameter_mm,
        dot_diameter_mm: 0.1 * ball_diameter_mm,
        ..MarkConfig::default()
    }
}

#[test]
fn the_poles_are_as_free_as_any_axis() {
    for dots in [4, 12, 20, 33] {
        let pattern = pattern(dots);
        let free = |n: &Vec3| {
            let angles = pattern.dots().iter().map(|d| angle_between(d, n));
            angles.fold(f64::INFINITY, |least, a| {
                least.min(a).min(std::f64::consts::PI - a)
            })
        };
        let axis = free_axis(pattern.dots());
        assert!((free(&axis.direction) - axis.clearance_rad).abs() < 1e-6);
        let best = spiral_directions(100_001)
            .map(|n| free(&n))
            .fold(0.0, f64::max);
        assert!(axis.clearance_rad > best - 1e-3, "{dots} dots: {best}");
        let pole = axis.rotation(0.7) * axis.direction;
        assert!((pole - Vec3::z()).norm() < 1e-12);
    }
}

/// A number of the drawing's note.
fn note(drawing: &Drawing, name: &str) -> f64 {
    drawing.note[name].as_f64().unwrap()
}

fn rotation(drawing: &Drawing) -> Rotation {
    let q = |k: &str| {
        drawing.note["rotation_pattern_to_mark"][k]
            .as_f64()
            .unwrap()
    };
    Rotation::from_quaternion(nalgebra::Quaternion::new(
        q("qw"),
        q("qx"),
        q("qy"),
        q("qz"),
    ))
}

/// The parts of all dots, laid back on the ball by the note alone: every point lies within its dot, the
/// points on the rims surround it, and the parts make up its area.
#[test]
fn lobes_hold_all_of_every_dot() {
    for (i, &ball) in BALLS_MM.iter().enumerate() {
        let pattern = pattern(24);
        let (config, lobes) = (config(ball), [12, 16, 24][i % 3]);
        let page = [PageSize::Sheet, PageSize::A4, PageSize::Letter][i % 3];
        let drawing = gores(
            &pattern,
            &config,
            &GoreConfig {
                lobes,
                page,
                ..GoreConfig::default()
            },
        )
        .unwrap();
        let (radius, edge) = (0.5 * ball, config.dot_angle_rad());
        let back = rotation(&drawing).inverse();
        let half_lobe = std::f64::consts::PI / note(&drawing, "lobes");
        let mut areas = vec![0.0; pattern.len()];
        let mut rims = vec![0.0; pattern.len()];
        for piece in drawing.note["pieces"].as_array().unwrap() {
            let value = |k: &str| piece[k].as_f64().unwrap();
            let page = &drawing.pages[value("page") as usize];
            let meridian =
                Rotation::from_axis_angle(&Vec3::z_axis(), value("longitude_deg").to_radians());
            for item in page.items.iter().filter(|i| i.layer == Layer::Dots) {
                let Shape::Area(points) = &item.shape else {
                    panic!("a dot is no area")
                };
                let local: Vec<_> = points
                    .iter()
                    .map(|p| {
                        (
                            (p.x - value("x_mm")) / radius,
                            (p.y - value("y_mm")) / radius,
                        )
                    })
                    .collect();
                let n = local.len() as f64;
                let middle = local
                    .iter()
                    .fold((0.0, 0.0), |m, p| (m.0 + p.0 / n, m.1 + p.1 / n));
                let range = value("from_mm") / radius..=value("to_mm") / radius;
                if middle.0.abs() > half_lobe || !range.contains(&middle.1) {
                    continue;
                }
                let dot = item.dot.unwrap();
                for (k, &(u, v)) in local.iter().enumerate() {
                    let p = Vec3::new(u.cos() * v.cos(), u.sin(), u.cos() * v.sin());
                    let off = radius
                        * (angle_between(&(back * meridian * p), &pattern.dots()[dot]) - edge);
                    assert!(off < 0.01, "{ball} mm, dot {dot}: {off} mm outside");
                    let (next_u, next_v) = local[(k + 1) % local.len()];
                    areas[dot] += radius.powi(2) * 0.5 * (u.sin() + next_u.sin()) * (next_v - v);
                    if off.abs() < 0.01 {
                        rims[dot] += radius * (next_u - u).hypot(next_v - v);
                    }
                }
            }
        }
        let area = TAU * radius.powi(2) * (1.0 - edge.cos());
        for dot in 0..pattern.len() {
            let share = areas[dot] / area;
            assert!(
                (share - 1.0).abs() < 0.005,
                "{ball} mm, dot {dot}: {share} of its area"
            );
            assert!(
                rims[dot] > 0.9 * TAU * radius * edge.sin(),
                "{ball} mm, dot {dot}: no rim"
            );
        }
    }
}

/// Neighboring lobes share their cut: together they cover the ball once.
#[test]
fn lobes_cover_the_ball() {
    for lobes in [12, 24] {
        let config = config(40.0);
        let drawing = gores(
            &pattern(20),
            &config,
            &GoreConfig {
                lobes,
                ..GoreConfig::default()
            },
        )
        .unwrap();
        let radius = config.radius_mm();
        let mut area = 0.0;
        for item in drawing.pages[0]
            .items
            .iter()
            .filter(|i| i.layer == Layer::Cut)
        {
            let Shape::Loop(points) = &item.shape else {
                panic!("a cut is no loop")
            };
            let middle = points.iter().map(|p| p.x).sum::<f64>() / points.len() as f64;
            for (k, p) in points.iter().enumerate() {
                let q = points[(k + 1) % points.len()];
                let strip = |x: f64| radius * ((x - middle) / radius).sin();
                area += 0.5 * (strip(p.x) + strip(q.x)) * (q.y - p.y);
            }
        }
        let ball = 2.0 * TAU * radius.powi(2);
        assert!(
            (area / ball - 1.0).abs() < 1e-3,
            "{lobes} lobes: {} of the ball",
            area / ball
        );
    }
}

#[test]
fn a_pen_inks_each_dot_and_nothing_else() {
    for ball in BALLS_MM {
        let (pattern, config) = (pattern(20), config(ball));
        let plotter = PlotterConfig {
            pen_diameter_mm: 0.02 * ball,
            ..PlotterConfig::default()
        };
        let (rotation, paths) = plotter_paths(&pattern, &config, &plotter).unwrap();
        assert_eq!(paths.len(), pattern.len());
        for path in &paths {
            let points: Vec<Vec3> = path
                .longitudes
                .iter()
                .zip(&path.latitudes)
                .map(|(l, p)| Vec3::new(p.cos() * l.cos(), p.cos() * l.sin(), p.sin()))
                .collect();
            let jumps = points.windows(2).map(|w| (w[1] - w[0]).norm() * 0.5 * ball);
            assert!(jumps.fold(0.0, f64::max) < 1.2 * plotter.pen_diameter_mm);
            assert!(path.latitudes.iter().all(|p| p.abs() < FRAC_PI_2 - 0.01));
            let turn = path
                .longitudes
                .windows(2)
                .map(|w| (w[1] - w[0]).abs())
                .fold(0.0, f64::max);
            assert!(turn < 1.0, "the ball jumps by {turn} rad");
            let center = rotation * pattern.dots()[path.dot];
            let reach =
                |p: &Vec3| 0.5 * ball * angle_between(p, &center) + 0.5 * plotter.pen_diameter_mm;
            let most = points.iter().map(reach).fold(0.0, f64::max);
            let dot = 0.5 * ball * config.dot_angle_rad();
            assert!(
                (most - dot).abs() < 0.02,
                "{ball} mm: ink to {most} of {dot} mm"
            );
        }
    }
}

#[test]
fn the_same_marks_give_the_same_bytes() {
    let make = || {
        gores(
            &pattern(20),
            &config(40.0),
            &GoreConfig {
                page: PageSize::A4,
                ..GoreConfig::default()
            },
        )
        .unwrap()
    };
    let (a, b) = (make(), make());
    assert_eq!(svg_text(&a), svg_text(&b));
    assert_eq!(pdf_bytes(&a), pdf_bytes(&b));
    assert_eq!(dxf_text(&a), dxf_text(&b));
}

fn spindoe(dir: &Path, arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_spindoe"));
    command
        .arg("mark")
        .args(arguments)
        .current_dir(dir)
        .output()
        .unwrap()
}

#[test]
fn bad_input_is_one_line_and_leaves_no_file() {
    let dir = tempfile::tempdir().unwrap();
    pattern(20)
        .write_csv(&dir.path().join("pattern.csv"))
        .unwrap();
    let cases: [(&[&str], &str); 7] = [
        (&["--as", "gores", "-o", "out.png"], ".svg, .pdf or .dxf"),
        (&["--as", "plotter", "-o", "out.pdf"], ".svg or .gcode"),
        (
            &["--as", "gores", "-o", "out.svg", "--lobes", "11"],
            "12 to 24",
        ),
        (
            &[
                "--as",
                "gores",
                "-o",
                "out.pdf",
                "--ball-diameter-mm",
                "900",
                "--dot-diameter-mm",
                "50",
            ],
            "more lobes",
        ),
        (
            &[
                "--as",
                "stickers",
                "-o",
                "out.svg",
                "--dot-diameter-mm",
                "19",
            ],
            "at most",
        ),
        (
            &["--as", "plotter", "-o", "out.svg", "--pen-diameter-mm", "5"],
            "the dot's diameter",
        ),
        (
            &[
                "--as",
                "plotter",
                "-o",
                "out.gcode",
                "--config",
                "pen_up=M3\nS4",
            ],
            "one line of G-code",
        ),
    ];
    for (arguments, expected) in cases {
        let output = spindoe(dir.path(), &[&["pattern.csv"], arguments].concat());
        let words = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{words}");
        assert_eq!(words.lines().count(), 1, "{words}");
        assert!(words.contains(expected), "{words}");
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1);
    }
}

/// Whether Python has the readers that `check_marks.py` needs.
fn python_reads() -> bool {
    let readers = "import numpy, svgpathtools, pdfplumber, ezdxf";
    let found = Command::new("python3").args(["-c", readers]).output();
    found.is_ok_and(|output| output.status.success())
}

#[test]
fn other_readers_find_every_dot_in_its_place() {
    if !python_reads() {
        let readers = "numpy, svgpathtools, pdfplumber and ezdxf";
        return crate::common::skipped(&format!("python3 with {readers} is not installed"));
    }
    let dir = tempfile::tempdir().unwrap();
    pattern(20)
        .write_csv(&dir.path().join("pattern.csv"))
        .unwrap();
    let mut names = Vec::new();
    for (i, ball) in BALLS_MM.iter().enumerate() {
        let (lobes, page) = ([12, 24][i % 2].to_string(), ["a4", "letter"][i % 2]);
        let (diameter, dot, pen) = (
            ball.to_string(),
            (0.1 * ball).to_string(),
            format!("pen_diameter_mm={}", 0.02 * ball),
        );
        let paper = ["--paper", page];
        let gores = ["--paper", page, "--lobes", &lobes];
        let plotter = ["--config", &pen];
        for (way, ending, own) in [
            ("gores", "svg", &gores[..]),
            ("gores", "pdf", &gores),
            ("gores", "dxf", &gores),
            ("stickers", "svg", &paper),
            ("stickers", "pdf", &paper),
            ("stickers", "dxf", &paper),
            ("plotter", "svg", &plotter),
            ("plotter", "gcode", &plotter),
        ] {
            let name = format!("{way}-{ball}.{ending}");
            let arguments = ["pattern.csv", "--as", way, "-o", &name];
            let sizes = ["--ball-diameter-mm", &diameter, "--dot-diameter-mm", &dot];
            let output = spindoe(dir.path(), &[&arguments, &sizes[..], own].concat());
            assert!(
                output.status.success(),
                "{}",
                String::from_utf8_lossy(&output.stderr)
            );
            names.push(name);
        }
    }
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/python/check_marks.py");
    let checked = Command::new("python3")
        .arg(script)
        .arg("pattern.csv")
        .args(&names)
        .current_dir(dir.path())
        .output()
        .unwrap();
    let words = String::from_utf8_lossy(&checked.stdout);
    assert!(
        checked.status.success(),
        "{words}{}",
        String::from_utf8_lossy(&checked.stderr)
    );
    assert_eq!(
        words.matches("dots off by at most").count(),
        names.len(),
        "{words}"
    );
}

#[test]
fn too_large_dots_are_refused_by_the_nearest_pair() {
    let shipped = spindoe::pattern::shipped_designs().unwrap();
    let pattern = shipped.into_iter().find(|s| s.name == "dots40").unwrap();
    let pattern = pattern.pattern;
    let config = |dot_diameter_mm| MarkConfig {
        dot_diameter_mm,
        ..MarkConfig::default()
    };
    let error = config(8.0).validate(&pattern).unwrap_err().to_string();
    let (_, rest) = error.split_once("at most ").unwrap();
    let fits: f64 = rest.split(' ').next().unwrap().parse().unwrap();
    assert!(config(fits).validate(&pattern).is_ok(), "{error}");
    assert!(config(fits + 0.1).validate(&pattern).is_err(), "{error}");
}
