//! Dots that are added to a ball that is drawn: those on it stay, the others keep what is demanded of them.

use std::sync::atomic::AtomicBool;

use serde_json::Value;
use spindoe::design::descent::descend;
use spindoe::design::{
    Constraints, DesignRequest, DesignViews, KeepOut, Objective, SearchState, design,
};
use spindoe::geometry::{Vec3, angle_between};
use spindoe::pattern::Pattern;
use spindoe::stats::Proportion;
use spindoe::validate::{Validation, ValidationConfig};
use spindoe::view::{Protocol, ProtocolName};
use spindoe::{Ball, RobustRecognizer};

use crate::common::{done, refused, spread_pattern};

/// A ball of eight dots as a hand draws them: two of them are ten degrees apart, nearer than any design has them.
fn drawn(seed: u64) -> Pattern {
    let mut dots = spread_pattern(7, 0.6, seed).dots().to_vec();
    let aside = dots[0].cross(&dots[1]).normalize();
    dots.push((dots[0] + 10f64.to_radians().tan() * aside).normalize());
    Pattern::new(dots).unwrap()
}

/// Right orientations of all views of protocol `clutter`, on trials that no design has drawn.
fn right(pattern: &Pattern, seed: u64, samples: u64) -> Proportion {
    let config = ValidationConfig {
        protocol: Protocol::standard(ProtocolName::Clutter),
        seed,
        samples,
        ..ValidationConfig::default()
    };
    let trials = config.trials(pattern);
    let recognizer = RobustRecognizer::new(pattern, trials.view.into()).unwrap();
    let found = trials.run(&recognizer, &|_| {}).unwrap();
    Validation::of(&found, ProtocolName::Clutter, &trials).answered
}

/// Asserts that dots from number `drawn` on keep their separation from all others.
fn assert_apart(dots: &[Vec3], drawn: usize, separation_rad: f64) {
    for i in drawn..dots.len() {
        for j in 0..i {
            let found = angle_between(&dots[i], &dots[j]);
            assert!(found > separation_rad - 1e-3, "{i} {j}: {found}");
        }
    }
}

#[test]
fn a_descent_leaves_drawn_dots_and_goes_down() {
    for seed in 0..3 {
        let drawn = drawn(seed);
        let cone = KeepOut {
            axis: -drawn.dots()[0],
            half_angle_rad: 0.3,
        };
        let constraints = Constraints {
            min_visible: 0,
            seam_margin_rad: 0.0,
            keep_out: vec![cone],
            drawn: 8,
            ..Constraints::default()
        };
        // Two added dots in the cone, and too near to each other.
        let beside = |x: f64| (cone.axis + Vec3::new(x, 0.07, -x)).normalize();
        let dots = drawn
            .dots()
            .iter()
            .copied()
            .chain([0.05, -0.06].map(beside));
        let start = Pattern::new(dots.collect()).unwrap();
        assert!(constraints.missed(&start).is_some());
        let found = descend(&start, &Objective::default(), &constraints, 60).unwrap();
        assert_eq!(found.dots()[..8], drawn.dots()[..]);
        assert_eq!(constraints.missed(&found), None);
        assert_apart(found.dots(), 8, constraints.min_separation_rad);
        for dot in &found.dots()[8..] {
            assert!(angle_between(dot, &cone.axis) > cone.half_angle_rad - 1e-3);
        }
        // From there on only the cost counts: elsewhere it is lower than where they would be by the way.
        let cost = |p: &Pattern| Objective::default().cost(p.dots()).unwrap().value;
        let near = descend(&start, &Objective::default(), &constraints, 4).unwrap();
        assert!(cost(&found) <= cost(&near), "seed {seed}");
    }
}

#[test]
fn added_dots_raise_the_share_of_right_views() {
    let drawn = drawn(21);
    let request = DesignRequest {
        pattern: Some(drawn.clone()),
        add: 2,
        starts: 8,
        scout_steps: 6,
        climb_steps: 20,
        samples: 300,
        protocol: DesignViews::Clutter,
        ..DesignRequest::default()
    };
    let config = request.config().unwrap();
    let run = || {
        design(
            &config,
            &mut SearchState::default(),
            &AtomicBool::new(false),
            &mut (),
        )
    };
    let best = run().unwrap().best;
    assert_eq!(best, run().unwrap().best);
    let found = best.pattern().unwrap();
    assert_eq!(found.dots()[..8], drawn.dots()[..]);
    assert_apart(found.dots(), 8, config.constraints.min_separation_rad);
    // As the guide asks: a dot's width of bare ball, 4 mm on 40 mm, beside each dot that a hand adds.
    assert_apart(found.dots(), 8, 4.0 * 0.1_f64.asin());
    let [before, after] = [&drawn, &found].map(|pattern| right(pattern, 77, 1500));
    assert!(after.low > before.high, "{before} {after}");
}

#[test]
fn what_cannot_be_added_is_refused() {
    let refused = |add: usize, change: fn(&mut DesignRequest)| {
        let mut request = DesignRequest {
            pattern: Some(drawn(1)),
            add,
            ..DesignRequest::default()
        };
        change(&mut request);
        let found = request.config().and_then(|config| {
            let (mut state, never) = (SearchState::default(), AtomicBool::new(false));
            design(&config, &mut state, &never, &mut ())
        });
        found.unwrap_err().to_string()
    };
    for (words, needle) in [
        (refused(57, |_| {}), "dots: expected 4 to 64, found 65"),
        (refused(2, |r| r.pattern = None), "add: expected a pattern"),
        (
            refused(2, |r| r.seam_margin_rad = Some(0.1)),
            "seam_margin_rad",
        ),
        (
            refused(24, |r| r.min_separation_rad = Some(0.9)),
            "24 more dots at least 51.6 degrees from all others do not fit",
        ),
        (
            refused(2, |r| {
                let axis = r.pattern.as_ref().unwrap().dots()[3];
                r.keep_out = vec![KeepOut {
                    axis,
                    half_angle_rad: 0.4,
                }];
            }),
            "dot 3 lies in zone 0",
        ),
    ] {
        assert!(words.contains(needle), "{words}");
    }
}

#[test]
fn a_folder_says_where_to_draw_them() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    let drawn = drawn(5);
    drawn.write_csv(&dir.join("ball.csv")).unwrap();
    let design = "design ball.csv --add 2 -o more --samples 100 --config starts=4 --config scout_steps=3 \
                  --config climb_steps=5";
    let words = done(dir, &design.split_whitespace().collect::<Vec<_>>());
    assert!(
        words.contains("dot 8: ") && words.contains("dot 9: "),
        "{words}"
    );
    let ball = Ball::read(&dir.join("more")).unwrap();
    assert_eq!(ball.pattern().dots()[..8], drawn.dots()[..]);
    for file in ["added.png", "table.npz", "report.html"] {
        assert!(dir.join("more").join(file).is_file(), "{file}");
    }
    let read = |name: &str| -> Value {
        let text = std::fs::read_to_string(dir.join(name).join("report.json")).unwrap();
        serde_json::from_str(&text).unwrap()
    };
    let report = read("more");
    assert_eq!(report["before"].as_array().unwrap().len(), 4);
    for (number, place) in (8..).zip(report["added"].as_array().unwrap()) {
        assert_eq!(place["number"], number);
        let dot = ball.pattern().dots()[number];
        for from in place["from"].as_array().unwrap() {
            let other = drawn.dots()[from[0].as_u64().unwrap() as usize];
            let mm = 20.0 * (other - dot).norm();
            assert!((from[1].as_f64().unwrap() - mm).abs() < 1e-9);
        }
    }
    // The command in the report makes the same ball.
    let command = report["command"].as_str().unwrap().replace("spindoe ", "");
    let again: Vec<&str> = command.split_whitespace().chain(["-o", "again"]).collect();
    done(dir, &again);
    assert_eq!(read("again")["pattern"], report["pattern"]);
    refused(dir, &["design", "--add", "2"], 2, "PATTERN");
}
