//! Damaged files and pictures of anything never stop the program; the long form is `cargo bench --bench fuzz`.

mod fuzzing;

use fuzzing::{Survived, survive};

#[test]
fn damaged_files_and_pictures_of_anything_are_survived() {
    const CASES: u64 = 600;
    let folder = std::env::temp_dir().join(format!("tiepoint-fuzzed-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a temporary folder");
    let mut survived = Survived::default();
    let tried: Result<(), String> =
        (0..CASES).try_for_each(|case| survive(case, &folder, &mut survived));
    std::fs::remove_dir_all(&folder).expect("the folder just made");
    assert_eq!(tried, Ok(()));
    // Else the cases would try nothing.
    assert!(
        survived.read > 50 && survived.refused > 50 && survived.dots > 50,
        "{survived:?}"
    );
}
