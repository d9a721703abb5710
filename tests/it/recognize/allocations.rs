//! The robust recognizer's loop allocates nothing once its workspace exists.

use spindoe::recognize::robust::{RobustConfig, RobustRecognizer};
use spindoe::recognize::{Identification, Recognizer};
use spindoe::validate::{Protocol, ProtocolName, Trial, TrialGenerator};

/// Allocations during `views` identifications, the first of them included.
fn allocations(protocol: &Protocol, config: RobustConfig, views: u64) -> u64 {
    let pattern = crate::common::random_pattern(20, 7);
    let recognizer = RobustRecognizer::new(&pattern, config).expect("valid parameters");
    let mut generator = TrialGenerator::new(&pattern, *protocol, 5);
    let mut trial = Trial::default();
    let mut workspace = recognizer.workspace();
    let mut answer = Identification::default();
    answer.assignment.reserve(64);
    let mut total = 0;
    for index in 0..views {
        generator.generate(index, &mut trial);
        let measured = allocation_counter::measure(|| {
            let _ = recognizer.identify_into(&trial.dots, &mut workspace, &mut answer);
        });
        total += measured.count_total;
    }
    total
}

#[test]
fn the_counter_counts() {
    let measured = allocation_counter::measure(|| {
        std::hint::black_box(Box::new(1));
    });
    assert_eq!(measured.count_total, 1);
}

#[test]
fn no_protocol_makes_the_loop_allocate() {
    for name in ProtocolName::ALL {
        let protocol = Protocol::standard(name);
        let found = allocations(&protocol, protocol.recognizer_config(), 400);
        assert_eq!(found, 0, "{name}");
    }
}

#[test]
fn nor_do_views_of_nothing_that_it_knows() {
    // Many false dots: the search runs to its end, and fills whatever it keeps.
    let protocol = Protocol {
        miss_probability: 0.9,
        false_dots: 25,
        ..Protocol::standard(ProtocolName::Clutter)
    };
    assert_eq!(allocations(&protocol, protocol.recognizer_config(), 20), 0);
}
