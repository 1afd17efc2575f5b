//! The paper's problem: derivatives against differences and against the general
//! model, minima against a Gauss-Newton iteration of its own.

use crate::paper::{Rng, TABLE_II, counts_of, rsi_parameters, table_iii};
use nalgebra::{DMatrix, DVector};
use rsicalib::Error;
use rsicalib::estimate::paper::Paper;
use rsicalib::mechanism::Mechanism;
use rsicalib::model::{Model, Want, Workspace, parse};
use rsicalib::numerics::lm::{SolverOptions, Termination};
use rsicalib::readings::{Readings, Table};

fn poses() -> Vec<[f64; 6]> {
    [&TABLE_II[..], &table_iii()].concat()
}

/// Readings with noise of one count.
fn noisy(offsets: &[f64], gains: &[f64], seed: u64) -> Vec<f64> {
    let mut rng = Rng::new(seed);
    counts_of(&poses(), offsets, gains).iter().map(|a| a + rng.normal()).collect()
}

fn nominal() -> (Vec<f64>, Vec<f64>) {
    rsi_parameters(0.0, 0.0)
}

#[test]
fn misclosure_and_jacobian_are_those_of_the_general_model() {
    let mechanism = Mechanism::rsi();
    let (offsets, gains) = rsi_parameters(0.05, 0.02);
    let counts = noisy(&offsets, &gains, 1);
    let paper = Paper::new(&mechanism, &counts).expect("24 poses");
    let readings =
        Readings::new(&mechanism, Table { values: counts, ..Table::default() }).expect("24 rows");
    let terms = parse(&mechanism, &readings, &["offset".into(), "gain".into()]).expect("terms");
    let model = Model::uncentred(&mechanism, &readings, terms).expect("a model");
    let mut beta: Vec<f64> = offsets.clone();
    beta.extend(&gains);
    for (c, channel) in mechanism.channels.iter().enumerate() {
        beta[c] -= channel.offset;
        beta[9 + c] -= channel.gain;
    }
    let f = paper.misclosure(&offsets, &gains).expect("nine channels");
    let x = paper.jacobian(&offsets, &gains).expect("nine channels");
    let mut ws = Workspace::default();
    for (block, meta) in readings.blocks().iter().enumerate() {
        let want = Want { x: true, a: false };
        model.evaluate(&readings, block, readings.raw(block), &beta, want, &mut ws);
        for (lane, &row) in meta.rows.iter().enumerate().take(meta.live) {
            for e in 0..3 {
                // Rounding of angles of six radians, and of squares of three inches.
                assert!((f[row * 3 + e] - ws.f[e].0[lane]).abs() < 1e-12);
                for p in 0..18 {
                    let (ours, theirs) = (x[(row * 3 + e) * 18 + p], ws.x[e * 18 + p].0[lane]);
                    let size = if p < 9 { 1.0 } else { 4096.0 };
                    assert!((ours - theirs).abs() < 1e-12 * size, "row {row}, {e}, {p}");
                }
            }
        }
    }
}

#[test]
fn the_minimum_is_that_of_gauss_and_newton() {
    let mechanism = Mechanism::rsi();
    let (offsets, gains) = rsi_parameters(0.05, 0.02);
    let counts = noisy(&offsets, &gains, 2);
    let paper = Paper::new(&mechanism, &counts).expect("24 poses");
    let (o, g) = nominal();
    let found = paper.minimize(&o, &g, &SolverOptions::default()).expect("nine channels");
    assert!(found.termination.converged());

    // From the truth, with a dense orthogonal factorisation, until it stands still.
    let mut x = [offsets, gains].concat();
    for _ in 0..60 {
        let f = DVector::from_vec(paper.misclosure(&x[..9], &x[9..]).expect("nine"));
        let j = DMatrix::from_row_slice(
            f.len(),
            18,
            &paper.jacobian(&x[..9], &x[9..]).expect("nine channels"),
        );
        let norms: Vec<f64> = j.column_iter().map(|c| c.norm()).collect();
        let unit = DMatrix::from_fn(f.len(), 18, |r, c| j[(r, c)] / norms[c]);
        let step = unit.svd(true, true).solve(&f, 0.0).expect("singular vectors");
        for i in 0..18 {
            x[i] -= step[i] / norms[i];
        }
    }
    for c in 0..9 {
        // Squared condition number of some hundred, 1e-16 each: 1e-11.
        assert!((found.offsets[c] / x[c] - 1.0).abs() < 1e-9, "offset {c}");
        assert!((found.gains[c] / x[9 + c] - 1.0).abs() < 1e-9, "gain {c}");
    }
}

#[test]
fn normal_equations_are_those_of_the_jacobian() {
    let mechanism = Mechanism::rsi();
    let (offsets, gains) = rsi_parameters(0.05, 0.02);
    // Many poses: several chunks, and a last block that is not full.
    let counts = noisy(&offsets, &gains, 3).repeat(61);
    let rows = counts.len() / 9;
    assert!(rows > 1024 && rows % 8 != 1);
    let paper = Paper::new(&mechanism, &counts[..(rows - 1) * 9]).expect("poses");
    let here = paper.linearization(&offsets, &gains).expect("nine channels");
    let f = DVector::from_vec(paper.misclosure(&offsets, &gains).expect("nine"));
    let j = paper.jacobian(&offsets, &gains).expect("nine");
    let j = DMatrix::from_row_slice(f.len(), 18, &j);
    let (gram, gradient, found) = (j.transpose() * &j, j.transpose() * &f, here.gram());
    assert!((here.cost / (0.5 * f.norm_squared()) - 1.0).abs() < 1e-12);
    for i in 0..18 {
        let size = gram[(i, i)].sqrt();
        assert!((here.gradient[i] - gradient[i]).abs() < 1e-12 * size * f.norm());
        for k in 0..18 {
            let error = (found[(i, k)] - gram[(i, k)]).abs();
            assert!(error < 1e-12 * size * gram[(k, k)].sqrt(), "{i}, {k}");
        }
    }
}

#[test]
fn answers_do_not_depend_on_the_number_of_threads() {
    let mechanism = Mechanism::rsi();
    let (offsets, gains) = rsi_parameters(0.05, 0.02);
    let counts = noisy(&offsets, &gains, 4).repeat(100);
    let (o, g) = nominal();
    let solve = || {
        let paper = Paper::new(&mechanism, &counts).expect("poses");
        paper.minimize(&o, &g, &SolverOptions::default()).expect("nine channels")
    };
    let pool = |n| rayon::ThreadPoolBuilder::new().num_threads(n).build().expect("threads");
    assert_eq!(pool(1).install(solve), pool(3).install(solve));
}

#[test]
fn a_start_without_numbers_is_named() {
    let (offsets, gains) = nominal();
    let counts = noisy(&offsets, &gains, 5);
    let paper = Paper::new(&Mechanism::rsi(), &counts).expect("24 poses");
    let mut bad = offsets.clone();
    bad[3] = f64::NAN;
    let found = paper.minimize(&bad, &gains, &SolverOptions::default()).expect("nine channels");
    assert_eq!(found.termination, Termination::NotFinite);
    let short = paper.minimize(&offsets[..8], &gains, &SolverOptions::default());
    assert!(matches!(short, Err(Error::Shape { found: 8, expected: 9, .. })));
}

#[test]
fn readings_that_cannot_be_used_are_refused() {
    let mechanism = Mechanism::rsi();
    assert!(matches!(Paper::new(&mechanism, &[]), Err(Error::Empty(_))));
    assert!(matches!(Paper::new(&mechanism, &[2000.0; 10]), Err(Error::Shape { .. })));
    let mut counts = vec![2000.0; 18];
    counts[13] = 5000.0;
    let found = Paper::new(&mechanism, &counts);
    assert!(matches!(found, Err(Error::Reading { row: 1, .. })), "{found:?}");
}
