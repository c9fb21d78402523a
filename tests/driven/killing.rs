//! The window killed at random moments: what it said to be saved must be in the file, and the work goes on from there.

use std::fmt;
use std::thread::sleep;
use std::time::{Duration, Instant};

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tiepoint::network::Source;
use tiepoint::project::storage::{Opened, Store};

use super::common::{Folder, NEW};
use super::driven::{Screen, Window};

const PROJECT: &str = "p.tiepoint";

/// What came of it.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Killed {
    /// Kills while stages ran or were to run.
    pub(crate) in_stages: usize,
    /// Kills while the operator edited.
    pub(crate) in_edits: usize,
    /// Measurements that went to their end over one or more kills.
    pub(crate) measured: usize,
    /// Steps and edits that the window said to be saved before it was killed.
    pub(crate) said: u64,
    /// Those of them that were not in the file.
    pub(crate) lost: u64,
}

impl fmt::Display for Killed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{} kills in stages, {} in edits; of {} steps and edits shown as saved {} were lost; {} measurements went on \
             to the digits of an undisturbed run",
            self.in_stages, self.in_edits, self.said, self.lost, self.measured
        )
    }
}

/// The journal of a project: what was done and how it ended.
fn journal(folder: &Folder) -> Vec<(String, String)> {
    let Opened {
        journal, warnings, ..
    } = opened(folder);
    assert_eq!(
        warnings,
        Vec::<String>::new(),
        "a killed window leaves a whole file"
    );
    journal
        .into_iter()
        .map(|entry| (entry.line.what, entry.line.outcome))
        .collect()
}

fn opened(folder: &Folder) -> Opened {
    Store::open(&folder.at(PROJECT)).expect("a killed window leaves a project that can be opened")
}

fn fresh(name: &str) -> Folder {
    let folder = Folder::with_scene(name);
    folder.run(&NEW).done();
    folder
}

fn points(folder: &Folder) -> String {
    folder
        .run(&["export", PROJECT, "--points", "points.csv"])
        .done();
    folder.text("points.csv")
}

/// Kills the window `kills` times while stages run and compares the end with that of a run that nothing disturbed.
pub(crate) fn kill_in_stages(screen: &Screen, kills: usize, seed: u64) -> Killed {
    let undisturbed = fresh("undisturbed");
    let lasted = measure(screen, &undisturbed);
    let expected = (journal(&undisturbed), points(&undisturbed));
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut killed = Killed::default();
    let mut folder = fresh("killed");
    while killed.in_stages < kills {
        let before = journal(&folder).len() as u64;
        let mut window = screen.open(folder.path(), PROJECT);
        window.press(&["ctrl+F5"]);
        let moment = lasted.mul_f64(random.random_range(0.0..0.5));
        let begun = Instant::now();
        let mut said = window.saved();
        while begun.elapsed() < moment {
            said = window.saved();
        }
        window.kill();
        killed.in_stages += 1;
        killed.said += said;
        let after = journal(&folder);
        killed.lost += (before + said).saturating_sub(after.len() as u64);
        assert_eq!(
            after,
            expected.0[..after.len().min(expected.0.len())],
            "no step is done twice or left out"
        );
        if after.len() == expected.0.len() || killed.in_stages == kills {
            folder.run(&["run", PROJECT]).done();
            assert_eq!(
                journal(&folder),
                expected.0,
                "no step is done twice or left out"
            );
            assert_eq!(
                points(&folder),
                expected.1,
                "the result does not know of the kills"
            );
            killed.measured += 1;
            folder = fresh("killed");
        }
    }
    killed
}

/// Measures in the window without a disturbance; says how long it took.
fn measure(screen: &Screen, folder: &Folder) -> Duration {
    let mut window = screen.open(folder.path(), PROJECT);
    let begun = Instant::now();
    window.press(&["ctrl+F5"]);
    window.wait("the end", |window| window.title().contains("adjust done"));
    let lasted = begun.elapsed();
    window.wait("all saved", |window| window.saved() > 0);
    lasted
}

/// Kills the window `kills` times while the operator rejects and restores targets: what was shown as saved is there.
pub(crate) fn kill_in_edits(screen: &Screen, kills: usize, seed: u64) -> Killed {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut killed = Killed::default();
    let folder = Folder::with_measured("edited");
    for _ in 0..kills {
        let before = journal(&folder).len() as u64;
        let mut window = screen.open(folder.path(), PROJECT);
        // A step that was begun at the last kill may have left the plain targets to be identified anew.
        if !window.title().contains("adjust done") {
            window.press(&["ctrl+F5"]);
            window.wait("the targets", |window| {
                window.title().contains("adjust done")
            });
        }
        let edits = random.random_range(1..6);
        for _ in 0..edits {
            let key = ["x", "r"][random.random_range(0..2)];
            edit(&mut window, &mut random, key);
        }
        // The last edit may be anywhere between the key and the disk.
        window.press(&[["ctrl+z", "x", "r", "F5"][random.random_range(0..4)]]);
        sleep(Duration::from_millis(random.random_range(0..150)));
        let said = window.saved();
        let state = window.title();
        window.kill();
        killed.in_edits += 1;
        killed.said += said;
        let after = journal(&folder);
        killed.lost += (before + said).saturating_sub(after.len() as u64);
        assert!(after.len() as u64 >= before + edits, "{state}");
        let by_hand = opened(&folder)
            .network
            .images
            .values()
            .flat_map(|image| image.labels.values())
            .filter(|label| label.source == Source::Operator)
            .count();
        assert!(by_hand > 0, "the operator's decisions are in the document");
    }
    folder.run(&["run", PROJECT]).done();
    killed
}

/// The middle of the first image panel of the window as it opens.
const PANEL: [u32; 2] = [457, 355];

/// Rejects or restores a random target in the first image panel, as an operator does who looks before the next key, and
/// waits until it is saved; takes another target where this one has no dot in that image, or the machine was slower.
fn edit(window: &mut Window<'_>, random: &mut ChaCha8Rng, key: &str) {
    const LOOK: Duration = Duration::from_millis(250);
    const PATIENCE: Duration = Duration::from_secs(3);
    let saved = window.saved();
    window.wait("the edit to be saved", |window| {
        // A pointer that rests where the last window left it is never told to this one.
        window.point_at(PANEL[0] + 5, PANEL[1]);
        window.point_at(PANEL[0], PANEL[1]);
        window.press(&["Escape", "ctrl+k"]);
        sleep(LOOK);
        window.write(&format!("point M{}", random.random_range(1..30)));
        window.press(&["Return"]);
        sleep(LOOK);
        window.press(&[key]);
        let begun = Instant::now();
        while window.saved() == saved && begun.elapsed() < PATIENCE {
            sleep(LOOK / 10);
        }
        window.saved() > saved
    });
}
