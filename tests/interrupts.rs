//! Every step of every stage, interrupted at every place where it can be, then run on: the same digits as without.

mod rendered;

use rendered::{Rendered, run_stage, small_box};
use tiepoint::monitor::Monitor;
use tiepoint::network::{Network, Stage};
use tiepoint::stages::{Halt, Step};
use tiepoint::synthetic::CrossPlan;

/// The network after a step that nobody interrupts.
fn whole(step: &Step, network: &Network, rendered: &Rendered) -> Network {
    step.run(network, &rendered.pictures, &Monitor::new())
        .expect("a step that can be done")
        .network
}

/// What an interrupt left.
#[expect(clippy::large_enum_variant, reason = "a test holds one")]
enum Left {
    /// Nothing: the step never held the document.
    NoTrace,
    /// The pictures that were finished.
    Part(Network),
    /// The step has fewer calls.
    Whole,
}

fn interrupted(step: &Step, network: &Network, rendered: &Rendered, calls: u64) -> Left {
    let monitor = Monitor::interrupting_after(calls);
    match step.run(network, &rendered.pictures, &monitor) {
        Err(Halt::Interrupted) => Left::NoTrace,
        Err(Halt::Failed(error)) => panic!("{step:?} failed: {error}"),
        Ok(advance) if !advance.complete => Left::Part(advance.network),
        Ok(_) => Left::Whole,
    }
}

#[test]
fn an_interrupt_at_any_call_leaves_no_trace() {
    // One thread: the countdown of calls then falls on the same call in every run.
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .build()
        .expect("a thread");
    pool.install(|| {
        let rendered = small_box(61, Some(CrossPlan::default()));
        let mut network = rendered.network.clone();
        let mut places = 0;
        for stage in Stage::ALL {
            let finished = format!(
                "{:?}",
                run_stage(network.clone(), stage, &rendered.pictures)
            );
            while let Some(step) = stage.next(&network) {
                let before = format!("{network:?}");
                let after = whole(&step, &network, &rendered);
                for calls in 0.. {
                    let resumed = match interrupted(&step, &network, &rendered, calls) {
                        Left::Whole => break,
                        // The same step begins anew; once is enough to see that it gives the same.
                        Left::NoTrace if calls > 0 => None,
                        Left::NoTrace => Some(whole(&step, &network, &rendered)),
                        Left::Part(kept) => {
                            // The next batch is another one, so the end of the stage is compared.
                            let end = run_stage(kept, stage, &rendered.pictures);
                            assert!(
                                format!("{end:?}") == finished,
                                "{step:?} interrupted at call {calls} ended with other digits"
                            );
                            None
                        }
                    };
                    places += 1;
                    assert!(
                        before == format!("{network:?}"),
                        "{step:?} left a trace at call {calls}"
                    );
                    assert!(
                        resumed
                            .is_none_or(|resumed| format!("{after:?}") == format!("{resumed:?}")),
                        "{step:?} interrupted at call {calls} went on to other digits"
                    );
                }
                network = after;
            }
            network = stage.conclude(&network, None);
        }
        assert!(network.adjustment.is_some(), "the measurement went through");
        // Eighteen pictures, sixteen images to connect, each with several iterations.
        assert!(places > 100, "only {places} places to interrupt");
    });
}
