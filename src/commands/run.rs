//! `run`: the stages, headless.

use std::path::Path;
use std::time::Instant;

use super::terminal::{say, show};
use super::{CommandError, Form, open_to_change};
use crate::monitor::Monitor;
use crate::network::{Connectivity, FindingKind, Outcome, Stage};
use crate::project::session::{Finished, Session};
use crate::report::{RunSummary, StageRun, connectivity_table};

/// Runs the stages of a project up to and including one.
///
/// # Errors
/// [`CommandError`]: the project cannot be opened, a stage cannot be done, or it was interrupted.
pub fn run(
    project: &Path,
    until: Stage,
    form: Form,
    monitor: &Monitor,
) -> Result<(), CommandError> {
    let mut session = open_to_change(project)?;
    let found = session.look_again_for_pictures(monitor)?;
    session.flush()?;
    if found > 0 {
        say(&format!(
            "{found} pictures that could not be read before are there"
        ));
    }
    let runs = measure(&mut session, until, monitor)?;
    let network = session.network();
    let summary = RunSummary::new(network, &runs);
    match form {
        Form::Json => {
            let json = serde_json::to_string_pretty(&summary)
                .map_err(|e| CommandError::work(format!("result as JSON: {e}")))?;
            show(&json)?;
        }
        Form::Text => {
            if until == Stage::Detect {
                show(&connectivity_table(network, &Connectivity::of(network)))?;
            }
            show(&summary.text())?;
        }
    }
    let last = runs.last();
    if last.is_some_and(|run| run.outcome == Outcome::Interrupted) {
        return Err(CommandError::interrupted_between_steps());
    }
    match last {
        Some(StageRun {
            stage,
            outcome: Outcome::Failed,
            ..
        }) => {
            let reason = network
                .findings
                .iter()
                .rev()
                .find(|f| f.stage == *stage && f.kind == FindingKind::StageFailed)
                .map_or_else(
                    || stage.missing(network).unwrap_or_default(),
                    |f| f.text.clone(),
                );
            Err(CommandError::work(format!(
                "{}: {stage}: {reason}",
                project.display()
            )))
        }
        _ => Ok(()),
    }
}

/// Runs the stages up to and including `until` and says how each ended; stops where one failed or was interrupted.
///
/// # Errors
/// [`CommandError`] where the project cannot be saved.
pub fn measure(
    session: &mut Session,
    until: Stage,
    monitor: &Monitor,
) -> Result<Vec<StageRun>, CommandError> {
    let mut runs = Vec::new();
    for stage in Stage::ALL.into_iter().filter(|stage| *stage <= until) {
        let begun = Instant::now();
        let mut outcome = None;
        while let Some(run) = session.begin(stage)? {
            let finished = session.finish(run.compute(monitor))?;
            // What is told to be done is on the disk.
            session.flush()?;
            match finished {
                Finished::Advanced => {}
                Finished::Concluded(end) => {
                    outcome = Some(end);
                    break;
                }
                Finished::Interrupted => {
                    outcome = Some(Outcome::Interrupted);
                    break;
                }
            }
        }
        session.flush()?;
        let concluded = session.network().conclusions.get(&stage).map(|c| c.outcome);
        let outcome = outcome.or(concluded).unwrap_or(Outcome::Failed);
        let seconds = begun.elapsed().as_secs_f64();
        say(&format!("{stage}: {outcome} ({seconds:.1} s)"));
        runs.push(StageRun {
            stage,
            seconds,
            outcome,
        });
        if matches!(outcome, Outcome::Failed | Outcome::Interrupted) {
            break;
        }
    }
    Ok(runs)
}
