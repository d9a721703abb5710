//! What a view model draws, against its closed forms.

use nalgebra::Matrix2;
use spindoe::geometry::angle_between;
use spindoe::validate::Trials;
use spindoe::view::{Detection, DotUncertainty, FalseDots, Noise, Trial, ViewModel};

#[test]
fn trials_are_what_the_model_says() {
    let pattern = crate::common::dots20();
    let (limit, probability, scale) = (0.2, 0.7, 2.0);
    let sigma = 2f64.to_radians();
    let view = ViewModel {
        visibility_limit: limit,
        noise: Noise::HeavyTailed { sigma_rad: sigma },
        noise_scale: scale,
        detection: Detection::Each { probability },
        false_dots: FalseDots::Usual(2),
        false_dot_limit: 0.1,
        ..ViewModel::default()
    };
    let trials = Trials::first(&pattern, view, 20_261_208, 4000);
    let mut generator = trials.generator();
    let mut trial = Trial::default();
    let (mut visible, mut detected, mut squares) = (0.0, 0.0, 0.0);
    for index in trials.range {
        generator.generate(index, &mut trial);
        let places = pattern.dots().iter().map(|d| trial.rotation * d);
        visible += places.filter(|q| q.z > limit).count() as f64;
        let mut false_dots = 0;
        for (dot, name) in trial.dots.iter().zip(&trial.truth) {
            match name {
                Some(j) => {
                    let place = trial.rotation * pattern.dots()[usize::from(*j)];
                    assert!(place.z > limit, "a hidden dot is seen");
                    detected += 1.0;
                    squares += angle_between(&place, &dot.direction).powi(2);
                }
                None => {
                    false_dots += 1;
                    assert!(dot.direction.z >= 0.1, "{}", dot.direction);
                }
            }
        }
        assert_eq!(false_dots, 2);
    }
    let rate: f64 = detected / visible;
    let deviation = (probability * (1.0 - probability) / visible).sqrt();
    assert!((rate - probability).abs() < 4.0 * deviation, "{rate}");
    // Over both tangent axes; one dot in ten is drawn twice as wide.
    let expected = 2.0 * (0.9 + 0.1 * 4.0) * (scale * sigma).powi(2);
    let found: f64 = squares / detected;
    assert!(
        (found / expected - 1.0).abs() < 0.03,
        "{found} of {expected}"
    );
}

/// Independent errors add their variances: 3, 4, 5.
#[test]
fn further_errors_of_a_dot_add_their_variances() {
    let wider = DotUncertainty::Isotropic { sigma_rad: 0.03 }.widened(0.04);
    let DotUncertainty::Isotropic { sigma_rad } = wider else {
        panic!("{wider:?}");
    };
    assert!((sigma_rad - 0.05).abs() < 1e-15, "{sigma_rad}");
    let covariance = Matrix2::new(9e-4, 2e-4, 2e-4, 1e-4);
    let wider = DotUncertainty::Tangent { covariance }.widened(0.04);
    let DotUncertainty::Tangent { covariance } = wider else {
        panic!("{wider:?}");
    };
    let expected = Matrix2::new(25e-4, 2e-4, 2e-4, 17e-4);
    assert!((covariance - expected).amax() < 1e-15, "{covariance}");
}
