//! Marks of a ball of which a person says which are its dots.

use std::fs;

use spindoe::Pattern;
use spindoe::geometry::{Vec3, angle_between, spiral_directions};

use super::unknown::{identified, mark, pictures, worst};
use crate::common::{done, few_or_all, random_pattern, spindoe};

#[test]
fn beside_print_a_person_says_which_marks_are_the_dots() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    // A bar and a disc of print.
    let truth = random_pattern(14, 35);
    let apart = |v: &&Vec3| truth.dots().iter().all(|d| angle_between(d, v) > 0.4);
    let places: Vec<Vec3> = spiral_directions(500).collect();
    let bar = *places.iter().find(apart).unwrap();
    let from_bar = |v: &&Vec3| angle_between(v, &bar) > 0.8;
    let disc = *places.iter().filter(apart).find(from_bar).unwrap();
    let print = [mark(bar, 0.2, 0.6), mark(disc, 0.07, 0.0)];
    fs::create_dir(dir.join("clip")).unwrap();
    let axes = [Vec3::x(), Vec3::y()];
    for (k, (image, ..)) in pictures(&truth, &print, &axes).into_iter().enumerate() {
        let path = dir.join(format!("clip/{k:03}.png"));
        image.write_png(&path).unwrap();
    }

    // The number alone is no answer.
    let known = [&["--dots", "14"][..], &[]];
    for known in known.into_iter().take(few_or_all(1, 2)) {
        let command = ["calibrate", "clip", "-o", "ball", "--samples", "0"];
        let refused = spindoe(dir, &[&command, known].concat());
        let words = String::from_utf8_lossy(&refused.stderr).into_owned();
        assert_eq!(refused.status.code(), Some(3), "{words}");
        assert!(
            words.contains("--marks") && words.contains("marks.png"),
            "{words}"
        );
        assert!(!dir.join("ball/table.npz").exists());
    }
    let picture = fs::read(dir.join("ball/marks.png")).unwrap();
    assert!(picture.starts_with(b"\x89PNG"));

    let csv = fs::read_to_string(dir.join("ball/marks.csv")).unwrap();
    let marks: Vec<Vec3> = csv
        .lines()
        .skip(1)
        .map(|line| {
            let numbers = line.split(',').skip(1).take(3);
            let [x, y, z] = numbers.map(|n| n.parse().unwrap()).collect::<Vec<f64>>()[..] else {
                panic!("{line}");
            };
            Vec3::new(x, y, z)
        })
        .collect();
    let named = identified(&marks, &truth).unwrap().assignment;
    let dots: Vec<usize> = (0..marks.len()).filter(|m| named[*m].is_some()).collect();
    assert_eq!(dots.len(), truth.len(), "{csv}");
    assert!(marks.len() > dots.len(), "{csv}");
    let said: Vec<String> = dots.iter().map(usize::to_string).collect();
    let (said, beyond) = (said.join(","), marks.len().to_string());
    let with = |numbers| {
        let command = [
            "calibrate",
            "clip",
            "-o",
            "ball",
            "--samples",
            "0",
            "--marks",
        ];
        [&command[..], &[numbers]].concat()
    };
    done(dir, &with(&said));
    let ball = Pattern::read_csv(&dir.join("ball/pattern.csv")).unwrap();
    let off = worst(&ball, &truth).map(f64::to_degrees);
    assert!(off.is_some_and(|w| w < 1.0), "{off:?} deg");

    // Rows that were sorted are not those of the picture.
    let (head, rows) = csv.split_once('\n').unwrap();
    let sorted: Vec<&str> = std::iter::once(head).chain(rows.lines().rev()).collect();
    fs::write(dir.join("ball/marks.csv"), sorted.join("\n")).unwrap();
    let refused = spindoe(dir, &[&with(&said)[..], &["--overwrite"]].concat());
    let words = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert_eq!(refused.status.code(), Some(2), "{words}");
    assert!(
        words.contains("marks.csv") && words.contains("line 2"),
        "{words}"
    );
    fs::write(dir.join("ball/marks.csv"), &csv).unwrap();

    // What is none of the marks.
    for bad in [&beyond[..], "3-", "5,5", "7-2", "dots"] {
        let command = with(bad);
        let command = [&command[..], &["--overwrite"]].concat();
        let refused = spindoe(dir, &command);
        let words = String::from_utf8_lossy(&refused.stderr).into_owned();
        assert_eq!(refused.status.code(), Some(2), "{bad}: {words}");
        assert!(words.contains("--marks"), "{bad}: {words}");
    }
}
