//! Files that are damaged, newer or something else.

use proptest::prelude::*;
use rusqlite::Connection;

use super::super::save_as;
use super::*;

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn damage_never_panics_and_is_never_taken_for_the_network(
        places in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..40),
        cut in prop::option::of(any::<prop::sample::Index>()),
    ) {
        let folder = Folder::new();
        let file = folder.file("a.tiepoint");
        let saved = ordinary();
        drop(Store::create(&file, &saved).unwrap());
        let mut bytes = fs::read(&file).unwrap();
        for (place, byte) in places {
            let place = place.index(bytes.len());
            bytes[place] = byte;
        }
        if let Some(cut) = cut {
            bytes.truncate(cut.index(bytes.len()));
        }
        fs::write(&file, &bytes).unwrap();
        for result in [Store::open(&file), Store::open_read_only(&file)] {
            match result {
                Ok(opened) if opened.warnings.is_empty() => prop_assert_eq!(&opened.network, &saved),
                Ok(opened) => {
                    prop_assert!(opened.store.is_none());
                    let one_line = |warning: &String| !warning.contains('\n');
                    prop_assert!(opened.warnings.iter().all(one_line), "{:?}", opened.warnings);
                }
                Err(error) => prop_assert!(!error.to_string().contains('\n'), "{}", error),
            }
        }
    }
}

#[test]
fn what_is_no_project_is_refused_in_one_line() {
    let folder = Folder::new();
    let file = folder.file("a.tiepoint");
    for open in [Store::open, Store::open_read_only] {
        assert!(refusal(open(&folder.file("none"))).contains("no such file"));
        assert!(refusal(open(&folder.0)).contains("found a folder"));
        fs::write(&file, "").unwrap();
        assert!(refusal(open(&file)).contains("found an empty file"));
        fs::write(&file, "This is a text.\n".repeat(1000)).unwrap();
        assert!(refusal(open(&file)).contains("not a Tiepoint project"));
        fs::write(&file, "short").unwrap();
        assert!(refusal(open(&file)).contains("not a Tiepoint project"));
        fs::remove_file(&file).unwrap();
        let other = Connection::open(&file).unwrap();
        other.execute_batch("CREATE TABLE t (x)").unwrap();
        drop(other);
        assert!(refusal(open(&file)).contains("found application id 0x00000000"));
        fs::remove_file(&file).unwrap();
    }
    assert_eq!(folder.names(), Vec::<String>::new());
}

#[test]
fn a_newer_project_is_refused() {
    let folder = Folder::new();
    let file = folder.file("a.tiepoint");
    drop(Store::create(&file, &Network::default()).unwrap());
    let newer = Connection::open(&file).unwrap();
    newer.pragma_update(None, "user_version", 2).unwrap();
    newer.execute_batch("DROP TABLE images").unwrap();
    drop(newer);
    let line = refusal(Store::open(&file));
    assert!(line.contains("newer version of Tiepoint: found format 2, expected at most 1"));
}

#[test]
fn a_cut_file_gives_what_is_left() {
    let folder = Folder::new();
    let file = folder.file("a.tiepoint");
    let mut number = 0.0;
    let saved = network(60, || {
        number += 0.01;
        number
    });
    drop(Store::create(&file, &saved).unwrap());
    let bytes = fs::read(&file).unwrap();
    fs::write(&file, &bytes[..bytes.len() * 2 / 3]).unwrap();
    let opened = Store::open(&file).unwrap();
    assert!(opened.store.is_none());
    assert!(
        opened.warnings[1].contains("cut off"),
        "{:?}",
        opened.warnings
    );
    let whole = |(id, image): (&ImageId, &Arc<ImageEntry>)| saved.images.get(id) == Some(image);
    let images = opened.network.images.iter().filter(|&i| whole(i)).count();
    assert!((10..60).contains(&images), "{images} images are whole");
    assert_eq!(opened.network.settings, saved.settings);
    assert_eq!(fs::read(&file).unwrap().len(), bytes.len() * 2 / 3);

    let rescued = folder.file("rescued.tiepoint");
    save_as(&rescued, &opened.network, &file, &opened.journal).unwrap();
    assert_eq!(super::opened(&rescued).1, opened.network);
}

#[test]
fn a_flipped_digit_is_noticed() {
    let folder = Folder::new();
    let file = folder.file("a.tiepoint");
    let mut network = ordinary().as_ref().clone();
    Arc::make_mut(&mut network.points).insert(
        PointId::Target(3),
        Arc::new(Point {
            position: Vector3::new(123.456_789, 0.0, 0.0),
            covariance: None,
            rays: 2,
            circle: None,
        }),
    );
    drop(Store::create(&file, &network).unwrap());
    let mut bytes = fs::read(&file).unwrap();
    let digits = b"123.456789";
    let place = bytes
        .windows(digits.len())
        .position(|w| w == digits)
        .unwrap();
    bytes[place + 5] = b'9';
    fs::write(&file, bytes).unwrap();
    let opened = Store::open(&file).unwrap();
    assert!(opened.store.is_none());
    assert!(
        opened.warnings[1].starts_with("points M3: "),
        "{:?}",
        opened.warnings
    );
    Arc::make_mut(&mut network.points).remove(&PointId::Target(3));
    assert_eq!(*opened.network, network);
}

#[test]
fn one_unknown_table_does_not_hide_the_others() {
    let folder = Folder::new();
    let file = folder.file("a.tiepoint");
    let network = ordinary();
    drop(Store::create(&file, &network).unwrap());
    let mut bytes = fs::read(&file).unwrap();
    let definition = b"CREATE TABLE journal";
    let place = bytes
        .windows(definition.len())
        .position(|w| w == definition);
    bytes[place.unwrap() + 13] = b'`';
    fs::write(&file, bytes).unwrap();
    let opened = Store::open(&file).unwrap();
    assert!(opened.store.is_none());
    assert_eq!(opened.network, network);
}

#[test]
fn what_refers_to_lost_rows_is_left_out() {
    let folder = Folder::new();
    let file = folder.file("a.tiepoint");
    drop(Store::create(&file, &ordinary()).unwrap());
    let vandal = Connection::open(&file).unwrap();
    vandal
        .execute_batch(
            "UPDATE cameras SET json = '{}'; UPDATE detections SET json = '' WHERE id = 1",
        )
        .unwrap();
    drop(vandal);
    let opened = Store::open(&file).unwrap();
    assert!(opened.network.images.is_empty() && opened.network.connection_order.is_empty());
    assert!(opened.network.adjustment.is_none());
    assert!(
        opened
            .warnings
            .iter()
            .any(|w| w == "images 2: left out, its camera is lost")
    );
}
