//! Data sets of flights: the published one written again, its bounces, and clips that become one.

use std::path::Path;

use nalgebra::Matrix3;
use rand::{RngExt as _, SeedableRng as _};
use rand_distr::StandardNormal;
use serde_json::Value;
use spindoe::dataset::{Bounce, BounceConfig, PathPoint, bounces, flights};
use spindoe::geometry::{Position, Rotation, Vec3};
use spindoe::spin::orientations::{OrientationRow, Orientations};
use spindoe::spin::robust::SpinConfig;
use spindoe::spin::trajectories::{Trajectory, TrajectorySet};

use crate::common::{done, published_trajectories, refused, spindoe};

#[test]
fn the_published_set_written_again_is_the_same() {
    let Some(published) = published_trajectories() else {
        return;
    };
    let set = TrajectorySet::read_dir(&published).unwrap();
    let dir = tempfile::tempdir().unwrap();
    set.write_dir(dir.path()).unwrap();
    let again = TrajectorySet::read_dir(dir.path()).unwrap();
    assert_eq!(again, set);
    assert!(again.trajectories.len() == 232 && again.trajectories.iter().all(|t| t.spin.is_some()));
    // By another reader, field by field: the authors' files are text with delimiters.
    for name in ["index.csv", "000.csv", "294.csv"].map(Path::new) {
        let numbers = |dir: &Path| -> Option<Vec<f64>> {
            let text = std::fs::read_to_string(dir.join(name)).ok()?;
            let fields = text.split(['\n', ';', ',']).map(str::trim);
            Some(fields.filter_map(|f| f.parse().ok()).collect())
        };
        let (ours, theirs) = (numbers(dir.path()), numbers(&published));
        assert!(ours.is_some() && ours == theirs, "{name:?}");
    }
}

/// A flight's points without its repeated times.
fn path(flight: &Trajectory) -> Vec<PathPoint> {
    let points = flight.points.iter().map(|p| PathPoint {
        time_s: p.time_s,
        position_m: p.position_m,
    });
    points.collect()
}

/// Bounces off the published table by another rule: the height has a minimum within a ball's diameter of the table, falling before it and rising
/// after it.
fn off_the_table(points: &[PathPoint]) -> Vec<f64> {
    let mut found: Vec<f64> = Vec::new();
    let z = |k: usize| points[k].position_m.z;
    let speed =
        |a: usize, b: usize| (z(b) - z(a)) / (points[b].time_s - points[a].time_s).max(1e-9);
    for k in 3..points.len().saturating_sub(3) {
        let near = k.saturating_sub(4)..(k + 5).min(points.len());
        let is_lowest = near.clone().all(|j| z(j) >= z(k));
        let turns = speed(k - 3, k - 1) < -0.4 && speed(k + 1, k + 3) > 0.4;
        if is_lowest
            && z(k) < 0.09
            && turns
            && found.last().is_none_or(|t| points[k].time_s - t > 0.03)
        {
            found.push(points[k].time_s);
        }
    }
    found
}

/// The settings were chosen by flights with even numbers.
#[test]
fn bounces_of_the_published_flights_with_odd_numbers_are_found() {
    let Some(published) = published_trajectories() else {
        return;
    };
    let set = TrajectorySet::read_dir(&published).unwrap();
    let (mut found, mut missed, mut more) = (0, 0, Vec::new());
    for flight in set.trajectories.iter().filter(|t| t.number % 2 == 1) {
        let points = path(flight);
        let mut kinks = bounces(&points, None, &BounceConfig::default());
        for time_s in off_the_table(&points) {
            let is_it = |b: &Bounce| (b.time_s - time_s).abs() < 0.02;
            match kinks.iter().position(is_it) {
                Some(k) => {
                    found += 1;
                    kinks.remove(k);
                }
                None => missed += 1,
            }
        }
        more.extend(kinks.iter().map(|b| (flight.number, b.time_s, b.jump_m_s)));
    }
    eprintln!(
        "{found} bounces found, {missed} missed, {} more: {more:?}",
        more.len()
    );
    assert!(
        found >= 100 && missed == 0,
        "{found} found, {missed} missed"
    );
    // Hits and walls, seven of which change the velocity by more than 4.7 m/s: flights have no more kinks.
    assert!(more.len() <= 11, "{more:?}");
}

/// A path, when it bounces and by how much that changes the velocity, and the covariance of a position.
type Flown = (Vec<PathPoint>, Option<(f64, Vec3)>, Matrix3<f64>);

/// A ball of 2.7 g and 40 mm in the air, that may bounce off a table at height 0: gravity, drag and Magnus force (y up), by small steps.
fn flown(bounces: bool, rate: f64, seed: u64) -> Flown {
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
    let mut normal = |sigma: f64| sigma * rng.sample::<f64, _>(StandardNormal);
    let spin = Vec3::new(normal(100.0), normal(60.0), normal(200.0));
    let mut velocity = Vec3::new(6.0 + normal(1.5), -1.0 + normal(0.5), normal(0.5));
    let mut place = Vec3::new(-0.6, 0.35, -1.5);
    let (mut time, mut bounced, mut points) = (0.0, None, Vec::new());
    // A camera's error, larger along its axis.
    let sigma = Vec3::new(2e-4, 2e-4, 5e-3);
    let step = 1e-5;
    let mut next = 0.0;
    while time < 0.22 {
        if time >= next {
            let error = Vec3::new(normal(sigma.x), normal(sigma.y), normal(sigma.z));
            points.push(PathPoint {
                time_s: time,
                position_m: place + error,
            });
            next += rate.recip();
        }
        let drag = velocity * (-0.12 * velocity.norm());
        let lift = spin.cross(&velocity) * 0.006;
        velocity += step * (drag + lift - Vec3::y() * 9.81);
        place += step * velocity;
        time += step;
        if bounces && place.y < 0.02 && velocity.y < 0.0 {
            let after = Vec3::new(0.8 * velocity.x, -0.9 * velocity.y, velocity.z);
            bounced = bounced.or(Some((time, after - velocity)));
            velocity = after;
        }
    }
    (
        points,
        bounced,
        Matrix3::from_diagonal(&sigma.component_mul(&sigma)),
    )
}

#[test]
fn paths_without_a_bounce_have_none_and_those_with_one_have_it() {
    let config = BounceConfig::default();
    for rate in [120.0, 350.0] {
        let (mut seen, mut missed, mut off_s) = (0, 0, 0.0f64);
        for seed in 0..100 {
            let (points, _, noise) = flown(false, rate, 7100 + seed);
            let found = bounces(&points, Some(&noise), &config);
            assert!(found.is_empty(), "{rate} fps, {seed}: {found:?}");
            let (points, bounced, noise) = flown(true, rate, 7300 + seed);
            // Enough points before it and after it to tell.
            let Some((time_s, _)) = bounced else { continue };
            let before = points.iter().filter(|p| p.time_s < time_s).count();
            if before < 8 || points.len() - before < 8 {
                continue;
            }
            seen += 1;
            let found = bounces(&points, Some(&noise), &config);
            match found
                .iter()
                .find(|b| (b.time_s - time_s).abs() < 2.0 / rate)
            {
                Some(bounce) => off_s = off_s.max((bounce.time_s - time_s).abs()),
                None => missed += 1,
            }
        }
        eprintln!("{rate} fps: {missed} of {seen} bounces missed, times off by up to {off_s:.4} s");
        assert!(
            seen >= 20 && missed * 20 <= seen,
            "{rate} fps: {missed} of {seen}"
        );
    }
}

/// Before a bounce and after it a ball has different spins: two flights.
#[test]
fn a_bounce_separates_two_spins() {
    // The first flight that is seen long enough after its bounce, too.
    let is_long = |points: &[PathPoint], bounced: Option<(f64, Vec3)>| {
        let after = points
            .iter()
            .filter(|p| bounced.is_some_and(|(b, _)| p.time_s > b));
        after.count() >= 15
    };
    let mut flown = (7301..7400).map(|seed| flown(true, 350.0, seed));
    let (points, bounced, noise) = flown.find(|(p, b, _)| is_long(p, *b)).expect("one");
    let (bounced, jump) = bounced.expect("a bounce");
    let spins = [Vec3::new(20.0, -5.0, 150.0), Vec3::new(10.0, 8.0, 90.0)];
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(7501);
    let row = |(k, point): (usize, &PathPoint)| {
        let before = point.time_s.min(bounced);
        let after = point.time_s - before;
        let turned = Rotation::new(spins[1] * after) * Rotation::new(spins[0] * before);
        let error = Vec3::from_fn(|_, _| 0.005 * rng.sample::<f64, _>(StandardNormal));
        OrientationRow {
            frame: k.to_string(),
            time_s: point.time_s,
            // Now and then a frame shows no dots, or no ball at all.
            orientation: (k % 7 != 3).then(|| Rotation::new(error) * turned),
            covariance: (k % 7 != 3).then(|| Matrix3::identity() * 2.5e-5),
            position: (k % 11 != 0).then_some(Position {
                center_m: point.position_m,
                covariance: noise,
                with_rotation: None,
            }),
            ..OrientationRow::default()
        }
    };
    let file = Orientations {
        rows: points.iter().enumerate().map(row).collect(),
        ..Orientations::default()
    };
    let count = file.rows.len();
    let found = flights(file, &SpinConfig::default(), &BounceConfig::default());
    assert_eq!(found.len(), 2);
    assert_eq!(
        found.iter().map(|f| f.file.rows.len()).sum::<usize>(),
        count
    );
    for (number, (flight, spin)) in found.iter().zip(&spins).enumerate() {
        let times = flight.file.rows.iter().map(|row| row.time_s);
        assert!(
            times.clone().all(|t| (t >= bounced) == (number == 1)),
            "{bounced}"
        );
        let fitted = flight.spin.as_ref().expect("a spin").overall();
        let off = fitted.motion.spin - spin;
        let covariance = fitted.spin_covariance.expect("a covariance");
        let distance2 = off.dot(&covariance.cholesky().unwrap().solve(&off));
        // 99.9 % of chi-squared with three degrees of freedom lie below.
        assert!(
            distance2 < 16.27 && off.norm() < 0.02 * spin.norm(),
            "flight {number}: {} {distance2}",
            fitted.motion.spin
        );
        let trajectory = flight.trajectory(7);
        assert_eq!((trajectory.number, trajectory.points[0].time_s), (7, 0.0));
        assert_eq!(trajectory.points.len(), flight.points().count());
    }
    assert!(found[0].bounce.is_none());
    let bounce = found[1].bounce.expect("begins with it");
    assert!((bounce.time_s - bounced).abs() < 1.0 / 350.0);
    // The velocity's change, across the camera's axis: along it positions are uncertain.
    let off = bounce.jump_m_s - jump;
    assert!(off.xy().norm() < 0.3, "{} of {jump}", bounce.jump_m_s);
}

/// A clip of a flight, the camera's intrinsics as a flag, and its truth.
fn clip(dir: &Path, name: &str, seed: &str) -> (String, Value) {
    let made = format!(
        "synth dots20 -o {name} --image-size 640x480 --ball-px 60 --frames 14 --seed {seed} --rps 25 --config drift_px=200,-60"
    );
    done(dir, &made.split(' ').collect::<Vec<_>>());
    let text = std::fs::read_to_string(dir.join(name).join("truth.json")).unwrap();
    let truth: Value = serde_json::from_str(&text).unwrap();
    let k = &truth["frames"][0]["intrinsics"];
    let known = ["fx", "fy", "cx", "cy"].map(|name| k[name].as_f64().unwrap().to_string());
    (format!("--intrinsics={}", known.join(",")), truth)
}

#[test]
fn clips_become_a_data_set_that_is_read_back() {
    let dir = tempfile::tempdir().unwrap();
    let (known, truth) = clip(dir.path(), "one", "3");
    let make = [
        "dataset",
        "--table",
        "dots20",
        &known,
        "one/images",
        "one/images",
        "-o",
        "set",
    ];
    let output = spindoe(dir.path(), &make);
    let words = String::from_utf8(output.stderr).unwrap();
    assert!(
        output.status.success() && words.contains("2 flights of 2 clips, 2 with a spin"),
        "{words}"
    );
    let set = TrajectorySet::read_dir(&dir.path().join("set")).unwrap();
    assert_eq!(set.trajectories.len(), 2);
    let record: Value = serde_json::from_str(
        &std::fs::read_to_string(dir.path().join("set/dataset.json")).unwrap(),
    )
    .unwrap();
    assert_eq!(record["spindoe"], env!("CARGO_PKG_VERSION"));
    assert_eq!(record["camera_frame"], "camera");
    assert_eq!(record["tables"][0]["name"], "dots20");
    for name in ["fx", "fy", "cx", "cy"] {
        assert_eq!(
            record["intrinsics"][name],
            truth["frames"][0]["intrinsics"][name]
        );
    }
    let flight = &record["clips"][0]["flights"][0];
    let spin = set.trajectories[0].spin.unwrap();
    for k in 0..3 {
        assert_eq!(flight["spin"]["spin_rad_s"][k].as_f64().unwrap(), spin[k]);
    }
    assert!(
        (spin.norm() / std::f64::consts::TAU - 25.0).abs() < 0.3,
        "{spin}"
    );
    let variance = flight["spin"]["covariance_rad2_s2"][0][0].as_f64().unwrap();
    assert!(variance > 0.0 && variance < 25.0);
    // Where the ball was rendered: on the ray of its center, so many radii of 20 mm away.
    let points = &set.trajectories[0].points;
    assert_eq!(points[0].time_s, 0.0);
    assert_eq!(flight["positions"].as_u64().unwrap() as usize, points.len());
    let k = &truth["frames"][0]["intrinsics"];
    let number = |name: &str| k[name].as_f64().unwrap();
    for (point, frame) in points.iter().zip(truth["frames"].as_array().unwrap()) {
        let p = point.position_m;
        let seen = [
            number("cx") + number("fx") * p.x / -p.z,
            number("cy") - number("fy") * p.y / -p.z,
        ];
        let truth = ["u", "v"].map(|x| frame["ball_center"][x].as_f64().unwrap());
        let off = (seen[0] - truth[0]).hypot(seen[1] - truth[1]);
        assert!(off < 0.5, "{seen:?} {truth:?}");
        let distance = 0.02 * frame["distance"].as_f64().unwrap();
        assert!((p.norm() / distance - 1.0).abs() < 0.03, "{p} {distance}");
    }
    // What was estimated, and the plots by which it is checked.
    let rows = Orientations::read_csv(&dir.path().join("set/orientations/001.csv")).unwrap();
    assert!(
        rows.rows
            .iter()
            .filter(|r| r.position.is_some() && r.covariance.is_some())
            .count()
            >= 10
    );
    for name in ["000_spin.png", "000_positions.png", "001_spin.png"] {
        assert!(
            image::open(dir.path().join("set/plots").join(name))
                .unwrap()
                .width()
                > 500
        );
    }
    refused(dir.path(), &make, 2, "holds a data set already");
    let again = [&make[..4], &["one/images", "-o", "set", "--overwrite"]].concat();
    // What is not the set's is neither removed nor taken for a part of it.
    for own in ["2024.csv", "plots/mine.png", "orientations/my.csv"] {
        let own = dir.path().join("set").join(own);
        std::fs::write(&own, "mine").unwrap();
        refused(dir.path(), &again, 2, "lists; move it");
        assert_eq!(std::fs::read_to_string(&own).unwrap(), "mine");
        std::fs::remove_file(own).unwrap();
    }
    std::fs::write(dir.path().join("set/notes.txt"), "mine").unwrap();
    done(dir.path(), &again);
    assert!(dir.path().join("set/notes.txt").exists());
    let set = TrajectorySet::read_dir(&dir.path().join("set")).unwrap();
    assert_eq!((set.trajectories.len(), set.without_file.len()), (1, 0));
    assert!(!dir.path().join("set/plots/001_spin.png").exists());
}

#[test]
fn what_makes_no_data_set_is_refused_and_leaves_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let (known, _) = clip(dir.path(), "one", "5");
    let base = ["dataset", "--table", "dots20", "one/images", "-o", "set"];
    refused(dir.path(), &base, 2, "intrinsics");
    refused(
        dir.path(),
        &[&base[..], &[&known, "--config", "half_window=2"]].concat(),
        2,
        "half_window",
    );
    refused(
        dir.path(),
        &[&base[..], &[&known, "--config", "ball_diameter_mm=0"]].concat(),
        2,
        "ball",
    );
    assert!(!dir.path().join("set").exists());
    // Files of the user's in a set's places, with and without --overwrite; a folder that is a clip.
    for own in ["2024.csv", "plots/mine.png", "orientations/my.csv"] {
        let own = dir.path().join("own").join(own);
        std::fs::create_dir_all(own.parent().unwrap()).unwrap();
        std::fs::write(&own, "mine").unwrap();
        for more in [&[][..], &["--overwrite"]] {
            let into = [&base[..4], &["-o", "own", known.as_str()], more].concat();
            refused(dir.path(), &into, 2, "own holds");
            assert_eq!(std::fs::read_to_string(&own).unwrap(), "mine");
        }
        std::fs::remove_dir_all(dir.path().join("own")).unwrap();
    }
    let into = [
        &base[..4],
        &["-o", "one/../one/images", known.as_str(), "--overwrite"],
    ]
    .concat();
    refused(dir.path(), &into, 2, "clip's own folder");
    // Another ball's table: no flight.
    let other = [
        "dataset",
        "--table",
        "dots32",
        "one/images",
        &known,
        "-o",
        "set",
    ];
    let output = spindoe(dir.path(), &other);
    let words = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(3), "{words}");
    assert!(!dir.path().join("set/index.csv").exists(), "{words}");
}
