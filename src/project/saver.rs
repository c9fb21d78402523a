//! Saving on a thread of its own: nobody who changes the document waits for the disk.
//!
//! What was done waits in a queue; the thread takes all that waits and writes the newest state with every line of the
//! journal in one transaction. When it falls behind, the newest state wins and no line is lost. What could not be
//! saved stays in the queue and is tried again with the next step, with [`Saver::flush`], and from time to time.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, SystemTime};

use super::storage::{JournalEntry, JournalLine, StorageError, Store, save_as, utc_text};
use crate::network::{MeasurementSettings, Network, Outcome};

/// How long after a failure it is tried again though nothing new is to be saved: disks get space, networks come back.
const PAUSE_AFTER_FAILURE: Duration = Duration::from_secs(10);

/// Whether what is in memory is on the disk.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Saving {
    /// All of it.
    Saved,
    /// It is being written.
    Behind {
        /// Steps and edits that are not yet on the disk.
        steps: usize,
    },
    /// It cannot be written, in one line; it is tried again.
    Failed(String),
}

/// Where is saved to.
pub(super) enum Target {
    /// A project that only we write to.
    File(Box<Store>),
    /// A project that is open for reading only: nothing can be saved but copies.
    Nowhere {
        /// The project file.
        file: PathBuf,
        /// What could be read of it.
        read: Arc<Network>,
        /// Its journal, as far as it could be read.
        journal: Vec<JournalEntry>,
    },
}

/// A step or edit that is not on the disk.
struct Waiting {
    what: String,
    time: SystemTime,
    settings: Arc<MeasurementSettings>,
    outcome: Option<Outcome>,
    sigma0: Option<f64>,
    /// What it led to; `None` where this could not be saved and something newer is there.
    network: Option<Arc<Network>>,
}

impl Waiting {
    fn line(&self) -> JournalLine {
        JournalLine {
            utc: utc_text(self.time),
            what: self.what.clone(),
            settings: serde_json::to_string(self.settings.as_ref()).unwrap_or_default(),
            outcome: self
                .outcome
                .map(|outcome| outcome.to_string())
                .unwrap_or_default(),
            // A network with such a number is refused; a line of one that was taken back must not stop all later saves.
            sigma0: self.sigma0.filter(|sigma0| sigma0.is_finite()),
        }
    }
}

type Answer = Box<dyn FnOnce(Result<(), StorageError>) + Send>;

/// A copy that was asked for.
struct Copy {
    path: PathBuf,
    answer: Answer,
}

/// The last attempt failed.
struct Failure {
    text: String,
    /// For the next [`Saver::flush`].
    error: Option<StorageError>,
    is_lasting: bool,
}

#[derive(Default)]
struct State {
    /// Oldest first; what is being written is not among them.
    waiting: Vec<Waiting>,
    /// How many are being written.
    under_way: usize,
    /// How many were written since the project was opened.
    saved: u64,
    /// Whether the thread works.
    is_busy: bool,
    /// Whether an attempt was asked for that has not begun.
    is_asked: bool,
    copies: Vec<Copy>,
    failure: Option<Failure>,
    is_closing: bool,
    /// Told when the file is closed.
    closed: Option<Answer>,
}

#[derive(Default)]
struct Shared {
    state: Mutex<State>,
    changed: Condvar,
    wake: Mutex<Option<Box<dyn Fn() + Send>>>,
}

impl Shared {
    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn wait<'a>(&self, state: MutexGuard<'a, State>) -> MutexGuard<'a, State> {
        self.changed
            .wait(state)
            .unwrap_or_else(PoisonError::into_inner)
    }
}

/// The thread that saves one project; dropping it waits until all is on the disk, or cannot be, and closes the file.
pub(super) struct Saver {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

impl Saver {
    /// Starts the thread.
    ///
    /// # Errors
    /// [`StorageError`] where the system gives no thread.
    pub(super) fn start(target: Target) -> Result<Self, StorageError> {
        let shared = Arc::new(Shared::default());
        let file = target.file().to_owned();
        let of_thread = Arc::clone(&shared);
        let thread = std::thread::Builder::new()
            .name("save".into())
            .spawn(move || work(target, &of_thread))
            .map_err(|source| StorageError::File {
                file,
                action: "start saving",
                source,
            })?;
        Ok(Self {
            shared,
            thread: Some(thread),
        })
    }

    /// Has a network saved that a step or edit led to; returns at once.
    pub(super) fn save(&self, what: &str, network: &Arc<Network>, outcome: Option<Outcome>) {
        let mut state = self.shared.state();
        state.waiting.push(Waiting {
            what: what.to_owned(),
            time: SystemTime::now(),
            settings: Arc::clone(&network.settings),
            outcome,
            sigma0: network.adjustment.as_ref().map(|a| a.sigma0),
            network: Some(Arc::clone(network)),
        });
        state.is_asked = true;
        self.shared.changed.notify_all();
    }

    /// Whether all is on the disk.
    pub(super) fn saving(&self) -> Saving {
        let state = self.shared.state();
        match (&state.failure, state.waiting.len() + state.under_way) {
            (Some(failure), _) => Saving::Failed(failure.text.clone()),
            (None, 0) => Saving::Saved,
            (None, steps) => Saving::Behind { steps },
        }
    }

    /// How many steps and edits were put on the disk since the project was opened.
    pub(super) fn saved(&self) -> u64 {
        self.shared.state().saved
    }

    /// Waits until all is on the disk; tries once more what failed before.
    ///
    /// # Errors
    /// [`StorageError`] where it cannot be saved; it stays waiting.
    pub(super) fn flush(&self) -> Result<(), StorageError> {
        let mut state = self.shared.state();
        if !state.waiting.is_empty() || state.is_busy {
            state.is_asked = true;
            self.shared.changed.notify_all();
        }
        while state.is_asked || state.is_busy {
            state = self.shared.wait(state);
        }
        match &mut state.failure {
            None => Ok(()),
            Some(failure) => Err(failure.error.take().unwrap_or_else(|| StorageError::Fault {
                message: failure.text.clone(),
            })),
        }
    }

    /// Has all that was done so far written to another file, also where the project itself cannot be saved; returns at
    /// once. The answer is called on the saving thread.
    pub(super) fn copy(
        &self,
        path: PathBuf,
        answer: impl FnOnce(Result<(), StorageError>) + Send + 'static,
    ) {
        let answer = Box::new(answer);
        self.shared.state().copies.push(Copy { path, answer });
        self.shared.changed.notify_all();
    }

    /// Has `wake` called, on the saving thread, whenever [`Self::saving`] may say something else.
    pub(super) fn on_saved(&self, wake: impl Fn() + Send + 'static) {
        let mut place = (self.shared.wake.lock()).unwrap_or_else(PoisonError::into_inner);
        *place = Some(Box::new(wake));
    }

    /// Closes the file when all is saved, or cannot be; returns at once.
    pub(super) fn close(mut self, closed: impl FnOnce(Result<(), StorageError>) + Send + 'static) {
        self.shared.state().closed = Some(Box::new(closed));
        self.end();
        // Not waited for: that is what `closed` is for.
        self.thread = None;
    }

    fn end(&self) {
        self.shared.state().is_closing = true;
        self.shared.changed.notify_all();
    }
}

impl Drop for Saver {
    fn drop(&mut self) {
        if let Some(thread) = self.thread.take() {
            self.end();
            // The thread catches panics itself; whatever ended it, there is nobody left to tell.
            let _ = thread.join();
        }
    }
}

/// What the thread does next.
struct Work {
    waiting: Vec<Waiting>,
    copies: Vec<Copy>,
    is_last: bool,
}

/// Saves until the saver is dropped.
fn work(mut target: Target, shared: &Shared) {
    loop {
        let Work {
            mut waiting,
            copies,
            is_last,
        } = next(shared);
        let error = target.save(&mut waiting).err();
        let copied: Vec<_> = copies
            .into_iter()
            .map(|copy| (copy.answer, target.copy(&copy.path, &waiting)))
            .collect();
        settle(shared, waiting, error);
        for (answer, result) in copied {
            let _ = guarded(|| {
                answer(result);
                Ok(())
            });
        }
        wake(shared);
        if is_last {
            break;
        }
    }
    // The file is closed and its lock given back before anybody is told.
    drop(target);
    let (closed, error) = {
        let mut state = shared.state();
        let error = state.failure.as_mut().and_then(|f| f.error.take());
        (state.closed.take(), error)
    };
    if let Some(closed) = closed {
        let _ = guarded(|| {
            closed(error.map_or(Ok(()), Err));
            Ok(())
        });
    }
}

/// Waits for something to do.
fn next(shared: &Shared) -> Work {
    let mut state = shared.state();
    while !(state.is_asked || state.is_closing || !state.copies.is_empty()) {
        if state.failure.as_ref().is_some_and(|f| !f.is_lasting) {
            let (after, timeout) = (shared.changed)
                .wait_timeout(state, PAUSE_AFTER_FAILURE)
                .unwrap_or_else(PoisonError::into_inner);
            state = after;
            state.is_asked |= timeout.timed_out();
        } else {
            state = shared.wait(state);
        }
    }
    let work = Work {
        waiting: std::mem::take(&mut state.waiting),
        copies: std::mem::take(&mut state.copies),
        is_last: state.is_closing,
    };
    state.under_way = work.waiting.len();
    state.is_busy = true;
    state.is_asked = false;
    work
}

/// Puts back what could not be saved and lets those go on who wait.
fn settle(shared: &Shared, left: Vec<Waiting>, error: Option<StorageError>) {
    let mut state = shared.state();
    state.saved += (state.under_way - left.len()) as u64;
    let later = std::mem::replace(&mut state.waiting, left);
    state.waiting.extend(later);
    state.under_way = 0;
    state.is_busy = false;
    state.failure = error.map(|error| Failure {
        text: error.to_string(),
        is_lasting: matches!(
            error,
            StorageError::NotStorable { .. }
                | StorageError::Changed { .. }
                | StorageError::ReadOnly { .. }
                | StorageError::Fault { .. }
        ),
        error: Some(error),
    });
    shared.changed.notify_all();
}

fn wake(shared: &Shared) {
    let wake = shared.wake.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(wake) = wake.as_ref() {
        let _ = guarded(|| {
            wake();
            Ok(())
        });
    }
}

/// A panic as an error: the thread must outlive it, for others wait for its answers.
fn guarded(job: impl FnOnce() -> Result<(), StorageError>) -> Result<(), StorageError> {
    catch_unwind(AssertUnwindSafe(job)).unwrap_or_else(|payload| {
        let said = payload.downcast_ref::<String>().map(String::as_str);
        let said = said.or_else(|| payload.downcast_ref::<&str>().copied());
        Err(StorageError::Fault {
            message: said.unwrap_or("a panic without a message").to_owned(),
        })
    })
}

impl Target {
    /// The project file.
    fn file(&self) -> &Path {
        match self {
            Target::File(store) => store.file(),
            Target::Nowhere { file, .. } => file,
        }
    }

    /// Saves the newest state that can be stored, with the lines up to it; leaves what could not be saved.
    fn save(&mut self, waiting: &mut Vec<Waiting>) -> Result<(), StorageError> {
        if waiting.is_empty() {
            return Ok(());
        }
        let Target::File(store) = self else {
            keep_newest(waiting);
            return Err(StorageError::ReadOnly {
                file: self.file().to_owned(),
            });
        };
        let lines: Vec<JournalLine> = waiting.iter().map(Waiting::line).collect();
        let mut refused = None;
        for end in (1..=waiting.len()).rev() {
            let Some(network) = waiting[end - 1].network.clone() else {
                continue;
            };
            match guarded(|| store.save(&network, &lines[..end]).map(drop)) {
                Ok(()) => {
                    waiting.drain(..end);
                    break;
                }
                // An older state that waited too may well be stored.
                Err(error @ StorageError::NotStorable { .. }) => {
                    refused.get_or_insert(error);
                }
                Err(error) => {
                    refused.get_or_insert(error);
                    break;
                }
            }
        }
        keep_newest(waiting);
        refused.map_or(Ok(()), Err)
    }

    /// Writes what was saved last, or the newest state that waits, to another file.
    fn copy(&self, path: &Path, waiting: &[Waiting]) -> Result<(), StorageError> {
        guarded(|| {
            let (saved, mut journal) = match self {
                // A project whose journal cannot be read any more is all the more in need of a copy.
                Target::File(store) => (store.saved(), store.journal().unwrap_or_default()),
                Target::Nowhere { read, journal, .. } => (read.as_ref(), journal.clone()),
            };
            let newest = waiting.last().and_then(|w| w.network.as_deref());
            let sequence = journal.last().map_or(0, |entry| entry.sequence);
            journal.extend(
                waiting
                    .iter()
                    .zip(sequence + 1..)
                    .map(|(waiting, sequence)| JournalEntry {
                        sequence,
                        line: waiting.line(),
                    }),
            );
            save_as(path, newest.unwrap_or(saved), self.file(), &journal)
        })
    }
}

/// Lets go of what was refused and is not the newest: it would only fill the memory.
fn keep_newest(waiting: &mut [Waiting]) {
    if let Some((_, older)) = waiting.split_last_mut() {
        for waiting in older {
            waiting.network = None;
        }
    }
}

#[cfg(test)]
mod tests;
