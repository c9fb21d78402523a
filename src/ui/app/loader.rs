//! Slow work on documents, on a thread of its own: projects are opened and made, the demo is rendered, pictures are
//! looked for. One after the other, each with a monitor that shows progress and stops it.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, TryRecvError, channel};

use crate::commands::{DemoRequest, prepare_demo};
use crate::monitor::{Monitor, Progress};
use crate::network::{ImageId, Network};
use crate::project::files::read_reference;
use crate::project::making::{ProjectPlan, make};
use crate::project::proposal::{Proposal, propose};
use crate::project::recent::{recent_projects, remember_project};
use crate::project::session::{Session, folder_of};
use crate::project::storage::StorageError;
use crate::project::whereabouts::{PictureMoves, pictures_missing, search_folder};
use crate::report::{NamingSettings, name_by_reference};
use crate::worker::{Panicked, Worker, apart};

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
        /// Images whose picture is not at its place.
        missing: Vec<ImageId>,
        /// What is to be done with it.
        then: Then,
    },
    /// What can be made of files that were dropped or named.
    Proposal(Proposal),
    /// Where missing pictures are now.
    Moves(PictureMoves),
    /// Names for targets by a list.
    Names {
        /// The names, by the numbers of the targets.
        names: BTreeMap<u32, String>,
        /// How many there are.
        line: String,
        /// What was named, what is ambiguous, what is left.
        text: String,
    },
    /// Projects that were open before, newest first.
    Recent(Vec<PathBuf>),
    /// Something was done that changes nothing in the window but this line.
    Line(String),
}

type Answer = Result<Loaded, String>;

/// The thread and what is under way on it.
pub(super) struct Loader {
    /// Where projects that were open are remembered.
    pub(super) state_folder: Option<PathBuf>,
    worker: Worker<Answer>,
    /// Titles and monitors of what waits or is under way, first the one under way.
    open: std::collections::VecDeque<(String, Arc<Monitor>)>,
    /// Answers of documents that were let go and may not be on the disk yet.
    closing: Vec<Receiver<Result<(), String>>>,
}

impl Loader {
    pub(super) fn new(wake: impl Fn() + Send + 'static) -> std::io::Result<Self> {
        Ok(Self {
            state_folder: None,
            worker: Worker::new("documents", wake)?,
            open: std::collections::VecDeque::new(),
            closing: Vec::new(),
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
        let title = self
            .open
            .pop_front()
            .map_or_else(String::new, |(title, _)| title);
        Some(match answer {
            Ok(answer) => answer,
            Err(Panicked { message }) => {
                Err(format!("{title}: a fault of this program: {message}"))
            }
        })
    }

    /// Does something slow.
    pub(super) fn start(
        &mut self,
        title: impl Into<String>,
        work: impl FnOnce(&Monitor) -> Answer + Send + 'static,
    ) {
        let monitor = Arc::new(Monitor::new());
        self.open.push_back((title.into(), Arc::clone(&monitor)));
        self.worker.start(monitor, work);
    }

    /// Opens a project; one that is being opened is not opened twice, as a double click would ask.
    pub(super) fn open(&mut self, path: &Path) {
        let title = format!("opening {}", path.display());
        if self.open.iter().any(|(open, _)| *open == title) {
            return;
        }
        let path = path.to_owned();
        let memory = self.state_folder.clone();
        self.start(title, move |_| {
            let session = Session::open(&path).map_err(|error| error.to_string())?;
            Ok(opened(session, path, Then::Wait, memory.as_deref()))
        });
    }

    /// Makes a project and opens it.
    pub(super) fn make(&mut self, plan: ProjectPlan) {
        let memory = self.state_folder.clone();
        self.start(
            format!("making {}", plan.project.display()),
            move |monitor| {
                let session = make(&plan, monitor).map_err(|error| error.to_string())?;
                Ok(opened(session, plan.project, Then::Wait, memory.as_deref()))
            },
        );
    }

    /// Renders the demo and opens its project.
    pub(super) fn demo(&mut self, request: DemoRequest) {
        let memory = self.state_folder.clone();
        self.start("rendering the demo", move |monitor| {
            let path = prepare_demo(&request, monitor)
                .map_err(|error| error.to_string())?
                .project;
            let session = Session::open(&path).map_err(|error| error.to_string())?;
            Ok(opened(session, path, Then::Measure, memory.as_deref()))
        });
    }

    /// Looks at what was dropped or named.
    pub(super) fn propose(&mut self, paths: Vec<PathBuf>) {
        self.start("looking at the files", move |_| {
            Ok(Loaded::Proposal(propose(&paths)))
        });
    }

    /// Looks for missing pictures in a folder.
    pub(super) fn find_pictures(&mut self, network: Arc<Network>, project: &Path, folder: PathBuf) {
        let home = folder_of(project);
        self.start(
            format!("looking for pictures in {}", folder.display()),
            move |monitor| {
                let moves = search_folder(&network, &home, &folder, monitor);
                moves.map(Loaded::Moves).map_err(|error| error.to_string())
            },
        );
    }

    /// Names for the targets by a list of approximate coordinates.
    pub(super) fn name_by_list(&mut self, network: Arc<Network>, list: PathBuf) {
        self.start(format!("naming by {}", list.display()), move |_| {
            let reference = read_reference(&list).map_err(|error| error.to_string())?;
            let naming = name_by_reference(&network, &reference, &NamingSettings::default())
                .map_err(|error| error.to_string())?;
            let line = format!(
                "{} targets named by {}; {} places ambiguous, {} others gave no name.",
                naming.names.len(),
                list.display(),
                naming.ambiguous.len(),
                naming.reference_left.len()
            );
            Ok(Loaded::Names {
                text: naming.text(),
                line,
                names: naming.names,
            })
        });
    }

    /// Reads which projects were open before.
    pub(super) fn recall(&mut self) {
        if let Some(folder) = self.state_folder.clone() {
            self.start("recent projects", move |_| {
                let there = recent_projects(&folder)
                    .into_iter()
                    .filter(|path| path.is_file());
                Ok(Loaded::Recent(there.collect()))
            });
        }
    }

    /// Lets a document go: closing its file may wait for the disk, and what is to be opened next waits for that.
    pub(super) fn close(&mut self, session: Session) {
        self.closing
            .retain(|closed| matches!(closed.try_recv(), Err(TryRecvError::Empty)));
        let (tell, told) = channel();
        let (answer, closed) = channel();
        let work = move || {
            session.close(move |saved| {
                let saved = in_words(saved);
                // One of the two may not listen any more.
                let _ = answer.send(saved.clone());
                let _ = tell.send(saved);
            });
        };
        // On a thread of its own, because the memory of a long history takes its time. Where the system gives none, the
        // session is dropped at once, which waits for the disk.
        let _ = apart("closing", work);
        self.closing.push(closed);
        self.start("closing", move |_| {
            let saved = told.recv().unwrap_or(Ok(()));
            saved.map(|()| Loaded::Line(String::new()))
        });
    }

    /// Waits until all documents that were let go are on the disk; returns why those are not that cannot be.
    pub(super) fn wait_for_closing(&mut self) -> Vec<String> {
        let answers = self.closing.drain(..);
        let answers = answers.filter_map(|closed| closed.recv().ok());
        answers.filter_map(Result::err).collect()
    }
}

/// What the operator is told of a document that is closed.
fn in_words(saved: Result<(), StorageError>) -> Result<(), String> {
    match saved {
        // That nothing is saved was told as long as it was open.
        Ok(()) | Err(StorageError::ReadOnly { .. }) => Ok(()),
        Err(error) => Err(format!(
            "the last changes are not in the file that was closed: {error}"
        )),
    }
}

/// A project that is open now; it is remembered, and its pictures are looked for.
fn opened(session: Session, path: PathBuf, then: Then, memory: Option<&Path>) -> Loaded {
    if let Some(folder) = memory {
        // A list of recent projects that cannot be written is no reason not to work.
        let _ = remember_project(folder, &path);
    }
    let missing = pictures_missing(session.network(), &folder_of(&path));
    Loaded::Project {
        session: Box::new(session),
        path,
        missing,
        then,
    }
}
