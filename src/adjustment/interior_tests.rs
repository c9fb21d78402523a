//! Interior parameters that each image has for itself: found again from simulated ones, against dense algebra, and loose ones.

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

use super::dense::{agrees_with_dense_algebra, dense_design};
use super::equations::{Equations, State, image_residuals};
use super::layout::Layout;
use super::simulation::{Noise, Simulated, bar, box_network, nadir_network, scene, solve, toy};
use super::step::Step;
use super::*;

/// Standard deviation of c, x0, y0 from image to image, mm.
const SPREAD_MM: f64 = 0.05;

/// The same network with c, x0, y0 off by normal deviates in every image, and known to be so.
fn varied(simulated: Simulated, seed: u64) -> Simulated {
    let Simulated {
        mut truth,
        mut problem,
    } = simulated;
    let mut noise = Noise::seeded(seed);
    let shared = truth.cameras[0].clone();
    let own = |change: Vector3<f64>| {
        let mut camera = shared.clone();
        let mut values = camera.interior.to_vector();
        for (k, change) in change.iter().enumerate() {
            values[k] += SPREAD_MM * change;
        }
        camera.interior = camera.interior.with_values(&values);
        Some(camera)
    };
    truth.own_cameras = truth.poses.iter().map(|_| own(noise.vector())).collect();
    for o in &mut problem.observations {
        let in_camera = truth.poses[o.station].camera_from_point(&truth.points[o.point]);
        let own = truth.own_cameras[o.station].as_ref().unwrap();
        o.pixel += own.project(&in_camera).unwrap() - shared.project(&in_camera).unwrap();
    }
    let values = shared.interior.to_vector();
    for k in 0..3 {
        problem.cameras[0].parameters[k] = ParameterState::Weighted {
            value: values[k],
            sigma: SPREAD_MM,
        };
        problem.cameras[0].sharing[k] = Sharing::Image;
    }
    Simulated { truth, problem }
}

/// Errors of an image's c, x0, y0, and their cofactors.
fn own_errors(truth: &State, adjustment: &Adjustment, s: usize) -> (Vector3<f64>, Matrix3<f64>) {
    let interior = adjustment.stations[s].interior.as_ref().unwrap();
    let of = |camera: &crate::camera::Camera| camera.interior.to_vector();
    let error = of(&interior.camera) - of(truth.own_cameras[s].as_ref().unwrap());
    let cofactor = interior.covariance.fixed_view::<3, 3>(0, 0) / adjustment.sigma0.powi(2);
    (error.fixed_rows::<3>(0).into_owned(), cofactor)
}

#[test]
fn the_values_of_every_image_are_found_within_their_sigmas() {
    let (mut chi_square, mut count) = (0.0, 0.0);
    let mut shared_chi_square = 0.0;
    for seed in 0..10 {
        let simulated = varied(box_network(&scene(300 + seed)), seed);
        let Simulated { truth, mut problem } = simulated;
        let adjustment = solve(&problem).unwrap();
        // Five standard deviations of chi-square.
        let r = adjustment.redundancy as f64;
        let off = adjustment.sigma0.powi(2) * r - r;
        assert!(off.abs() < 5.0 * (2.0 * r).sqrt(), "{}", adjustment.sigma0);
        for s in 0..12 {
            let (error, cofactor) = own_errors(&truth, &adjustment, s);
            chi_square += error.dot(&(cofactor.try_inverse().unwrap() * error));
            count += 3.0;
            let principal_distance = cofactor[(0, 0)].sqrt();
            assert!(principal_distance < 0.7 * SPREAD_MM, "{principal_distance}");
        }
        let camera = &adjustment.cameras[0];
        let cofactor = camera.covariance / adjustment.sigma0.powi(2);
        let error = camera.camera.interior.to_vector() - truth.cameras[0].interior.to_vector();
        let sigma = |k: usize| cofactor[(k, k)].sqrt();
        let in_sigmas = SVector::<f64, 7>::from_fn(|k, _| error[3 + k] / sigma(3 + k));
        let correlation = SMatrix::<f64, 7, 7>::from_fn(|i, j| {
            cofactor[(3 + i, 3 + j)] / (sigma(3 + i) * sigma(3 + j))
        });
        shared_chi_square += in_sigmas.dot(&(correlation.try_inverse().unwrap() * in_sigmas));
        assert!((0..3).all(|k| camera.covariance[(k, k)] == 0.0));
        problem.cameras[0].sharing = [Sharing::Camera; 10];
        let of_one_lens = solve(&problem).unwrap().sigma0;
        assert!(of_one_lens > 1.3, "{of_one_lens}: one lens does not fit");
    }
    // 360 squares, those of different images hardly correlated, and 70 free of correlation: their means are known to some 8 and 17 %.
    let mean = chi_square / count;
    assert!((mean - 1.0).abs() < 0.3, "{mean}");
    let mean: f64 = shared_chi_square / 70.0;
    assert!((mean - 1.0).abs() < 0.6, "{mean}");
}

#[test]
fn what_each_image_has_for_itself_is_counted_in_each() {
    let Simulated { problem, .. } = varied(box_network(&scene(320)), 1);
    let adjustment = solve(&problem).unwrap();
    let rays = problem.observations.len();
    assert_eq!(adjustment.unknown_count, 12 * (6 + 3) + 7 + 3 * 60);
    assert_eq!(adjustment.observation_count, 2 * rays + 12 * 3);
    assert_eq!(
        adjustment.redundancy,
        2 * rays + 36 + 7 - adjustment.unknown_count
    );
}

/// Weighted c, free x0 of each image, K1 and K2 of all; a second camera of which nothing is each image's own; bars.
fn mixed_network(seed: u64) -> Simulated {
    let mut simulated = varied(toy(seed), seed);
    let problem = &mut simulated.problem;
    let block = &mut problem.cameras[0];
    block.parameters[5..].fill(ParameterState::Fixed);
    block.parameters[1] = ParameterState::Free;
    block.sharing[2] = Sharing::Camera;
    let mut other = block.clone();
    other.sharing = [Sharing::Camera; 10];
    other.parameters[3..].fill(ParameterState::Fixed);
    problem.cameras.push(other);
    for s in [1, 3] {
        problem.stations[s].camera = 1;
    }
    problem.distances = vec![
        bar(&simulated.truth, 0, 7, 0.004),
        bar(&simulated.truth, 12, 1, -0.003),
    ];
    simulated
}

#[test]
fn statistics_agree_with_dense_algebra() {
    for seed in [1, 2] {
        let mut problem = varied(toy(seed), seed).problem;
        agrees_with_dense_algebra(&problem, 7);
        problem = mixed_network(seed).problem;
        agrees_with_dense_algebra(&problem, 6);
    }
}

#[test]
fn the_design_is_the_derivative_by_every_unknown_of_the_reduced_system() {
    let problem = mixed_network(3).problem;
    let layout = Layout::new(&problem, &Monitor::new()).unwrap();
    let state = State::start(&problem);
    let design = dense_design(&problem, &layout, &state);
    let scaled = |state: &State| -> Vec<f64> {
        let residuals = image_residuals(&problem, &layout, state);
        let rays = layout.frames.iter().flat_map(|frame| &frame.rays);
        rays.flat_map(|ray| {
            let sigma = problem.observations[ray.observation].sigma_px;
            let residual = residuals[ray.observation].unwrap() / sigma;
            [residual.x, residual.y]
        })
        .collect()
    };
    // Rows of rays come by frames, with those of known coordinates between them, of which there are none.
    for unknown in 0..layout.kept {
        let column = design.column(unknown);
        let of_rays = 2 * problem.observations.len();
        let size = column.rows(0, of_rays).amax();
        // A change of some 0.1 px.
        let h = 2.0 / size;
        let [ahead, behind] = [h, -h].map(|h| {
            let mut kept = nalgebra::DVector::zeros(layout.kept);
            kept[unknown] = h;
            let step = Step {
                kept,
                points: vec![None; layout.frames.len()],
            };
            scaled(&step.from(&state, &layout, 1.0))
        });
        for row in 0..of_rays {
            let by_difference = (ahead[row] - behind[row]) / (2.0 * h);
            assert!(
                (by_difference - column[row]).abs() < 1e-5 * size,
                "{}: {by_difference} {}",
                layout.name(unknown),
                column[row]
            );
        }
    }
    assert_eq!(
        Equations::at(&problem, &layout, &state, &Monitor::new())
            .unwrap()
            .distances
            .len(),
        2
    );
}

#[test]
fn what_is_loose_is_named_with_its_image() {
    let mut problem = nadir_network();
    problem.cameras[0].sharing[0] = Sharing::Image;
    let Err(AdjustmentError::RankDefect { defect, loose }) = solve(&problem) else {
        panic!("not seen");
    };
    assert_eq!(defect, 4, "{loose:?}");
    for index in 0..4 {
        let parameter = 0;
        assert!(loose.contains(&ParameterName::Image { index, parameter }));
        let component = StationComponent::Z;
        assert!(loose.contains(&ParameterName::Station { index, component }));
    }
    assert_eq!(
        ParameterName::Image {
            index: 2,
            parameter: 0
        }
        .to_string(),
        "c of station 2"
    );
    // Known beforehand, it is not loose.
    problem.cameras[0].parameters[0] = ParameterState::Weighted {
        value: problem.cameras[0].camera.interior.principal_distance,
        sigma: 0.01,
    };
    assert!(solve(&problem).is_ok());
}

#[test]
fn sharing_changes_nothing_of_what_is_fixed() {
    let mut problem = box_network(&scene(321)).problem;
    problem.cameras[0].parameters[4..7].fill(ParameterState::Fixed);
    let shared = solve(&problem).unwrap();
    assert!(shared.stations.iter().all(|s| s.interior.is_none()));
    problem.cameras[0].sharing[4..7].fill(Sharing::Image);
    assert_eq!(solve(&problem).unwrap(), shared);
}

#[test]
fn one_and_more_threads_give_the_same_bits() {
    let problem = varied(box_network(&scene(322)), 2).problem;
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        pool.unwrap().install(|| solve(&problem)).unwrap()
    };
    assert_eq!(on(1), on(3));
}

/// Between passes of rejection the values of the images are kept, and they are no gross errors.
#[test]
fn rejection_goes_on_from_the_values_of_the_images() {
    let Simulated { truth, mut problem } = varied(box_network(&scene(323)), 3);
    for index in [40, 200, 333] {
        problem.observations[index].pixel.y -= 4.0;
    }
    let (bundle, rejection) = (BundleSettings::default(), RejectionSettings::default());
    let robust = adjust_with_rejection(&problem, bundle, &rejection, &Monitor::new()).unwrap();
    for index in [40, 200, 333] {
        assert!(robust.rejected.iter().any(|r| r.index == index));
    }
    assert!(robust.rejected.len() <= 4, "{:?}", robust.rejected);
    assert!((robust.adjustment.sigma0 - 1.0).abs() < 0.1);
    for s in 0..12 {
        let (error, cofactor) = own_errors(&truth, &robust.adjustment, s);
        // 36 deviates of three: 20 is passed by chance once in 6,000.
        let chi_square = error.dot(&(cofactor.try_inverse().unwrap() * error));
        assert!(chi_square < 20.0, "{chi_square} at image {s}");
    }
}
