//! Runs stages on the worker, step after step, and keeps edits that come while a step is under way.
//!
//! The window, the commands and the tests use the same three calls: `session.begin`, `run.compute`, `session.finish`.

use std::sync::Arc;

use super::action::RunRequest;
use crate::monitor::{Monitor, Progress};
use crate::network::{FindingKind, Outcome, Stage};
use crate::project::edit::Edit;
use crate::project::session::{Computed, Finished, Session};
use crate::worker::{Panicked, Worker};

/// What the operator is told after an interrupt.
const INTERRUPTED: &str = "Interrupted; all finished steps are kept.";

/// What is under way.
struct Now {
    request: RunRequest,
    stage: Stage,
    title: String,
    monitor: Arc<Monitor>,
}

/// A step that ended by a fault of this program, for the operator.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "The step \"{title}\" ended by {panicked}. Nothing that was finished is lost: the project stands as it was before this step."
)]
pub struct Fault {
    /// What was under way.
    pub title: String,
    /// What happened.
    pub panicked: Panicked,
}

/// Runs stages on the worker.
pub struct Runner {
    worker: Worker<Computed>,
    now: Option<Now>,
    pending: Vec<Edit>,
    fault: Option<Fault>,
    /// Results still to come of steps that nobody waits for any more.
    forgotten: usize,
}

impl Runner {
    /// A runner with its own thread; `wake` is called whenever there is something to look at.
    ///
    /// # Errors
    /// Where the system gives no thread.
    pub fn new(wake: impl Fn() + Send + 'static) -> std::io::Result<Self> {
        Ok(Self {
            worker: Worker::new("compute", wake)?,
            now: None,
            pending: Vec::new(),
            fault: None,
            forgotten: 0,
        })
    }

    /// Whether a step is under way.
    #[must_use]
    pub fn is_running(&self) -> bool {
        self.now.is_some()
    }

    /// Whether the step under way was asked to stop.
    #[must_use]
    pub fn is_stopping(&self) -> bool {
        self.now
            .as_ref()
            .is_some_and(|now| now.monitor.is_interrupted())
    }

    /// The stage, the step and the progress of what is under way.
    #[must_use]
    pub fn progress(&self) -> Option<(Stage, &str, Progress)> {
        self.now
            .as_ref()
            .map(|now| (now.stage, now.title.as_str(), now.monitor.progress()))
    }

    /// The last fault of this program, until it is dismissed.
    #[must_use]
    pub fn fault(&self) -> Option<&Fault> {
        self.fault.as_ref()
    }

    /// The operator has seen the fault.
    pub fn dismiss_fault(&mut self) {
        self.fault = None;
    }

    /// Edits that wait for the end of the step.
    #[must_use]
    pub fn pending(&self) -> &[Edit] {
        &self.pending
    }

    /// Begins what was asked for; returns lines for the operator.
    pub fn start(&mut self, session: &mut Session, request: RunRequest) -> Vec<String> {
        if self.is_running() {
            return vec!["A step is under way; interrupt it first.".into()];
        }
        let mut lines = Vec::new();
        self.begin_next(session, request, &mut lines);
        if self.now.is_none() && lines.is_empty() {
            lines.push("Nothing is left to do on the present inputs.".into());
        }
        lines
    }

    /// Asks the step under way to stop; what is finished is kept.
    pub fn interrupt(&self) {
        if let Some(now) = &self.now {
            now.monitor.interrupt();
        }
    }

    /// Stops the step under way and forgets it: the document goes. The edits that waited for it are made; returns lines
    /// for the operator.
    pub fn forget(&mut self, session: &mut Session) -> Vec<String> {
        if let Some(now) = self.now.take() {
            now.monitor.interrupt();
            self.forgotten += 1;
        }
        self.fault = None;
        let mut lines = Vec::new();
        self.make_pending(session, &mut lines);
        lines
    }

    /// Takes back the last edit that waits.
    pub fn take_back_pending(&mut self) -> Option<Edit> {
        self.pending.pop()
    }

    /// An edit: made at once, or kept until the step under way ends.
    pub fn edit(&mut self, session: &mut Session, edit: Edit) -> Option<String> {
        if self.is_running() {
            self.pending.push(edit);
            return None;
        }
        session.apply(&edit).err().map(|error| error.to_string())
    }

    /// Takes over what the worker finished, makes the edits that waited, and begins the next step; returns lines for the
    /// operator. Called once a frame, never waits.
    pub fn poll(&mut self, session: &mut Session) -> Vec<String> {
        let mut lines = Vec::new();
        while let Some(result) = self.worker.poll() {
            if self.forgotten > 0 {
                self.forgotten -= 1;
                continue;
            }
            let Some(now) = self.now.take() else { continue };
            let go_on = match result {
                Err(panicked) => {
                    let fault = Fault {
                        title: now.title,
                        panicked,
                    };
                    lines.push(fault.to_string());
                    self.fault = Some(fault);
                    false
                }
                Ok(computed) => match session.finish(computed) {
                    Err(error) => {
                        lines.push(error.to_string());
                        false
                    }
                    Ok(Finished::Interrupted) => {
                        lines.push(INTERRUPTED.into());
                        false
                    }
                    Ok(Finished::Advanced) => now.request != RunRequest::Step,
                    Ok(Finished::Concluded(outcome)) => {
                        let reason = reason(session, now.stage, outcome);
                        lines.push(format!("{}: {outcome}{reason}", now.stage));
                        matches!(now.request, RunRequest::Until(last) if now.stage < last)
                            && outcome != Outcome::Failed
                    }
                },
            };
            self.make_pending(session, &mut lines);
            match (go_on, now.monitor.is_interrupted()) {
                (true, false) => self.begin_next(session, now.request, &mut lines),
                // The step was finished before it heard of the interrupt.
                (true, true) => lines.push(INTERRUPTED.into()),
                (false, _) => {}
            }
        }
        lines
    }

    /// Makes the edits that waited.
    fn make_pending(&mut self, session: &mut Session, lines: &mut Vec<String>) {
        for edit in std::mem::take(&mut self.pending) {
            if let Err(error) = session.apply(&edit) {
                lines.push(format!("an edit could not be made any more: {error}"));
            }
        }
    }

    /// Begins the next step of the first stage that has one.
    fn begin_next(&mut self, session: &mut Session, request: RunRequest, lines: &mut Vec<String>) {
        let last = match request {
            RunRequest::Until(stage) => stage,
            RunRequest::Step | RunRequest::Stage => Stage::Adjust,
        };
        for stage in Stage::ALL.into_iter().filter(|stage| *stage <= last) {
            match session.begin(stage) {
                Err(error) => {
                    lines.push(error.to_string());
                    return;
                }
                Ok(Some(run)) => {
                    let monitor = Arc::new(Monitor::new());
                    self.now = Some(Now {
                        request,
                        stage,
                        title: run.title().to_owned(),
                        monitor: Arc::clone(&monitor),
                    });
                    self.worker
                        .start(monitor, move |monitor| run.compute(monitor));
                    return;
                }
                Ok(None) => {
                    if let Some(missing) = stage.missing(session.network()) {
                        lines.push(format!("{stage}: {missing}"));
                        return;
                    }
                }
            }
        }
    }
}

/// Why a stage failed, behind a colon; empty where it did not.
fn reason(session: &Session, stage: Stage, outcome: Outcome) -> String {
    let failed = outcome == Outcome::Failed;
    let mut findings = session.network().findings.iter().rev();
    findings
        .find(|f| failed && f.stage == stage && f.kind == FindingKind::StageFailed)
        .map_or_else(String::new, |finding| format!(": {}", finding.text))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::network::{ImageId, ImageUse, Network};
    use std::sync::mpsc::channel;

    /// A project in a folder that goes when the test ends.
    struct Project(std::path::PathBuf);

    impl Project {
        fn new(name: &str) -> (Self, Session) {
            let name = format!("tiepoint-runner-{name}-{}", std::process::id());
            let file = std::env::temp_dir().join(name).with_extension("tiepoint");
            let session = Session::create(&file, Network::default()).expect("a project");
            (Self(file), session)
        }
    }

    impl Drop for Project {
        fn drop(&mut self) {
            let _ = std::fs::remove_file(&self.0);
        }
    }

    #[test]
    fn edits_that_wait_for_a_step_are_made_when_the_document_goes() {
        let (_project, mut session) = Project::new("goes");
        let mut runner = Runner::new(|| ()).unwrap();
        let monitor = Arc::new(Monitor::new());
        runner.now = Some(Now {
            request: RunRequest::Step,
            stage: Stage::Detect,
            title: "detect a.png".into(),
            monitor: Arc::clone(&monitor),
        });
        let mut settings = session.network().settings.as_ref().clone();
        settings.seed += 1;
        let of_no_image = Edit::UseImage {
            image: ImageId(1),
            usage: ImageUse::Excluded,
        };
        for edit in [Edit::Settings(Box::new(settings.clone())), of_no_image] {
            assert_eq!(runner.edit(&mut session, edit), None);
        }
        assert_eq!(runner.pending().len(), 2);

        let lines = runner.forget(&mut session);

        assert_eq!(*session.network().settings, settings);
        assert_eq!(lines.len(), 1, "{lines:?}");
        assert!(monitor.is_interrupted());
        assert!(!runner.is_running() && runner.pending().is_empty());
    }

    #[test]
    fn a_step_that_panics_is_told_as_our_fault_and_the_document_stands() {
        let (_project, mut session) = Project::new("panics");
        let (wake, woken) = channel();
        let mut runner = Runner::new(move || wake.send(()).expect("the test listens")).unwrap();
        let monitor = Arc::new(Monitor::new());
        runner.now = Some(Now {
            request: RunRequest::Until(Stage::Adjust),
            stage: Stage::Detect,
            title: "detect a.png".into(),
            monitor: Arc::clone(&monitor),
        });
        runner.worker.start(monitor, |_| panic!("on purpose"));
        let before = Arc::clone(session.network());

        woken.recv().unwrap();
        let lines = runner.poll(&mut session);

        let fault = runner.fault().expect("a fault").to_string();
        assert_eq!(lines, std::slice::from_ref(&fault));
        assert!(fault.contains("detect a.png") && fault.contains("on purpose"));
        assert!(fault.contains("a fault of this program") && fault.contains("Nothing"));
        assert!(!runner.is_running(), "the other stages must not begin");
        assert!(Arc::ptr_eq(&before, session.network()));
        runner.dismiss_fault();
        assert_eq!(runner.fault(), None);
        // The worker goes on.
        assert_ne!(
            runner.start(&mut session, RunRequest::Step),
            Vec::<String>::new()
        );
    }
}
