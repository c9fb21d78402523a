//! Opening the window, and saying in one line why it cannot be opened.

use std::panic::{AssertUnwindSafe, PanicHookInfo, catch_unwind, resume_unwind, set_hook};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::channel;
use std::sync::{Arc, Mutex, PoisonError};

use eframe::egui;

use super::app::App;
use crate::commands::DemoRequest;
use crate::project::recent::state_folder;

/// What the window begins with.
#[derive(Clone, Debug, Default)]
pub enum Beginning {
    /// An empty window.
    #[default]
    Empty,
    /// This project.
    Project(PathBuf),
    /// The demo, which is rendered and measured at once before the operator's eyes.
    Demo(DemoRequest),
}

/// Why there is no window, or what was lost with it.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum WindowError {
    /// There is no display: work goes on headless.
    #[error("found no display (neither DISPLAY nor WAYLAND_DISPLAY leads to one)")]
    NoDisplay,
    /// A driver or library is missing.
    #[error("the window could not start: {found}; expected what Debian has in {packages}")]
    Missing {
        /// What was found.
        found: String,
        /// Packages that provide what is missing.
        packages: &'static str,
    },
    /// Something else is wrong.
    #[error("the window could not start: {0}")]
    Failed(String),
    /// The window is closed, but what was done last could not be saved.
    #[error("{0}")]
    NotSaved(String),
}

/// Libraries through which X is reached, and the Debian packages that hold them.
const X_LIBRARIES: [(&str, &str); 6] = [
    ("libX11-xcb", "libx11-xcb1"),
    ("libX11", "libx11-6"),
    ("libXcursor", "libxcursor1"),
    ("libXi", "libxi6"),
    ("libxkbcommon-x11", "libxkbcommon-x11-0"),
    ("libxkbcommon", "libxkbcommon0"),
];

/// All of them, where the message names none.
const X_PACKAGES: &str = "libx11-6 libx11-xcb1 libxcursor1 libxi6 libxkbcommon-x11-0";

/// Drivers that draw.
const DRIVER_PACKAGES: &str = "mesa-vulkan-drivers, or libegl1 and libgl1-mesa-dri";

/// Opens the window and returns when it is closed.
///
/// # Errors
/// [`WindowError`].
pub fn open(beginning: Beginning) -> Result<(), WindowError> {
    let displays = ["DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET"];
    if cfg!(target_os = "linux")
        && displays
            .iter()
            .all(|name| std::env::var_os(name).is_none_or(|v| v.is_empty()))
    {
        return Err(WindowError::NoDisplay);
    }
    let options = eframe::NativeOptions {
        viewport: egui::ViewportBuilder::default()
            .with_title("Tiepoint")
            .with_inner_size([1400.0, 900.0])
            .with_min_inner_size([800.0, 500.0])
            .with_drag_and_drop(true),
        ..eframe::NativeOptions::default()
    };
    // A missing library of the X keyboard is a panic in a dependency; a printed backtrace would say nothing to anybody.
    let usual = Arc::new(Mutex::new(Some(std::panic::take_hook())));
    std::panic::set_hook(Box::new(|_| {}));
    let started = Arc::new(AtomicBool::new(false));
    let (flag, hook) = (Arc::clone(&started), Arc::clone(&usual));
    let (last_words, told) = channel();
    let result = catch_unwind(AssertUnwindSafe(|| {
        eframe::run_native(
            "tiepoint",
            options,
            Box::new(move |creation| {
                flag.store(true, Ordering::SeqCst);
                put_back(&hook);
                let app = App::new(creation, beginning)?;
                let app = app.remembering(state_folder()).telling(last_words);
                Ok(Box::new(app))
            }),
        )
    }));
    put_back(&usual);
    match result {
        Ok(Ok(())) => told
            .try_recv()
            .map_or(Ok(()), |line| Err(WindowError::NotSaved(line))),
        Ok(Err(error)) => Err(reason(&error)),
        Err(payload) if started.load(Ordering::SeqCst) => resume_unwind(payload),
        Err(payload) => {
            let said = payload.downcast_ref::<String>().map(String::as_str);
            let said = said.or_else(|| payload.downcast_ref::<&str>().copied());
            Err(missing_library(said.unwrap_or("a library is missing")))
        }
    }
}

type Hook = Box<dyn Fn(&PanicHookInfo<'_>) + Send + Sync>;

/// From here on a panic is printed again.
fn put_back(hook: &Mutex<Option<Hook>>) {
    if let Some(hook) = hook.lock().unwrap_or_else(PoisonError::into_inner).take() {
        set_hook(hook);
    }
}

/// What the window's maker says, in our words.
fn reason(error: &eframe::Error) -> WindowError {
    match error {
        // The same error stands for "no display" and for "no library to reach one", and which library is missing is
        // told only in its full form.
        eframe::Error::WinitEventLoop(error) => {
            let said = format!("{error:?}");
            match said.contains("LibraryOpenError") {
                true => missing_library(&said),
                false => WindowError::NoDisplay,
            }
        }
        eframe::Error::Wgpu(_) => WindowError::Missing {
            found: "found no Vulkan or OpenGL driver that draws in a window".into(),
            packages: DRIVER_PACKAGES,
        },
        other => WindowError::Failed(one_line(&other.to_string())),
    }
}

fn missing_library(said: &str) -> WindowError {
    let known = X_LIBRARIES
        .iter()
        .find(|(library, _)| said.contains(&format!("{library}.so")));
    match known {
        Some((library, package)) => WindowError::Missing {
            found: format!("found no usable {library}.so"),
            packages: package,
        },
        None => WindowError::Missing {
            found: one_line(said),
            packages: X_PACKAGES,
        },
    }
}

fn one_line(text: &str) -> String {
    let words: Vec<&str> = text.split_whitespace().collect();
    words.join(" ").trim_end_matches('.').to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_missing_library_is_told_by_its_package() {
        for (said, package) in [
            (
                "opening library failed (libX11.so.6: cannot open shared object file)",
                "libx11-6",
            ),
            (
                "opening library failed (libX11-xcb.so.1: file too short)",
                "libx11-xcb1",
            ),
            (
                "Library libxkbcommon-x11.so could not be loaded.",
                "libxkbcommon-x11-0",
            ),
            (
                "Library libxkbcommon.so could not be loaded.",
                "libxkbcommon0",
            ),
            ("something else\nis missing.", X_PACKAGES),
        ] {
            let line = missing_library(said).to_string();
            assert!(line.ends_with(&format!(" {package}")), "{line}");
            assert_eq!(line.lines().count(), 1);
        }
    }
}
