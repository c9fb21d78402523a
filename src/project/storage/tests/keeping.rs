//! What was saved comes back, and nothing else is written.

use proptest::prelude::*;
use rusqlite::Connection;

use super::super::{JournalLine, Saved, utc_text};
use super::*;
use crate::geometry::{AxisOrder, Similarity, ThreeTwoOne};

/// Numbers that JSON readers get wrong, and any other finite ones.
fn finite() -> impl Strategy<Value = f64> {
    prop_oneof![
        any::<u64>()
            .prop_map(f64::from_bits)
            .prop_filter("finite", |v| v.is_finite()),
        prop::sample::select(vec![
            -0.0,
            5e-324,
            -2.225_073_858_507_201e-308,
            1e308,
            f64::MAX,
            f64::MIN,
            f64::EPSILON,
            0.1 + 0.2,
            9_007_199_254_740_993.0,
        ]),
        -1e4..1e4,
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn every_number_comes_back_to_the_bit(numbers in prop::collection::vec(finite(), 211)) {
        let folder = Folder::new();
        let file = folder.file("a.tiepoint");
        let mut endless = numbers.iter().copied().cycle();
        let saved = network(2, || endless.next().unwrap());
        drop(Store::create(&file, &saved).unwrap());
        let (_store, loaded) = opened(&file);
        prop_assert_eq!(&saved, loaded.as_ref());
        // `Debug` writes the shortest text that means this very number, and tells -0.0 from 0.0.
        prop_assert_eq!(format!("{saved:?}"), format!("{loaded:?}"));
    }
}

#[test]
fn a_save_writes_only_what_changed() {
    let folder = Folder::new();
    let file = folder.file("a.tiepoint");
    drop(Store::create(&file, &ordinary()).unwrap());
    let (mut store, first) = opened(&file);
    assert_eq!(store.save(&first, None).unwrap(), Saved::default());

    let mut moved = first.as_ref().clone();
    for id in 0..3 {
        let station = moved.image_mut(ImageId(id)).station.as_mut();
        station.unwrap().pose.centre_in_world.x += 1.0;
    }
    let only_images = Saved {
        rows_written: 3,
        rows_deleted: 0,
    };
    assert_eq!(store.save(&moved, None).unwrap(), only_images);
    assert_eq!(store.save(&moved, None).unwrap(), Saved::default());

    let mut fewer = moved.clone();
    Arc::make_mut(&mut fewer.images).remove(&ImageId(1));
    Arc::make_mut(&mut fewer.points).remove(&PointId::Target(7));
    fewer.adjustment = None;
    fewer.image_mut(ImageId(0)).detections = None;
    let image = fewer.image_mut(ImageId(0));
    image.labels = Arc::default();
    image.set_aside = Arc::default();
    image.unlabelled = Arc::default();
    image.rejected_dots = Arc::default();
    // Image 0 is written; its detections and marks, the three rows of image 1, a point and the adjustment go.
    let expected = Saved {
        rows_written: 1,
        rows_deleted: 7,
    };
    assert_eq!(store.save(&fewer, None).unwrap(), expected);
    drop(store);
    let (mut store, loaded) = opened(&file);
    assert_eq!(*loaded, fewer);

    // Back to the first, as an undo does.
    store.save(&first, None).unwrap();
    drop(store);
    assert_eq!(opened(&file).1, first);
}

#[test]
fn a_project_at_rest_is_one_file() {
    let folder = Folder::new();
    let file = folder.file("a.tiepoint");
    let network = ordinary();
    let mut store = Store::create(&file, &network).unwrap();
    assert_eq!(folder.names(), ["a.tiepoint", "a.tiepoint-lock"]);
    let mut changed = network.as_ref().clone();
    changed.inputs = 5;
    store.save(&changed, None).unwrap();
    assert!(folder.names().contains(&"a.tiepoint-wal".into()));
    drop(store);
    assert_eq!(folder.names(), ["a.tiepoint"]);
    let before = fs::read(&file).unwrap();
    let read = Store::open_read_only(&file).unwrap();
    assert_eq!(*read.network, changed);
    drop(opened(&file));
    assert_eq!(folder.names(), ["a.tiepoint"]);
    assert!(fs::read(&file).unwrap() == before, "opening writes nothing");
}

#[test]
fn the_journal_is_kept() {
    let folder = Folder::new();
    let file = folder.file("a.tiepoint");
    let network = ordinary();
    let line = |what: &str, sigma0| JournalLine {
        utc: utc_text(std::time::UNIX_EPOCH),
        what: what.into(),
        settings: "{}".into(),
        outcome: "done".into(),
        sigma0,
    };
    let mut store = Store::create(&file, &network).unwrap();
    store.save(&network, Some(&line("detect", None))).unwrap();
    store
        .save(&network, Some(&line("adjust", Some(0.1 + 0.2))))
        .unwrap();
    let refused = store.save(&network, Some(&line("adjust", Some(f64::NAN))));
    assert!(refused.unwrap_err().to_string().contains("sigma0: NaN"));
    let journal = store.journal().unwrap();
    let expected = [line("detect", None), line("adjust", Some(0.1 + 0.2))];
    assert!(journal.iter().map(|entry| &entry.line).eq(&expected));
    assert_eq!(journal[1].sequence, 2);
    drop(store);
    assert_eq!(Store::open_read_only(&file).unwrap().journal, journal);
}

#[test]
fn a_number_that_is_not_finite_is_refused_with_its_row() {
    let folder = Folder::new();
    let file = folder.file("a.tiepoint");
    let network = ordinary();
    let mut store = Store::create(&file, &network).unwrap();
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let mut broken = network.as_ref().clone();
        broken.inputs = 1;
        let station = broken.image_mut(ImageId(2)).station.as_mut().unwrap();
        station.pose.centre_in_world.y = bad;
        let error = store.save(&broken, None).unwrap_err().to_string();
        let expected = format!(
            "images 2 cannot be stored: found a number that is not finite, centre_in_world: {bad:?}"
        );
        assert!(error.contains(&expected), "{error}");
        // An optional number would become `null` and come back as none.
        let mut broken = network.as_ref().clone();
        Arc::make_mut(&mut broken.control)[0].sigmas_mm[2] = Some(bad);
        let error = store.save(&broken, None).unwrap_err().to_string();
        assert!(error.contains("document control"), "{error}");
        let other = folder.file("b.tiepoint");
        assert!(Store::create(&other, &broken).is_err() && !other.exists());
    }
    drop(store);
    assert_eq!(opened(&file).1, network);
}

#[test]
fn a_project_is_never_overwritten() {
    let folder = Folder::new();
    let file = folder.file("a.tiepoint");
    fs::write(&file, "letter").unwrap();
    let error = Store::create(&file, &Network::default()).unwrap_err();
    assert!(matches!(error, StorageError::Exists { .. }));
    assert_eq!(fs::read(&file).unwrap(), b"letter");
    assert_eq!(folder.names(), ["a.tiepoint"]);
}

#[test]
fn a_copy_holds_everything_and_finds_its_pictures() {
    let folder = Folder::new();
    let file = folder.file("a.tiepoint");
    let network = ordinary();
    let mut store = Store::create(&file, &network).unwrap();
    let line = JournalLine {
        what: "detect".into(),
        ..JournalLine::default()
    };
    store.save(&network, Some(&line)).unwrap();
    let beside = folder.file("b.tiepoint");
    store.save_copy(&beside).unwrap();
    let copy = Store::open(&beside).unwrap();
    assert_eq!(copy.network, network);
    assert_eq!(copy.journal, store.journal().unwrap());
    assert!(matches!(
        store.save_copy(&beside),
        Err(StorageError::Exists { .. })
    ));
    fs::create_dir(folder.file("deep")).unwrap();
    let deep = folder.file("deep/c.tiepoint");
    store.save_copy(&deep).unwrap();
    let (_, copied) = opened(&deep);
    let path = &copied.images[&ImageId(1)].file.path;
    assert_eq!(path, "../pictures/IMG 1.png");
}

/// The frame came later: files without it have none of their own, and that is no damage.
#[test]
fn a_frame_is_kept_and_files_without_one_are_whole() {
    let folder = Folder::new();
    let file = folder.file("a.tiepoint");
    let mut network = ordinary().as_ref().clone();
    network.frame = Frame::ThreeTwoOne(ThreeTwoOne {
        origin: PointId::Target(7),
        axis: PointId::Device(0),
        plane: PointId::of_code(Family::Ring(14), 57)[0],
        order: AxisOrder::Zx,
    });
    network.moved_by = Some(Similarity {
        translation: Vector3::new(0.1, -1e-17, 4e9),
        ..Similarity::identity()
    });
    drop(Store::create(&file, &network).unwrap());
    let (store, back) = opened(&file);
    assert_eq!(*back, network);
    drop(store);
    let older = Connection::open(&file).unwrap();
    let removed = older
        .execute("DELETE FROM document WHERE id IN ('frame', 'moved_by')", [])
        .unwrap();
    assert_eq!(removed, 2);
    drop(older);
    network.frame = Frame::Automatic;
    network.moved_by = None;
    assert_eq!(*opened(&file).1, network);
}
