//! Codes under hard conditions against truth, in few trials; `cargo bench --bench codes` makes many.

mod code_trials;

use code_trials::{Kind, Tally, kinds};
use tiepoint::targets::Family;

fn run(wanted: impl Fn(&Kind) -> bool, count: u64) -> Vec<(String, Tally)> {
    kinds()
        .into_iter()
        .filter(wanted)
        .map(|kind| {
            (
                format!("{} {}", kind.family, kind.name),
                kind.run(0..count).0,
            )
        })
        .collect()
}

#[test]
fn clean_codes_are_read_without_a_doubt() {
    let clean = |kind: &Kind| {
        let fine = kind.family == Family::Ring(20) && !kind.name.contains("deg 20 px");
        let small = kind.name.contains("deg 8 px") || fine;
        kind.name.starts_with("clean") && !kind.name.contains("70 deg") && !small
    };
    for (name, tally) in run(clean, 60) {
        // A turn may be unlucky: a small oblique ring code has few pixels to spare.
        assert!(tally.read >= 59, "{name}: {tally:?}");
    }
}

#[test]
fn six_dot_codes_get_no_wrong_number() {
    let simulated = |kind: &Kind| {
        kind.family == Family::Dot420
            && !kind.name.starts_with("rendered")
            && !kind.name.contains("crowded")
    };
    for (name, tally) in run(simulated, 200) {
        assert_eq!(tally.wrong, 0, "{name}: {tally:?}");
    }
}

#[test]
fn rendered_six_dot_codes_get_no_wrong_number() {
    let dense = |kind: &Kind| kind.name.starts_with("rendered");
    for (name, tally) in run(dense, 20) {
        assert_eq!(tally.wrong, 0, "{name}: {tally:?}");
    }
}

#[test]
fn rings_partly_covered_or_beside_other_light_get_no_wrong_number() {
    let rings = |kind: &Kind| kind.family == Family::Ring(12);
    for (name, tally) in run(rings, 60) {
        assert_eq!(tally.wrong, 0, "{name}: {tally:?}");
    }
}

#[test]
fn a_frame_that_gives_way_hides_no_changed_part() {
    // In these trials a frame turned or stretched a little explains most of what a changed part leaves.
    const NUMBERS: [u64; 8] = [14575, 15257, 22783, 23032, 27274, 28733, 51935, 56829];
    let kinds = kinds();
    let kind = kinds
        .iter()
        .find(|kind| kind.family == Family::Ring(12) && kind.name == "part of a ring changed")
        .expect("the kind");
    for number in NUMBERS {
        let tally = kind.once(number);
        let without_a_doubt = tally.wrong + tally.same_picture;
        assert_eq!(without_a_doubt, 0, "{number}: {tally:?}");
    }
}

/// The codes that a trial shows, read again.
fn once(segments: u8, name: &str, number: u64) -> Tally {
    let kinds = kinds();
    let is_wanted = |kind: &&Kind| kind.family == Family::Ring(segments) && kind.name == name;
    kinds.iter().find(is_wanted).expect("the kind").once(number)
}

#[test]
fn a_cover_a_little_darker_than_the_ground_shows_over_several_segments() {
    // The cover takes two light segments away; each of the three dark ones under it is within what noise may do, their mean is not.
    let tally = once(14, "cover, its own grey", 123_092);
    assert_eq!((tally.wrong, tally.wrong_doubtful), (0, 1), "{tally:?}");
}

#[test]
fn a_cover_that_leaves_wedges_at_borders_is_doubted() {
    // It hides a dark segment and the light ones beside it but for a wedge at either end: no border is shifted, two of them lean.
    let tally = once(12, "cover, the ground's grey", 172_259);
    assert_eq!((tally.wrong, tally.wrong_doubtful), (0, 1), "{tally:?}");
}

#[test]
fn plain_targets_in_the_place_of_two_segments_are_doubted() {
    let tally = once(12, "plain", 347_500);
    assert_eq!((tally.wrong, tally.wrong_doubtful), (0, 1), "{tally:?}");
}

#[test]
fn plain_targets_that_run_together_along_a_ring_are_doubted() {
    // Thirteen of them look like eight segments but for the ends.
    let tally = once(12, "plain", 532_640);
    assert_eq!((tally.wrong, tally.wrong_doubtful), (0, 1), "{tally:?}");
}

#[test]
fn a_cover_half_of_which_looks_like_a_slope_of_the_ground_is_doubted() {
    let tally = once(14, "cover, its own grey", 224_512);
    assert_eq!((tally.wrong, tally.wrong_doubtful), (0, 1), "{tally:?}");
}

#[test]
fn plain_targets_that_look_like_a_code_by_all_strains_together_are_doubted() {
    // Perspective, blur and light of the dot are each just within what happens.
    let tally = once(14, "plain", 2857);
    assert_eq!((tally.wrong, tally.wrong_doubtful), (0, 1), "{tally:?}");
}

#[test]
fn the_same_tally_comes_from_any_number_of_threads() {
    let field = |kind: &Kind| kind.name == "cover in field dense";
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        pool.expect("threads").install(|| run(field, 50))
    };
    assert_eq!(with(1), with(3));
}
