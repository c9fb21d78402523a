//! The program in its window, as a user meets it: on an X server without a screen, driven by keys and pointer.
#![allow(dead_code, reason = "every program uses its own part")]

use std::fs::{File, read_to_string};
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

/// How long anything is waited for before it counts as never coming; a busy machine draws one frame in a second.
const PATIENCE: Duration = Duration::from_secs(120);

/// How often is looked.
const PAUSE: Duration = Duration::from_millis(10);

/// An X server without a screen; it ends with this value.
pub(crate) struct Screen {
    server: Child,
    name: String,
}

impl Drop for Screen {
    fn drop(&mut self) {
        let _ = self.server.kill();
        let _ = self.server.wait();
    }
}

impl Screen {
    /// Starts the server on a free number; the reason where there is none.
    pub(crate) fn start() -> Result<Self, String> {
        if Command::new("xdotool").arg("version").output().is_err() {
            return Err("found no xdotool".into());
        }
        let mut server = Command::new("Xvfb")
            .args([
                "-displayfd",
                "1",
                "-screen",
                "0",
                "1600x1000x24",
                "-nolisten",
                "tcp",
                // Else it starts anew, and refuses who comes then, whenever the last of its clients goes.
                "-noreset",
            ])
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .map_err(|e| format!("found no Xvfb: {e}"))?;
        let mut number = String::new();
        let told = server
            .stdout
            .take()
            .map(|out| BufReader::new(out).read_line(&mut number));
        let screen = Self {
            server,
            name: format!(":{}", number.trim()),
        };
        match told {
            Some(Ok(length)) if length > 0 => Ok(screen),
            _ => Err("Xvfb does not start".into()),
        }
    }

    fn xdotool(&self, arguments: &[&str]) -> Option<String> {
        let output = Command::new("xdotool")
            .args(arguments)
            .env("DISPLAY", &self.name)
            .stdin(Stdio::null())
            .output()
            .expect("xdotool was there before");
        output
            .status
            .success()
            .then(|| String::from_utf8_lossy(&output.stdout).trim().to_owned())
    }

    /// Opens the window on a project in its folder.
    pub(crate) fn open(&self, folder: &Path, project: &str) -> Window<'_> {
        let said = folder.join("window.txt");
        let program = Command::new(env!("CARGO_BIN_EXE_tiepoint"))
            .arg(project)
            .current_dir(folder)
            .env("DISPLAY", &self.name)
            .env("WGPU_BACKEND", "vulkan")
            .env("XDG_RUNTIME_DIR", folder)
            .env("XDG_STATE_HOME", folder)
            .env_remove("WAYLAND_DISPLAY")
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(File::create(&said).expect("a file in the folder"))
            .spawn()
            .expect("the program starts");
        let mut window = Window {
            said,
            screen: self,
            program,
            id: String::new(),
        };
        window.wait("a window", |window| {
            let found = window
                .screen
                .xdotool(&["search", "--onlyvisible", "--name", "Tiepoint"]);
            window.id = found
                .unwrap_or_default()
                .lines()
                .next()
                .unwrap_or_default()
                .to_owned();
            !window.id.is_empty()
        });
        let id = window.id.clone();
        window.wait("the keyboard", |window| {
            window
                .screen
                .xdotool(&["windowfocus", "--sync", &id])
                .is_some()
        });
        window.wait("the project", |window| window.title().starts_with(project));
        window
    }
}

/// The program in its window; it is killed with this value.
pub(crate) struct Window<'a> {
    screen: &'a Screen,
    program: Child,
    id: String,
    /// What it writes to stderr.
    said: PathBuf,
}

impl Drop for Window<'_> {
    fn drop(&mut self) {
        self.kill();
    }
}

impl Window<'_> {
    /// What its frame says.
    pub(crate) fn title(&self) -> String {
        self.screen
            .xdotool(&["getwindowname", &self.id])
            .unwrap_or_default()
    }

    /// How many steps and edits it says to be on the disk.
    pub(crate) fn saved(&self) -> u64 {
        let title = self.title();
        let figure = title
            .split(" - ")
            .find_map(|part| part.strip_suffix(" saved")?.parse().ok());
        figure.unwrap_or(0)
    }

    /// Presses keys, as xdotool names them, one after the other.
    pub(crate) fn press(&self, keys: &[&str]) {
        for key in keys {
            self.screen.xdotool(&["key", key]);
        }
    }

    /// Types a text.
    pub(crate) fn write(&self, text: &str) {
        self.screen.xdotool(&["type", "--delay", "20", text]);
    }

    /// Moves the pointer to a place of the window.
    pub(crate) fn point_at(&self, x: u32, y: u32) {
        self.screen.xdotool(&[
            "mousemove",
            "--window",
            &self.id,
            &x.to_string(),
            &y.to_string(),
        ]);
    }

    /// Waits until something holds.
    #[track_caller]
    pub(crate) fn wait(&mut self, what: &str, mut holds: impl FnMut(&mut Self) -> bool) {
        let begun = Instant::now();
        while !holds(self) {
            if let Ok(Some(status)) = self.program.try_wait() {
                let said = read_to_string(&self.said).unwrap_or_default();
                panic!("the program ended ({status}) while {what} was waited for: {said}");
            }
            let title = self.title();
            assert!(
                begun.elapsed() < PATIENCE,
                "waited for {what}, the window says: {title}"
            );
            sleep(PAUSE);
        }
    }

    /// Kills it as a power cut would.
    pub(crate) fn kill(&mut self) {
        let _ = self.program.kill();
        let _ = self.program.wait();
    }
}
