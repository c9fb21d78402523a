//! Opening the window, and saying in one line why it cannot be opened.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;

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

/// Why there is no window.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum WindowError {
    /// There is no display: work goes on headless.
    #[error("found no display (neither DISPLAY nor WAYLAND_DISPLAY leads to one)")]
    NoDisplay,
    /// A driver or library is missing.
    #[error("the window could not start: {found}; expected the Debian packages {packages}")]
    Missing {
        /// What was found.
        found: String,
        /// Packages that provide what is missing.
        packages: &'static str,
    },
}

/// Libraries that windowing systems are reached through.
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
    let hook = std::panic::take_hook();
    std::panic::set_hook(Box::new(|_| {}));
    let started = std::sync::Arc::new(std::sync::atomic::AtomicBool::new(false));
    let flag = std::sync::Arc::clone(&started);
    let hook = std::sync::Mutex::new(Some(hook));
    let result = catch_unwind(AssertUnwindSafe(|| {
        eframe::run_native(
            "tiepoint",
            options,
            Box::new(move |creation| {
                flag.store(true, std::sync::atomic::Ordering::SeqCst);
                if let Some(hook) = hook.lock().ok().and_then(|mut hook| hook.take()) {
                    std::panic::set_hook(hook);
                }
                let app = App::new(creation, beginning)?;
                Ok(Box::new(app.remembering(state_folder())))
            }),
        )
    }));
    match result {
        Ok(Ok(())) => Ok(()),
        Ok(Err(eframe::Error::WinitEventLoop(_))) => Err(WindowError::NoDisplay),
        Ok(Err(error)) => Err(WindowError::Missing {
            found: one_line(&error.to_string()),
            packages: DRIVER_PACKAGES,
        }),
        Err(payload) if started.load(std::sync::atomic::Ordering::SeqCst) => {
            std::panic::resume_unwind(payload)
        }
        Err(payload) => {
            let said = payload
                .downcast_ref::<String>()
                .map(String::as_str)
                .or_else(|| payload.downcast_ref::<&str>().copied())
                .unwrap_or("a library is missing");
            Err(WindowError::Missing {
                found: one_line(said),
                packages: X_PACKAGES,
            })
        }
    }
}

fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}
