//! Every step of every stage, interrupted at every place where it can be, then run on: the same digits as without.

mod rendered;

use rendered::{Rendered, small_box};
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

/// Interrupts a step at its `calls`-th call, goes on from what is kept, and returns the network at the end of the step's
/// work; `None` where the step has fewer calls.
fn interrupted(step: &Step, network: &Network, rendered: &Rendered, calls: u64) -> Option<Network> {
    let monitor = Monitor::interrupting_after(calls);
    let kept = match step.run(network, &rendered.pictures, &monitor) {
        Err(Halt::Interrupted) => network.clone(),
        Err(Halt::Failed(error)) => panic!("{step:?} failed: {error}"),
        Ok(advance) if !advance.complete => advance.network,
        Ok(_) => return None,
    };
    assert!(monitor.is_interrupted());
    // What is left of a batch of pictures comes next; any other step begins anew.
    let next = step
        .stage()
        .next(&kept)
        .expect("an interrupted stage has a next step");
    Some(whole(&next, &kept, rendered))
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
            while let Some(step) = stage.next(&network) {
                let after = whole(&step, &network, &rendered);
                for calls in 0.. {
                    let Some(resumed) = interrupted(&step, &network, &rendered, calls) else {
                        break;
                    };
                    places += 1;
                    assert!(
                        format!("{after:?}") == format!("{resumed:?}"),
                        "{step:?} interrupted at call {calls} went on to other digits"
                    );
                }
                network = after;
            }
            network = stage.conclude(&network, None);
        }
        assert!(network.adjustment.is_some(), "the measurement went through");
        // Twelve pictures, ten images to connect, six adjustments of several iterations.
        assert!(places > 60, "only {places} places to interrupt");
    });
}
