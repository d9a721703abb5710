//! Patterns before a camera: signals against rendered images, better cameras, races, and the commands
//! that take a camera.

use rand::{RngExt, SeedableRng};
use spindoe::camera::{
    CameraConditions, CameraTrials, DotSize, ErrorRatio, FrameOutcome, FrameRates, RaceConfig,
    Racer, Surroundings, coverage, race_patterns,
};
use spindoe::pattern::shipped_designs;
use spindoe::synth::sensor::Sensor;
use spindoe::synth::{Scene, SynthConfig, dataset::frame_rng};

use crate::common::{done, few_or_all, random_pattern, spindoe};

/// The default camera in a dark room.
fn in_the_dark() -> CameraConditions {
    CameraConditions {
        surroundings: Surroundings::Dark,
        ..CameraConditions::default()
    }
}

#[test]
fn signals_are_what_the_image_shows() {
    // A sensor without faults: contrast and brightness can be read off the pixels.
    let pattern = random_pattern(20, 4);
    let config = SynthConfig {
        ball_px: Some([300.0; 2]),
        size_px: [300, 400],
        max_gloss: 0.0,
        max_streaks: 0.0,
        rps: [0.0; 2],
        max_shift_px: 0.0,
        max_arc_rad: 0.0,
        ..SynthConfig::good().unprinted()
    };
    let mut seen_dots = 0;
    for k in 0..6 {
        let mut scene = Scene::random(&pattern, &config, &mut frame_rng(8, k)).unwrap();
        scene.sensor = Sensor {
            gain: scene.sensor.gain.min(1.0),
            ..Sensor::PERFECT
        };
        let ball = scene.signal().unwrap();
        let gray = scene.render().unwrap().image.to_gray();
        let value = |u: f64, v: f64| f64::from(gray.at(u.round() as isize, v.round() as isize));
        for dot in ball.dots.iter().filter(|d| d.truth.facing > 0.8) {
            let at = dot.truth.pixel;
            let reach = 1.7 * dot.truth.radius_rad * ball.circle.radius;
            let around: f64 = (0..8)
                .map(|k| (std::f64::consts::TAU * f64::from(k) / 8.0).sin_cos())
                .map(|(s, c)| value(at.u + reach * c, at.v + reach * s))
                .sum::<f64>()
                / 8.0;
            if !(0.05..=0.99).contains(&around) {
                continue;
            }
            let contrast = dot.contrast / dot.brightness.max(0.02);
            let shown = (around - value(at.u, at.v)) / around;
            assert!((dot.brightness - around).abs() < 0.06, "{dot:?} {around}");
            assert!((contrast - shown).abs() < 0.1, "{dot:?} {shown}");
            seen_dots += 1;
        }
    }
    assert!(seen_dots > 10, "{seen_dots}");
}

#[test]
fn a_small_ball_is_less_exact_and_a_blurred_one_answered_less_often() {
    let designs = shipped_designs().unwrap();
    let rates = |conditions: &CameraConditions| {
        let trials = CameraTrials::new(*conditions, 5);
        let outcomes = trials
            .frames(&designs[2].pattern, 0..few_or_all(80, 160) as u64, &|_| ())
            .unwrap();
        FrameRates::of(&outcomes, 5)
    };
    let usual = in_the_dark();
    let far = CameraConditions {
        ball_px: 20.0,
        ..usual
    };
    let blurred = CameraConditions {
        exposure_s: 2e-3,
        rps: [80.0, 100.0],
        ..usual
    };
    let [good, far, blurred] = [usual, far, blurred].map(|c| rates(&c));
    // Balls of 20 pixels are answered as often.
    let is_better = good.right.rate >= far.right.rate && good.mean_error_deg < far.mean_error_deg;
    assert!(is_better, "{good:?}\n{far:?}");
    assert!(good.right.rate > blurred.right.rate + 0.1);
    // The best one's interval is below that of the worst.
    let [_, high] = good.effective_error_interval_deg.unwrap();
    let [low, _] = far.effective_error_interval_deg.unwrap();
    assert!(high < low, "{good:?}\n{far:?}");
}

#[test]
fn a_race_drops_a_pattern_that_the_camera_cannot_read() {
    let designs = shipped_designs().unwrap();
    let dots20 = &designs.iter().find(|d| d.name == "dots20").unwrap().pattern;
    // Four dots are hardly ever enough.
    let racers = [random_pattern(4, 3), dots20.clone()];
    let racers: Vec<Racer<'_>> = racers
        .iter()
        .map(|pattern| Racer {
            pattern,
            dot_diameter: 0.1,
        })
        .collect();
    let trials = CameraTrials::new(in_the_dark(), 6);
    let config = RaceConfig {
        first_frames: 24,
        max_frames: 48,
    };
    let read = std::sync::atomic::AtomicU64::new(0);
    let count = |n| {
        read.fetch_add(n, std::sync::atomic::Ordering::Relaxed);
    };
    let never = std::sync::atomic::AtomicBool::new(false);
    let standings = race_patterns(&trials, &racers, &config, &never, &count).unwrap();
    assert_eq!((standings[0].entry, standings[1].left), (1, true));
    assert_eq!([48, 24], [0, 1].map(|k| standings[k].outcomes.len()));
    assert!(race_patterns(&trials, &[], &config, &never, &count).is_err());
    // What is read and what is spared make the whole.
    assert_eq!(read.into_inner(), 192);
    // What is reported are frames that the race has not seen.
    let own = trials.frames(racers[1].pattern, 48..96, &|_| ()).unwrap();
    assert_eq!(standings[0].outcomes, own);
    // The stencil of more dots has smaller holes.
    let hole = |name: &str| {
        let design = designs.iter().find(|d| d.name == name).unwrap();
        let size = DotSize::LargestHole { ball_mm: 40.0 };
        size.of(&design.pattern, &CameraConditions::default())
            .unwrap()
    };
    assert!(hole("dots12") > hole("dots40"));
}

#[test]
fn spins_of_sequences_come_with_their_errors() {
    let designs = shipped_designs().unwrap();
    let slow = CameraConditions {
        rps: [20.0, 60.0],
        ..in_the_dark()
    };
    let trials = CameraTrials::new(slow, 9);
    let spins = |frames| trials.spins(&designs[2].pattern, 24, frames, &|_| ());
    let (short, long) = (spins(6).unwrap(), spins(24).unwrap());
    assert!(
        short.right.rate > 0.8 && long.right.rate > 0.9,
        "{short:?}\n{long:?}"
    );
    assert!(long.median_magnitude_error_rps < short.median_magnitude_error_rps);
    // In the frame in which a ball off the camera's axis is seen: that frame is turned by a degree and more.
    assert!(long.median_axis_error_deg < 0.6, "{long:?}");
    assert!(spins(1).is_err());
}

#[test]
fn the_command_advises_and_names_what_it_cannot_use() {
    let dir = tempfile::tempdir().unwrap();
    let frames = few_or_all(28, 100);
    std::fs::write(
        dir.path().join("camera.toml"),
        "ball_px = 45\nrps = [10, 60]\n",
    )
    .unwrap();
    let words = done(
        dir.path(),
        &[
            "advise",
            "--camera",
            "camera.toml",
            "--exposure-ms",
            "0.2",
            "--samples",
            &frames.to_string(),
            "--config",
            "sequences=4",
            "--json",
        ],
    );
    let advice: serde_json::Value = serde_json::from_str(&words).unwrap();
    assert_eq!(advice["conditions"]["ball_px"], 45.0);
    assert_eq!(advice["conditions"]["exposure_s"], 2e-4);
    let shipped = shipped_designs().unwrap().len();
    assert_eq!(advice["patterns"].as_array().unwrap().len(), shipped);
    // Those that stay to the end come first, and alone have spins; half of the frames choose, half measure.
    let patterns = advice["patterns"].as_array().unwrap();
    let (stayed, left): (Vec<_>, Vec<_>) = patterns.iter().partition(|p| p["left"] == false);
    for (k, pattern) in stayed.iter().enumerate() {
        assert_eq!(pattern["frames"]["right"]["trials"], frames / 2);
        assert!(pattern["spin"].is_object());
        assert_eq!(pattern["error_ratio"].is_null(), k == 0, "{pattern}");
    }
    assert!(stayed.len() > 1 && patterns[..stayed.len()].iter().eq(stayed));
    assert!(left.iter().all(|p| p["spin"].is_null()));
    // The changes are tried on the scenes of the best pattern.
    for change in advice["changes"].as_array().unwrap() {
        assert_eq!(change["frames"]["right"]["trials"], frames / 2);
        let ratio = &change["error_ratio"];
        let [low, high] = ["low", "high"].map(|end| ratio[end].as_f64().unwrap());
        assert!(
            low < ratio["ratio"].as_f64().unwrap() && low < high,
            "{change}"
        );
    }
    // A larger ball, by itself: as its frames say, with an interval that holds beside those of the other changes.
    let all = advice["changes"].as_array().unwrap();
    let larger = all.iter().find(|c| {
        c["change"]
            .as_str()
            .unwrap()
            .starts_with("ball of 68 pixels")
    });
    let larger = larger.expect("a ball of 68 pixels");
    let best = &patterns[0];
    let own = CameraConditions {
        dot_diameter: best["dot_diameter"].as_f64().unwrap(),
        ..serde_json::from_value(advice["conditions"].clone()).unwrap()
    };
    let designs = shipped_designs().unwrap();
    let design = designs.iter().find(|d| best["name"] == *d.name).unwrap();
    let seed = best["frames"]["seed"].as_u64().unwrap();
    let half = frames as u64 / 2;
    let seen = |conditions| {
        let trials = CameraTrials::new(conditions, seed);
        trials
            .frames(&design.pattern, half..2 * half, &|_| ())
            .unwrap()
    };
    let ball_px = 1.5 * own.ball_px;
    let (unchanged, changed) = (seen(own), seen(CameraConditions { ball_px, ..own }));
    let rates: FrameRates = serde_json::from_value(larger["frames"].clone()).unwrap();
    assert_eq!(rates.right, FrameRates::of(&changed, seed).right);
    let ratio = ErrorRatio::of(&unchanged, &changed, all.len()).unwrap();
    for (end, expected) in [
        ("ratio", ratio.ratio),
        ("low", ratio.low),
        ("high", ratio.high),
    ] {
        let found = larger["error_ratio"][end].as_f64().unwrap();
        assert!(
            (found - expected).abs() < 1e-9,
            "{end}: {found}, expected {expected}"
        );
    }
    for (text, flags, expected) in [
        ("ball = 3\n", &["--camera", "camera.toml"][..], "line 1"),
        (
            "\nball_px = \"x\"\n",
            &["--camera", "camera.toml"],
            "line 2",
        ),
        ("", &["--ball-px", "3"], "--ball-px: expected 20 to 200"),
        ("", &["--exposure-ms", "50"], "--exposure-ms: expected"),
        (
            "",
            &["--dot-diameter-mm", "30"],
            "--dot-diameter-mm: expected",
        ),
        ("", &["--config", "rps=5"], "rps: expected MIN,MAX"),
        ("", &["--camera", "nosuch.toml"], "nosuch.toml"),
    ] {
        std::fs::write(dir.path().join("camera.toml"), text).unwrap();
        let output = spindoe(dir.path(), &[&["advise"], flags].concat());
        let words = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{flags:?}: {words}");
        assert!(
            words.contains(expected) && words.trim().lines().count() == 1,
            "{words}"
        );
    }
}

#[test]
fn what_is_assumed_of_a_camera_comes_first() {
    let dir = tempfile::tempdir().unwrap();
    let few = ["dots20", "--samples", "4", "--config", "sequences=1"];
    let words = |flags: &[&str]| done(dir.path(), &[&["advise"], &few[..], flags].concat());
    let said = words(&[]);
    let first = said.lines().next().unwrap();
    for assumed in [
        "any surroundings",
        "60 pixels",
        "350 frames",
        "0 to 100 rps",
    ] {
        assert!(first.contains(assumed), "{first}");
    }
    let said = words(&[
        "--camera",
        "dark",
        "--ball-px",
        "30",
        "--config",
        "rps=0,40",
    ]);
    let first = said.lines().next().unwrap();
    assert!(first.contains("350 frames"), "{first}");
    for stated in ["surroundings", "pixels", "rps"] {
        assert!(!first.contains(stated), "{first}");
    }
    // What is known of no frame is no number.
    let blind = [
        "validate",
        "p.csv",
        "--camera",
        "any",
        "--samples",
        "4",
        "--json",
    ];
    // A tetrahedron's dots look alike from twelve sides.
    let s = 1.0 / 3f64.sqrt();
    let dots = [[s, s, s], [s, -s, -s], [-s, s, -s], [-s, -s, s]];
    let pattern = spindoe::pattern::Pattern::new(dots.map(spindoe::Vec3::from).to_vec()).unwrap();
    pattern.write_csv(&dir.path().join("p.csv")).unwrap();
    let frames: serde_json::Value = serde_json::from_str(&done(dir.path(), &blind)).unwrap();
    assert_eq!(frames["orientation"]["successes"], 0);
    for name in ["mean_error_deg", "median_error_deg"] {
        assert!(frames[name].is_null(), "{frames}");
    }
}

#[test]
fn what_an_objective_assumes_follows_from_the_camera() {
    let assumed = |conditions: &CameraConditions| coverage(conditions, 20, &|_| ()).unwrap();
    let usual = assumed(&in_the_dark());
    let small = assumed(&CameraConditions {
        ball_px: 25.0,
        noise_levels: Some(8.0),
        ..in_the_dark()
    });
    // Of a small ball in noise dots are found only nearer to the middle.
    assert!(
        small.visibility_limit > usual.visibility_limit + 0.05,
        "{small:?} {usual:?}"
    );
    let dots = random_pattern(20, 1);
    let value = |c: &spindoe::design::objective::TooFewDots| c.evaluate(dots.dots()).value;
    assert!(value(&small) > value(&usual));
}

#[test]
fn sensitivity_and_simulation_take_a_camera() {
    let dir = tempfile::tempdir().unwrap();
    let at = dir.path();
    let pattern = random_pattern(16, 2);
    pattern.write_csv(&at.join("p.csv")).unwrap();
    std::fs::write(
        at.join("camera.toml"),
        "ball_px = 40\nfps = 200\nrps = [20, 30]\n",
    )
    .unwrap();
    let swept = [
        "validate",
        "p.csv",
        "--sweep=camera",
        "-o",
        "sweep",
        "--camera",
        "camera.toml",
    ];
    let frames = few_or_all(4, 40).to_string();
    let words = done(
        at,
        &[&swept[..], &["--samples", &frames, "--json"]].concat(),
    );
    let points: serde_json::Value = serde_json::from_str(&words).unwrap();
    let points = points["points"].as_array().unwrap();
    let value = |p: &serde_json::Value| (p["parameter"].to_string(), p["value"].as_f64().unwrap());
    // Half of 40 pixels is the least that is allowed, twice of it within.
    assert_eq!(value(&points[0]), ("\"ball_px\"".to_owned(), 20.0));
    assert_eq!(value(&points[4]), ("\"ball_px\"".to_owned(), 80.0));
    let right = |k: usize| points[k]["right"]["rate"].as_f64().unwrap();
    assert!(right(4) > right(0), "{points:?}");
    let csv = std::fs::read_to_string(at.join("sweep/sensitivity.csv")).unwrap();
    assert_eq!(csv.lines().count(), 1 + points.len());
    let output = spindoe(at, &[&swept[..], &["--protocol", "sparse"]].concat());
    assert_eq!(output.status.code(), Some(2));

    let simulated = [
        "synth",
        "p.csv",
        "--as=orientations",
        "-o",
        "s.csv",
        "--frames",
        "40",
        "--json",
    ];
    let words = done(at, &[&simulated[..], &["--camera", "camera.toml"]].concat());
    let truth: serde_json::Value = serde_json::from_str(&words).unwrap();
    let rps = truth["rps"].as_f64().unwrap();
    assert!((20.0..30.0).contains(&rps), "{truth}");
    // 40 frames at 200 a second end after 0.195 s.
    let last = std::fs::read_to_string(at.join("s.csv")).unwrap();
    let last: f64 = last
        .lines()
        .last()
        .unwrap()
        .split(',')
        .nth(1)
        .unwrap()
        .parse()
        .unwrap();
    assert!(last > 0.1 && last < 0.2, "{last}");
    let found = spindoe(at, &["spin", "s.csv", "--json"]);
    let found: serde_json::Value = serde_json::from_slice(&found.stdout).unwrap();
    assert!(
        (found["rps"].as_f64().unwrap() - rps).abs() < 1.0,
        "{found}"
    );
}

/// Of frames that are right with 0.8 and wrong with 0.05, off by errors of the mean square `s^2` where they are right, the effective error is
/// `s / sqrt(0.8 - 2 * 0.05)`: the 95 % interval holds it in 95 % of the samples.
#[test]
fn an_effective_errors_interval_holds_it_as_often_as_it_says() {
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(61);
    let (s, samples): (f64, usize) = (0.05, 400);
    let effective_deg = (s / 0.7f64.sqrt()).to_degrees();
    let mut held = 0;
    for _ in 0..samples {
        let outcome = |_| match rng.random::<f64>() {
            u if u < 0.8 => FrameOutcome::Answered {
                error_rad: s * (-(1.0 - rng.random::<f64>()).ln()).sqrt(),
            },
            u if u < 0.85 => FrameOutcome::Answered { error_rad: 1.0 },
            _ => FrameOutcome::Unanswered,
        };
        let outcomes: Vec<FrameOutcome> = (0..300).map(outcome).collect();
        let interval = FrameRates::of(&outcomes, 0).effective_error_interval_deg;
        let [low, high] = interval.expect("most are right");
        held += usize::from((low..high).contains(&effective_deg));
    }
    // 95 % of 400 are 380, with a deviation of 4.4.
    assert!((364..=395).contains(&held), "{held} of {samples}");
}
