//! Predictions without rendering: regressions against closed forms, observables against rendered
//! images, the shipped model against rendered frames that the estimator reads.

use nalgebra::{Matrix2, Vector2};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use spindoe::predict::regression::{Link, Regression, Scaling};
use spindoe::predict::{
    CameraConditions, DetectionModel, FrameOutcome, FrameRates, Predictor, Surroundings, coverage,
    shipped_designs,
};
use spindoe::synth::observables::{BALL_OBSERVABLES, DOT_OBSERVABLES};
use spindoe::synth::sensor::Sensor;
use spindoe::synth::{Scene, SynthConfig, dataset::frame_rng};
use spindoe::vision::net::graph::Head;
use spindoe::vision::net::weights::built_in_sha256;
use spindoe::vision::{Budget, DetectorName, Estimator, EstimatorConfig, FrameEstimate, Prior};

use crate::common::{done, random_pattern, spindoe};

/// Coefficients of a model of an intercept and one term, without the ridge's pull (some 1 in 1e5).
fn fitted(link: Link, rows: &[[f64; 2]], values: &[f64]) -> [f64; 2] {
    let terms: Vec<f64> = rows.concat();
    let fit = Regression::fit(link, &terms, values).unwrap();
    [fit.coefficients[0], fit.coefficients[1]]
}

#[test]
fn regressions_have_their_closed_forms() {
    // Two groups: the logit is that of their shares, the rate that of their means.
    let n = 40_000;
    let rows: Vec<[f64; 2]> = (0..n)
        .map(|i| [1.0, f64::from(u8::from(i % 2 == 0))])
        .collect();
    let share = |i: usize| {
        if i.is_multiple_of(2) {
            i % 10 < 6
        } else {
            i.is_multiple_of(5)
        }
    };
    let values: Vec<f64> = (0..n).map(|i| f64::from(u8::from(share(i)))).collect();
    let rate = |group: usize| {
        let of: Vec<f64> = values.iter().skip(group).step_by(2).copied().collect();
        of.iter().sum::<f64>() / of.len() as f64
    };
    let (even, odd) = (rate(0), rate(1));
    let logit = |p: f64| (p / (1.0 - p)).ln();
    let [b0, b1] = fitted(Link::Logit, &rows, &values);
    assert!((b0 - logit(odd)).abs() < 1e-3, "{b0} {odd}");
    assert!((b1 - (logit(even) - logit(odd))).abs() < 2e-3, "{b1}");
    let [b0, b1] = fitted(Link::Log, &rows, &values);
    assert!((b0 - odd.ln()).abs() < 1e-3 && (b1 - (even / odd).ln()).abs() < 2e-3);
    let [b0, b1] = fitted(Link::Identity, &rows, &values);
    assert!((b0 - odd).abs() < 1e-3 && (b1 - (even - odd)).abs() < 1e-3);
}

#[test]
fn a_smooth_function_is_learned_from_its_noisy_values() {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let truth = |x: f64, y: f64| 0.4 - x + 0.7 * x * y - 0.3 * y * y;
    let rows: Vec<f64> = (0..60_000).map(|_| rng.random_range(-1.0..1.0)).collect();
    let scaling = Scaling::of(&rows, 2).unwrap();
    let mut terms = vec![0.0; scaling.terms() * rows.len() / 2];
    let mut values = Vec::new();
    for (x, terms) in rows.chunks(2).zip(terms.chunks_mut(scaling.terms())) {
        scaling.expand(x, terms);
        let p = 1.0 / (1.0 + (-truth(x[0], x[1])).exp());
        values.push(f64::from(u8::from(rng.random::<f64>() < p)));
    }
    let fit = Regression::fit(Link::Logit, &terms, &values).unwrap();
    let mut row = vec![0.0; scaling.terms()];
    for (x, y) in [(0.0, 0.0), (0.5, -0.5), (-0.8, 0.8), (0.9, 0.2)] {
        scaling.expand(&[x, y], &mut row);
        assert!((fit.predictor(&row) - truth(x, y)).abs() < 0.12);
    }
    // Beyond what was seen, the border's value holds.
    let mut far = vec![0.0; scaling.terms()];
    scaling.expand(&[5.0, 0.0], &mut far);
    scaling.expand(&[scaling.domain[0][1], 0.0], &mut row);
    assert_eq!(far, row);
    assert!(!scaling.contains(&[5.0, 0.0]));
    // Rows that do not fit, and what is no number.
    assert!(Regression::fit(Link::Logit, &terms[1..], &values).is_err());
    assert!(Regression::fit(Link::Identity, &[1.0], &[f64::NAN]).is_err());
}

#[test]
fn observables_are_what_the_image_shows() {
    // A sensor without faults: contrast and brightness can be read off the pixels.
    let pattern = random_pattern(20, 4);
    let config = SynthConfig {
        ball_px: Some([300.0; 2]),
        size_px: [300, 400],
        logo_probability: 0.0,
        seam_probability: 0.0,
        stains: false,
        max_gloss: 0.0,
        max_streaks: 0.0,
        rps: [0.0; 2],
        max_shift_px: 0.0,
        max_arc_rad: 0.0,
        ..SynthConfig::good()
    };
    let mut seen_dots = 0;
    for k in 0..6 {
        let mut scene = Scene::random(&pattern, &config, &mut frame_rng(8, k)).unwrap();
        scene.sensor = Sensor {
            gain: scene.sensor.gain.min(1.0),
            ..Sensor::PERFECT
        };
        let ball = scene.seen().unwrap();
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
            let [_, facing, _, contrast, _, brightness, ..] = dot.observables;
            let shown = (around - value(at.u, at.v)) / around;
            assert_eq!(facing, dot.truth.facing);
            assert!((brightness - around).abs() < 0.06, "{brightness} {around}");
            assert!((contrast - shown).abs() < 0.1, "{contrast} {shown}");
            seen_dots += 1;
        }
    }
    assert!(seen_dots > 10, "{seen_dots}");
}

#[test]
fn the_shipped_model_belongs_to_the_shipped_weights() {
    let model = DetectionModel::shipped().unwrap();
    let of = &model.provenance;
    assert_eq!(of.weights_sha256, built_in_sha256(Head::Dots));
    assert_eq!(of.large_sha256, built_in_sha256(Head::DotsLarge));
    assert_eq!(of.outline_sha256, built_in_sha256(Head::Outline));
    assert_eq!(model.dot_names, DOT_OBSERVABLES);
    assert_eq!(model.ball_names, BALL_OBSERVABLES);
    // As a file it reads back, and what is no model is refused in words.
    let text = model.to_json().unwrap();
    assert_eq!(DetectionModel::from_json(&text).unwrap(), model);
    let refused = |text: &str| DetectionModel::from_json(text).unwrap_err();
    let version = format!("\"version\":{}", model.version);
    assert!(refused(&text.replace(&version, "\"version\":999")).contains("version"));
    assert!(refused(&text.replace("facing", "phasing")).contains("covariates"));
    assert!(refused(&text[..text.len() / 2]).contains("EOF"));
    let mut unlikely = model.clone();
    unlikely.second_look.false_dots[0] = [0.9, 0.2];
    assert!(refused(&unlikely.to_json().unwrap()).contains("coefficient"));
    let mut short = model;
    short.likely.coefficients.pop();
    assert!(refused(&short.to_json().unwrap()).contains("coefficient"));
}

#[test]
fn errors_of_drawn_detections_have_the_learned_size() {
    // Over many draws of one scene: dots at their true places on average, spread as stated times
    // the learned error.
    let model = DetectionModel::shipped().unwrap();
    let pattern = random_pattern(20, 5);
    let scene = CameraConditions::default().scene(&pattern, 3, 1).unwrap();
    let ball = scene.seen().unwrap();
    let dot = ball
        .dots
        .iter()
        .filter(|d| d.truth.is_visible())
        .max_by(|a, b| a.truth.facing.total_cmp(&b.truth.facing))
        .unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let (mut terms, mut offs) = (Default::default(), Vec::new());
    let mut outline = Vec::new();
    for _ in 0..2000 {
        let Some(detected) = model.detect(&ball, None, &mut terms, &mut rng) else {
            continue;
        };
        let frame = detected.frame;
        let circle = frame.outline.unwrap().circle;
        outline.push(circle.radius / ball.circle.radius - 1.0);
        let near = frame
            .dots
            .iter()
            .find(|d| (d.pixel.u - dot.truth.pixel.u).hypot(d.pixel.v - dot.truth.pixel.v) < 3.0);
        offs.extend(near.map(|d| {
            let off = Vector2::new(d.pixel.u - dot.truth.pixel.u, d.pixel.v - dot.truth.pixel.v);
            (off, d.covariance)
        }));
    }
    assert!(offs.len() > 1500, "{}", offs.len());
    let n = offs.len() as f64;
    let mean = offs.iter().map(|o| o.0).sum::<Vector2<f64>>() / n;
    assert!(mean.norm() < 0.05, "{mean}");
    let chi2 = |(off, s): &(Vector2<f64>, Matrix2<f64>)| off.dot(&(s.try_inverse().unwrap() * off));
    let mut squares: Vec<f64> = offs.iter().map(chi2).collect();
    squares.sort_by(f64::total_cmp);
    // The detector's covariances are calibrated: chi-square's median with two degrees is 1.39.
    let median = squares[squares.len() / 2];
    assert!((0.4..3.0).contains(&median), "{median}");
    let spread = (outline.iter().map(|x| x * x).sum::<f64>() / outline.len() as f64).sqrt();
    assert!(spread < 0.03, "{spread}");
}

#[test]
fn predictions_agree_with_rendered_frames() {
    let designs = shipped_designs().unwrap();
    let pattern = &designs.iter().find(|d| d.name == "dots20").unwrap().pattern;
    let model = DetectionModel::shipped().unwrap();
    let predictor = Predictor::new(&model, pattern, EstimatorConfig::default()).unwrap();
    let detector = DetectorName::Cnn.build().unwrap();
    let estimator = Estimator::new(pattern, EstimatorConfig::default(), detector).unwrap();
    let (mut ws, mut found) = (estimator.workspace(), FrameEstimate::default());
    for surroundings in Surroundings::ALL {
        let conditions = CameraConditions {
            ball_px: 40.0,
            surroundings,
            ..CameraConditions::default()
        };
        let rendered: Vec<FrameOutcome> = (0..150)
            .map(|k| {
                let scene = conditions.scene(pattern, 77, k).unwrap();
                let rendering = scene.render().unwrap();
                estimator.estimate(
                    &rendering.image,
                    &Prior::default(),
                    &Budget::default(),
                    &mut ws,
                    &mut found,
                );
                FrameOutcome::of(&found, &rendering.rotation)
            })
            .collect();
        let rendered = FrameRates::of(&rendered);
        let predicted = predictor.frames(&conditions, 78, 600).unwrap().rates;
        let overlaps = predicted.right.low <= rendered.right.high
            && rendered.right.low <= predicted.right.high;
        let words = format!("{surroundings:?}: {rendered:?}\n{predicted:?}");
        assert!(overlaps, "{words}");
        let ratio = predicted.mean_error_deg / rendered.mean_error_deg;
        assert!((0.75..1.33).contains(&ratio), "{words}");
    }
}

#[test]
fn better_cameras_are_predicted_to_do_better() {
    let designs = shipped_designs().unwrap();
    let model = DetectionModel::shipped().unwrap();
    let predictor =
        Predictor::new(&model, &designs[2].pattern, EstimatorConfig::default()).unwrap();
    let right = |conditions: &CameraConditions| {
        let rates = predictor.frames(conditions, 5, 400).unwrap().rates;
        (rates.right.rate, rates.mean_error_deg)
    };
    let usual = CameraConditions::default();
    let far = CameraConditions {
        ball_px: 25.0,
        ..usual
    };
    let blurred = CameraConditions {
        exposure_s: 2e-3,
        rps: [80.0, 100.0],
        ..usual
    };
    let (good, error) = right(&usual);
    assert!(good > right(&far).0 && error < right(&far).1);
    assert!(good > right(&blurred).0 + 0.1);
    // The same seed gives the same frames, on any number of threads.
    let one = rayon_pool(1, || predictor.frames(&usual, 5, 300).unwrap());
    assert_eq!(
        one,
        rayon_pool(3, || predictor.frames(&usual, 5, 300).unwrap())
    );
}

fn rayon_pool<T: Send>(threads: usize, work: impl FnOnce() -> T + Send) -> T {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    pool.unwrap().install(work)
}

#[test]
fn spins_of_sequences_come_with_their_errors() {
    let designs = shipped_designs().unwrap();
    let model = DetectionModel::shipped().unwrap();
    let predictor =
        Predictor::new(&model, &designs[2].pattern, EstimatorConfig::default()).unwrap();
    let slow = CameraConditions {
        rps: [20.0, 60.0],
        ..CameraConditions::default()
    };
    let short = predictor.spins(&slow, 9, 24, 6).unwrap();
    let long = predictor.spins(&slow, 9, 24, 24).unwrap();
    assert!(
        short.right.rate > 0.8 && long.right.rate > 0.9,
        "{short:?}\n{long:?}"
    );
    assert!(long.median_magnitude_error_rps < short.median_magnitude_error_rps);
    assert!(predictor.spins(&slow, 9, 24, 1).is_err());
}

#[test]
fn the_command_advises_and_names_what_it_cannot_use() {
    let dir = tempfile::tempdir().unwrap();
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
            "--frames",
            "100",
            "--sequences",
            "4",
            "--json",
        ],
    );
    let advice: serde_json::Value = serde_json::from_str(&words).unwrap();
    assert_eq!(advice["conditions"]["ball_px"], 45.0);
    assert_eq!(advice["conditions"]["exposure_s"], 2e-4);
    let shipped = shipped_designs().unwrap().len();
    assert_eq!(advice["patterns"].as_array().unwrap().len(), shipped);
    let errors: Vec<f64> = advice["patterns"]
        .as_array()
        .unwrap()
        .iter()
        .map(|p| p["effective_error_deg"].as_f64().unwrap())
        .collect();
    assert!(errors.is_sorted(), "{errors:?}");
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
        ("", &["--rps", "5"], "--rps: expected MIN,MAX"),
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
fn what_an_objective_assumes_follows_from_the_camera() {
    let model = DetectionModel::shipped().unwrap();
    let assumed = |conditions: &CameraConditions| coverage(&model, conditions, 20).unwrap();
    let usual = assumed(&CameraConditions::default());
    let small = assumed(&CameraConditions {
        ball_px: 25.0,
        noise_levels: Some(8.0),
        ..CameraConditions::default()
    });
    // Of a small ball in noise dots are found only nearer to the middle.
    assert!(
        small.visibility_limit > usual.visibility_limit + 0.05,
        "{small:?} {usual:?}"
    );
    let dots = random_pattern(20, 1);
    let value = |c: &spindoe::design::objective::Coverage| c.evaluate(dots.dots()).value;
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
        "sensitivity",
        "p.csv",
        "-o",
        "sweep",
        "--camera",
        "camera.toml",
    ];
    let words = done(at, &[&swept[..], &["--samples", "40", "--json"]].concat());
    let points: serde_json::Value = serde_json::from_str(&words).unwrap();
    let points = points.as_array().unwrap();
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
        "simulate",
        "-o",
        "s.csv",
        "--pattern",
        "p.csv",
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
