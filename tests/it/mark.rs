//! Lobes, stickers and plotters' files: laid back on the ball, every dot is where the pattern has it.
//!
//! `tests/python/check_marks.py` reads the written files with other people's readers, where Python has them.

use std::f64::consts::{FRAC_PI_2, TAU};
use std::path::Path;
use std::process::{Command, Output};
use std::sync::OnceLock;

use spindoe::geometry::{Rotation, Vec3, angle_between, spiral_directions};
use spindoe::mark::{
    Caliper, Drawing, GoreConfig, Item, Layer, MarkConfig, PageSize, PlotterConfig, Shape,
    StickerConfig, dxf_text, free_axis, gores, pdf_bytes, plotter_drawing, plotter_paths,
    references, stickers, svg_text,
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

/// A piece of a lobe: its place on its page, and its cut.
struct Piece<'a> {
    page: usize,
    origin: [f64; 2],
    longitude: f64,
    dots: Vec<usize>,
    cut: &'a [spindoe::mark::Point],
}

impl Piece<'_> {
    /// Points of the page on the ball of radius 1, in the frame of the marks.
    fn on_ball(&self, points: &[spindoe::mark::Point], radius: f64) -> Vec<Vec3> {
        let meridian = Rotation::from_axis_angle(&Vec3::z_axis(), self.longitude);
        let back = |p: &spindoe::mark::Point| {
            let [u, v] = [p.x - self.origin[0], p.y - self.origin[1]].map(|mm| mm / radius);
            meridian * Vec3::new(u.cos() * v.cos(), u.sin(), u.cos() * v.sin())
        };
        points.iter().map(back).collect()
    }
}

/// The pieces of lobes by the note; cuts are drawn in their order.
fn pieces(drawing: &Drawing) -> Vec<Piece<'_>> {
    let items = drawing.pages.iter().flat_map(|page| &page.items);
    let cuts = items.filter_map(|item| match (&item.shape, item.layer) {
        (Shape::Loop(points), Layer::Cut) => Some(points.as_slice()),
        _ => None,
    });
    let pieces = drawing.note["pieces"].as_array().unwrap();
    let pieces = pieces.iter().zip(cuts).map(|(piece, cut)| {
        let value = |k: &str| piece[k].as_f64().unwrap();
        let dots = piece["dots"].as_array().unwrap().iter();
        Piece {
            page: value("page") as usize,
            origin: [value("x_mm"), value("y_mm")],
            longitude: value("longitude_deg").to_radians(),
            dots: dots.map(|d| d.as_u64().unwrap() as usize).collect(),
            cut,
        }
    });
    pieces.collect()
}

/// The area on the ball, mm^2, of a polygon given by its points' distances from a lobe's middle, mm.
fn area(points: &[spindoe::mark::Point], piece: &Piece<'_>, radius: f64) -> f64 {
    let n = points.len();
    (0..n)
        .map(|k| {
            let (p, q) = (points[k], points[(k + 1) % n]);
            let strip = |x: f64| radius * ((x - piece.origin[0]) / radius).sin();
            0.5 * (strip(p.x) + strip(q.x)) * (q.y - p.y)
        })
        .sum()
}

/// Balls, patterns, and the numbers of lobes that are drawn for them.
fn drawn_lobes() -> impl Iterator<Item = (Pattern, MarkConfig, Drawing)> {
    static DRAWN: OnceLock<Vec<(Pattern, MarkConfig, Drawing)>> = OnceLock::new();
    DRAWN.get_or_init(|| draw_lobes().collect()).iter().cloned()
}

fn draw_lobes() -> impl Iterator<Item = (Pattern, MarkConfig, Drawing)> {
    let shipped = spindoe::pattern::shipped_designs().unwrap().into_iter();
    // One of three patterns at each change, of 12, 24 and 60 dots among them.
    let each = crate::common::few_or_all(3, 1);
    let shipped = shipped.map(|s| s.pattern).step_by(each);
    let patterns = shipped.chain([pattern(24), pattern(60)]);
    patterns.enumerate().flat_map(|(k, pattern)| {
        let drawn = [12, 13, 24].into_iter().enumerate().map(move |(i, lobes)| {
            let mut config = config(BALLS_MM[(i + k) % 5]);
            if pattern.len() > 40 {
                config.dot_diameter_mm *= 0.6;
            }
            let own = GoreConfig {
                lobes,
                page: [PageSize::Sheet, PageSize::A4, PageSize::Letter][(i + k) % 3],
                ..GoreConfig::default()
            };
            let drawing = gores(&pattern, &config, &own);
            let drawing =
                drawing.unwrap_or_else(|e| panic!("{} dots, {lobes} lobes: {e}", pattern.len()));
            (pattern.clone(), config, drawing)
        });
        drawn.collect::<Vec<_>>()
    })
}

/// Every dot, laid back on the ball by the note alone, is whole in one piece, and no cut goes through
/// it or another.
#[test]
fn no_cut_goes_through_a_dot() {
    for (pattern, config, drawing) in drawn_lobes() {
        let (radius, edge) = (config.radius_mm(), config.dot_angle_rad());
        let turned: Vec<Vec3> = pattern
            .dots()
            .iter()
            .map(|d| rotation(&drawing) * d)
            .collect();
        let whole = TAU * radius.powi(2) * (1.0 - edge.cos());
        // Chords are up to 0.005 mm inside the rim, at two thirds of that on average.
        let facets = 2.0 * (2.0 / 3.0 * 0.005) / (0.5 * config.dot_diameter_mm) + 1e-3;
        let mut found = vec![0; pattern.len()];
        for piece in pieces(&drawing) {
            for (dot, center) in turned.iter().enumerate() {
                let cut = piece.on_ball(piece.cut, radius).into_iter();
                let middles = piece.cut.iter().zip(piece.cut.iter().cycle().skip(1));
                let middles: Vec<_> = middles.map(|(a, b)| nalgebra::center(a, b)).collect();
                let cut = cut.chain(piece.on_ball(&middles, radius));
                let off = cut.map(|p| radius * (angle_between(&p, center) - edge));
                let nearest = off.fold(f64::INFINITY, f64::min);
                assert!(
                    nearest > 0.0,
                    "{}: a cut is {nearest} mm off dot {dot}",
                    drawing.title
                );
            }
            for &dot in &piece.dots {
                let own = |item: &&Item| item.dot == Some(dot) && item.layer == Layer::Dots;
                let mut items = drawing.pages[piece.page].items.iter().filter(own);
                let (
                    Some(Item {
                        shape: Shape::Area(points),
                        ..
                    }),
                    None,
                ) = (items.next(), items.next())
                else {
                    panic!("dot {dot} is not drawn once")
                };
                for p in piece.on_ball(points, radius) {
                    let off = radius * (angle_between(&p, &turned[dot]) - edge);
                    assert!(
                        off.abs() < 0.01,
                        "{}: dot {dot} off by {off} mm",
                        drawing.title
                    );
                }
                let share = area(points, &piece, radius) / whole;
                assert!(
                    (share - 1.0).abs() < facets,
                    "dot {dot}: {share} of its area"
                );
                found[dot] += 1;
            }
        }
        assert!(
            found.iter().all(|n| *n == 1),
            "{}: {found:?}",
            drawing.title
        );
    }
}

/// Neighboring lobes share their cut: together they cover the ball once.
#[test]
fn lobes_cover_the_ball() {
    for (_, config, drawing) in drawn_lobes() {
        let radius = config.radius_mm();
        let covered = pieces(&drawing)
            .iter()
            .map(|p| area(p.cut, p, radius))
            .sum::<f64>();
        let ball = 2.0 * TAU * radius.powi(2);
        let share = covered / ball;
        assert!(
            (share - 1.0).abs() < 2e-3,
            "{}: {share} of the ball",
            drawing.title
        );
    }
}

/// Boxes of all words and numbers of a page, mm: text of Helvetica is at most 0.6 of its size wide a
/// character.
fn boxes(items: &[Item], layer: Layer) -> Vec<(String, [f64; 4])> {
    let words = items
        .iter()
        .filter(|i| i.layer == layer)
        .filter_map(|item| {
            let Shape::Text {
                at,
                anchor,
                height_mm,
                words,
            } = &item.shape
            else {
                return None;
            };
            let width = height_mm / 0.72 * 0.556 * words.len() as f64;
            let left = match anchor {
                spindoe::mark::Anchor::Start => at.x,
                spindoe::mark::Anchor::Middle => at.x - 0.5 * width,
                spindoe::mark::Anchor::End => at.x - width,
            };
            Some((words.clone(), [left, at.y, left + width, at.y + height_mm]))
        });
    words.collect()
}

fn distance(frame: &[f64; 4], p: &spindoe::mark::Point) -> f64 {
    let x = (frame[0] - p.x).max(p.x - frame[2]).max(0.0);
    let y = (frame[1] - p.y).max(p.y - frame[3]).max(0.0);
    x.hypot(y)
}

/// Numbers stand off dots, cuts and each other, on lobes and on stickers' maps.
#[test]
fn numbers_are_never_covered() {
    let sheets = |(pattern, config, lobes): (Pattern, MarkConfig, Drawing)| {
        let maps = [PageSize::Sheet, PageSize::A4].map(|page| {
            let own = StickerConfig {
                page,
                ..StickerConfig::default()
            };
            stickers(&pattern, &config, &own).unwrap()
        });
        maps.into_iter().chain([lobes])
    };
    for drawing in drawn_lobes().flat_map(sheets) {
        for page in &drawing.pages {
            let words = boxes(&page.items, Layer::Notes);
            for (k, (label, frame)) in words.iter().enumerate() {
                for (other, others) in &words[..k] {
                    let apart = frame[0] > others[2]
                        || others[0] > frame[2]
                        || frame[1] > others[3]
                        || others[1] > frame[3];
                    assert!(apart, "{}: {label} covers {other}", drawing.title);
                }
            }
            let numbers: Vec<_> = words.iter().filter(|(words, _)| words.len() < 3).collect();
            for (number, frame) in &numbers {
                for item in page
                    .items
                    .iter()
                    .filter(|i| matches!(i.layer, Layer::Dots | Layer::Cut))
                {
                    let (Shape::Area(points) | Shape::Loop(points)) = &item.shape else {
                        continue;
                    };
                    let nearest = points
                        .iter()
                        .map(|p| distance(frame, p))
                        .fold(f64::INFINITY, f64::min);
                    assert!(
                        nearest > 0.15,
                        "{}: {number} is {nearest} mm off a dot or cut",
                        drawing.title
                    );
                }
                assert!(
                    frame[0] > 0.0 && frame[2] < page.width_mm && frame[3] < page.height_mm,
                    "{}: {number} leaves the page",
                    drawing.title
                );
            }
        }
    }
}

/// Each lobe has its letter inside its cut, and an arrow that points north above it, off all dots.
#[test]
fn every_lobe_carries_its_letter_and_an_arrow() {
    for (_, _, drawing) in drawn_lobes() {
        let pieces = pieces(&drawing);
        let note = drawing.note["pieces"].as_array().unwrap();
        for (piece, note) in pieces.iter().zip(note) {
            let items = &drawing.pages[piece.page].items;
            let inside = |x: f64, y: f64| {
                let edges = piece.cut.iter().zip(piece.cut.iter().cycle().skip(1));
                let crossed = edges.filter(|(a, b)| {
                    (a.y > y) != (b.y > y) && x < a.x + (y - a.y) / (b.y - a.y) * (b.x - a.x)
                });
                crossed.count() % 2 == 1
            };
            let name = note["name"].as_str().unwrap();
            let names = boxes(items, Layer::Names);
            let found = names
                .iter()
                .find(|(words, f)| words == name && inside(f[0], f[1]));
            let Some((_, frame)) = found else {
                panic!("{}: no {name} within its lobe", drawing.title)
            };
            assert!(inside(frame[2], frame[3]));
            let above = |item: &Item| match &item.shape {
                Shape::Line(points) if item.layer == Layer::Names && points.len() == 3 => {
                    let tip = points[1];
                    tip.y > frame[3]
                        && tip.y > points[0].y
                        && tip.y > points[2].y
                        && frame[0] < tip.x
                        && tip.x < frame[2]
                        && inside(tip.x, tip.y)
                }
                _ => false,
            };
            assert!(
                items.iter().any(above),
                "{}: no arrow above {name}",
                drawing.title
            );
            for item in items.iter().filter(|i| i.layer == Layer::Dots) {
                if let Shape::Area(points) = &item.shape {
                    assert!(points.iter().all(|p| distance(frame, p) > 0.2));
                }
            }
        }
    }
}

/// The place that three distances give: gradient steps from the true one.
fn laid_off(start: Vec3, from: &[Vec3], distances: &[f64]) -> Vec3 {
    let mut d = start;
    for _ in 0..60 {
        let mut normal = nalgebra::Matrix3::from_diagonal_element(1e-12);
        let mut pull = Vec3::zeros();
        for (p, s) in from.iter().zip(distances) {
            let way = (d - p).normalize();
            let way = way - way.dot(&d) * d;
            normal += way * way.transpose();
            pull += way * (s - (d - p).norm());
        }
        // Steps stay on the ball.
        let step = (normal + d * d.transpose()).lu().solve(&pull).unwrap();
        d = (d + step).normalize();
    }
    d
}

/// Distances that are off by up to an error, laid off one after another, put no dot farther off than
/// stated, and the worst one nearly so far.
#[test]
fn a_caliper_must_be_as_exact_as_stated() {
    for shipped in spindoe::pattern::shipped_designs().unwrap() {
        let dots = shipped.pattern.dots();
        let from = references(dots).unwrap();
        let caliper = Caliper::new(dots, from);
        let [a, b, c] = from.map(|i| dots[i]);
        // No other place has these distances: the three are far from a great circle.
        assert!(a.dot(&b.cross(&c)).abs() > 0.7, "{}", shipped.name);
        assert!(
            caliper.worst_ratio < 5.2,
            "{}: {}",
            shipped.name,
            caliper.worst_ratio
        );
        let error = 1e-5;
        let mut worst = 0.0f64;
        for (i, &d) in dots.iter().enumerate().filter(|(i, _)| !from.contains(i)) {
            for bits in 0..64u32 {
                let off = |k: u32| if bits >> k & 1 == 0 { error } else { -error };
                let second = {
                    // Along the great circle from the first.
                    let angle = 2.0 * (0.5 * ((b - a).norm() + off(0))).asin();
                    let way = (b - b.dot(&a) * a).normalize();
                    angle.cos() * a + angle.sin() * way
                };
                let third = laid_off(
                    c,
                    &[a, second],
                    &[(c - a).norm() + off(1), (c - b).norm() + off(2)],
                );
                let distances = [
                    (d - a).norm() + off(3),
                    (d - b).norm() + off(4),
                    (d - c).norm() + off(5),
                ];
                let placed = laid_off(d, &[a, second, third], &distances);
                let ratio = (placed - d).norm() / error;
                assert!(
                    ratio < 1.01 * caliper.worst_ratio,
                    "{}: dot {i} {ratio}",
                    shipped.name
                );
                worst = worst.max(ratio);
            }
        }
        assert!(
            worst > 0.98 * caliper.worst_ratio,
            "{}: {worst}",
            shipped.name
        );
    }
}

/// Every sheet says what it is, and a date only where one is stated.
#[test]
fn every_sheet_has_a_title_block() {
    let dated = MarkConfig {
        date: Some("2031-02-03".to_owned()),
        ..config(220.0)
    };
    for (config, date) in [(dated, true), (config(220.0), false)] {
        let pattern = pattern(40);
        let page = PageSize::Letter;
        let sheet = StickerConfig {
            page,
            ..StickerConfig::default()
        };
        let lobes = GoreConfig {
            page,
            ..GoreConfig::default()
        };
        for drawing in [
            gores(&pattern, &config, &lobes).unwrap(),
            stickers(&pattern, &config, &sheet).unwrap(),
        ] {
            for (k, page) in drawing.pages.iter().enumerate() {
                let words = boxes(&page.items, Layer::Notes);
                let facts = words
                    .iter()
                    .find(|(w, _)| w.starts_with("pattern "))
                    .unwrap();
                assert!(facts.0.contains(&pattern.sha256()[..12]), "{}", facts.0);
                assert!(
                    facts.0.contains("ball 220 mm; 40 dots of 22 mm"),
                    "{}",
                    facts.0
                );
                assert_eq!(facts.0.contains("; 2031-02-03; "), date, "{}", facts.0);
                let sheet = format!("sheet {} of {}", k + 1, drawing.pages.len());
                assert!(facts.0.ends_with(&sheet), "{}", facts.0);
                // Nothing else comes so low.
                for item in page
                    .items
                    .iter()
                    .filter(|i| i.layer == Layer::Cut || i.layer == Layer::Dots)
                {
                    let (Shape::Area(points) | Shape::Loop(points)) = &item.shape else {
                        continue;
                    };
                    assert!(points.iter().all(|p| p.y > facts.1[3] + 4.0));
                }
            }
        }
    }
}

#[test]
fn a_pen_inks_each_dot_and_nothing_else() {
    // Dots are a tenth of the ball: pens of a fifth of a dot to nine tenths of it.
    let pens = [0.02, 0.06, 0.09];
    for (ball, pen) in BALLS_MM.iter().flat_map(|b| pens.map(|p| (*b, p))) {
        let (pattern, config) = (pattern(20), config(ball));
        let plotter = PlotterConfig {
            pen_diameter_mm: pen * ball,
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
fn stickers_are_printed_beyond_their_cut() {
    let own = StickerConfig {
        bleed_mm: 0.7,
        ..StickerConfig::default()
    };
    let drawing = stickers(&pattern(20), &config(40.0), &own).unwrap();
    let items = || drawing.pages.iter().flat_map(|page| &page.items);
    // Middle and width along the row.
    let across = |points: &[spindoe::mark::Point]| {
        let x = || points.iter().map(|p| p.x);
        let (low, high) = (
            x().fold(f64::INFINITY, f64::min),
            x().fold(f64::NEG_INFINITY, f64::max),
        );
        (0.5 * (low + high), high - low)
    };
    for dot in 0..20 {
        let of_dot = || items().filter(|item| item.dot == Some(dot));
        let cut = of_dot().find_map(|item| match &item.shape {
            Shape::Loop(points) if item.layer == Layer::Cut => Some(across(points)),
            _ => None,
        });
        let (middle, width) = cut.unwrap();
        assert!((width - 4.0).abs() < 0.02, "{dot}: cut to {width} mm");
        // The maps show the dot besides.
        let printed = of_dot().filter_map(|item| match &item.shape {
            Shape::Area(points) if item.layer == Layer::Dots => Some(across(points)),
            _ => None,
        });
        let sticker = printed
            .into_iter()
            .filter(|(own, _)| (own - middle).abs() < 0.02)
            .map(|(_, width)| width);
        let widths: Vec<f64> = sticker.collect();
        assert!(
            widths.iter().any(|width| (width - 5.4).abs() < 0.02),
            "{dot}: {widths:?}"
        );
    }
}

#[test]
fn a_stated_time_dates_the_sheet() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("pattern.csv");
    pattern(20).write_csv(&path).unwrap();
    let output = Command::new(env!("CARGO_BIN_EXE_spindoe"))
        .args(["mark", "pattern.csv", "--as", "stickers", "-o", "s.svg"])
        .env("SOURCE_DATE_EPOCH", "31536000")
        .current_dir(dir.path())
        .output()
        .unwrap();
    assert!(output.status.success());
    let sheet = std::fs::read_to_string(dir.path().join("s.svg")).unwrap();
    assert!(sheet.contains("1971-01-01"));
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
    let cases: [(&[&str], &str); 9] = [
        (&["--as", "gores", "-o", "out.png"], ".svg, .pdf or .dxf"),
        (
            &["--as", "gores", "-o", "out.svg", "--keep-out", "0,0,1,60"],
            "lies in zone 0",
        ),
        (&["--as", "plotter", "-o", "out.pdf"], ".svg or .gcode"),
        (
            &["--as", "gores", "-o", "out.svg", "--config=lobes=11"],
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
            &[
                "--as",
                "plotter",
                "-o",
                "out.svg",
                "--config=pen_diameter_mm=5",
            ],
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
        (
            &["--as", "stickers", "-o", "out.svg", "--config=pen_up=M5"],
            "--as plotter",
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
    // Both numbers of lobes and both papers, and the largest ball.
    let each = crate::common::few_or_all(3, 1);
    for (i, ball) in BALLS_MM.iter().rev().enumerate().step_by(each) {
        let (lobes, page) = ([12, 24][i % 2].to_string(), ["a4", "letter"][i % 2]);
        let (diameter, dot, pen) = (
            ball.to_string(),
            (0.1 * ball).to_string(),
            format!("pen_diameter_mm={}", 0.02 * ball),
        );
        let lobes = format!("--config=lobes={lobes}");
        let paper = ["--sheet", page];
        let gores = ["--sheet", page, &lobes];
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
    assert_eq!(
        config(25.0).validate(&pattern).unwrap_err().to_string(),
        error.replace("found 8;", "found 25;")
    );
    let (_, rest) = error.split_once("at most ").unwrap();
    let fits: f64 = rest.split(' ').next().unwrap().parse().unwrap();
    assert!(config(fits).validate(&pattern).is_ok(), "{error}");
    assert!(config(fits + 0.1).validate(&pattern).is_err(), "{error}");
}

/// EggBot's driver (`eggbot.py` of evil-mad/EggBot, `getDocProps` and `effect`) takes width and height as pixels, of 96 an inch where they
/// are in millimeters, and scales the drawing by them over the view box: motor steps must come out as they are.
#[test]
fn an_eggbot_draws_steps_as_they_are() {
    let plotter = PlotterConfig::default();
    let drawing = plotter_drawing(&pattern(20), &config(40.0), &plotter).unwrap();
    let svg = svg_text(&drawing).concat();
    let head = svg.split('>').next().unwrap();
    let attribute = |name: &str| {
        let at = head.find(&format!(" {name}=\"")).unwrap() + name.len() + 3;
        head[at..].split('"').next().unwrap().to_owned()
    };
    let pixels = |text: &str| match text.strip_suffix("mm") {
        Some(mm) => mm.parse::<f64>().unwrap() * 96.0 / 25.4,
        None => text.parse().unwrap(),
    };
    let (width, height) = (attribute("width"), attribute("height"));
    assert_eq!((&*width, &*height), ("3200", "1600"));
    let view: Vec<f64> = attribute("viewBox")
        .split(' ')
        .map(|n| n.parse().unwrap())
        .collect();
    assert_eq!(view[..2], [0.0, 0.0]);
    assert_eq!(
        [pixels(&width) / view[2], pixels(&height) / view[3]],
        [1.0, 1.0]
    );
    // What is printed on paper keeps its millimeters.
    let paper = stickers(&pattern(20), &config(40.0), &StickerConfig::default()).unwrap();
    assert!(
        svg_text(&paper)[0]
            .split('>')
            .next()
            .unwrap()
            .contains("mm\"")
    );
}

/// Words of a DXF file that are not set from their left end stand at their second point (group codes 11 and 21): on their own page, beside
/// those before it.
#[test]
fn words_of_a_dxf_file_stand_on_their_own_page() {
    let own = GoreConfig {
        page: PageSize::A4,
        ..GoreConfig::default()
    };
    let largest = BALLS_MM.into_iter().fold(0.0, f64::max);
    let drawing = gores(&pattern(20), &config(largest), &own).unwrap();
    assert!(drawing.pages.len() > 1, "{largest} mm");
    let (mut left, mut expected) = (0.0, Vec::new());
    for page in &drawing.pages {
        for item in &page.items {
            if let Shape::Text { at, words, .. } = &item.shape {
                expected.push((left + at.x, at.y, words.replace('°', "%%d")));
            }
        }
        left += page.width_mm + 10.0;
    }
    let text = dxf_text(&drawing);
    let lines: Vec<&str> = text.lines().collect();
    let groups: Vec<(u16, &str)> = lines
        .chunks_exact(2)
        .map(|pair| (pair[0].trim().parse().unwrap(), pair[1]))
        .collect();
    let starts = (0..groups.len()).filter(|k| groups[*k] == (0, "TEXT"));
    let found: Vec<(f64, f64, String)> = starts
        .map(|k| {
            let of = |code: u16| groups[k + 1..].iter().find(|g| g.0 == code).unwrap().1;
            let number = |code: u16| of(code).parse::<f64>().unwrap();
            let [x, y] = match of(72) {
                "0" => [10, 20].map(number),
                _ => [11, 21].map(number),
            };
            (x, y, of(1).to_owned())
        })
        .collect();
    assert_eq!(found.len(), expected.len());
    for (found, expected) in found.iter().zip(&expected) {
        assert_eq!(found.2, expected.2);
        let off = (found.0 - expected.0).hypot(found.1 - expected.1);
        assert!(off < 1e-3, "{found:?}, expected {expected:?}");
    }
}
