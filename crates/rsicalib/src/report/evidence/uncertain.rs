//! How well the parameters of a fit place points of a mechanism.
//!
//! With the correlation `R` of the parameters and the shift `M` of a place by one standard
//! deviation of each, to first order by differences,
//!
//! ```text
//! cov place = M R Mᵀ,    corr(parameters, uᵀ place) = R Mᵀ u / √(uᵀ M R Mᵀ u)
//! ```

use crate::numerics::order::Ends;
use faer::Mat;
use nalgebra::{Matrix3, SymmetricEigen, Vector3};

use crate::estimate::Fit;
use crate::numerics::workers;

/// Step of the differences, in standard deviations: small for linearity, large against rounding.
const STEP: f64 = 1e-2;

/// How the parameters of a fit move places.
pub struct Uncertain {
    /// Shifts by one standard deviation: parameter by parameter, place by place.
    moves: Vec<Vec<Vector3<f64>>>,
    /// Correlation of the parameters.
    correlation: Mat<f64>,
}

impl Uncertain {
    /// Of the places that `at` gives for parameters of a fit.
    pub fn of(fit: &Fit, at: impl Fn(&[f64]) -> Vec<Vector3<f64>> + Sync) -> Self {
        // What is unknown beside the terms places what is somewhere else in each pose.
        let n = fit.covariance.nrows();
        let sd: Vec<f64> = (0..n).map(|i| fit.covariance[(i, i)].max(0.0).sqrt()).collect();
        let moved = |i: usize| -> Vec<Vector3<f64>> {
            let there = |sign: f64| {
                let mut beta = fit.beta.clone();
                beta[i] += sign * STEP * sd[i];
                at(&beta)
            };
            let (ahead, behind) = (there(1.0), there(-1.0));
            ahead.iter().zip(&behind).map(|(a, b)| (a - b) / (2.0 * STEP)).collect()
        };
        let correlation = Mat::from_fn(n, n, |i, j| {
            fit.covariance[(i, j)] / (sd[i] * sd[j]).max(f64::MIN_POSITIVE)
        });
        Self { moves: workers::map(0..n, moved), correlation }
    }

    /// Covariance of a place.
    pub fn covariance(&self, place: usize) -> Matrix3<f64> {
        let mut sum = Matrix3::zeros();
        for (i, a) in self.moves.iter().enumerate() {
            let mut with = Vector3::zeros();
            for (j, b) in self.moves.iter().enumerate() {
                with += b[place] * self.correlation[(i, j)];
            }
            sum += a[place] * with.transpose();
        }
        sum
    }

    /// The parameter that is most correlated with a place along a direction, and its correlation;
    /// none where no parameter moves it.
    pub fn goes_with(&self, place: usize, along: &Vector3<f64>) -> Option<(usize, f64)> {
        let shifts: Vec<f64> = self.moves.iter().map(|m| m[place].dot(along)).collect();
        let n = shifts.len();
        let with = |i: usize| (0..n).map(|j| self.correlation[(i, j)] * shifts[j]).sum::<f64>();
        let variance: f64 = (0..n).map(|i| shifts[i] * with(i)).sum();
        let found = (0..n).map(|i| (i, with(i) / variance.sqrt()));
        found.filter(|(_, r)| r.is_finite()).greatest_by(|a| a.1.abs())
    }
}

/// Longest axis of a covariance, one standard deviation long.
pub fn principal(covariance: &Matrix3<f64>) -> Vector3<f64> {
    if covariance.iter().any(|v| !v.is_finite()) {
        return Vector3::zeros();
    }
    let eigen = SymmetricEigen::new(*covariance);
    let longest = eigen.eigenvalues.imax();
    eigen.eigenvectors.column(longest) * eigen.eigenvalues[longest].max(0.0).sqrt()
}
