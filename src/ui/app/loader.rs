//! Slow work on documents, on a thread of its own: projects are opened and made, the demo is rendered, pictures are
//! looked for. One after the other, each with a monitor that shows progress and stops it.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::commands::{DemoRequest, prepare_demo};
use crate::monitor::{Monitor, Progress};
use crate::project::session::Session;
use crate::worker::{Panicked, Worker};

/// What is done with a project as soon as it is open.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Then {
    /// The operator decides.
    Wait,
    /// All stages run.
    Measure,
}

/// What came of the work.
pub(super) enum Loaded {
    /// A project is open.
    Project {
        /// The document.
        session: Box<Session>,
        /// Its file.
        path: PathBuf,
        /// What is to be done with it.
        then: Then,
    },
    /// Something was done that changes nothing in the window but this line.
    Line(String),
}

type Answer = Result<Loaded, String>;

/// The thread and what is under way on it.
pub(super) struct Loader {
    worker: Worker<Answer>,
    /// Titles and monitors of what waits or is under way, first the one under way.
    open: std::collections::VecDeque<(String, Arc<Monitor>)>,
}

impl Loader {
    pub(super) fn new(wake: impl Fn() + Send + 'static) -> std::io::Result<Self> {
        Ok(Self {
            worker: Worker::new("documents", wake)?,
            open: std::collections::VecDeque::new(),
        })
    }

    pub(super) fn is_busy(&self) -> bool {
        self.worker.is_busy()
    }

    /// What is under way, with its progress.
    pub(super) fn progress(&self) -> Option<(&str, Progress)> {
        let (title, monitor) = self.open.front()?;
        Some((title, monitor.progress()))
    }

    /// Asks what is under way to stop.
    pub(super) fn interrupt(&self) {
        for (_, monitor) in &self.open {
            monitor.interrupt();
        }
    }

    /// The next answer, if there is one; never waits.
    pub(super) fn poll(&mut self) -> Option<Answer> {
        let answer = self.worker.poll()?;
        let title = self.open.pop_front().map_or_else(String::new, |(title, _)| title);
        Some(match answer {
            Ok(answer) => answer,
            Err(Panicked { message }) => Err(format!("{title}: a fault of this program: {message}")),
        })
    }

    /// Does something slow.
    pub(super) fn start(&mut self, title: impl Into<String>, work: impl FnOnce(&Monitor) -> Answer + Send + 'static) {
        let monitor = Arc::new(Monitor::new());
        self.open.push_back((title.into(), Arc::clone(&monitor)));
        self.worker.start(monitor, work);
    }

    /// Opens a project.
    pub(super) fn open(&mut self, path: &Path, then: Then) {
        let path = path.to_owned();
        self.start(format!("opening {}", path.display()), move |_| {
            let session = Session::open(&path).map_err(|error| error.to_string())?;
            Ok(Loaded::Project { session: Box::new(session), path, then })
        });
    }

    /// Renders the demo and opens its project.
    pub(super) fn demo(&mut self, request: DemoRequest) {
        self.start("rendering the demo", move |monitor| {
            let path = prepare_demo(&request, monitor).map_err(|error| error.to_string())?.project;
            let session = Session::open(&path).map_err(|error| error.to_string())?;
            Ok(Loaded::Project { session: Box::new(session), path, then: Then::Measure })
        });
    }

    /// Lets a document go: closing its file may wait for the disk.
    pub(super) fn close(&mut self, session: Session) {
        self.start("closing", move |_| {
            drop(session);
            Ok(Loaded::Line(String::new()))
        });
    }
}
