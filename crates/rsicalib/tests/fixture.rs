//! Open-loop calibration (13) against closed forms and Monte Carlo.

use crate::paper::{Rng, TABLE_II, counts_of, rsi_parameters};
use rsicalib::Error;
use rsicalib::apply::fixture::fixture;
use rsicalib::mechanism::Mechanism;
use rsicalib::readings::Table;

fn table(values: Vec<f64>) -> Table {
    Table { values, ..Table::default() }
}

#[test]
fn readings_without_noise_give_back_offsets_and_gains() {
    let mechanism = Mechanism::rsi();
    let (offsets, gains) = rsi_parameters(0.05, 0.02);
    let counts = counts_of(&TABLE_II, &offsets, &gains);
    let (lines, poses) = fixture(&mechanism, &table(counts), &TABLE_II).expect("twelve poses");
    assert_eq!(poses, 12);
    for (c, line) in lines.iter().enumerate() {
        // Newton's method leaves 1e-9 rad, the intercept lies some five spreads away.
        assert!((line.offset - offsets[c]).abs() < 1e-7, "offset {c}: {}", line.offset);
        assert!((line.gain / gains[c] - 1.0).abs() < 1e-7, "gain {c}: {}", line.gain);
        assert!(line.residual < 1e-8);
    }
}

#[test]
fn standard_deviations_are_those_of_repeated_trials() {
    let mechanism = Mechanism::rsi();
    let (offsets, gains) = rsi_parameters(0.05, 0.02);
    let exact = counts_of(&TABLE_II, &offsets, &gains);
    let mut rng = Rng::new(7);
    let trials = 400;
    let (mut z2, mut count) = (0.0, 0.0);
    for _ in 0..trials {
        let noisy = exact.iter().map(|a| a + 2.0 * rng.normal()).collect();
        let (lines, _) = fixture(&mechanism, &table(noisy), &TABLE_II).expect("twelve poses");
        for (c, line) in lines.iter().enumerate() {
            let variance = line.covariance.expect("poses to spare")[0][0];
            z2 += (line.offset - offsets[c]).powi(2) / variance;
            count += 1.0;
        }
    }
    // Student's t of 10 degrees of freedom has variance 10/8; 3600 draws know it to 4 %.
    let expected = 10.0 / 8.0;
    assert!((z2 / count / expected - 1.0).abs() < 0.15, "{}", z2 / count);
}

#[test]
fn samples_of_a_pose_count_as_their_mean_and_unknown_poses_not_at_all() {
    let mechanism = Mechanism::rsi();
    let (offsets, gains) = rsi_parameters(0.05, 0.02);
    let exact = counts_of(&TABLE_II, &offsets, &gains);
    let (mut values, mut poses, mut labels) = (Vec::new(), Vec::new(), Vec::new());
    for (m, row) in exact.chunks_exact(9).enumerate() {
        for shift in [-3.0, 3.0] {
            values.extend(row.iter().map(|a| a + shift));
            poses.push(TABLE_II[m]);
            labels.push(m as i64);
        }
    }
    values.extend([1000.0; 9]);
    poses.push([f64::NAN; 6]);
    labels.push(99);
    let table = Table { values, pose: Some(labels), ..Table::default() };
    let (lines, count) = fixture(&mechanism, &table, &poses).expect("twelve poses");
    assert_eq!(count, 12);
    for (c, line) in lines.iter().enumerate() {
        assert!((line.offset - offsets[c]).abs() < 1e-7);
    }
}

/// Counts with noise of `sigma` from sample to sample, and of `shared` from pose to pose.
fn repeated(samples: usize, sigma: f64, shared: f64, seed: u64) -> (Table, Vec<[f64; 6]>) {
    let (offsets, gains) = rsi_parameters(0.05, 0.02);
    let exact = counts_of(&TABLE_II, &offsets, &gains);
    let mut rng = Rng::new(seed);
    let (mut values, mut poses, mut labels) = (Vec::new(), Vec::new(), Vec::new());
    for (m, row) in exact.chunks_exact(9).enumerate() {
        let placed: Vec<f64> = row.iter().map(|a| a + shared * rng.normal()).collect();
        for _ in 0..samples {
            values.extend(placed.iter().map(|a| a + sigma * rng.normal()));
            poses.push(TABLE_II[m]);
            labels.push(m as i64);
        }
    }
    (Table { values, pose: Some(labels), ..Table::default() }, poses)
}

#[test]
fn noise_is_that_of_one_reading_however_often_a_pose_is_read() {
    let mechanism = Mechanism::rsi();
    // Root mean square over nine channels, and its degrees of freedom for one.
    let found = |samples: usize, shared: f64| {
        let (table, poses) = repeated(samples, 2.0, shared, 11 + samples as u64);
        let (lines, _) = fixture(&mechanism, &table, &poses).expect("twelve poses");
        let square = lines.iter().map(|line| line.noise * line.noise).sum::<f64>() / 9.0;
        (square.sqrt(), lines.iter().map(|line| line.dof).fold(f64::INFINITY, f64::min))
    };
    // Nine channels of ten degrees of freedom each know a standard deviation to 7.5 %.
    for samples in [1, 2, 8, 32] {
        let (sigma, dof) = found(samples, 0.0);
        assert!((sigma / 2.0 - 1.0).abs() < 0.25, "{samples} samples: {sigma}");
        assert!(dof >= 9.999, "{samples} samples: {dof}");
    }
    // What all samples of a pose share belongs to a reading, too.
    let (sigma, dof) = found(32, 6.0);
    assert!((sigma / 2.0_f64.hypot(6.0) - 1.0).abs() < 0.25, "{sigma}");
    assert!(dof < 30.0, "{dof}");
}

#[test]
fn what_cannot_be_calibrated_says_why() {
    let mechanism = Mechanism::rsi();
    let (offsets, gains) = rsi_parameters(0.0, 0.0);
    let counts = counts_of(&TABLE_II, &offsets, &gains);
    let few = fixture(&mechanism, &table(counts[..9].to_vec()), &TABLE_II[..1]);
    assert!(matches!(few, Err(Error::TooFew { poses: 1, .. })), "{few:?}");
    let shape = fixture(&mechanism, &table(counts.clone()), &TABLE_II[..5]);
    assert!(matches!(shape, Err(Error::Shape { found: 5, expected: 12, .. })), "{shape:?}");
    let mut far = TABLE_II;
    far[4][2] = -40.0;
    let out = fixture(&mechanism, &table(counts), &far);
    assert!(matches!(out, Err(Error::OutOfReach { pose: Some(4), .. })), "{out:?}");
}
