//! Several writers and readers, and processes that are killed.

use std::io::{BufRead, BufReader, Lines, Write};
use std::process::{Child, ChildStderr, Command, Stdio};

use super::*;

#[test]
fn a_second_writer_is_refused_and_a_reader_is_not() {
    let folder = Folder::new();
    let file = folder.file("a.tiepoint");
    let mut store = Store::create(&file, &ordinary()).unwrap();
    let (before, mut after) = (ordinary(), ordinary().as_ref().clone());
    after.inputs = 1;
    let line = refusal(Store::open(&file));
    let process = std::process::id();
    let expected = format!("a.tiepoint is open in another Tiepoint (process {process})");
    assert!(line.ends_with(&expected), "{line}");
    assert_eq!(Store::open_read_only(&file).unwrap().network, before);
    store.save(&after, None).unwrap();
    assert_eq!(*Store::open_read_only(&file).unwrap().network, after);
    #[cfg(unix)]
    {
        let link = folder.file("link");
        std::os::unix::fs::symlink(&file, &link).unwrap();
        assert!(refusal(Store::open(&link)).contains("is open in another Tiepoint"));
    }
    drop(store);
    assert_eq!(*opened(&file).1, after);
}

#[test]
fn a_foreign_change_stops_the_next_save() {
    let folder = Folder::new();
    let file = folder.file("a.tiepoint");
    let mut network = ordinary().as_ref().clone();
    let mut store = Store::create(&file, &network).unwrap();
    network.inputs = 1;
    store.save(&network, None).unwrap();
    // As where the lock does not reach: a network drive with two machines.
    fs::remove_file(folder.file("a.tiepoint-lock")).unwrap();
    let (mut other, mut theirs) = opened(&file);
    Arc::make_mut(&mut theirs).next_target = 99;
    other.save(&theirs, None).unwrap();
    network.inputs = 2;
    let error = store.save(&network, None).unwrap_err();
    assert!(matches!(error, StorageError::Changed { .. }), "{error}");
    drop((store, other));
    assert_eq!(opened(&file).1, theirs);
}

#[test]
fn files_copied_while_a_project_is_open_hold_the_last_save() {
    let folder = Folder::new();
    let file = folder.file("a.tiepoint");
    let mut network = ordinary().as_ref().clone();
    let mut store = Store::create(&file, &network).unwrap();
    for inputs in 1..5 {
        network.inputs = inputs;
        store.save(&network, None).unwrap();
        let copy = folder.file(&format!("copy{inputs}"));
        fs::copy(&file, &copy).unwrap();
        let wal = folder.file("a.tiepoint-wal");
        fs::copy(wal, folder.file(&format!("copy{inputs}-wal"))).unwrap();
        assert_eq!(*opened(&copy).1, network);
        assert!(!folder.names().contains(&format!("copy{inputs}-wal")));
    }
}

/// Not a test by itself: the other process of the tests below, which saves until it is killed.
#[test]
fn child_saves_until_killed() {
    let Some(file) = std::env::var_os("TIEPOINT_TEST_PROJECT") else {
        return;
    };
    let (mut store, mut network) = opened(Path::new(&file));
    let endless = std::iter::successors(Some(network.inputs), |n| Some(n + 1));
    for inputs in endless {
        Arc::make_mut(&mut network).inputs = inputs;
        let network = Arc::make_mut(&mut network);
        for point in Arc::make_mut(&mut network.points).values_mut() {
            Arc::make_mut(point).position.x = inputs as f64;
        }
        store.save(network, None).unwrap();
        writeln!(std::io::stderr(), "saved {inputs}").unwrap();
    }
}

/// Another process that saves a project.
struct Saving {
    process: Child,
    /// Kept open: a process that nobody listens to would end by itself.
    says: Lines<BufReader<ChildStderr>>,
}

impl Saving {
    fn start(file: &Path) -> Self {
        let mut process = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "--nocapture"])
            .arg("project::storage::tests::writers::child_saves_until_killed")
            .env("TIEPOINT_TEST_PROJECT", file)
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let says = BufReader::new(process.stderr.take().unwrap()).lines();
        Self { process, says }
    }

    /// The number of the last of its next few saves.
    fn after(&mut self, saves: usize) -> u64 {
        let lines = self.says.by_ref().map(Result::unwrap);
        let numbers = lines.filter_map(|line| {
            let (_, number) = line.rsplit_once("saved ")?;
            number.parse().ok()
        });
        numbers.take(saves).last().expect("the other process saves")
    }
}

#[test]
fn a_killed_process_leaves_its_last_save_and_no_lock() {
    let folder = Folder::new();
    let file = folder.file("a.tiepoint");
    let mut network = ordinary().as_ref().clone();
    network.inputs = 0;
    drop(Store::create(&file, &network).unwrap());
    for saves in [1, 2, 7, 12] {
        let mut child = Saving::start(&file);
        let last = child.after(saves);
        let expected = format!(
            "is open in another Tiepoint (process {})",
            child.process.id()
        );
        assert!(refusal(Store::open(&file)).ends_with(&expected));
        assert!(Store::open_read_only(&file).unwrap().network.inputs >= last);
        child.process.kill().unwrap();
        child.process.wait().unwrap();
        let (_store, loaded) = opened(&file);
        assert!(loaded.inputs >= last);
        let one_save = |p: &Arc<Point>| p.position.x == loaded.inputs as f64;
        assert!(loaded.points.values().all(one_save));
    }
    assert_eq!(folder.names(), ["a.tiepoint"]);
}

#[test]
fn a_store_can_move_to_a_thread_that_saves() {
    fn can_move<T: Send + 'static>() {}
    can_move::<Store>();
}
