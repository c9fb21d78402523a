//! Laws of saving: nobody waits, nothing is lost, failures are told and tried again.

use std::fs;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::mpsc::channel;

use nalgebra::Vector3;
use rusqlite::Connection;

use super::*;
use crate::network::{Point, PointId};
use crate::project::session::Session;

/// A folder with a project, gone when the test ends.
struct Folder(PathBuf);

impl Folder {
    fn new() -> Self {
        static NEXT: AtomicU32 = AtomicU32::new(0);
        let number = NEXT.fetch_add(1, Ordering::Relaxed);
        let name = format!("tiepoint-saver-{}-{number}", std::process::id());
        let path = std::env::temp_dir().join(name);
        fs::create_dir_all(&path).unwrap();
        Self(path)
    }

    fn project(&self) -> PathBuf {
        self.0.join("a.tiepoint")
    }

    fn session(&self) -> Session {
        Session::create(&self.project(), Network::default()).unwrap()
    }

    /// Another program at the same database.
    fn other(&self) -> Connection {
        Connection::open(self.project()).unwrap()
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

/// What a project file holds, and what its journal tells.
fn on_disk(file: &Path) -> (Network, Vec<String>) {
    let opened = Store::open_read_only(file).unwrap();
    let told = opened.journal.into_iter().map(|entry| entry.line.what);
    (opened.network.as_ref().clone(), told.collect())
}

/// An edit that puts the first point at `x`.
fn put(session: &mut Session, title: &str, x: f64) {
    let edited: Result<(), StorageError> = session.edit(title, |network| {
        let point = Point {
            position: Vector3::new(x, 0.0, 0.0),
            covariance: None,
            rays: 2,
            circle: None,
        };
        Arc::make_mut(&mut network.points).insert(PointId::Target(1), Arc::new(point));
        Ok(())
    });
    edited.unwrap();
}

fn count_saves(connection: &Connection) -> i64 {
    connection
        .query_row("SELECT count FROM saves", [], |row| row.get(0))
        .unwrap()
}

#[test]
fn nobody_waits_for_a_disk_that_does_not_answer_and_every_line_is_kept() {
    let folder = Folder::new();
    let mut session = folder.session();
    let other = folder.other();
    other.execute_batch("BEGIN IMMEDIATE").unwrap();
    for step in 1..=5 {
        put(&mut session, &format!("step {step}"), f64::from(step));
    }
    session.undo().unwrap();
    // All of it is in the document, none of it on the disk.
    assert_eq!(session.saving(), Saving::Behind { steps: 6 });
    assert_eq!(
        session.network().points[&PointId::Target(1)].position.x,
        4.0
    );
    assert!(on_disk(&folder.project()).0 == Network::default());
    other.execute_batch("ROLLBACK").unwrap();
    session.flush().unwrap();
    assert_eq!(session.saving(), Saving::Saved);
    let (network, told) = on_disk(&folder.project());
    assert!(network == **session.network());
    let expected = [
        "step 1",
        "step 2",
        "step 3",
        "step 4",
        "step 5",
        "undo: step 5",
    ];
    assert_eq!(told, expected);
    // What was under way when the disk stopped, and all the rest at once.
    assert!((1..=2).contains(&count_saves(&other)));
}

#[test]
fn a_failure_is_told_and_tried_again() {
    let folder = Folder::new();
    let mut session = folder.session();
    let other = folder.other();
    put(&mut session, "saved", 1.0);
    session.flush().unwrap();
    let foreign = |change: &str| {
        let query = format!("UPDATE saves SET count = count {change}");
        assert_eq!(other.execute(&query, []).unwrap(), 1);
    };
    foreign("+ 7");
    put(&mut session, "first", 2.0);
    let error = session.flush().unwrap_err();
    assert!(matches!(error, StorageError::Changed { .. }), "{error}");
    assert_eq!(session.saving(), Saving::Failed(error.to_string()));
    put(&mut session, "second", 3.0);
    assert!(session.flush().is_err());
    assert_eq!(
        session.network().points[&PointId::Target(1)].position.x,
        3.0
    );
    assert_eq!(on_disk(&folder.project()).1, ["saved"]);
    foreign("- 7");
    session.flush().unwrap();
    assert_eq!(session.saving(), Saving::Saved);
    let (network, told) = on_disk(&folder.project());
    assert!(network == **session.network());
    assert_eq!(told, ["saved", "first", "second"]);
}

#[test]
fn what_cannot_be_stored_does_not_take_older_steps_with_it() {
    let folder = Folder::new();
    let mut session = folder.session();
    let other = folder.other();
    other.execute_batch("BEGIN IMMEDIATE").unwrap();
    put(&mut session, "under way", 1.0);
    put(&mut session, "good", 2.0);
    put(&mut session, "bad", f64::NAN);
    put(&mut session, "bad too", f64::INFINITY);
    other.execute_batch("ROLLBACK").unwrap();
    let error = session.flush().unwrap_err();
    assert!(error.to_string().contains("not finite"), "{error}");
    let (network, told) = on_disk(&folder.project());
    assert_eq!(network.points[&PointId::Target(1)].position.x, 2.0);
    assert_eq!(told, ["under way", "good"]);
    session.undo().unwrap();
    session.undo().unwrap();
    session.flush().unwrap();
    let told = on_disk(&folder.project()).1;
    let expected = [
        "under way",
        "good",
        "bad",
        "bad too",
        "undo: bad too",
        "undo: bad",
    ];
    assert_eq!(told, expected);
}

#[test]
fn a_session_that_is_dropped_or_closed_has_saved_all_and_given_the_file_back() {
    let folder = Folder::new();
    let mut session = folder.session();
    for step in 1..=20 {
        put(&mut session, &step.to_string(), f64::from(step));
    }
    let last = session.network().clone();
    drop(session);
    assert!(!fs::exists(folder.0.join("a.tiepoint-lock")).unwrap());
    let mut session = Session::open(&folder.project()).unwrap();
    assert!(*session.network() == last);
    put(&mut session, "21", 21.0);
    let (tell, told) = channel();
    let project = folder.project();
    session.close(move |result| {
        result.unwrap();
        tell.send(Session::open(&project).map(drop)).unwrap();
    });
    told.recv().unwrap().unwrap();
    assert_eq!(on_disk(&folder.project()).1.len(), 21);
}

#[test]
fn a_project_that_cannot_be_saved_can_be_copied_as_it_is() {
    let folder = Folder::new();
    let mut session = folder.session();
    put(&mut session, "saved", 1.0);
    session.flush().unwrap();
    folder
        .other()
        .execute_batch("UPDATE saves SET count = 99")
        .unwrap();
    put(&mut session, "not saved", 2.0);
    assert!(session.flush().is_err());
    let copy = folder.0.join("copy.tiepoint");
    let (tell, told) = channel();
    session.copy_request(&copy, move |result| tell.send(result).unwrap());
    told.recv().unwrap().unwrap();
    let (network, lines) = on_disk(&copy);
    assert!(network == **session.network());
    assert_eq!(lines, ["saved", "not saved"]);
    let again = session.save_copy(&copy);
    assert!(
        matches!(again, Err(StorageError::Exists { .. })),
        "{again:?}"
    );
}

#[test]
fn a_project_open_for_reading_says_so_and_can_be_copied_with_its_changes() {
    let folder = Folder::new();
    let file = folder.project();
    let saver = Saver::start(Target::Nowhere {
        file: file.clone(),
        read: Arc::default(),
        journal: Vec::new(),
    })
    .unwrap();
    assert_eq!(saver.saving(), Saving::Saved);
    let changed = Network {
        inputs: 3,
        ..Network::default()
    };
    saver.save("an edit", &Arc::new(changed.clone()), None);
    let error = saver.flush().unwrap_err();
    assert!(matches!(error, StorageError::ReadOnly { .. }), "{error}");
    let copy = folder.0.join("copy.tiepoint");
    let (tell, told) = channel();
    saver.copy(copy.clone(), move |result| tell.send(result).unwrap());
    told.recv().unwrap().unwrap();
    let (network, lines) = on_disk(&copy);
    assert!(network == changed);
    assert_eq!(lines, ["an edit"]);
    assert!(!fs::exists(file).unwrap());
}

#[test]
fn the_window_is_woken_when_all_is_saved() {
    let folder = Folder::new();
    let mut session = folder.session();
    let (wake, woken) = channel();
    session.on_saved(move || wake.send(()).unwrap());
    put(&mut session, "an edit", 1.0);
    woken.recv().unwrap();
    assert_eq!(session.saving(), Saving::Saved);
}

#[test]
fn a_panic_is_an_error() {
    let error = guarded(|| panic!("on purpose")).unwrap_err();
    assert_eq!(
        error.to_string(),
        "a fault of this program while saving: on purpose"
    );
}

#[test]
fn a_session_can_be_opened_on_one_thread_and_used_on_another() {
    fn can_move<T: Send + 'static>() {}
    can_move::<Session>();
}
