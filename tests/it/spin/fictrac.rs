//! FicTrac's columns, against what its documents define. Expected numbers are worked out here, from the animal's walk: the crate's rows
//! are made of the ball's orientations alone.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use nalgebra::Matrix3;
use spindoe::Error;
use spindoe::geometry::{CameraFrame, Rotation, Vec3};
use spindoe::spin::fictrac::{self, COLUMNS, FicTrac, FicTracConfig, FicTracRow};
use spindoe::spin::orientations::{OrientationRow, Orientations};

/// How an animal walks in a frame: radii ahead and to its right, radians clockwise seen from above.
#[derive(Clone, Copy)]
struct Walk {
    ahead: f64,
    right: f64,
    clockwise: f64,
}

/// Where the animal is: north, east, heading clockwise from north.
#[derive(Clone, Copy, Default)]
struct Place {
    north: f64,
    east: f64,
    heading: f64,
}

impl Place {
    /// After a frame's walk, in so many small steps that no formula of an arc is needed.
    fn after(mut self, walk: Walk) -> Self {
        const STEPS: usize = 20_000;
        for k in 0..STEPS {
            let share = (k as f64 + 0.5) / STEPS as f64;
            let (sin, cos) = (self.heading + share * walk.clockwise).sin_cos();
            self.north += (walk.ahead * cos - walk.right * sin) / STEPS as f64;
            self.east += (walk.ahead * sin + walk.right * cos) / STEPS as f64;
        }
        self.heading = (self.heading + walk.clockwise).rem_euclid(TAU);
        self
    }
}

/// The ball's turn in a frame, lab axes (x front, y right, z down): its top, one radius above its center, moves against the walk, and
/// the ball turns against the animal.
fn ball_turn(walk: Walk) -> Vec3 {
    let top = Vec3::new(0.0, 0.0, -1.0);
    let wanted = Vec3::new(-walk.ahead, -walk.right, 0.0);
    // Of all turns that move the top so, the one without a turn about the vertical.
    let turn = top.cross(&wanted) - Vec3::z() * walk.clockwise;
    assert!((turn.cross(&top) - wanted).norm() < 1e-12);
    turn
}

/// A camera in any pose, and a ball that begins in any orientation.
fn lab() -> (Rotation, Rotation) {
    let camera_to_lab = Rotation::new(Vec3::new(0.7, -1.3, 2.1));
    (camera_to_lab, Rotation::new(Vec3::new(-2.0, 0.4, 0.9)))
}

/// What a camera sees of these walks, and the rows that come of it.
fn rows_of(walks: &[Walk]) -> Vec<FicTracRow> {
    let (camera_to_lab, mut in_lab) = lab();
    let mut seen = vec![in_lab];
    for walk in walks {
        in_lab = Rotation::new(ball_turn(*walk)) * in_lab;
        seen.push(in_lab);
    }
    let row = |(k, in_lab): (usize, &Rotation)| OrientationRow {
        time_s: 2.0 + 0.01 * k as f64,
        orientation: Some(camera_to_lab.inverse() * in_lab),
        ..OrientationRow::default()
    };
    let file = Orientations {
        rows: seen.iter().enumerate().map(row).collect(),
        camera_frame: Some(CameraFrame::Optical),
        ..Orientations::default()
    };
    let config = FicTracConfig {
        camera_to_lab,
        ..FicTracConfig::default()
    };
    fictrac::rows(&file, config).unwrap()
}

fn assert_walk(walks: &[Walk]) {
    let rows = rows_of(walks);
    assert_eq!(rows.len(), walks.len() + 1);
    let (camera_to_lab, begun) = lab();
    let (mut place, mut sums, mut in_lab) = (Place::default(), [0.0; 2], begun);
    // The first row is a place, and no step.
    let first = rows[0].values();
    assert_eq!((first[0], first[22]), (1.0, 1.0));
    let still = [1, 2, 3, 4, 5, 6, 7, 14, 15, 16, 17, 18, 19, 20, 23];
    assert!(still.iter().all(|&k| first[k] == 0.0), "{first:?}");
    for (k, walk) in walks.iter().enumerate() {
        place = place.after(*walk);
        sums = [sums[0] + walk.ahead, sums[1] + walk.right];
        let turn = ball_turn(*walk);
        in_lab = Rotation::new(turn) * in_lab;
        let near = |name: &str, found: &[f64], expected: &[f64]| {
            let off = found.iter().zip(expected).map(|(a, b)| (a - b).abs());
            let off = off.fold(0.0, f64::max);
            assert!(
                off < 1e-8,
                "{name}, row {k}: {found:?}, expected {expected:?}"
            );
        };
        let found = rows[k + 1].values();
        near("frame", &found[..1], &[k as f64 + 2.0]);
        let cam = camera_to_lab.inverse() * turn;
        near("delta, camera", &found[1..4], cam.as_slice());
        near("delta, lab", &found[5..8], turn.as_slice());
        let absolute = |columns: &[f64]| Rotation::new(Vec3::from_column_slice(columns));
        let off = absolute(&found[8..11]).angle_to(&(camera_to_lab.inverse() * in_lab));
        assert!(off < 1e-7, "absolute, camera: {off}");
        let off = absolute(&found[11..14]).angle_to(&in_lab);
        assert!(off < 1e-7, "absolute, lab: {off}");
        near("position", &found[14..16], &[place.north, place.east]);
        let apart = (found[16] - place.heading + PI).rem_euclid(TAU) - PI;
        assert!(apart.abs() < 1e-9 && (0.0..TAU).contains(&found[16]));
        if walk.ahead.hypot(walk.right) > 0.0 {
            let direction = walk.right.atan2(walk.ahead);
            let apart = (found[17] - direction + PI).rem_euclid(TAU) - PI;
            assert!(apart.abs() < 1e-8, "direction, row {k}: {}", found[17]);
        }
        assert!((0.0..TAU).contains(&found[17]));
        near("speed", &found[18..19], &[walk.ahead.hypot(walk.right)]);
        near("motion", &found[19..21], &sums);
        near(
            "times",
            &found[21..24],
            &[2010.0 + 10.0 * k as f64, k as f64 + 2.0, 10.0],
        );
        assert!(found[24].is_nan());
    }
}

fn walk(ahead: f64, right: f64, clockwise: f64) -> Walk {
    Walk {
        ahead,
        right,
        clockwise,
    }
}

#[test]
fn ahead_sideways_and_in_place() {
    assert_walk(&[walk(0.05, 0.0, 0.0); 8]);
    assert_walk(&[walk(0.0, 0.04, 0.0); 8]);
    assert_walk(&[walk(0.0, -0.04, 0.0); 8]);
    assert_walk(&[walk(-0.03, 0.0, 0.0); 4]);
    assert_walk(&[walk(0.0, 0.0, 0.3); 30]);
    assert_walk(&[walk(0.0, 0.0, -0.3); 30]);
    // What the documents say in words: north is where the animal looked first, and its right is east.
    let last = |walks: &[Walk]| *rows_of(walks).last().unwrap();
    let row = last(&[walk(0.05, 0.0, 0.0); 8]);
    assert!((row.position_radii[0] - 0.4).abs() < 1e-9 && row.position_radii[1].abs() < 1e-9);
    let row = last(&[walk(0.0, 0.05, 0.0); 8]);
    assert!((row.position_radii[1] - 0.4).abs() < 1e-9 && row.position_radii[0].abs() < 1e-9);
    assert!((row.direction_rad - FRAC_PI_2).abs() < 1e-9);
    // "If the animal turns clockwise 90 degrees and walks forwards this will give fictive motion in the +Y direction."
    let row = last(&[walk(0.0, 0.0, FRAC_PI_2), walk(0.3, 0.0, 0.0)]);
    assert!((row.position_radii[1] - 0.3).abs() < 1e-9 && row.position_radii[0].abs() < 1e-9);
}

#[test]
fn an_even_turn_while_walking_is_a_circle_that_closes() {
    let row = *rows_of(&[walk(0.1, 0.02, TAU / 16.0); 16]).last().unwrap();
    let [north, east] = row.position_radii;
    assert!(north.hypot(east) < 1e-9, "{north} {east}");
    assert_walk(&[
        walk(0.1, 0.02, 0.5),
        walk(0.02, -0.3, -0.4),
        walk(-0.1, 0.0, 0.9),
    ]);
}

#[test]
fn axes_of_a_file_are_those_that_it_names() {
    // The same motion in the crate's axes: y and z point the other way.
    let (mut optical, mut camera) = (Vec::new(), Vec::new());
    for k in 0..4 {
        let turn = Rotation::new(Vec3::new(0.1, 0.03, -0.02) * f64::from(k));
        let row = |orientation| OrientationRow {
            time_s: f64::from(k),
            orientation: Some(orientation),
            covariance: Some(Matrix3::from_diagonal(&Vec3::new(1.0, 4.0, 4.0)) * 1e-6),
            ..OrientationRow::default()
        };
        optical.push(row(turn));
        camera.push(row(CameraFrame::Optical.turn() * turn));
    }
    let of = |rows, frame| {
        let file = Orientations {
            rows,
            camera_frame: Some(frame),
            ..Orientations::default()
        };
        fictrac::rows(&file, FicTracConfig::default()).unwrap()
    };
    let (a, b) = (
        of(optical, CameraFrame::Optical),
        of(camera, CameraFrame::Camera),
    );
    for (a, b) in a.iter().zip(&b) {
        let pairs = a.values().into_iter().zip(b.values());
        assert!(
            pairs
                .filter(|(a, _)| !a.is_nan())
                .all(|(a, b)| (a - b).abs() < 1e-9)
        );
    }
    // Two deviations of 3e-3 rad.
    assert!((a[1].delta_error - 3e-3 * 2f64.sqrt()).abs() < 1e-12);
}

#[test]
fn frames_without_an_orientation_have_no_row_and_count() {
    let row = |k: u64, is_seen: bool| OrientationRow {
        time_s: k as f64,
        orientation: is_seen.then(|| Rotation::new(Vec3::x() * 0.1 * k as f64)),
        ..OrientationRow::default()
    };
    let seen = [true, true, false, false, true, false, true];
    let push_all = |max_bad_frames| {
        let config = FicTracConfig {
            max_bad_frames,
            ..FicTracConfig::default()
        };
        let mut fictrac = FicTrac::new(config);
        let rows = (0..)
            .zip(seen)
            .filter_map(|(k, is)| fictrac.push(&row(k, is), None).unwrap());
        rows.collect::<Vec<_>>()
    };
    let rows = push_all(None);
    let counts = |rows: &[FicTracRow]| {
        rows.iter()
            .map(|r| (r.frame, r.sequence))
            .collect::<Vec<_>>()
    };
    assert_eq!(counts(&rows), [(1, 1), (2, 2), (5, 5), (7, 7)]);
    // The change is that since the last row, and so is the time.
    assert!((rows[2].delta_cam - Vec3::x() * 0.3).norm() < 1e-12);
    assert_eq!(rows[2].delta_timestamp_ms, 3000.0);
    assert!((rows[3].position_radii[0] - 0.6).abs() < 1e-12);
    // A path that begins anew: place, heading and count, but not the sums of an optical mouse.
    let rows = push_all(Some(1));
    assert_eq!(counts(&rows), [(1, 1), (2, 2), (5, 1), (7, 3)]);
    assert_eq!(rows[2].delta_cam, Vec3::zeros());
    assert_eq!(rows[2].position_radii, [0.0; 2]);
    assert!((rows[2].motion_radii[0] - 0.1).abs() < 1e-12);
    assert!((rows[3].position_radii[0] - 0.2).abs() < 1e-12);
}

#[test]
fn many_frames_missed_at_once_are_as_many_one_by_one() {
    let at = |k: u64| OrientationRow {
        time_s: k as f64,
        orientation: Some(Rotation::new(Vec3::x() * 0.1 * k as f64)),
        ..OrientationRow::default()
    };
    for max_bad_frames in [None, Some(0), Some(1), Some(2), Some(7), Some(u64::MAX)] {
        let config = FicTracConfig {
            max_bad_frames,
            ..FicTracConfig::default()
        };
        for (before, missed) in (0..4).flat_map(|b| (0..9).map(move |m| (b, m))) {
            let row = |misses: &[u64]| {
                let mut fictrac = FicTrac::new(config);
                fictrac.push(&at(0), None).unwrap();
                fictrac.push(&at(1), None).unwrap();
                fictrac.miss(before);
                misses.iter().for_each(|n| fictrac.miss(*n));
                fictrac.push(&at(20), None).unwrap().unwrap()
            };
            let once = row(&[missed]).to_string();
            let each = row(&vec![1; missed as usize]).to_string();
            assert_eq!(once, each, "{max_bad_frames:?} {before} {missed}");
        }
    }
}

#[test]
fn a_row_is_25_numbers_between_commas() {
    let rows = rows_of(&[walk(0.05, 1e-9, 0.1)]);
    for row in rows {
        let text = row.to_string();
        let numbers: Vec<f64> = text.split(", ").map(|n| n.parse().unwrap()).collect();
        assert_eq!(numbers.len(), COLUMNS);
        let same = numbers.iter().zip(row.values());
        assert!(
            same.clone()
                .all(|(a, b)| *a == b || a.is_nan() && b.is_nan()),
            "{text}"
        );
        assert!(!text.contains("-0,"), "{text}");
    }
}

#[test]
fn times_are_there_and_increase() {
    let row = |time_s| OrientationRow {
        time_s,
        orientation: Some(Rotation::identity()),
        ..OrientationRow::default()
    };
    let refused = |rows: Vec<OrientationRow>, words: &str| {
        let file = Orientations {
            rows,
            ..Orientations::default()
        };
        let error = fictrac::rows(&file, FicTracConfig::default()).unwrap_err();
        assert!(
            matches!(error, Error::Argument { .. }) && error.to_string().contains(words),
            "{error}"
        );
    };
    refused(vec![row(f64::NAN)], "frame 1: expected a time");
    refused(
        vec![row(0.0), row(0.0)],
        "frame 2: expected a time after 0 s",
    );
    assert!(
        FicTracConfig::default()
            .with_c2a_r([0.0, f64::NAN, 0.0])
            .is_err()
    );
}
