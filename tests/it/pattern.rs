//! Patterns: their file, their checks and their figures.

use proptest::prelude::*;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use spindoe::geometry::{Vec3, random_direction, spiral_directions, tangent_frame};
use spindoe::pattern::Pattern;

/// The twelve vertices of the icosahedron.
fn icosahedron() -> Pattern {
    let golden = (1.0 + 5f64.sqrt()) / 2.0;
    let mut dots = Vec::new();
    for a in [-1.0, 1.0] {
        for b in [-golden, golden] {
            for v in [[0.0, a, b], [a, b, 0.0], [b, 0.0, a]] {
                dots.push(Vec3::from(v).normalize());
            }
        }
    }
    Pattern::new(dots).unwrap()
}

#[test]
fn the_icosahedron_has_its_textbook_figures() {
    let summary = icosahedron().summary();
    // Adjacent vertices: arctan 2.
    assert!((summary.min_separation_rad - 2f64.atan()).abs() < 1e-12);
    assert!((summary.mean_nearest_separation_rad - 2f64.atan()).abs() < 1e-12);
    // Vertices come in opposite pairs, and from anywhere one of each pair is in front.
    assert_eq!(summary.min_visible, 6);
    assert_eq!(summary.mean_visible, 6.0);
}

#[test]
fn the_published_pattern_reads() {
    let Some(pattern) = crate::common::published_pattern() else {
        return;
    };
    let summary = pattern.summary();
    assert_eq!(summary.dots, 20);
    assert!(summary.min_visible >= 6, "{summary:?}");
    assert!((summary.min_separation_rad.to_degrees() - 24.9).abs() < 0.05);
}

/// The fewest dots above the limit in any of these views.
fn fewest(dots: &[Vec3], limit: f64, views: impl Iterator<Item = Vec3>) -> usize {
    let shown = |v: Vec3| dots.iter().filter(|d| d.dot(&v) > limit).count();
    views.map(shown).min().unwrap()
}

/// Views in all cells of the arrangement of the circles `v . d = limit`: all around each point where two
/// of them meet, and beside each circle.
fn views_in_all_cells(dots: &[Vec3], limit: f64) -> Vec<Vec3> {
    const NEAR: f64 = 1e-5;
    let mut views = Vec::new();
    let mut around = |v: Vec3| {
        let [a, b] = tangent_frame(&v);
        views.extend((0..720).map(|k| {
            let (sin, cos) = (f64::from(k) * 0.5f64.to_radians()).sin_cos();
            (v + NEAR * (cos * a + sin * b)).normalize()
        }));
    };
    for (i, a) in dots.iter().enumerate() {
        let [side, _] = tangent_frame(a);
        around(limit * a + (1.0 - limit * limit).sqrt() * side);
        for b in &dots[..i] {
            // v = s (a + b) +- t a x b with a.v = b.v = limit.
            let normal = a.cross(b);
            let middle = (a + b) * (limit / (1.0 + a.dot(b)));
            let rest = 1.0 - middle.norm_squared();
            if rest > 0.0 && normal.norm() > 1e-6 {
                let up = normal * (rest.sqrt() / normal.norm());
                around(middle + up);
                around(middle - up);
            }
        }
    }
    views
}

#[test]
fn the_fewest_visible_dots_are_those_of_the_poorest_cell() {
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    let mut missed_by_samples = 0;
    for (k, n) in (4..40).enumerate() {
        let dots: Vec<Vec3> = (0..n).map(|_| random_direction(&mut rng)).collect();
        let Ok(pattern) = Pattern::new(dots) else {
            continue;
        };
        let (dots, limit) = (pattern.dots(), [0.0, 0.15, 1.0 / 3.0, -0.4, 0.8][k % 5]);
        let found = pattern.min_visible(limit);
        let cells = fewest(dots, limit, views_in_all_cells(dots, limit).into_iter());
        assert_eq!(found, cells, "{n} dots, z > {limit}");
        let sampled = fewest(dots, limit, spiral_directions(20_000));
        assert!(found <= sampled, "{n} dots, z > {limit}");
        missed_by_samples += usize::from(found < sampled);
    }
    // Cells that no sample lies in are what this is for.
    assert!(missed_by_samples > 0);
}

#[test]
fn a_shipped_pattern_shows_fewer_dots_than_samples_say() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/designs/dots28/pattern.csv");
    let pattern = Pattern::read_csv(path.as_ref()).unwrap();
    assert_eq!(fewest(pattern.dots(), 0.0, spiral_directions(20_000)), 11);
    assert_eq!(pattern.min_visible(0.0), 10);
    let cells = views_in_all_cells(pattern.dots(), 0.0);
    assert_eq!(fewest(pattern.dots(), 0.0, cells.into_iter()), 10);
}

#[test]
fn shipped_reports_state_the_fewest_visible_dots() {
    let designs = concat!(env!("CARGO_MANIFEST_DIR"), "/designs");
    let mut reports = 0;
    for folder in std::fs::read_dir(designs).unwrap() {
        let folder = folder.unwrap().path();
        let Ok(text) = std::fs::read_to_string(folder.join("report.json")) else {
            continue;
        };
        let report: serde_json::Value = serde_json::from_str(&text).unwrap();
        let summary = &report["pattern"]["summary"];
        // Reports of version 1 call it `least_visible`.
        let stated = summary.get("min_visible").or(summary.get("least_visible"));
        let pattern = Pattern::read_csv(&folder.join("pattern.csv")).unwrap();
        let found = pattern.min_visible(0.0) as u64;
        assert_eq!(stated.unwrap().as_u64(), Some(found), "{folder:?}");
        reports += 1;
    }
    assert!(reports >= 8, "{reports}");
}

#[test]
fn regular_patterns_show_what_symmetry_says() {
    // Opposite dots share their circle at z = 0, and many circles meet in one point.
    let shown = |dots: &[[f64; 3]], limit: f64| {
        let dots = dots.iter().map(|d| Vec3::from(*d).normalize()).collect();
        Pattern::new(dots).unwrap().min_visible(limit)
    };
    let mut octahedron = Vec::new();
    let mut cube = Vec::new();
    for sign in [-1.0, 1.0] {
        octahedron.extend([[sign, 0.0, 0.0], [0.0, sign, 0.0], [0.0, 0.0, sign]]);
        for (y, z) in [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)] {
            cube.push([sign, y, z]);
        }
    }
    assert_eq!(
        [0.0, -0.01, 0.01].map(|limit| shown(&octahedron, limit)),
        [3, 3, 1]
    );
    // Of a cube four corners are in front, one of three is 54.7 degrees from the nearest axis.
    assert_eq!(
        [0.0, 0.3, 0.34, 0.8].map(|limit| shown(&cube, limit)),
        [4, 2, 1, 0]
    );
    // A ring seen from its axis has all dots at the limit, and half of them in front beside it.
    let ring = |n: u32| -> Vec<[f64; 3]> {
        let turn = |k: u32| (f64::from(k) * std::f64::consts::TAU / f64::from(n)).sin_cos();
        (0..n).map(turn).map(|(s, c)| [c, s, 0.0]).collect()
    };
    assert_eq!([8, 9].map(|n| shown(&ring(n), 0.0)), [4, 4]);
    assert_eq!(shown(&ring(9), 0.01), 0);
    // No view shows a dot above z = 1, every one all that are not opposite.
    let icosahedron = icosahedron();
    assert_eq!(
        [1.0, 1.5, -1.0].map(|limit| icosahedron.min_visible(limit)),
        [0, 0, 12]
    );
    assert_eq!(icosahedron.min_visible(0.999), 0);
}

#[test]
fn headers_comments_and_spaces_are_accepted() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("p.csv");
    let plain = "1,0,0\n0,1,0\n0,0,1\n-0.6,0,0.8\n";
    std::fs::write(&path, plain).unwrap();
    let expected = Pattern::read_csv(&path).unwrap();
    let variants = [
        format!("x,y,z\n{plain}"),
        format!("# drawn by hand\nx, y, z\n{plain}"),
        plain.replace(',', " , "),
        plain.replace('\n', "\r\n"),
        plain.trim_end().to_owned(),
        plain.replace("1,", "1.0005,"),
    ];
    for text in variants {
        std::fs::write(&path, &text).unwrap();
        assert_eq!(Pattern::read_csv(&path).unwrap(), expected, "{text:?}");
    }
}

proptest! {
    #[test]
    fn what_is_written_reads_back_bit_for_bit(n in 4usize..=64, seed in 0u64..1000) {
        let pattern = crate::common::random_pattern(n, seed);
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("p.csv");
        pattern.write_csv(&path).unwrap();
        let again = Pattern::read_csv(&path).unwrap();
        prop_assert_eq!(&again, &pattern);
        prop_assert_eq!(again.sha256(), pattern.sha256());
    }

    #[test]
    fn any_text_is_read_or_refused_in_one_line(text in ".{0,200}") {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("p.csv");
        std::fs::write(&path, &text).unwrap();
        if let Err(error) = Pattern::read_csv(&path) {
            prop_assert!(error.is_usage());
        }
    }
}

#[test]
fn shipped_designs_are_written_as_the_writer_writes_them() {
    let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR"));
    for spindoe::pattern::NamedPattern { name, pattern, .. } in
        spindoe::pattern::shipped_designs().unwrap()
    {
        let path = root.join("designs").join(&name).join("pattern.csv");
        let text = std::fs::read_to_string(path).unwrap();
        assert_eq!(text, pattern.to_csv(), "{name}");
    }
}
