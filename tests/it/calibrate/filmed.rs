//! `calibrate --live`: a ball without a table while it is filmed.

use std::fs;

use spindoe::Pattern;
use spindoe::geometry::Vec3;

use super::unknown::{pictures, worst};
use crate::common::{random_pattern, spindoe};

#[test]
fn what_is_filmed_is_judged_when_it_shows_the_ball_or_breaks_off() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    let truth = random_pattern(14, 35);
    let mut stream = Vec::new();
    let mut ends = Vec::new();
    let axes = [Vec3::y(), Vec3::x(), Vec3::y()];
    for (image, ..) in pictures(&truth, &[], &axes) {
        let path = dir.join("frame.png");
        image.write_png(&path).unwrap();
        stream.extend(fs::read(&path).unwrap());
        ends.push(stream.len());
    }
    // This ball turns about another axis from one frame to the next.
    let live = |name: &str| {
        let command = "calibrate --live --fps 30 --samples 0 -o ball";
        let command: Vec<&str> = command.split(' ').chain([name]).collect();
        let done = spindoe(dir, &command);
        let words = String::from_utf8_lossy(&done.stderr).into_owned();
        (done.status.code(), words)
    };

    // The camera is unplugged within a frame.
    fs::write(dir.join("short"), &stream[..ends[24] - 100]).unwrap();
    let (code, words) = live("short");
    assert_eq!(code, Some(3), "{words}");
    assert!(
        words.contains("judged") && words.contains("24 of 24 frames"),
        "{words}"
    );
    assert!(words.contains("in the last frame"), "{words}");
    assert!(!dir.join("ball").exists());

    fs::write(dir.join("whole"), &stream).unwrap();
    let (code, words) = live("whole");
    assert_eq!(code, Some(0), "{words}");
    assert!(words.contains("% of the ball shown, 14 dots"), "{words}");
    let ball = Pattern::read_csv(&dir.join("ball/pattern.csv")).unwrap();
    let off = worst(&ball, &truth).map(f64::to_degrees);
    assert!(off.is_some_and(|w| w < 1.0), "{off:?} deg");
}
