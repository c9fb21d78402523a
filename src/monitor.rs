//! Progress out, interrupts in: one call does both.
//!
//! Invariant: there is no way to report progress that does not also obey the interrupt, so no loop that shows
//! progress can forget to stop.

use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

/// What the running work looks like from outside; the latest state wins.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Progress {
    /// What is being done, in the operator's words.
    pub title: String,
    /// Units of work finished.
    pub done: u64,
    /// Units of work in all; 0 where it cannot be known beforehand.
    pub total: u64,
}

/// The operator (or Ctrl-C) asked for the work to stop.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("interrupted")]
pub struct Interrupted;

type Watcher = Box<dyn Fn(&Progress) + Send + Sync>;

/// Shared by the worker that computes and by whoever watches or interrupts it.
#[derive(Default)]
pub struct Monitor {
    interrupted: AtomicBool,
    /// Calls of [`Task::step`] left before the monitor interrupts by itself; `u64::MAX` stands for "never".
    countdown: Option<AtomicU64>,
    progress: Mutex<Progress>,
    watcher: Option<Watcher>,
}

impl Monitor {
    /// A monitor that nobody watches.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// A monitor that calls `watcher` at every change of progress, from the thread that computes.
    #[must_use]
    pub fn watched(watcher: impl Fn(&Progress) + Send + Sync + 'static) -> Self {
        Self {
            watcher: Some(Box::new(watcher)),
            ..Self::default()
        }
    }

    /// A monitor that interrupts at its `calls`-th step: tests try every place where work can be interrupted.
    #[must_use]
    pub fn interrupting_after(calls: u64) -> Self {
        Self {
            countdown: Some(AtomicU64::new(calls)),
            ..Self::default()
        }
    }

    /// Asks the work to stop at its next step.
    pub fn interrupt(&self) {
        self.interrupted.store(true, Ordering::SeqCst);
    }

    /// Whether the work was asked to stop.
    #[must_use]
    pub fn is_interrupted(&self) -> bool {
        self.interrupted.load(Ordering::SeqCst)
    }

    /// Obeys the interrupt within a unit of work that takes long; no progress.
    ///
    /// # Errors
    /// [`Interrupted`] when the work was asked to stop.
    pub fn check(&self) -> Result<(), Interrupted> {
        match self.is_interrupted() {
            true => Err(Interrupted),
            false => Ok(()),
        }
    }

    /// The latest progress.
    #[must_use]
    pub fn progress(&self) -> Progress {
        self.progress
            .lock()
            .unwrap_or_else(std::sync::PoisonError::into_inner)
            .clone()
    }

    /// Begins a task of `total` units (0: unknown).
    pub fn task(&self, title: impl Into<String>, total: u64) -> Task<'_> {
        let task = Task {
            monitor: self,
            done: AtomicU64::new(0),
        };
        self.show(Progress {
            title: title.into(),
            done: 0,
            total,
        });
        task
    }

    fn show(&self, progress: Progress) {
        if let Some(watcher) = &self.watcher {
            watcher(&progress);
        }
        *self
            .progress
            .lock()
            .unwrap_or_else(std::sync::PoisonError::into_inner) = progress;
    }
}

/// One piece of work under way; may be shared by the threads that do it.
pub struct Task<'a> {
    monitor: &'a Monitor,
    done: AtomicU64,
}

impl<'a> Task<'a> {
    /// Whom the task reports to, for what is done within a unit.
    #[must_use]
    pub fn monitor(&self) -> &'a Monitor {
        self.monitor
    }

    /// One unit finished or about to be done: reports it and obeys the interrupt.
    ///
    /// # Errors
    /// [`Interrupted`] when the work was asked to stop.
    pub fn step(&self) -> Result<(), Interrupted> {
        if let Some(countdown) = &self.monitor.countdown {
            let left =
                countdown.fetch_update(Ordering::SeqCst, Ordering::SeqCst, |n| n.checked_sub(1));
            if left.is_err() {
                self.monitor.interrupt();
            }
        }
        if self.monitor.is_interrupted() {
            return Err(Interrupted);
        }
        let done = self.done.fetch_add(1, Ordering::SeqCst) + 1;
        let mut progress = self.monitor.progress();
        progress.done = done;
        self.monitor.show(progress);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn progress_is_counted_and_the_interrupt_obeyed() {
        let monitor = Monitor::new();
        let task = monitor.task("counting", 3);
        assert_eq!(task.step(), Ok(()));
        assert_eq!(
            monitor.progress(),
            Progress {
                title: "counting".into(),
                done: 1,
                total: 3
            }
        );
        monitor.interrupt();
        assert_eq!(task.step(), Err(Interrupted));
        assert_eq!(
            monitor.progress().done,
            1,
            "an interrupted step is not progress"
        );
    }

    #[test]
    fn the_countdown_interrupts_at_the_chosen_call() {
        let monitor = Monitor::interrupting_after(2);
        let task = monitor.task("counting", 0);
        assert_eq!(
            [task.step(), task.step(), task.step()],
            [Ok(()), Ok(()), Err(Interrupted)]
        );
        assert!(monitor.is_interrupted());
    }
}
