//! A spin is believed only where the frames believe it, and lies of the clock are named: a sample of what `bench spin-lies` measures.

use spindoe::spin::simulate::stream;

use super::lies::{Fate, Judged, LIES, TRUTHS, judge};

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
