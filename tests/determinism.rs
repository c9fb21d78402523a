//! Same input, same digits: on one core and on many.

mod rendered;

use rendered::{measure, small_box};
use tiepoint::network::Network;
use tiepoint::synthetic::CrossPlan;

fn with_threads(threads: usize) -> Network {
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .expect("a pool of threads");
    pool.install(|| {
        let rendered = small_box(51, Some(CrossPlan::default()));
        measure(rendered.network, &rendered.pictures)
    })
}

#[test]
fn the_number_of_threads_changes_no_digit() {
    let one = with_threads(1);
    assert!(one.adjustment.is_some(), "the measurement went through");
    for threads in [2, 5] {
        // Compared as text: every digit of every number, and -0 is not 0.
        let many = with_threads(threads);
        assert!(
            format!("{one:?}") == format!("{many:?}"),
            "{threads} threads gave other digits"
        );
    }
}
