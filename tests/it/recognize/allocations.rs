//! The robust recognizer's loop allocates nothing once its workspace exists.

use spindoe::Trials;
use spindoe::recognize::Recognizer;
use spindoe::recognize::robust::RobustRecognizer;
use spindoe::view::{Detection, FalseDots, ProtocolName, Trial, ViewModel};

/// Allocations during `views` identifications, the first of them included.
fn allocations(view: ViewModel, views: u64) -> u64 {
    let pattern = crate::common::random_pattern(20, 7);
    let recognizer = RobustRecognizer::new(&pattern, view.into()).expect("valid parameters");
    let trials = Trials::first(&pattern, view, 5, views);
    let mut generator = trials.generator();
    let mut trial = Trial::default();
    let mut workspace = recognizer.workspace();
    let mut total = 0;
    for index in trials.range {
        generator.generate(index, &mut trial);
        let measured = allocation_counter::measure(|| {
            let _ = recognizer.explain(&trial.dots, None, &mut workspace);
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
        assert_eq!(allocations(name.view(), 400), 0, "{name}");
    }
}

#[test]
fn nor_do_views_of_nothing_that_it_knows() {
    // Many false dots: the search runs to its end, and fills whatever it keeps.
    let view = ViewModel {
        detection: Detection::Each { probability: 0.1 },
        false_dots: FalseDots::Usual(25),
        ..ProtocolName::Clutter.view()
    };
    assert_eq!(allocations(view, 20), 0);
}
