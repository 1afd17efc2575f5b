//! The Cramér-Rao bound against dense matrices, and plans against brute force.

mod paper;

use nalgebra::DMatrix;
use paper::{TABLE_II, counts_of, rsi_parameters, table_iii};
use rsicalib::Error;
use rsicalib::design::exchange::Criterion;
use rsicalib::design::information::Candidates;
use rsicalib::design::observability::{Scaling, observability};
use rsicalib::design::reach::readings_at;
use rsicalib::estimate::paper::Paper;
use rsicalib::mechanism::Mechanism;

const SIGMA: [f64; 9] = [1.0, 1.2, 0.8, 1.0, 1.0, 1.5, 1.0, 0.7, 1.0];

fn candidates(poses: &[[f64; 6]]) -> (Candidates, Vec<f64>) {
    let (offsets, gains) = rsi_parameters(0.0, 0.0);
    let counts = counts_of(poses, &offsets, &gains);
    let made = Candidates::new(&Mechanism::rsi(), counts.clone(), &offsets, &gains, &SIGMA);
    (made.expect("poses"), counts)
}

/// Covariance of the bound, by inverting the whole of eq. (91) at once.
fn covariance(counts: &[f64]) -> DMatrix<f64> {
    let (offsets, gains) = rsi_parameters(0.0, 0.0);
    let paper = Paper::new(&Mechanism::rsi(), counts).expect("poses");
    let x = paper.jacobian(&offsets, &gains).expect("nine channels");
    let mut sum = DMatrix::zeros(18, 18);
    for x in x.chunks_exact(54) {
        let x = DMatrix::from_row_slice(3, 18, x);
        let a = DMatrix::from_fn(3, 9, |e, c| x[(e, c)] * gains[c] * SIGMA[c]);
        let s = (&a * a.transpose()).try_inverse().expect("three independent closures");
        sum += x.transpose() * s * &x;
    }
    let scale: Vec<f64> = (0..18).map(|i| sum[(i, i)].sqrt()).collect();
    let unit = DMatrix::from_fn(18, 18, |i, j| sum[(i, j)] / (scale[i] * scale[j]));
    let inverse = unit.try_inverse().expect("poses that tell everything");
    DMatrix::from_fn(18, 18, |i, j| inverse[(i, j)] / (scale[i] * scale[j]))
}

fn both() -> Vec<[f64; 6]> {
    [&TABLE_II[..], &table_iii()].concat()
}

#[test]
fn the_bound_is_the_inverse_of_the_information() {
    let (made, counts) = candidates(&both());
    let bound = made.bound(&(0..24).collect::<Vec<_>>());
    let known = covariance(&counts);
    for c in 0..9 {
        // Squared condition number 1e4, rounding 1e-16.
        assert!((bound.offset_sd[c] / known[(c, c)].sqrt() - 1.0).abs() < 1e-9);
        assert!((bound.gain_sd[c] / known[(9 + c, 9 + c)].sqrt() - 1.0).abs() < 1e-9);
    }
}

#[test]
fn poses_that_cannot_tell_have_no_bound() {
    let (made, _) = candidates(&both());
    let bound = made.bound(&[0, 1, 2, 3]); // 12 equations
    assert!(bound.offset_sd.iter().all(|sd| sd.is_infinite()));
    assert!(bound.offset_rms().is_infinite());
}

#[test]
fn no_single_exchange_improves_a_plan() {
    let (made, counts) = candidates(&both());
    for criterion in [Criterion::Offsets, Criterion::Volume] {
        let (chosen, score) = made.exchange(&(0..9).collect::<Vec<_>>(), &[20], criterion);
        assert_eq!(chosen.len(), 9);
        let judge = |chosen: &[usize]| {
            let rows: Vec<f64> = chosen
                .iter()
                .chain(&[20])
                .flat_map(|&p| counts[p * 9..(p + 1) * 9].to_vec())
                .collect();
            let c = covariance(&rows);
            match criterion {
                Criterion::Volume => {
                    let d: Vec<f64> = (0..18).map(|i| c[(i, i)].sqrt()).collect();
                    let unit = DMatrix::from_fn(18, 18, |i, j| c[(i, j)] / (d[i] * d[j]));
                    unit.determinant().ln() + 2.0 * d.iter().map(|d| d.ln()).sum::<f64>()
                }
                _ => (0..9).map(|i| c[(i, i)]).sum(),
            }
        };
        let here = judge(&chosen);
        if criterion == Criterion::Offsets {
            assert!((score / here - 1.0).abs() < 1e-6, "{score} is not {here}");
        }
        for place in 0..chosen.len() {
            for other in (0..24).filter(|p| *p != 20) {
                let mut changed = chosen.clone();
                changed[place] = other;
                let there = judge(&changed);
                // Rounding, and the faint prior that lets any start be improved.
                assert!(there > here - 1e-5 * here.abs(), "{place} -> {other}: {there} < {here}");
            }
        }
    }
}

#[test]
fn poses_within_reach_have_readings_and_others_none() {
    let mechanism = Mechanism::rsi();
    let (offsets, gains) = rsi_parameters(0.03, 0.02);
    let exact = counts_of(&TABLE_II, &offsets, &gains);
    for (pose, row) in TABLE_II.iter().zip(exact.chunks_exact(9)) {
        let found = readings_at(&mechanism, pose, &offsets, &gains, 20.0).expect("a platform");
        for (found, exact) in found.expect("within reach").iter().zip(row) {
            assert!((found - exact).abs() < 1e-5); // 1e-8 rad
        }
    }
    let far = [0.0, 0.0, -30.0, 0.0, 0.0, 0.0];
    assert_eq!(readings_at(&mechanism, &far, &offsets, &gains, 0.0), Ok(None));
    let near = [0.0, 0.0, -2.666, 0.0, 0.0, 0.0];
    assert_eq!(readings_at(&mechanism, &near, &offsets, &gains, 2040.0), Ok(None));
}

#[test]
fn criteria_and_scalings_have_names() {
    assert_eq!(Criterion::find("joints"), Ok(Criterion::Joints));
    assert!(matches!(Criterion::find("best"), Err(Error::Unknown { kind: "criterion", .. })));
    assert_eq!(Scaling::find("unit_columns"), Ok(Scaling::UnitColumns));
    assert!(matches!(Scaling::find("best"), Err(Error::Unknown { kind: "scaling", .. })));
}

#[test]
fn observability_orders_the_paper_s_poses_as_the_paper_does() {
    let (offsets, gains) = rsi_parameters(0.0, 0.0);
    let of = |poses: &[[f64; 6]]| {
        let counts = counts_of(poses, &offsets, &gains);
        observability(&Mechanism::rsi(), &counts, &offsets, &gains, Scaling::UnitColumns)
            .expect("poses")
    };
    let (alone, together) = (of(&TABLE_II), of(&both()));
    assert!(together.measures.condition < alone.measures.condition / 5.0);
    assert!(together.measures.o3 > alone.measures.o3);
    assert!(together.unobservable.is_empty());
    // Four poses: 12 equations, six directions open.
    assert_eq!(of(&TABLE_II[..4]).measures.o3, 0.0);
}
