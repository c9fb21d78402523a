//! What the terminal shows: progress on stderr, results on stdout, failures in one line.

use std::io::{IsTerminal, Write};
use std::sync::Mutex;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use super::CommandError;
use crate::monitor::{Monitor, Progress};

/// Width of the title beside the bar, columns.
const TITLE_COLUMNS: usize = 44;

/// A monitor that shows progress on stderr: a bar on a terminal, else one line a task.
#[must_use]
pub fn monitor_on_terminal() -> Monitor {
    if std::io::stderr().is_terminal() {
        let bar = ProgressBar::with_draw_target(None, ProgressDrawTarget::stderr());
        let template = format!("{{msg:{TITLE_COLUMNS}}} {{wide_bar}} {{pos}}/{{len}} {{elapsed}}");
        if let Ok(style) = ProgressStyle::with_template(&template) {
            bar.set_style(style);
        }
        Monitor::watched(move |progress| draw(&bar, progress))
    } else {
        let last = Mutex::new(String::new());
        Monitor::watched(move |progress| {
            let mut last = last
                .lock()
                .unwrap_or_else(std::sync::PoisonError::into_inner);
            // A task that has done nothing yet may be refused in the next moment, which is one line by itself.
            if progress.done > 0 && *last != progress.title {
                last.clone_from(&progress.title);
                say(&progress.title);
            }
        })
    }
}

fn draw(bar: &ProgressBar, progress: &Progress) {
    bar.set_message(progress.title.clone());
    if progress.total > 0 {
        bar.set_length(progress.total);
    } else {
        bar.unset_length();
    }
    bar.set_position(progress.done);
    if progress.total > 0 && progress.done >= progress.total {
        bar.finish_and_clear();
        bar.reset();
    }
}

/// A line on stderr. A closed stderr is no reason to stop.
pub(super) fn say(line: &str) {
    let _ = writeln!(std::io::stderr(), "{line}");
}

/// A result on stdout.
///
/// # Errors
/// [`CommandError`] where stdout cannot be written; a reader that has gone away is not an error.
pub(super) fn show(text: &str) -> Result<(), CommandError> {
    let mut out = std::io::stdout().lock();
    let written = out.write_all(text.as_bytes()).and_then(|()| {
        if text.ends_with('\n') {
            Ok(())
        } else {
            out.write_all(b"\n")
        }
    });
    match written.and_then(|()| out.flush()) {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(CommandError::work(format!("standard output: {error}")))
        }
        _ => Ok(()),
    }
}

/// A remark in one line on stderr.
pub fn report(line: &str) {
    say(&format!("tiepoint: {line}"));
}

/// A failure in one line on stderr.
pub fn report_failure(error: &CommandError) {
    say(&format!("tiepoint: {}", error.line));
}
