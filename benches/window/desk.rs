//! The window as its tests run it, with a clock.

use std::path::Path;
use std::time::{Duration, Instant};

use egui_kittest::Harness;
use tiepoint::ui::action::Action;
use tiepoint::ui::app::App;
use tiepoint::ui::window::Beginning;

/// The size of the window, points.
const SIZE: [f32; 2] = [1400.0, 900.0];

/// Nothing here lasts longer.
const PATIENCE: Duration = Duration::from_secs(600);

/// The times of one frame.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Frame {
    /// What the window computes.
    pub(crate) window: Duration,
    /// What the renderer draws and hands back.
    pub(crate) renderer: Duration,
}

/// The window with a clock.
pub(crate) struct Desk {
    pub(crate) harness: Harness<'static, App>,
}

impl Desk {
    /// An empty window.
    pub(crate) fn new() -> Self {
        let harness = Harness::builder()
            .with_size(SIZE)
            .wgpu()
            .build_eframe(|creation| App::new(creation, Beginning::Empty).expect("threads"));
        Self { harness }
    }

    pub(crate) fn app(&self) -> &App {
        self.harness.state()
    }

    pub(crate) fn apply(&mut self, action: Action) {
        let context = self.harness.ctx.clone();
        self.harness.state_mut().apply(action, &context);
    }

    /// One frame without its picture.
    pub(crate) fn step(&mut self) -> Duration {
        let begun = Instant::now();
        self.harness.step();
        begun.elapsed()
    }

    /// One frame with its picture.
    pub(crate) fn frame(&mut self) -> Frame {
        let window = self.step();
        let begun = Instant::now();
        self.harness
            .render()
            .expect("a renderer: mesa-vulkan-drivers has one");
        Frame {
            window,
            renderer: begun.elapsed(),
        }
    }

    /// Frames without pictures until something holds.
    pub(crate) fn until(&mut self, holds: impl Fn(&App) -> bool) -> Duration {
        let begun = Instant::now();
        while !holds(self.app()) {
            self.step();
            assert!(
                begun.elapsed() < PATIENCE,
                "it never came: {}",
                self.app().message()
            );
        }
        begun.elapsed()
    }

    /// Opens a project and waits until it is there.
    pub(crate) fn open(&mut self, project: &Path) {
        let name = project
            .file_name()
            .expect("a file")
            .to_string_lossy()
            .into_owned();
        self.apply(Action::Open(project.to_owned()));
        self.until(|app| app.is_idle() && app.window_title().starts_with(&name));
    }
}
