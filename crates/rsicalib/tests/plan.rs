//! The Cramér-Rao bound against dense matrices, and plans against brute force.

use crate::paper::{TABLE_II, counts_of, rsi_parameters, table_iii};
use nalgebra::{DMatrix, DVector};
use rsicalib::Error;
use rsicalib::design::bound::{Bound, bound};
use rsicalib::design::criterion::Criterion;
use rsicalib::design::observability::{Scaling, observability};
use rsicalib::design::plan::{self, MARGIN, PlanOptions, plan};
use rsicalib::design::reach::readings_at;
use rsicalib::estimate::paper::Paper;
use rsicalib::mechanism::{Mechanism, hand_controller};

const SIGMA: [f64; 9] = [1.0, 1.2, 0.8, 1.0, 1.0, 1.5, 1.0, 0.7, 1.0];

fn bound_of(poses: &[[f64; 6]]) -> (Bound, Vec<f64>) {
    let (offsets, gains) = rsi_parameters(0.0, 0.0);
    let counts = counts_of(poses, &offsets, &gains);
    (bound(&Mechanism::rsi(), &counts, &offsets, &gains, &SIGMA).expect("poses"), counts)
}

/// Root mean square of the offsets' standard deviations.
fn offset_rms(bound: &Bound) -> f64 {
    DVector::from_column_slice(&bound.offset_sd).norm() / (bound.offset_sd.len() as f64).sqrt()
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
    let (bound, counts) = bound_of(&both());
    let known = covariance(&counts);
    for c in 0..9 {
        // Squared condition number 1e4, rounding 1e-16.
        assert!((bound.offset_sd[c] / known[(c, c)].sqrt() - 1.0).abs() < 1e-9);
        assert!((bound.gain_sd[c] / known[(9 + c, 9 + c)].sqrt() - 1.0).abs() < 1e-9);
    }
}

#[test]
fn poses_that_cannot_tell_have_no_bound() {
    let (bound, _) = bound_of(&both()[..4]); // 12 equations
    assert!(bound.offset_sd.iter().all(|sd| sd.is_infinite()));
    assert!(offset_rms(&bound).is_infinite());
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

#[test]
fn twelve_poses_are_ten_times_better_than_the_paper_s() {
    let (offsets, gains) = rsi_parameters(0.0, 0.0);
    for seed in 0..4 {
        let options = PlanOptions { seed, ..PlanOptions::default() };
        let found = plan(&Mechanism::rsi(), &offsets, &gains, &options).expect("a workspace");
        // A crude exchange of an independent prototype reached 0.0044 to 0.0056.
        assert!(offset_rms(&found.bound) < 0.0056, "{}", offset_rms(&found.bound));
        assert_eq!((found.poses.len(), found.before), (12, None));
        // The closed forms of the paper are the witness of the readings.
        let exact = counts_of(&found.poses, &offsets, &gains);
        for (found, exact) in found.readings.iter().flatten().zip(exact) {
            assert!((found - exact).abs() < 1e-5); // 1e-8 rad
            assert!(*found >= MARGIN && *found <= 4095.0 - MARGIN);
        }
        let inside = |pose: &[f64; 6]| {
            let ends = hand_controller::WORKSPACE.iter();
            ends.zip(pose).all(|([low, high], v)| v >= low && v <= high)
        };
        assert!(found.poses.iter().all(inside));
        // The same poses, judged on their own.
        let again = plan::bound(&Mechanism::rsi(), &offsets, &gains, &found.poses, 1.0);
        let again = again.expect("poses within reach");
        assert!((offset_rms(&again) / offset_rms(&found.bound) - 1.0).abs() < 1e-9);
    }
}

#[test]
fn a_plan_is_that_of_its_seed_and_complements_what_is_there() {
    let (offsets, gains) = rsi_parameters(0.0, 0.0);
    let few = PlanOptions { candidates: 300, starts: 2, seed: 9, ..PlanOptions::default() };
    let of = |o: &PlanOptions| plan(&Mechanism::rsi(), &offsets, &gains, o).expect("a workspace");
    let first = of(&few);
    assert_eq!(first, of(&few));
    assert_ne!(first.poses, of(&PlanOptions { seed: 10, ..few.clone() }).poses);
    let there = counts_of(&TABLE_II, &offsets, &gains);
    let found = of(&PlanOptions { poses: 8, beside: there, noise: 2.0, ..few });
    let before = found.before.expect("poses visited already");
    assert!(offset_rms(&found.bound) < offset_rms(&before) / 2.0);
    assert_eq!(found.poses.len(), 8);
}

#[test]
fn options_that_cannot_be_used_are_errors() {
    let (offsets, gains) = rsi_parameters(0.0, 0.0);
    let rsi = Mechanism::rsi();
    let refused = |options: PlanOptions| {
        let error = plan(&rsi, &offsets, &gains, &options).expect_err("refused");
        assert!(matches!(error, Error::Option { .. } | Error::Shape { .. }), "{error}");
        error.to_string()
    };
    let few = PlanOptions { candidates: 100, starts: 1, ..PlanOptions::default() };
    refused(PlanOptions { poses: 0, ..few.clone() });
    refused(PlanOptions { candidates: 0, ..few.clone() });
    refused(PlanOptions { candidates: usize::MAX, ..few.clone() });
    refused(PlanOptions { poses: usize::MAX, ..few.clone() });
    refused(PlanOptions { starts: usize::MAX, ..few.clone() });
    assert!(refused(PlanOptions { poses: 3, ..few.clone() }).contains("at least 9"));
    refused(PlanOptions { beside: vec![2000.0; 10], ..few.clone() });
    for noise in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        refused(PlanOptions { noise, ..few.clone() });
    }
    let mut within = hand_controller::WORKSPACE;
    within[3][0] = f64::NAN;
    refused(PlanOptions { within: Some(within), ..few.clone() });
    within[3] = [1.0, -1.0];
    refused(PlanOptions { within: Some(within), ..few.clone() });
    within = [[50.0, 51.0]; 6];
    refused(PlanOptions { within: Some(within), ..few.clone() });

    assert!(plan(&rsi, &offsets[1..], &gains, &few).is_err());
    assert!(plan(&rsi, &offsets, &[0.0; 9], &few).is_err());
    assert!(plan::bound(&rsi, &offsets, &gains, &[], 1.0).is_err());
    let far = [[0.0, 0.0, 9.0, 0.0, 0.0, 0.0], [f64::NAN; 6]];
    assert!(far.iter().all(|p| plan::bound(&rsi, &offsets, &gains, &[*p], 1.0).is_err()));
    let another = Mechanism { name: "another".into(), workspace: None, ..rsi.clone() };
    assert!(plan(&another, &offsets, &gains, &few).is_ok(), "joint limits stand for a workspace");
    let mut empty = rsi.clone();
    empty.channels.clear();
    empty.chains.clear();
    assert!(plan(&empty, &[], &[], &few).is_err());
}
