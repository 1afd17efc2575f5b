//! Products of small matrices and vectors.

use faer::Mat;

/// `A x`
pub(super) fn times(a: &Mat<f64>, x: &[f64]) -> Vec<f64> {
    (0..a.nrows()).map(|i| (0..x.len()).map(|j| a[(i, j)] * x[j]).sum()).collect()
}

/// `a - b`
pub(super) fn minus(a: &[f64], b: &[f64]) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| a - b).collect()
}
