//! Factor and inverse against those of the whole matrix.

use super::super::selected_inverse::Multiplicand;
use super::*;
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

/// Blocks of all sizes that meet in random sets, and a positive definite matrix with entries there alone.
fn random(seed: u64) -> (Structure, BlockMatrix) {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let count = random.random_range(1..60);
    let mut starts = vec![0];
    for _ in 0..count {
        starts.push(starts[starts.len() - 1] + [6, 6, 6, 9, 3][random.random_range(0..5)]);
    }
    let meetings: Vec<Vec<usize>> = (0..random.random_range(1..80))
        .map(|_| {
            let from = random.random_range(0..count);
            let mut blocks: Vec<usize> = (0..random.random_range(1..6))
                .map(|_| (from + random.random_range(0..8)) % count)
                .collect();
            blocks.push(count - 1);
            blocks.sort_unstable();
            blocks.dedup();
            blocks
        })
        .collect();
    let mut datum = vec![0, count - 1];
    datum.dedup();
    let structure = Structure::new(starts, meetings.into_iter(), datum);
    let mut matrix = BlockMatrix {
        columns: structure
            .columns
            .iter()
            .map(|column| vec![0.0; column.offsets[1] * column.offsets[column.rows.len()]])
            .collect(),
    };
    for (block, column) in structure.columns.iter().enumerate() {
        for &row in &column.rows {
            for j in structure.range(block) {
                for i in structure.range(row as usize).filter(|&i| i >= j) {
                    let value = if i == j {
                        200.0
                    } else {
                        random.random_range(-1.0..1.0)
                    };
                    matrix.add(&structure, i, j, value);
                }
            }
        }
    }
    (structure, matrix)
}

fn factorised(
    structure: &Structure,
    reduced: &BlockMatrix,
    scale: &DVector<f64>,
    datum: Option<DatumRows>,
) -> Result<Vec<FrontFactor>, NotFactorised> {
    let matrix = Regular {
        reduced,
        scale,
        datum,
    };
    factorise(structure, &matrix, |_, pivot| pivot > 0.0, &Monitor::new())
}

/// Rows of a datum that takes so many motions.
fn datum(
    seed: u64,
    structure: &Structure,
    scale: &DVector<f64>,
    motions: usize,
) -> Option<DatumRows> {
    let mut random = ChaCha8Rng::seed_from_u64(1000 + seed);
    let null_vectors =
        DMatrix::from_fn(scale.len(), motions, |_, _| random.random_range(-1.0..1.0));
    DatumRows::of(structure, scale, &null_vectors)
}

#[test]
fn factor_and_inverse_are_those_of_the_whole_matrix() {
    for seed in 0..40 {
        let (structure, matrix) = random(seed);
        let mut dense = matrix.dense(&structure);
        dense.fill_upper_triangle_with_lower_triangle();
        let n = dense.nrows();
        let scale = DVector::from_fn(n, |i, _| 1.0 + 0.01 * i as f64);
        let scaled = DMatrix::from_diagonal(&scale);
        let mut regular = &scaled * dense * &scaled;
        let datum = datum(seed, &structure, &scale, seed as usize % 4);
        if let Some(rows) = &datum {
            let products = rows.longer * &rows.basis * rows.basis.transpose();
            for (a, &i) in rows.unknowns.iter().enumerate() {
                for (b, &j) in rows.unknowns.iter().enumerate() {
                    regular[(i, j)] += products[(a, b)];
                }
            }
        }
        let fronts = factorised(&structure, &matrix, &scale, datum).unwrap();
        let factor = Factor {
            scale: scale.clone(),
            fronts,
        };
        let whole = &scaled * regular.try_inverse().unwrap() * &scaled;
        let right_side = DVector::from_fn(n, |i, _| (i as f64).sin());
        let solved = factor.solve(&structure, &right_side, &Monitor::new());
        let off = solved.expect("nobody interrupts") - &whole * &right_side;
        assert!(
            off.amax() < 1e-12 * whole.amax() * n as f64,
            "{seed}: {}",
            off.amax()
        );
        let inverse = factor
            .inverse(&structure, &Monitor::new())
            .expect("nobody interrupts");
        for column in &structure.columns {
            let blocks: Vec<usize> = [column.rows[0], column.rows[column.rows.len() - 1]]
                .map(|block| block as usize)
                .to_vec();
            let blocks = if blocks[0] == blocks[1] {
                vec![blocks[0]]
            } else {
                blocks
            };
            let unknowns: Vec<usize> = blocks
                .iter()
                .flat_map(|&block| structure.range(block))
                .collect();
            let among = inverse.among(&structure, &blocks);
            for (a, &i) in unknowns.iter().enumerate() {
                for (b, &j) in unknowns.iter().enumerate() {
                    let off = among[(a, b)] - whole[(i, j)];
                    assert!(off.abs() < 1e-12 * whole.amax(), "{seed}: {off}");
                }
            }
            let mut place = 0;
            let with_places = blocks.iter().map(|&block| {
                place += structure.range(block).len();
                (block, place - structure.range(block).len())
            });
            let with_places: Vec<(usize, usize)> = with_places.collect();
            let columns: Vec<[f64; 4]> = (0..unknowns.len())
                .map(|k| [k as f64, 1.0, (k as f64).cos(), 0.0])
                .collect();
            let twice = [(); 2].map(|()| Multiplicand {
                blocks: &with_places,
                columns: &columns,
            });
            let products = inverse.times(&structure, twice.into());
            assert_eq!(products[0], products[1]);
            let product = &products[0];
            for (a, &i) in unknowns.iter().enumerate() {
                for axis in 0..4 {
                    let rows = unknowns.iter().zip(&columns);
                    let wanted: f64 = rows.map(|(&j, row)| whole[(i, j)] * row[axis]).sum();
                    let off = product[a][axis] - wanted;
                    assert!(off.abs() < 1e-11 * whole.amax(), "{seed}: {off}");
                }
            }
        }
    }
}

#[test]
fn what_is_not_positive_is_named() {
    let (structure, mut matrix) = random(3);
    matrix.add(&structure, 1, 1, -400.0);
    let scale = DVector::repeat(structure.starts[structure.blocks()], 1.0);
    let refused = factorised(&structure, &matrix, &scale, None);
    assert!(matches!(refused, Err(NotFactorised::Loose(1))));
}
