//! One named thread that computes while the window stays alive.
//!
//! The worker takes closures and knows no stage. A panic in a job is caught and comes back as a result; every result
//! wakes the window.

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread;

use crate::monitor::Monitor;

/// A job that ended by a panic: a fault of this program, not of the data.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("a fault of this program: {message}")]
pub struct Panicked {
    /// What the panic said.
    pub message: String,
}

type Job<T> = Box<dyn FnOnce(&Monitor) -> T + Send>;

struct Order<T> {
    job: Job<T>,
    monitor: Arc<Monitor>,
}

/// A thread that does one job after the other.
pub struct Worker<T> {
    orders: Sender<Order<T>>,
    results: Receiver<Result<T, Panicked>>,
    open: usize,
}

impl<T: Send + 'static> Worker<T> {
    /// Starts the thread; `wake` is called from it after every job.
    ///
    /// # Errors
    /// Where the system gives no thread.
    pub fn new(name: &str, wake: impl Fn() + Send + 'static) -> std::io::Result<Self> {
        let (orders, incoming) = channel::<Order<T>>();
        let (outgoing, results) = channel();
        thread::Builder::new()
            .name(name.to_owned())
            .spawn(move || {
                for Order { job, monitor } in incoming {
                    let result = catch_unwind(AssertUnwindSafe(|| job(&monitor)));
                    let sent = outgoing.send(result.map_err(|payload| Panicked {
                        message: said(payload.as_ref()),
                    }));
                    wake();
                    if sent.is_err() {
                        break;
                    }
                }
            })?;
        Ok(Self {
            orders,
            results,
            open: 0,
        })
    }

    /// Gives the worker a job; it is done after those given before.
    pub fn start(
        &mut self,
        monitor: Arc<Monitor>,
        job: impl FnOnce(&Monitor) -> T + Send + 'static,
    ) {
        // The thread ends only with the worker, so there is always somebody to take the order.
        if self
            .orders
            .send(Order {
                job: Box::new(job),
                monitor,
            })
            .is_ok()
        {
            self.open += 1;
        }
    }

    /// The next result, if there is one; never waits.
    pub fn poll(&mut self) -> Option<Result<T, Panicked>> {
        let result = self.results.try_recv().ok()?;
        self.open -= 1;
        Some(result)
    }

    /// Whether a job is waiting or under way.
    #[must_use]
    pub fn is_busy(&self) -> bool {
        self.open > 0
    }
}

/// Does something that may wait for long, a dialog of the system for one, on a thread of its own; it answers by what it
/// was given.
///
/// # Errors
/// Where the system gives no thread.
pub fn apart(name: &str, work: impl FnOnce() + Send + 'static) -> std::io::Result<()> {
    thread::Builder::new()
        .name(name.to_owned())
        .spawn(work)
        .map(drop)
}

fn said(payload: &(dyn Any + Send)) -> String {
    payload
        .downcast_ref::<&str>()
        .map(|text| (*text).to_owned())
        .or_else(|| payload.downcast_ref::<String>().cloned())
        .unwrap_or_else(|| "a panic without a message".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::mpsc::channel;

    #[test]
    fn jobs_are_done_in_order_and_wake_the_window() {
        let (wake, woken) = channel();
        let mut worker = Worker::new("test", move || wake.send(()).expect("the test listens"))
            .expect("a thread");
        for number in 0..3 {
            worker.start(Arc::new(Monitor::new()), move |_| number);
        }
        let mut results = Vec::new();
        for _ in 0..3 {
            woken.recv().expect("a result");
            results.push(worker.poll().expect("a result").expect("no panic"));
        }
        assert_eq!(results, [0, 1, 2]);
        assert!(!worker.is_busy());
    }

    #[test]
    fn a_panic_is_a_result_and_the_worker_goes_on() {
        let (wake, woken) = channel();
        let mut worker = Worker::new("test", move || wake.send(()).expect("the test listens"))
            .expect("a thread");
        worker.start(Arc::new(Monitor::new()), |_| panic!("on purpose"));
        worker.start(Arc::new(Monitor::new()), |_| 7);
        woken.recv().expect("a result");
        assert_eq!(
            worker.poll(),
            Some(Err(Panicked {
                message: "on purpose".into()
            }))
        );
        woken.recv().expect("a result");
        assert_eq!(worker.poll(), Some(Ok(7)));
    }
}
