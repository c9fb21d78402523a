//! A session: the document, its history and its file.
//!
//! Two doors change the document: [`Session::edit`] and [`Session::finish`]. Both hand it to the saving thread and
//! return at once: what is done is in the document, and on the disk a moment later. [`Session::saving`] tells how far
//! that is, [`Session::flush`] waits for it.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::channel;

use super::edit::{Edit, EditError};
use super::history::{History, HistorySettings, Move};
use super::intake::picture_path;
pub use super::saver::Saving;
use super::saver::{Saver, Target};
use super::storage::{JournalEntry, Opened, StorageError, Store};
use super::whereabouts::{Found, PictureMoves};
use crate::imaging::{GreyImage, LoadSettings, load_picture_until};
use crate::monitor::Monitor;
use crate::network::{About, Finding, FindingKind, ImageEntry, ImageId, Network, Outcome, Stage};
use crate::stages::{Advance, Halt, Pictures, StageError, Step};

/// Pictures from their files.
struct PictureFiles {
    folder: PathBuf,
}

impl Pictures for PictureFiles {
    fn load(&self, image: &ImageEntry, monitor: &Monitor) -> Result<GreyImage, String> {
        let path = picture_path(&self.folder, &image.file.path);
        let picture = load_picture_until(&path, &LoadSettings::default(), monitor)
            .map_err(|e| e.to_string())?
            .image;
        let found = (picture.width() as u64, picture.height() as u64);
        let expected = (
            u64::from(image.file.width_px),
            u64::from(image.file.height_px),
        );
        if found != expected {
            return Err(format!(
                "{}: found {} x {} px, expected {} x {} px as when it was added",
                path.display(),
                found.0,
                found.1,
                expected.0,
                expected.1
            ));
        }
        Ok(picture)
    }
}

/// A step that was begun: it holds all it needs and computes without the session.
pub struct Run {
    stage: Stage,
    step: Step,
    title: String,
    network: Arc<Network>,
    pictures: Arc<PictureFiles>,
}

/// What came of a run.
pub struct Computed {
    stage: Stage,
    title: String,
    begun_with: Arc<Network>,
    result: Stepped,
}

/// A step with what it means for its stage, so that taking it over is quick. One at a time is under way.
#[expect(
    clippy::large_enum_variant,
    reason = "there is one, and it is moved twice"
)]
enum Stepped {
    /// The operator stopped it before anything was finished.
    Interrupted,
    /// The operator stopped it, some is finished.
    Part(Network),
    /// The stage has another step.
    Advanced(Network),
    /// It was the last step of its stage.
    Last {
        network: Network,
        concluded: Network,
    },
    /// It cannot be done, which ends its stage.
    Failed {
        error: StageError,
        concluded: Network,
    },
}

impl Run {
    /// What it does, for the operator.
    #[must_use]
    pub fn title(&self) -> &str {
        &self.title
    }

    /// Does the step, and concludes its stage where it was the last; may take long, obeys the monitor's interrupt.
    #[must_use]
    pub fn compute(self, monitor: &Monitor) -> Computed {
        let stage = self.stage;
        let result = self
            .step
            .run(&self.network, self.pictures.as_ref(), monitor);
        let result = match result {
            Ok(Advance {
                network,
                complete: false,
            }) => Stepped::Part(network),
            Ok(Advance { network, .. }) if stage.next(&network).is_some() => {
                Stepped::Advanced(network)
            }
            Ok(Advance { network, .. }) => Stepped::Last {
                concluded: concluded(&network, stage, None),
                network,
            },
            Err(Halt::Interrupted) => Stepped::Interrupted,
            Err(Halt::Failed(error)) => Stepped::Failed {
                concluded: concluded(&self.network, stage, Some(&error)),
                error,
            },
        };
        Computed {
            stage,
            title: self.title,
            begun_with: self.network,
            result,
        }
    }
}

/// Why an edit was not made.
#[derive(Debug, thiserror::Error)]
pub enum SessionError {
    /// What it is about is gone.
    #[error(transparent)]
    Edit(#[from] EditError),
    /// It cannot be saved.
    #[error(transparent)]
    Storage(#[from] StorageError),
}

/// How a finished step left its stage.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Finished {
    /// The stage has another step.
    Advanced,
    /// The stage is done.
    Concluded(Outcome),
    /// The operator stopped it; all finished steps are kept.
    Interrupted,
}

/// A document that is open.
pub struct Session {
    network: Arc<Network>,
    history: History,
    saver: Saver,
    is_writable: bool,
    warnings: Vec<String>,
    /// The journal as it was when the project was opened.
    earlier: Vec<JournalEntry>,
    pictures: Arc<PictureFiles>,
}

impl Session {
    /// A new project file with this document.
    ///
    /// # Errors
    /// [`StorageError`] where the file exists or cannot be written.
    pub fn create(path: &Path, network: Network) -> Result<Self, StorageError> {
        let network = Arc::new(network);
        let store = Store::create(path, &network)?;
        Self::with(path, network, Target::File(Box::new(store)))
    }

    /// An existing project file.
    ///
    /// # Errors
    /// [`StorageError`] where it is no project, damaged, made by a newer version, or open elsewhere.
    pub fn open(path: &Path) -> Result<Self, StorageError> {
        let Opened {
            network,
            journal,
            store,
            warnings,
        } = Store::open(path)?;
        let target = match store {
            Some(store) => Target::File(Box::new(store)),
            None => Target::Nowhere {
                file: path.to_owned(),
                read: Arc::clone(&network),
                journal: journal.clone(),
            },
        };
        Ok(Self {
            warnings,
            earlier: journal,
            ..Self::with(path, network, target)?
        })
    }

    fn with(path: &Path, network: Arc<Network>, target: Target) -> Result<Self, StorageError> {
        let history = History::new(Arc::clone(&network), HistorySettings::default());
        let pictures = Arc::new(PictureFiles {
            folder: folder_of(path),
        });
        Ok(Self {
            network,
            history,
            is_writable: matches!(target, Target::File(_)),
            saver: Saver::start(target)?,
            warnings: Vec::new(),
            earlier: Vec::new(),
            pictures,
        })
    }

    /// Why the document is open for reading only, and what of it could not be read; empty where all is well.
    #[must_use]
    pub fn warnings(&self) -> &[String] {
        &self.warnings
    }

    /// Whether changes can be saved.
    #[must_use]
    pub fn is_writable(&self) -> bool {
        self.is_writable
    }

    /// The document.
    #[must_use]
    pub fn network(&self) -> &Arc<Network> {
        &self.network
    }

    /// Changes the document by an edit of the operator.
    ///
    /// # Errors
    /// The edit's own error; the document is unchanged then.
    pub fn edit<T, E>(
        &mut self,
        title: &str,
        edit: impl FnOnce(&mut Network) -> Result<T, E>,
    ) -> Result<T, E> {
        let mut network = self.network.as_ref().clone();
        let value = edit(&mut network)?;
        self.adopt(title, network, None);
        Ok(value)
    }

    /// Makes an edit of the operator.
    ///
    /// # Errors
    /// [`SessionError::Edit`]: the edit cannot be made any more; the document is unchanged then.
    pub fn apply(&mut self, edit: &Edit) -> Result<(), SessionError> {
        let title = edit.title(&self.network);
        self.edit(&title, |network| Ok(edit.apply(network)?))
    }

    /// Takes the last step or edit back; returns its title, `None` where there is nothing to take back.
    ///
    /// # Errors
    /// None at present: [`Self::saving`] tells those of saving.
    pub fn undo(&mut self) -> Result<Option<String>, StorageError> {
        let moved = self.history.undo();
        Ok(self.go_to(moved, "undo"))
    }

    /// Does again what was taken back last; returns its title.
    ///
    /// # Errors
    /// None at present: [`Self::saving`] tells those of saving.
    pub fn redo(&mut self) -> Result<Option<String>, StorageError> {
        let moved = self.history.redo();
        Ok(self.go_to(moved, "redo"))
    }

    /// The history of this session.
    #[must_use]
    pub fn history(&self) -> &History {
        &self.history
    }

    /// What was done in earlier sessions, oldest first, as the project file tells it.
    #[must_use]
    pub fn earlier(&self) -> &[JournalEntry] {
        &self.earlier
    }

    /// Whether what was done is on the disk. A failure does not touch the document in memory, and is tried again with
    /// the next step or edit, by [`Self::flush`], and every few seconds where that may help.
    #[must_use]
    pub fn saving(&self) -> Saving {
        self.saver.saving()
    }

    /// How many steps and edits are on the disk that were not when the project was opened; undo and redo count too.
    #[must_use]
    pub fn changes_saved(&self) -> u64 {
        self.saver.saved()
    }

    /// Has `wake` called whenever [`Self::saving`] may say something else; it is called on the saving thread.
    pub fn on_saved(&mut self, wake: impl Fn() + Send + 'static) {
        self.saver.on_saved(wake);
    }

    /// Waits until all that was done is on the disk.
    ///
    /// # Errors
    /// [`StorageError`] where it cannot be saved; the document in memory stands, and it can be tried again.
    pub fn flush(&mut self) -> Result<(), StorageError> {
        self.saver.flush()
    }

    /// Closes the project without waiting: `closed` is called, on the saving thread, when all is on the disk, or cannot
    /// be, and another may open the file. Dropping a session does the same and waits; a program that ends must drop.
    pub fn close(self, closed: impl FnOnce(Result<(), StorageError>) + Send + 'static) {
        self.saver.close(closed);
    }

    /// Writes the document to another file; this one stays open. Waits for the disk.
    ///
    /// # Errors
    /// [`StorageError`] where the file exists or cannot be written.
    pub fn save_copy(&self, path: &Path) -> Result<(), StorageError> {
        let (tell, told) = channel();
        self.copy_request(path, move |result| {
            // The other end waits below.
            let _ = tell.send(result);
        });
        told.recv().unwrap_or_else(|_| {
            Err(StorageError::Fault {
                message: "the saving thread ended".into(),
            })
        })
    }

    /// Has the document as it is now, with its journal, written to another file, also where this one cannot be saved
    /// or is open for reading only; returns at once. `answer` is called on the saving thread.
    pub fn copy_request(
        &self,
        path: &Path,
        answer: impl FnOnce(Result<(), StorageError>) + Send + 'static,
    ) {
        self.saver.copy(path.to_owned(), answer);
    }

    fn go_to(&mut self, moved: Option<Move>, verb: &str) -> Option<String> {
        let Move { title, network } = moved?;
        self.saver.save(&format!("{verb}: {title}"), &network, None);
        self.network = network;
        Some(title)
    }

    /// Looks again for pictures that could not be read when their targets were to be detected (a drive that was not
    /// there, a file that was moved) and says how many can be read now: the next run detects them.
    ///
    /// # Errors
    /// None at present: [`Self::saving`] tells those of saving.
    pub fn look_again_for_pictures(&mut self, monitor: &Monitor) -> Result<usize, StorageError> {
        let readable: Vec<ImageId> = self
            .network
            .used_images()
            .filter(|(_, image)| {
                image.unreadable.is_some() && self.pictures.load(image, monitor).is_ok()
            })
            .map(|(id, _)| id)
            .collect();
        if readable.is_empty() {
            return Ok(0);
        }
        self.edit("pictures are there again", |network| {
            for &id in &readable {
                network.image_mut(id).unreadable = None;
            }
            network.inputs += 1;
            Ok(readable.len())
        })
    }

    /// Takes over where pictures are now, an edit that can be undone: what was measured in them stays, for the same
    /// content is the same picture. Quick; only between two steps, as every edit.
    ///
    /// # Errors
    /// None at present: [`Self::saving`] tells those of saving.
    pub fn move_pictures(&mut self, moves: &PictureMoves) -> Result<Found, StorageError> {
        let mut network = self.network.as_ref().clone();
        let mut counts = moves.counts();
        let (mut taken, mut are_readable) = (0, false);
        for (&id, found) in &moves.found {
            let known = network.images.get(&id);
            if known.is_none_or(|image| image.file.sha256 != found.sha256) {
                continue;
            }
            let image = network.image_mut(id);
            image.file.path.clone_from(&found.path);
            are_readable |= image.unreadable.take().is_some();
            taken += 1;
        }
        counts.found = taken;
        if taken > 0 {
            // Only a picture that can be read again gives the stages something to do.
            network.inputs += u64::from(are_readable);
            let title = format!("pictures found in {}", moves.folder.display());
            self.adopt(&title, network, None);
        }
        Ok(counts)
    }

    /// Begins the next step of a stage; `None` where the stage has none, which concludes it.
    ///
    /// # Errors
    /// None at present: [`Self::saving`] tells those of saving.
    pub fn begin(&mut self, stage: Stage) -> Result<Option<Run>, StorageError> {
        let Some(step) = stage.next(&self.network) else {
            if !self.network.is_concluded(stage) && stage.missing(&self.network).is_none() {
                let network = concluded(&self.network, stage, None);
                self.adopt_conclusion(stage, network);
            }
            return Ok(None);
        };
        Ok(Some(Run {
            stage,
            title: step.title(&self.network),
            step,
            network: Arc::clone(&self.network),
            pictures: Arc::clone(&self.pictures),
        }))
    }

    /// Takes over what a run computed, and has it saved. Quick: all that can be long was done by the run.
    ///
    /// # Errors
    /// None at present: [`Self::saving`] tells those of saving.
    pub fn finish(&mut self, computed: Computed) -> Result<Finished, StorageError> {
        let Computed {
            stage,
            title,
            begun_with,
            result,
        } = computed;
        let done = Some(Outcome::Done);
        Ok(match result {
            Stepped::Interrupted => Finished::Interrupted,
            Stepped::Part(network) => {
                self.adopt(&title, network, Some(Outcome::Interrupted));
                Finished::Interrupted
            }
            Stepped::Advanced(network) => {
                self.adopt(&title, network, done);
                Finished::Advanced
            }
            Stepped::Last { network, concluded } => {
                self.adopt(&title, network, done);
                self.adopt_conclusion(stage, concluded)
            }
            Stepped::Failed {
                error,
                concluded: known,
            } => {
                // A step that failed changes nothing: what was done meanwhile stays.
                let is_same = Arc::ptr_eq(&begun_with, &self.network);
                let network = if is_same {
                    known
                } else {
                    concluded(&self.network, stage, Some(&error))
                };
                self.adopt_conclusion(stage, network)
            }
        })
    }

    fn adopt_conclusion(&mut self, stage: Stage, network: Network) -> Finished {
        let outcome = network.conclusions[&stage].outcome;
        let network = Arc::new(network);
        self.saver
            .save(&format!("{stage}: {outcome}"), &network, Some(outcome));
        // The end of a stage follows from its last step, or from the edit that left it nothing to do.
        self.history.amend(Arc::clone(&network));
        self.network = network;
        Finished::Concluded(outcome)
    }

    fn adopt(&mut self, title: &str, network: Network, outcome: Option<Outcome>) {
        let network = Arc::new(network);
        self.saver.save(title, &network, outcome);
        self.history.push(title, Arc::clone(&network));
        self.network = network;
    }
}

/// The network with the end of a stage.
fn concluded(network: &Network, stage: Stage, failure: Option<&StageError>) -> Network {
    stage.conclude(&without_former_findings(network, stage), failure)
}

/// The network without what this stage and later ones told when they ended before: they tell it again where it still
/// holds. What single steps told stays.
fn without_former_findings(network: &Network, stage: Stage) -> Network {
    let told_at_the_end = |finding: &Finding| match finding.kind {
        FindingKind::UnreadableImage
        | FindingKind::UnconnectedImage
        | FindingKind::Connectivity
        | FindingKind::ScaleBar
        | FindingKind::StageFailed => true,
        FindingKind::DoubtfulCode => {
            finding.stage != Stage::Connect && matches!(finding.about, About::Image(_))
        }
        _ => false,
    };
    let mut network = network.clone();
    if network
        .findings
        .iter()
        .any(|f| f.stage >= stage && told_at_the_end(f))
    {
        Arc::make_mut(&mut network.findings).retain(|f| f.stage < stage || !told_at_the_end(f));
    }
    network
}

/// The folder of a project file.
#[must_use]
pub fn folder_of(project: &Path) -> PathBuf {
    // The pictures lie beside the file, not beside a link to it.
    let is_link = project.is_symlink();
    let real = is_link.then(|| project.canonicalize().ok()).flatten();
    match real.as_deref().unwrap_or(project).parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent.to_owned(),
        _ => PathBuf::from("."),
    }
}
