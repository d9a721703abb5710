//! Every plot: a PNG file of the stated size with something on it, or an error and no file.
//!
//! With `SPINDOE_PLOTS` set to a folder the pictures are left there, to be looked at.

use std::path::{Path, PathBuf};

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use spindoe::geometry::{Vec3, spiral_directions};
use spindoe::pattern::Pattern;
use spindoe::plot::*;
use spindoe::{Error, Result};

/// A folder for pictures, with what deletes it.
fn folder() -> (PathBuf, tempfile::TempDir) {
    let aside = tempfile::tempdir().unwrap();
    match std::env::var_os("SPINDOE_PLOTS") {
        Some(dir) => (PathBuf::from(dir), aside),
        None => (aside.path().to_path_buf(), aside),
    }
}

/// Asserts that `draw` leaves a PNG file of `size` on which more than `ink` of the pixels are drawn,
/// the same bytes when drawn again, and nothing at all in a folder that is not there.
fn check(name: &str, size: (u32, u32), ink: f64, draw: impl Fn(&Path) -> Result<()>) {
    let (dir, _aside) = folder();
    let path = dir.join(name);
    draw(&path).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    let mut reader = png::Decoder::new(std::io::Cursor::new(&bytes))
        .read_info()
        .unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().expect("a size")];
    let info = reader.next_frame(&mut pixels).unwrap();
    assert_eq!((info.width, info.height), size);
    assert_eq!(pixels.len(), size.0 as usize * size.1 as usize * 3);
    let drawn = pixels.chunks(3).filter(|p| *p != [255; 3]).count();
    let part = drawn as f64 / (pixels.len() / 3) as f64;
    assert!(part > ink && part < 0.9, "{name}: {part}");
    draw(&path).unwrap();
    assert_eq!(bytes, std::fs::read(&path).unwrap(), "{name}: other bytes");
    check_svg(&path.with_extension("svg"), size, &draw);

    let missing = dir.join("missing");
    let error = draw(&missing.join(name)).unwrap_err();
    assert!(matches!(error, Error::Write { .. }), "{error}");
    assert!(!missing.exists());
}

/// Asserts that `draw` leaves an SVG file of `size` which parses, has words in it, and names the font.
fn check_svg(path: &Path, size: (u32, u32), draw: impl Fn(&Path) -> Result<()>) {
    use svg::parser::Event;
    draw(path).unwrap();
    let text = std::fs::read_to_string(path).unwrap();
    let head = format!("<svg width=\"{}\" height=\"{}\" viewBox=", size.0, size.1);
    assert!(text.starts_with(&head), "{:.200}", text);
    let (mut shapes, mut words) = (0, 0);
    for event in svg::read(&text).unwrap() {
        match event {
            Event::Error(error) => panic!("{}: {error}", path.display()),
            Event::Tag("text", _, attributes) if attributes.contains_key("font-family") => {
                assert!(attributes["font-family"].contains("DejaVu Sans"));
                words += 1;
            }
            Event::Tag(..) => shapes += 1,
            _ => {}
        }
    }
    assert!(shapes > 8 && words > 3, "{shapes} shapes, {words} words");
}

/// The colors of the first series.
const COLORS: [&str; 3] = ["#0072B2", "#D55E00", "#009E73"];

/// A plot with linear axes, read as a reader does: by its grid and the numbers at it.
struct Shown {
    /// Slope and offset from a position to a value, of x and y.
    scales: [(f64, f64); 2],
    /// The round marks, in the first series' color, but for the legend's.
    marks: Vec<(f64, f64)>,
    /// Lines of at least two points with their colors, but for the legend's.
    lines: Vec<(String, Vec<(f64, f64)>)>,
}

impl Shown {
    fn of(draw: impl Fn(&Path) -> Result<()>) -> Self {
        use svg::parser::Event;
        let (dir, _aside) = folder();
        let path = dir.join("shown.svg");
        draw(&path).unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        let (mut grid, mut numbers) = ([Vec::new(), Vec::new()], [Vec::new(), Vec::new()]);
        let (mut marks, mut lines) = (Vec::new(), Vec::new());
        let mut anchor = String::new();
        for event in svg::read(&text).unwrap() {
            let (tag, of) = match &event {
                Event::Tag(tag, _, of) => (*tag, of),
                Event::Text(words) => {
                    let words = words.trim();
                    let (words, unit) = match words.strip_suffix(" %") {
                        Some(words) => (words, 0.01),
                        None => (words, 1.0),
                    };
                    let axis = usize::from(anchor == "end");
                    if let Ok(number) = words.parse::<f64>() {
                        numbers[axis].push(number * unit);
                    }
                    continue;
                }
                _ => continue,
            };
            let number = |name: &str| of[name].parse::<f64>().unwrap();
            match tag {
                "text" if !of.is_empty() => anchor = of["text-anchor"].to_string(),
                "line" if *of["stroke"] == *"#E2E2E2" => {
                    let is_flat = number("y1") == number("y2");
                    grid[usize::from(is_flat)].push(number(if is_flat { "y1" } else { "x1" }));
                }
                "circle" if *of["fill"] == *COLORS[0] => marks.push((number("cx"), number("cy"))),
                "polyline" => {
                    let points = of["points"].split_whitespace().map(|point| {
                        let (x, y) = point.split_once(',').unwrap();
                        (x.parse().unwrap(), y.parse().unwrap())
                    });
                    lines.push((of["stroke"].to_string(), points.collect()));
                }
                _ => {}
            }
        }
        let scales = [0, 1].map(|axis| {
            let (grid, numbers) = (&mut grid[axis], &mut numbers[axis]);
            assert!(grid.len() > 2, "{axis}: {grid:?}");
            assert_eq!(grid.len(), numbers.len(), "{axis}: {grid:?} {numbers:?}");
            // Rows count downwards, values upwards.
            grid.sort_by(f64::total_cmp);
            numbers.sort_by(f64::total_cmp);
            if axis == 1 {
                grid.reverse();
            }
            let last = grid.len() - 1;
            let slope = (numbers[last] - numbers[0]) / (grid[last] - grid[0]);
            let offset = numbers[0] - slope * grid[0];
            for (at, number) in grid.iter().zip(&*numbers) {
                assert!(
                    (slope * at + offset - number).abs() < 1.5 * slope.abs(),
                    "{at} {number}"
                );
            }
            (slope, offset)
        });
        Self {
            scales,
            marks: marks.split_off(1),
            lines,
        }
    }

    /// Asserts that these positions show these values, to two drawn pixels.
    fn assert_shown(&self, drawn: &[(f64, f64)], values: &[(f64, f64)]) {
        assert_eq!(drawn.len(), values.len());
        let [x, y] = self.scales;
        for (at, value) in drawn.iter().zip(values) {
            let off = [x.0 * at.0 + x.1 - value.0, y.0 * at.1 + y.1 - value.1];
            assert!(
                off[0].abs() < 2.0 * x.0.abs() && off[1].abs() < 2.0 * y.0.abs(),
                "{at:?} {value:?}"
            );
        }
    }

    /// Asserts that the first series' marks show these values.
    fn assert_marks(&self, values: &[(f64, f64)]) {
        self.assert_shown(&self.marks, values);
    }

    /// Asserts that a line of this color joins these values.
    fn assert_line(&self, color: &str, values: &[(f64, f64)]) {
        let of_color = self.lines.iter().filter(|(c, _)| c == color);
        // The legend's sign stands before it.
        let (_, drawn) = of_color
            .skip(1)
            .find(|(_, p)| p.len() == values.len())
            .expect("a line");
        self.assert_shown(drawn, values);
    }
}

fn pattern(n: usize) -> Pattern {
    Pattern::new(spiral_directions(n).collect()).unwrap()
}

fn view() -> BallDrawing {
    BallDrawing {
        title: "Pattern of 20 dots".into(),
        ball_diameter_mm: 40.0,
        dot_diameter_mm: 3.0,
        to_draw: 0,
    }
}

/// Successes in 10 000 trials with about their interval.
fn point(x: f64, rate: f64) -> RatePoint {
    let half = 1.96 * (rate * (1.0 - rate) / 1e4).sqrt() + 2e-4;
    RatePoint {
        x,
        rate,
        low: (rate - half).max(0.0),
        high: (rate + half).min(1.0),
    }
}

fn curves(scale: RateScale) -> CurvePlot {
    let series = [
        ("paper", 0.004),
        ("robust", 0.0001),
        ("robust, other pattern", 0.0004),
    ];
    CurvePlot {
        title: "Sensitivity to the noise of the dots, protocol sparse".into(),
        x_label: "noise sigma (deg)".into(),
        y_label: match scale {
            RateScale::Success => "orientation found".into(),
            RateScale::Failure => "orientation not found".into(),
        },
        scale,
        log_x: false,
        series: series
            .map(|(name, c)| RateSeries {
                name: name.into(),
                points: (0..=10)
                    .map(|s| point(f64::from(s), 1.0 - c * f64::from(s * s)))
                    .collect(),
            })
            .into(),
    }
}

#[test]
fn pattern_is_seen_from_both_sides() {
    check("pattern.png", VIEWS_SIZE, 0.3, |path| {
        pattern_views(path, &pattern(20), &view())
    });
    let path = Path::new("/tmp/never.png");
    for (ball, dot) in [(0.0, 1.0), (40.0, 0.0), (40.0, 40.0), (f64::NAN, 1.0)] {
        let view = BallDrawing {
            ball_diameter_mm: ball,
            dot_diameter_mm: dot,
            ..view()
        };
        let error = pattern_views(path, &pattern(20), &view).unwrap_err();
        assert!(matches!(error, Error::Argument { .. }), "{error}");
    }
}

#[test]
fn crowded_patterns_are_drawn_too() {
    let view = BallDrawing {
        title: "64 small dots".into(),
        dot_diameter_mm: 1.5,
        ..view()
    };
    check("pattern64.png", VIEWS_SIZE, 0.3, |path| {
        pattern_views(path, &pattern(64), &view)
    });
}

#[test]
fn rates_are_drawn_with_intervals() {
    for (name, scale) in [
        ("success.png", RateScale::Success),
        ("failure.png", RateScale::Failure),
    ] {
        check(name, CURVES_SIZE, 0.03, |path| {
            rate_curves(path, &curves(scale))
        });
    }
    let plot = curves(RateScale::Success);
    let shown = Shown::of(|path| rate_curves(path, &plot));
    for (series, color) in plot.series.iter().zip(COLORS) {
        let points = series.points.iter().map(|p| (p.x, p.rate));
        shown.assert_line(color, &points.collect::<Vec<_>>());
    }
    let path = Path::new("/tmp/never.png");
    let mut empty = curves(RateScale::Success);
    empty.series.clear();
    assert!(matches!(
        rate_curves(path, &empty),
        Err(Error::Argument { .. })
    ));
    let mut wrong = curves(RateScale::Success);
    wrong.series[1].points[2].rate = f64::NAN;
    let error = rate_curves(path, &wrong).unwrap_err().to_string();
    assert!(error.contains("\"robust\", point 2"), "{error}");
}

#[test]
fn perfect_rates_have_an_axis() {
    let (dir, _aside) = folder();
    for scale in [RateScale::Success, RateScale::Failure] {
        let mut plot = curves(scale);
        plot.series.truncate(1);
        plot.series[0].points = vec![RatePoint {
            x: 3.0,
            rate: 1.0,
            low: 1.0,
            high: 1.0,
        }];
        let path = dir.join("perfect.svg");
        rate_curves(&path, &plot).unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        let words = text.split("</text>").filter_map(|t| t.rsplit('>').next());
        let numbers = words.filter_map(|w| w.trim().trim_end_matches(['%', ' ']).parse().ok());
        let mut numbers: Vec<f64> = numbers.collect();
        assert!(numbers.iter().all(|n| n.is_finite()), "{numbers:?}");
        numbers.sort_by(f64::total_cmp);
        numbers.dedup();
        assert!(numbers.len() >= 3, "{numbers:?}");
        // Successes lie at 100 %, failures at none.
        let end = match scale {
            RateScale::Success => 100.0,
            RateScale::Failure => 0.0,
        };
        assert!(numbers.contains(&end), "{numbers:?}");
    }
}

/// The features of a pattern, by their definition.
fn features(dots: &[Vec3]) -> Vec<[f64; 3]> {
    let mut features = Vec::new();
    for (i, a) in dots.iter().enumerate() {
        for (j, b) in dots.iter().enumerate().filter(|(j, _)| *j != i) {
            let basis = nalgebra::Matrix3::from_columns(&[*a, *b, a.cross(b)]);
            let inverse = basis.try_inverse().unwrap();
            for (_, c) in dots.iter().enumerate().filter(|(k, _)| *k != i && *k != j) {
                let h = inverse * c;
                features.push([h.x, h.y, h.z]);
            }
        }
    }
    features
}

#[test]
fn features_are_scattered_and_counted() {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let dots: Vec<Vec3> = (0..20)
        .map(|_| spindoe::geometry::random_direction(&mut rng))
        .collect();
    let features = features(&dots);
    let distances: Vec<f64> = features
        .iter()
        .enumerate()
        .map(|(i, f)| {
            let square = |g: &[f64; 3]| (0..3).map(|c| (f[c] - g[c]).powi(2)).sum::<f64>();
            let others = features.iter().enumerate().filter(|(j, _)| *j != i);
            others
                .map(|(_, g)| square(g))
                .fold(f64::INFINITY, f64::min)
                .sqrt()
        })
        .collect();
    let title = "Features of 20 random dots in hash space";
    check("features.png", FEATURES_SIZE, 0.05, |path| {
        feature_plot(path, &features, &distances, title)
    });
    let path = Path::new("/tmp/never.png");
    for distances in [
        &distances[1..],
        &vec![-1.0; features.len()],
        &vec![f64::NAN; features.len()],
    ] {
        let error = feature_plot(path, &features, distances, title).unwrap_err();
        assert!(matches!(error, Error::Argument { .. }), "{error}");
    }
    let (dir, _aside) = folder();
    feature_plot(
        &dir.join("same.png"),
        &[[1.0; 3]; 4],
        &[0.0; 4],
        "all the same",
    )
    .unwrap();
}

fn bars(scale: RateScale) -> BarChart {
    let groups = [
        ("paper", [0.956, 0.961, 0.9998, 1.0]),
        ("sparse", [0.947, 0.951, 0.972, 0.984]),
        ("clutter", [0.41, 0.45, 0.961, 0.972]),
        ("image", [0.88, 0.9, 0.9991, 0.9996]),
    ];
    BarChart {
        title: "Recognition rates, 10 000 trials each".into(),
        y_label: match scale {
            RateScale::Success => "orientation found".into(),
            RateScale::Failure => "orientation not found".into(),
        },
        scale,
        series: [
            "published, paper",
            "ours, paper",
            "published, robust",
            "ours, robust",
        ]
        .map(String::from)
        .into(),
        groups: groups
            .map(|(name, rates)| BarGroup {
                name: name.into(),
                rates: rates.map(|r| Some(point(0.0, r))).into(),
            })
            .into(),
    }
}

#[test]
fn rates_stand_side_by_side() {
    for (name, scale) in [
        ("bars.png", RateScale::Success),
        ("bars_failure.png", RateScale::Failure),
    ] {
        check(name, BARS_SIZE, 0.03, |path| {
            bar_comparison(path, &bars(scale))
        });
    }
    let mut wrong = bars(RateScale::Success);
    wrong.groups[1].rates.pop();
    let error = bar_comparison(Path::new("/tmp/never.png"), &wrong).unwrap_err();
    assert!(error.to_string().contains("\"sparse\""), "{error}");
}

#[test]
fn points_are_where_their_values_are() {
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    let mut points = || -> Vec<(f64, f64)> {
        let mut point = || (rng.random(), 5.0 * rng.random::<f64>() - 2.0);
        (0..40).map(|_| point()).collect()
    };
    let plot = ScatterPlot {
        title: "Does the objective predict failures?".into(),
        x_label: "objective".into(),
        y_label: "failures [%]".into(),
        series: [("random", points()), ("descended", points())]
            .map(|(name, points)| LineSeries {
                name: name.into(),
                points,
            })
            .into(),
    };
    check("scatter.png", CURVES_SIZE, 0.02, |path| {
        scatter_plot(path, &plot)
    });
    let shown = Shown::of(|path| scatter_plot(path, &plot));
    shown.assert_marks(&plot.series[0].points);
    let mut wrong = plot;
    wrong.series[0].points[0].1 = f64::NAN;
    let error = scatter_plot(Path::new("/tmp/never.png"), &wrong).unwrap_err();
    assert!(matches!(error, Error::Argument { .. }), "{error}");
}

#[test]
fn reliability_is_drawn() {
    let series = [("paper", 0.9), ("robust", 1.0)].map(|(name, slope)| RateSeries {
        name: name.into(),
        points: (0..10)
            .map(|i| {
                let x = 0.05 + 0.1 * f64::from(i);
                point(x, x * slope)
            })
            .collect(),
    });
    let plot = ReliabilityPlot {
        title: "Are confidences what they say?".into(),
        x_label: "predicted probability".into(),
        y_label: "observed rate".into(),
        series: series.into(),
    };
    check("reliability.png", RELIABILITY_SIZE, 0.02, |path| {
        reliability_plot(path, &plot)
    });
}

#[test]
fn values_are_drawn_with_intervals() {
    let point = |i: usize| {
        let (x, y) = (i as f64 * 0.02, 80.0 - i as f64 * 0.2);
        ValuePoint {
            x,
            y,
            low: y - 0.4,
            high: y + 0.5,
        }
    };
    let plot = ValuePlot {
        title: "Spin over time".into(),
        x_label: "time (s)".into(),
        y_label: "spin (rps)".into(),
        values: vec![ValueSeries {
            name: "runs".into(),
            points: (0..30).map(point).collect(),
        }],
        lines: vec![LineSeries {
            name: "fit".into(),
            points: vec![(0.0, 80.0), (0.6, 74.0)],
        }],
    };
    check("values.png", CURVES_SIZE, 0.01, |p| value_curves(p, &plot));
    let shown = Shown::of(|path| value_curves(path, &plot));
    let values = plot.values[0].points.iter().map(|p| (p.x, p.y));
    shown.assert_marks(&values.collect::<Vec<_>>());
    shown.assert_line(COLORS[1], &plot.lines[0].points);
    let refused = |change: fn(&mut ValuePlot)| {
        let mut plot = plot.clone();
        change(&mut plot);
        let (dir, _aside) = folder();
        let path = dir.join("refused.png");
        assert!(value_curves(&path, &plot).unwrap_err().is_usage());
        assert!(!path.exists());
    };
    refused(|p| p.values[0].points[3].low = 90.0);
    refused(|p| p.values[0].points[3].y = f64::NAN);
    refused(|p| p.lines[0].points[0].1 = f64::INFINITY);
    refused(|p| (p.values, p.lines) = (Vec::new(), Vec::new()));
}

#[test]
fn the_surface_of_a_ball_shows_its_marks_and_what_no_frame_shows() {
    use spindoe::calibrate::{MarkKind, MarkedSurface, SurfaceMark, SurfacePlace};
    let place = |direction: Vec3| SurfacePlace {
        direction,
        darkness: if direction.z > 0.98 { 0.8 } else { 0.0 },
        views: if direction.x > -0.8 { 9 } else { 0 },
        steady: 1.0,
    };
    let mark = |direction: Vec3, kind| SurfaceMark {
        direction,
        radius_rad: 0.2,
        kind,
        evidence: None,
    };
    let surface = MarkedSurface {
        places: spiral_directions(4000).map(place).collect(),
        marks: vec![
            mark(Vec3::z(), MarkKind::Dot),
            mark(Vec3::new(0.6, 0.0, -0.8), MarkKind::Doubtful),
            mark(Vec3::y(), MarkKind::TurnedAway),
            mark(Vec3::new(0.0, -0.8, 0.6), MarkKind::Other),
        ],
    };
    check("surface.png", SURFACE_SIZE, 0.3, |path| {
        surface_views(path, &surface)
    });

    let (dir, _aside) = folder();
    let path = dir.join("surface.png");
    surface_views(&path, &surface).unwrap();
    let file = std::fs::File::open(&path).unwrap();
    let mut reader = png::Decoder::new(std::io::BufReader::new(file))
        .read_info()
        .unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    reader.next_frame(&mut pixels).unwrap();
    let at = |x: usize, y: usize| {
        let k = 3 * (y * SURFACE_SIZE.0 as usize + x);
        [pixels[k], pixels[k + 1], pixels[k + 2]].map(i32::from)
    };
    // The front's middle has the dot; beside it, equal areas away, the ball is bare. Its left rim no frame shows, and its
    // right rim is the back's left one, which some do.
    let (middle, y) = (SURFACE_SIZE.0 as usize / 4, 44 + 316);
    assert!(at(middle, y)[0] < 80, "{:?}", at(middle, y));
    assert!(at(middle + 120, y)[0] > 230, "{:?}", at(middle + 120, y));
    let [red, _, blue] = at(middle - 280, y);
    assert!(blue > red + 20, "{red} {blue}");
    let [red, _, blue] = at(middle + 280, y);
    assert!(blue == red && red > 230, "{red} {blue}");
    // The doubtful mark of the back, 0.64 to the front's right and so to the back's left, has an orange ring.
    let other = 3 * middle - (290.0 * 0.6 / (1.8f64).sqrt()) as usize;
    let is_orange = |x: usize| {
        let [red, green, blue] = at(x, y);
        red > green + 40 && green > blue + 20
    };
    assert!((other - 60..other + 60).any(is_orange));
}

/// A glyph's outline, in the font's units, and what leads to the next.
#[derive(Debug, Default, PartialEq)]
struct Outlined(Vec<(char, [f32; 6])>, Option<u16>);

impl ttf_parser::OutlineBuilder for Outlined {
    fn move_to(&mut self, x: f32, y: f32) {
        self.0.push(('M', [x, y, 0.0, 0.0, 0.0, 0.0]));
    }
    fn line_to(&mut self, x: f32, y: f32) {
        self.0.push(('L', [x, y, 0.0, 0.0, 0.0, 0.0]));
    }
    fn quad_to(&mut self, x1: f32, y1: f32, x: f32, y: f32) {
        self.0.push(('Q', [x1, y1, x, y, 0.0, 0.0]));
    }
    fn curve_to(&mut self, x1: f32, y1: f32, x2: f32, y2: f32, x: f32, y: f32) {
        self.0.push(('C', [x1, y1, x2, y2, x, y]));
    }
    fn close(&mut self) {
        self.0.push(('Z', [0.0; 6]));
    }
}

#[test]
fn the_fonts_are_parts_of_the_whole_ones() {
    let outlined = |face: &ttf_parser::Face<'_>, c: char| {
        let glyph = face.glyph_index(c)?;
        let mut outlined = Outlined::default();
        face.outline_glyph(glyph, &mut outlined);
        outlined.1 = face.glyph_hor_advance(glyph);
        Some(outlined)
    };
    let kerned = |face: &ttf_parser::Face<'_>, [a, b]: [char; 2]| {
        let [a, b] = [a, b].map(|c| face.glyph_index(c));
        let tables = face.tables().kern.into_iter();
        let mut kerns = tables.flat_map(|kern| kern.subtables.into_iter());
        kerns.find_map(|kern| kern.glyphs_kerning(a?, b?))
    };
    for (name, whole) in [
        ("DejaVuSans", dejavu::sans::regular()),
        ("DejaVuSansCondensed-Bold", dejavu::sans_condensed::bold()),
    ] {
        let path = format!("{}/src/fonts/{name}.ttf", env!("CARGO_MANIFEST_DIR"));
        let bytes = std::fs::read(path).unwrap();
        let [part, whole] = [&bytes, whole].map(|b| ttf_parser::Face::parse(b, 0).unwrap());
        assert_eq!(part.units_per_em(), whole.units_per_em());
        let heights = |f: &ttf_parser::Face<'_>| [f.ascender(), f.descender(), f.line_gap()];
        assert_eq!(heights(&part), heights(&whole));
        let all = (' '..='\u{ffff}').filter(|c| outlined(&part, *c).is_some());
        let all: Vec<char> = all.collect();
        assert!(all.len() > 2000, "{}", all.len());
        for &c in &all {
            assert_eq!(outlined(&part, c), outlined(&whole, c), "{name}: {c}");
        }
        // What the project's own words and people's names are written with.
        let written = (' '..='~').chain("µ°±²³σκ×–—…≤≥√äßçéøőșŽλЖиԱა€→".chars());
        for c in written {
            assert!(all.contains(&c), "{name}: {c}");
        }
        let pairs = (' '..='~').flat_map(|a| (' '..='~').map(move |b| [a, b]));
        let mut moved = 0;
        for pair in pairs {
            assert_eq!(
                kerned(&part, pair),
                kerned(&whole, pair),
                "{name}: {pair:?}"
            );
            moved += usize::from(kerned(&part, pair).is_some_and(|k| k != 0));
        }
        assert!(moved > 50, "{name}: {moved}");
    }
}

/// A dot up and to the right of the ball's middle is drawn there.
#[test]
fn views_of_a_recognition_have_y_up() {
    use spindoe::geometry::Rotation;
    use svg::parser::Event;
    let (dir, _aside) = folder();
    let path = dir.join("upright.svg");
    let dot = Vec3::new(0.48, 0.6, 0.64);
    let view = RecognitionView {
        caption: "upright".into(),
        visibility_limit: 0.0,
        observed: vec![dot],
        truth: Rotation::identity(),
        answer: None,
    };
    let pattern = Pattern::new(spiral_directions(12).collect()).unwrap();
    recognition_views(&path, "upright", &pattern, &[view]).unwrap();
    let text = std::fs::read_to_string(&path).unwrap();
    let circles = svg::read(&text).unwrap().filter_map(|event| match event {
        Event::Tag("circle", _, of) => {
            let at = ["cx", "cy", "r"].map(|name| of[name].parse::<f64>().unwrap());
            Some((at, *of["fill"] != *"none"))
        }
        _ => None,
    });
    let circles: Vec<([f64; 3], bool)> = circles.collect();
    let [u, v, radius] = circles
        .iter()
        .map(|c| c.0)
        .max_by(|a, b| a[2].total_cmp(&b[2]))
        .unwrap();
    let is_at = |y: f64| {
        let off = |at: &[f64; 3]| (at[0] - u - radius * dot.x).hypot(at[1] - v - radius * y);
        circles
            .iter()
            .any(|(at, filled)| *filled && off(at) < 0.02 * radius)
    };
    assert!(is_at(-dot.y) && !is_at(dot.y), "{circles:?}");
}
