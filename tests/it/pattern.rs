//! Patterns: their file, their checks and their figures.

use proptest::prelude::*;
use spindoe::geometry::Vec3;
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
