//! A spin is believed only where the frames believe it, and lies of the clock are named: a sample of what `bench spin-lies` measures.

use spindoe::spin::Measurement;
use spindoe::spin::simulate::stream;

use super::lies::{Fate, Judged, LIES, NOISE_DEG, TRUTHS, judge, turning};

const CLIPS: u64 = 40;

fn clips(make: super::lies::Maker, seed: u64) -> Vec<Judged> {
    (0..CLIPS)
        .map(|i| judge(&make(&mut stream(seed, i))))
        .collect()
}

#[test]
fn true_clips_are_answered_without_a_word_of_their_times() {
    for (number, (name, make)) in TRUTHS.iter().enumerate() {
        let is_altered = ["two frames swapped", "one frame twice", "one frame lost"].contains(name);
        for (i, judged) in clips(*make, 300 + number as u64).iter().enumerate() {
            assert_eq!(judged.fate, Fate::Right, "{name} {i}: {}", judged.words);
            assert!(judged.error < 0.3, "{name} {i}: {}", judged.words);
            assert!(
                is_altered || !judged.told.anything(),
                "{name} {i}: {}",
                judged.words
            );
        }
    }
}

#[test]
fn no_lie_gives_a_wrong_spin_without_a_word() {
    for (number, (name, make, is_named)) in LIES.iter().enumerate() {
        let judged = clips(*make, 400 + number as u64);
        for (i, judged) in judged.iter().enumerate() {
            let is_wrong = judged.fate == Fate::Wrong && !judged.told.anything();
            assert!(!is_wrong, "{name} {i}: {}", judged.words);
        }
        let named = judged.iter().filter(|j| is_named(&j.told)).count();
        assert!(named as f64 >= 0.8 * CLIPS as f64, "{name}: {named} named");
    }
}

#[test]
fn a_clip_that_was_brought_to_a_higher_rate_keeps_its_spin() {
    // 200 frames per second shown as 240: some images twice, the others up to an interval late.
    for (i, rps) in [2.0, 8.0, 30.0, 60.0].into_iter().enumerate() {
        let taken: Vec<f64> = (0..48).map(|k| f64::from(k) / 200.0).collect();
        let mut clip = turning(&mut stream(500, i as u64), rps, NOISE_DEG, &taken);
        let shown = (0..57).map(|k| Measurement {
            time_s: k as f64 / 240.0,
            ..clip.measurements[k * 200 / 240]
        });
        clip.measurements = shown.collect();
        let judged = judge(&clip);
        assert_eq!(judged.fate, Fate::Right, "{}", judged.words);
        assert!(
            judged.error < 0.01 && judged.told.repeated,
            "{}",
            judged.words
        );
    }
}

#[test]
fn a_video_that_was_brought_to_a_lower_rate_keeps_its_duration() {
    use spindoe::spin::estimate::{MotionModel, SpinEstimate};
    use spindoe::spin::robust::{SpinConfig, TimeOrigin};

    // Images are left out so that the rest can be shown at even times: the steps between them are of one interval or two.
    let rates = [(25.0, 20.0, 0.6), (30.0, 24.0, 1.0), (240.0, 200.0, 8.0)];
    for (i, (from, to, rps)) in rates.into_iter().enumerate() {
        let times: Vec<f64> = (0..40).map(|k| f64::from(k) / from).collect();
        let clip = turning(&mut stream(501, i as u64), rps, NOISE_DEG, &times);
        let shown = (0..32).map(|j| f64::from(j) / to);
        let measurements: Vec<Measurement> = shown
            .map(|time_s| Measurement {
                time_s,
                ..clip.measurements[(time_s * from).round() as usize]
            })
            .collect();
        let config = SpinConfig {
            times: TimeOrigin::Video,
            ..SpinConfig::default()
        };
        let found = SpinEstimate::fit(&measurements, MotionModel::Auto, &config).unwrap();
        let (spin, expected) = (found.at(found.middle_s()).motion.spin, clip.spin);
        let what = format!("{from} {to}: {spin} {expected} {:?}", found.clock);
        assert!((spin - expected).norm() < 0.01 * expected.norm(), "{what}");
        let ratio = found.clock.rate_ratio.unwrap_or_default();
        assert!((ratio * to / from - 1.0).abs() < 0.01, "{what}");
    }
}
