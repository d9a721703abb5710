//! The robust estimator's promise: no allocation once it has seen a sequence as long, where nothing speaks against its times.

use spindoe::spin::robust::{RobustEstimator, SpinConfig};
use spindoe::spin::shared::SharedError;
use spindoe::spin::simulate::{Scenario, SimulatedSequence};

#[test]
fn a_warm_estimator_does_not_allocate() {
    let scenario = Scenario {
        outliers: 0.3,
        ..Scenario::default()
    };
    let answered = |s: &SimulatedSequence| {
        let mut estimator = RobustEstimator::new(SpinConfig::default());
        estimator.fit(&s.measurements).is_ok()
    };
    let sequences: Vec<_> = (0..200)
        .map(|i| scenario.sequence((1.0, 170.0), 51, i))
        .filter(answered)
        .collect();
    assert!(sequences.len() > 190, "{}", sequences.len());
    let mut estimator = RobustEstimator::new(SpinConfig {
        shared: SharedError::of_residuals([0.03; 10].into_iter()),
        ..SpinConfig::default()
    });
    let cold = allocation_counter::measure(|| {
        let _ = estimator.fit(&sequences[0].measurements);
    });
    assert!(cold.count_total > 0, "the counter does not count");
    let warm = allocation_counter::measure(|| {
        for sequence in &sequences {
            let _ = std::hint::black_box(estimator.fit(&sequence.measurements));
        }
    });
    assert_eq!(warm.count_total, 0);
}
