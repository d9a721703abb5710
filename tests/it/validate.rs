//! The Monte Carlo loop: what it counts, and that it repeats itself.

use spindoe::ball::Ball;
use spindoe::pattern::Pattern;
use spindoe::recognize::RecognizerName;
use spindoe::recognize::observed::observed_frames;
use spindoe::recognize::robust::RobustRecognizer;
use spindoe::validate::{SensitivityConfig, TrialResult, Trials, Validation, sensitivity};
use spindoe::view::{Protocol, ProtocolName, Trial};

fn random_pattern(n: usize, seed: u64) -> Pattern {
    crate::common::spread_pattern(n, 0.0, seed)
}

/// The robust recognizer's successes on trials of a protocol.
fn validate(trials: &Trials<'_>, name: ProtocolName) -> spindoe::Result<Validation> {
    let recognizer = RobustRecognizer::new(trials.pattern, name.view().into())?;
    let results = trials.run(&recognizer, &|_| {})?;
    Ok(Validation::of(&results, name, trials))
}

#[test]
fn same_seed_same_result_on_any_number_of_threads() {
    let pattern = random_pattern(20, 3);
    for name in ProtocolName::ALL {
        let trials = Trials::first(&pattern, name.view(), 5, 300);
        let run = |threads| {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .expect("pool");
            pool.install(|| validate(&trials, name))
                .expect("valid")
                .untimed()
        };
        assert_eq!(run(1), run(3), "{name}");
    }
}

#[test]
fn without_noise_every_view_is_identified() {
    let pattern = random_pattern(20, 4);
    let name = ProtocolName::Paper;
    let trials = Trials::first(&pattern, name.view().with_sigma_rad(0.0), 1, 500);
    let v = validate(&trials, name).expect("valid");
    assert_eq!(v.identity.successes, v.identity.trials);
    assert!(v.mean_error_deg < 0.01, "{}", v.mean_error_deg);
}

#[test]
fn views_with_too_few_dots_are_counted_apart() {
    // Four dots on one side: from the other side nothing is seen.
    let pattern = four_dots();
    let name = ProtocolName::Sparse;
    let trials = Trials::first(&pattern, name.view(), 1, 1000);
    let v = validate(&trials, name).expect("valid");
    assert!(v.skipped > 500);
    assert_eq!(v.skipped + v.identity.trials, v.samples);
    // They are failures of the pattern.
    assert_eq!(v.answered.trials, v.samples);
    assert_eq!(v.answered.successes, v.orientation.successes);
    assert!(v.answered.high < 0.5 && v.orientation.low > 0.9, "{v:?}");
    // Without a right answer there is no error, and JSON says null.
    let none = Validation::of(&[TrialResult::Skipped; 3], name, &trials);
    assert!(none.mean_error_deg.is_nan() && none.median_error_deg.is_nan());
    let json = serde_json::to_value(&none).expect("JSON");
    assert!(json["mean_error_deg"].is_null() && json["answered"]["rate"] == 0.0);
}

#[test]
fn false_dots_make_no_view_of_too_few_real_ones() {
    // From behind, the two false dots and at most one of the pattern's are seen.
    let pattern = four_dots();
    let name = ProtocolName::Clutter;
    let trials = Trials::first(&pattern, name.view(), 3, 1000);
    let mut generator = trials.generator();
    let mut trial = Trial::default();
    let mut too_few = 0;
    for index in trials.range.clone() {
        generator.generate(index, &mut trial);
        assert!(trial.real_dots() + 2 == trial.dots.len());
        too_few += u64::from(trial.real_dots() < 3);
    }
    assert!(too_few > 400, "{too_few}");
    let v = validate(&trials, name).expect("valid");
    assert_eq!(v.skipped, too_few);
    let frames = observed_frames(&pattern, &trials.view, 3, 1000);
    assert_eq!(frames.len() as u64, 1000 - too_few);
}

fn four_dots() -> Pattern {
    let csv = b"x,y,z\n0,0,1\n0,0.6,0.8\n0.6,0,0.8\n-0.28,0,0.96\n";
    Pattern::from_csv(std::path::Path::new("four.csv"), csv).expect("pattern")
}

#[test]
fn no_trials_are_refused() {
    let pattern = random_pattern(8, 1);
    let name = ProtocolName::Paper;
    assert!(validate(&Trials::first(&pattern, name.view(), 1, 0), name).is_err());
    let wrong = name.view().with_sigma_rad(-1.0);
    assert!(validate(&Trials::first(&pattern, wrong, 1, 10), name).is_err());
}

/// A point of a sweep is a validation of the same views with noise of so many degrees on either axis.
#[test]
fn a_sweep_is_of_the_noise_that_it_states() {
    let ball = Ball::new(random_pattern(16, 5));
    let config = SensitivityConfig {
        recognizers: vec![RecognizerName::Robust],
        sigmas_deg: vec![4.0, 12.0],
        alphas: Vec::new(),
        samples: 200,
        seed: 9,
    };
    let protocol = Protocol::standard(ProtocolName::Sparse);
    let swept = sensitivity(&ball, &protocol, &config, None, &mut |_| Ok(())).expect("a sweep");
    assert_eq!(swept.len(), 2);
    for (point, sigma_deg) in swept.iter().zip([4.0f64, 12.0]) {
        assert_eq!(point.value, sigma_deg);
        let view = ProtocolName::Sparse
            .view()
            .with_sigma_rad(sigma_deg.to_radians());
        let trials = Trials::first(ball.pattern(), view, 9, 200);
        let recognizer = RobustRecognizer::new(ball.pattern(), view.into()).expect("a recognizer");
        let results = trials.run(&recognizer, &|_| {}).expect("trials");
        let own = Validation::of(&results, ProtocolName::Sparse, &trials).untimed();
        assert_eq!(point.result.validation.clone().untimed(), own);
    }
}
