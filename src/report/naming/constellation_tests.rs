use nalgebra::Rotation3;

use super::*;

fn cloud(count: usize, seed: u64) -> Vec<Vector3<f64>> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let size = [1000.0, 700.0, 400.0];
    let mut place = || Vector3::from(size.map(|size| random.random_range(0.0..size)));
    (0..count).map(|_| place()).collect()
}

fn grid(columns: usize, rows: usize) -> Vec<Vector3<f64>> {
    let place = |k: usize| Vector3::new((k % columns) as f64, (k / columns) as f64, 0.0) * 80.0;
    (0..columns * rows).map(place).collect()
}

fn elsewhere(places: &[Vector3<f64>], scale: f64) -> Vec<Vector3<f64>> {
    let fit = Similarity {
        scale,
        rotation: Rotation3::from_euler_angles(0.4, -1.1, 2.5),
        translation: Vector3::new(300.0, -20.0, 77.0),
    };
    places.iter().map(|place| fit.apply(place)).collect()
}

fn recognised(points: &[Vector3<f64>], known: &[Vector3<f64>], scale: Scale) -> Recognition {
    recognise(&Lists {
        points,
        known,
        scale,
        within: 4.0,
        seed: 1,
    })
}

#[test]
fn a_cloud_is_recognised_in_another_frame() {
    let known = cloud(60, 1);
    let same: Vec<[usize; 2]> = (0..60).map(|k| [k, k]).collect();
    let points = elsewhere(&known, 1.0);
    assert_eq!(
        recognised(&points, &known, Scale::One),
        Recognition::Only(same.clone())
    );
    let small = elsewhere(&known, 1.0 / 1.7);
    assert_eq!(
        recognised(&small, &known, Scale::Free),
        Recognition::Only(same)
    );
    let kept = recognised(&small, &known, Scale::One);
    assert!(matches!(kept, Recognition::Nothing { .. }), "{kept:?}");
}

#[test]
fn other_points_are_not_recognised() {
    for scale in [Scale::One, Scale::Free] {
        let found = recognised(&cloud(60, 1), &cloud(60, 2), scale);
        assert!(matches!(found, Recognition::Nothing { .. }), "{found:?}");
    }
    let few = recognised(&cloud(2, 1), &cloud(60, 1), Scale::One);
    assert_eq!(few, Recognition::Nothing { most: 0 });
}

#[test]
fn a_mirrored_cloud_is_not_recognised() {
    let known = cloud(60, 1);
    let mirrored: Vec<_> = known.iter().map(|p| Vector3::new(-p.x, p.y, p.z)).collect();
    for scale in [Scale::One, Scale::Free] {
        let found = recognised(&mirrored, &known, scale);
        assert!(matches!(found, Recognition::Nothing { .. }), "{found:?}");
    }
}

#[test]
fn a_grid_has_as_many_poses_as_symmetries() {
    let rectangle = grid(6, 4);
    let found = recognised(&elsewhere(&rectangle, 1.0), &rectangle, Scale::One);
    let poses = |poses, points| Recognition::Several { poses, points };
    assert_eq!(found, poses(4, 24));
    let square = grid(5, 5);
    let found = recognised(&elsewhere(&square, 1.0), &square, Scale::One);
    assert_eq!(found, poses(8, 25));
}

#[test]
fn a_grid_with_a_mark_has_a_rival_pose_still() {
    let mut known = grid(6, 4);
    known.push(Vector3::new(30.0, 50.0, 20.0));
    known.push(Vector3::new(190.0, 110.0, 35.0));
    let found = recognised(&elsewhere(&known, 1.0), &known, Scale::One);
    let points = 26;
    let is_rival = matches!(found, Recognition::Several { points: p, .. } | Recognition::Rival { points: p, .. } if p == points);
    assert!(is_rival, "{found:?}");
}

#[test]
fn a_grid_that_is_not_quite_regular_is_recognised_by_its_irregularity() {
    let mut random = ChaCha8Rng::seed_from_u64(4);
    let mut off = |size: f64| Vector3::from_fn(|_, _| random.random_range(-size..size));
    let known: Vec<_> = grid(8, 6).iter().map(|place| place + off(1.0)).collect();
    let points: Vec<_> = elsewhere(&known, 1.0)
        .iter()
        .map(|p| p + off(0.02))
        .collect();
    let same: Vec<[usize; 2]> = (0..48).map(|k| [k, k]).collect();
    assert_eq!(
        recognised(&points, &known, Scale::One),
        Recognition::Only(same)
    );
}
