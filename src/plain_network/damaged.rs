//! Damaged texts of other programs are answered in one line, never by a panic.

use proptest::prelude::*;

use super::{AiconTexts, ColmapTexts, DbatTexts, NamedText, from_aicon, from_colmap, from_dbat};

const AICON: [&str; 5] = [
    "1 -999 -28.8 0.1 -0.2 -1e-4 1e-7 13\n0\n1e-6 2e-6\n3e-5 4e-5\n36 24 8000 6000\n",
    "7 1 0 0 1000 0 0 0 0 307 3\n",
    "5 1 2 3 .1 .1 .1 9 1 1 0\n6 4 2 3 .1 .1 .1 9 1 1 0\n",
    "7 5 1.5 -0.75 0 0 0 0 1 1 1\n7 6 1 1 0 0 0 0 1 0 1\n",
    "0 \"bar\" 5 6 3.0 0.01 1\n",
];
const DBAT: [&str; 5] = [
    "1, 7, 10.5, 20, 0.1\n1, 1001, 30, 40\n",
    "<camera><name>O</name><unit>mm</unit><sensor>auto,6</sensor><image>24,16</image><focal>7</focal><model>3</model><nK>2</nK><cc>0,0</cc><!-- a --><pp>1,2</pp><K>1e-3,0</K></camera>",
    "# a\n1001,CP1,0,1,0\n1002,CP2,1,1,0,0.5\n",
    "1, data/cam/A.JPG\n",
    "1, 1, 0.5, 1, 2, 0.1, -0.2, 3, 1, 1, B.JPG\n",
];
const COLMAP: [&str; 3] = [
    "# c\n1 OPENCV 30 20 25 25 15 10 0.1 0 0 0\n",
    "1 1 0 0 0 0 0 5 1 A.JPG\n1 2 58 3 4 -1\n",
    "58 1.67 0.29 0.61 115 121 122 1.3 1 0\n",
];

/// The texts with one character of one of them replaced, inserted before or cut off behind.
fn damaged<const N: usize>(
    texts: [&str; N],
    (which, at, kind): (usize, usize, usize),
    letter: char,
) -> [String; N] {
    let mut texts = texts.map(str::to_owned);
    let text = &mut texts[which % N];
    let at = at % text.len();
    match kind % 3 {
        0 => text.replace_range(at..=at, &letter.to_string()),
        1 => text.insert(at, letter),
        _ => text.truncate(at),
    }
    texts
}

fn is_one_line<T>(result: Result<T, super::ImportError>) -> bool {
    result
        .err()
        .is_none_or(|error| !error.to_string().contains('\n'))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1000))]
    #[test]
    fn damaged_texts_are_answered(
        place in (0usize..5, 0usize..1000, 0usize..3),
        letter in prop_oneof![Just('-'), Just('9'), Just('e'), Just(','), Just(' '), Just('\n'), Just('<'), Just('"'), Just('\u{e9}')],
    ) {
        let named = |text| NamedText { file: "file", text };
        let [cameras, orientations, points, image_points, bars] = &damaged(AICON, place, letter);
        let read = from_aicon(AiconTexts {
            cameras: named(cameras),
            orientations: named(orientations),
            points: named(points),
            image_points: named(image_points),
            bars: Some(named(bars)),
        });
        prop_assert!(is_one_line(read));
        let [marks, camera, control, images, stations] = &damaged(DBAT, place, letter);
        let read = from_dbat(DbatTexts {
            marks: named(marks),
            camera: named(camera),
            control: Some(named(control)),
            images: Some(named(images)),
            stations: Some(named(stations)),
        });
        prop_assert!(is_one_line(read));
        let [cameras, images, points] = &damaged(COLMAP, place, letter);
        let read = from_colmap(ColmapTexts {
            cameras: named(cameras),
            images: named(images),
            points: named(points),
        });
        prop_assert!(is_one_line(read));
    }
}
