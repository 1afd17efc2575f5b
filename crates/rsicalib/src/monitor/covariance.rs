//! The pseudo-inverse of a covariance.

use faer::Mat;
use nalgebra::DMatrix;

use crate::numerics::symmetric::inverse_root;

/// Inverse of a covariance along what is not rounding, and its rank.
pub(super) fn inverse(covariance: &DMatrix<f64>) -> (DMatrix<f64>, usize) {
    let n = covariance.nrows();
    let (root, ..) = inverse_root(&Mat::from_fn(n, n, |i, j| covariance[(i, j)]));
    let root = DMatrix::from_fn(n, root.ncols(), |i, j| root[(i, j)]);
    (&root * root.transpose(), root.ncols())
}
