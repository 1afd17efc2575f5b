//! Symmetric eigenproblems: rank, pseudo-inverse, roots and quadratic forms.

use faer::linalg::solvers::DenseSolveCore;
use faer::{Mat, MatRef, Side};

/// Eigenvalues below this fraction of the largest count as zero, in unit columns.
const RANK: f64 = 1e-11;

/// Pseudo-inverse of a Gram matrix, a flag for each parameter that takes part in an unobservable
/// direction, and the condition number of the Jacobian with unit columns.
#[must_use]
pub fn invert(gram: &Mat<f64>) -> (Mat<f64>, Vec<bool>, f64) {
    let (root, unknowable, condition) = inverse_root(gram);
    (&root * root.transpose(), unknowable, condition)
}

/// A root `R` of the pseudo-inverse `R Rᵀ` of a Gram matrix, with a column for each direction that
/// is observable; flags and condition number as of [`invert`].
#[must_use]
pub fn inverse_root(gram: &Mat<f64>) -> (Mat<f64>, Vec<bool>, f64) {
    let n = gram.nrows();
    if n == 0 {
        return (Mat::zeros(0, 0), Vec::new(), 1.0);
    }
    let norms: Vec<f64> = (0..n).map(|i| gram[(i, i)].max(0.0).sqrt()).collect();
    let unit = Mat::from_fn(n, n, |i, j| {
        let norm = norms[i] * norms[j];
        if norm > 0.0 { gram[(i, j)] / norm } else { 0.0 }
    });
    let mut unknowable: Vec<bool> = norms.iter().map(|v| *v == 0.0 || !v.is_finite()).collect();
    let Ok(eigen) = unit.self_adjoint_eigen(faer::Side::Lower) else {
        return (Mat::zeros(n, 0), vec![true; n], f64::INFINITY);
    };
    let values = eigen.S().column_vector();
    let vectors = eigen.U();
    let (largest, smallest) = (values[n - 1], values[0].max(0.0));
    for k in 0..n {
        if values[k] < RANK * largest {
            for i in 0..n {
                unknowable[i] |= vectors[(i, k)].abs() > 1e-3;
            }
        }
    }
    let kept: Vec<usize> = (0..n).filter(|&k| values[k] >= RANK * largest).collect();
    let root = Mat::from_fn(n, kept.len(), |i, k| {
        if norms[i] > 0.0 {
            vectors[(i, kept[k])] / (norms[i] * values[kept[k]].sqrt())
        } else {
            0.0
        }
    });
    (root, unknowable, (largest / smallest).sqrt())
}

/// Directions of which a Gram matrix tells nothing, row by row: `x` with `G x = 0`, and `u` with
/// `uᵀ x = 1`, whose square holds that direction and no other.
pub(crate) struct Unseen {
    /// The directions.
    pub(crate) ways: Mat<f64>,
    /// What holds each.
    pub(crate) holds: Mat<f64>,
}

impl Unseen {
    /// Of a Gram matrix.
    pub(crate) fn of(gram: &Mat<f64>) -> Self {
        let n = gram.nrows();
        let norm = |i: usize| {
            let norm = gram[(i, i)].max(0.0).sqrt();
            if norm > 0.0 { norm } else { 1.0 }
        };
        let norms: Vec<f64> = (0..n).map(norm).collect();
        let unit = Mat::from_fn(n, n, |i, j| gram[(i, j)] / (norms[i] * norms[j]));
        let (values, vectors) =
            eigenvalues(unit.as_ref()).unwrap_or_else(|| (vec![1.0; n], Mat::zeros(n, n)));
        let largest = values.iter().copied().fold(0.0, f64::max);
        let lost: Vec<usize> = (0..n).filter(|&k| values[k] < RANK * largest).collect();
        let rows = |scale: &dyn Fn(usize) -> f64| {
            Mat::from_fn(lost.len(), n, |k, i| vectors[(i, lost[k])] * scale(i))
        };
        Self { ways: rows(&|i| 1.0 / norms[i]), holds: rows(&|i| norms[i]) }
    }

    /// True where some direction changes `½ xᵀ Ω x` by more than rounding.
    pub(crate) fn matters(&self, omega: &Mat<f64>) -> bool {
        (0..self.ways.nrows()).any(|k| {
            let (whole, parts) = along(&self.ways, k, omega);
            whole > VISIBLE * parts
        })
    }

    /// `Σ xᵀ Ω x`
    pub(crate) fn trace(&self, omega: &Mat<f64>) -> f64 {
        (0..self.ways.nrows()).map(|k| along(&self.ways, k, omega).0).sum()
    }
}

/// `xᵀ Ω x` of a row, and the sum of what its components alone would make.
fn along(ways: &Mat<f64>, k: usize, omega: &Mat<f64>) -> (f64, f64) {
    let n = ways.ncols();
    let product = |ij: usize| ways[(k, ij / n)] * omega[(ij / n, ij % n)] * ways[(k, ij % n)];
    ((0..n * n).map(product).sum(), (0..n).map(|i| product(i * n + i)).sum())
}

/// Eigenvalues of a symmetric matrix, ascending, and its eigenvectors; none where it holds what is no
/// number. Most matrices of candidates are one number, its own eigenvalue.
pub(crate) fn eigenvalues(square: MatRef<'_, f64>) -> Option<(Vec<f64>, Mat<f64>)> {
    let n = square.nrows();
    if n == 1 && square[(0, 0)].is_finite() {
        return Some((vec![square[(0, 0)]], Mat::identity(1, 1)));
    }
    let eigen = square.self_adjoint_eigen(Side::Lower).ok()?;
    let values = eigen.S().column_vector();
    Some(((0..n).map(|k| values[k]).collect(), eigen.U().to_owned()))
}

/// `dᵀ C⁺ d`, and in how many directions: those that have a part of the variance that rounding does
/// not, in units of the standard deviations.
pub(crate) fn told(covariance: MatRef<'_, f64>, d: &[f64]) -> (f64, f64) {
    let n = d.len();
    let sd: Vec<f64> = (0..n).map(|i| covariance[(i, i)].max(0.0).sqrt()).collect();
    let free: Vec<usize> = (0..n).filter(|&i| sd[i] > 0.0).collect();
    let unit = Mat::from_fn(free.len(), free.len(), |i, j| {
        covariance[(free[i], free[j])] / (sd[free[i]] * sd[free[j]])
    });
    let Some((values, vectors)) = eigenvalues(unit.as_ref()) else { return (0.0, 0.0) };
    let along = |k: usize| -> f64 {
        free.iter().enumerate().map(|(i, &f)| vectors[(i, k)] * d[f] / sd[f]).sum()
    };
    let kept = (0..values.len()).filter(|&k| values[k] > 1e-6);
    kept.fold((0.0, 0.0), |(sum, count), k| (sum + along(k).powi(2) / values[k], count + 1.0))
}

/// The part of a step that lies in directions of which a Gram matrix tells nothing.
#[must_use]
pub fn nowhere(gram: &Mat<f64>, step: &[f64]) -> Vec<f64> {
    let n = gram.nrows();
    if n == 0 {
        return Vec::new();
    }
    let norms: Vec<f64> = (0..n).map(|i| gram[(i, i)].max(0.0).sqrt()).collect();
    let unit = Mat::from_fn(n, n, |i, j| {
        let norm = norms[i] * norms[j];
        if norm > 0.0 { gram[(i, j)] / norm } else { 0.0 }
    });
    if seen_everywhere(&unit) {
        return vec![0.0; n];
    }
    let mut part: Vec<f64> =
        step.iter().zip(&norms).map(|(s, norm)| if *norm > 0.0 { 0.0 } else { *s }).collect();
    let Ok(eigen) = unit.self_adjoint_eigen(Side::Lower) else { return part };
    let (values, vectors) = (eigen.S().column_vector(), eigen.U());
    for k in (0..n).filter(|&k| values[k] < RANK * values[n - 1]) {
        let along: f64 = (0..n).map(|i| vectors[(i, k)] * norms[i] * step[i]).sum();
        for (i, part) in part.iter_mut().enumerate().filter(|(i, _)| norms[*i] > 0.0) {
            *part += vectors[(i, k)] * along / norms[i];
        }
    }
    part
}

/// True where a Cholesky factor proves that no eigenvalue of a matrix with a unit diagonal is
/// below [`RANK`] of the largest: `λ_max ≤ tr A = n`.
fn seen_everywhere(unit: &Mat<f64>) -> bool {
    inverse_above(unit, unit.nrows() as f64 * RANK).is_some()
}

/// `A⁻¹` where a Cholesky factor proves that all eigenvalues are well above this one:
/// `λ_min ≥ 1/tr A⁻¹`. It takes a tenth of the time of the eigenvalues.
pub(crate) fn inverse_above(a: &Mat<f64>, least: f64) -> Option<Mat<f64>> {
    let inverse = a.llt(Side::Lower).ok()?.inverse();
    let trace: f64 = (0..a.nrows()).map(|i| inverse[(i, i)]).sum();
    (trace > 0.0 && trace * least < 0.01).then_some(inverse)
}

/// Smallest share of a column that counts after the projection.
pub const SEEN: f64 = 1e-3;

/// Smallest share of a column's square that is more than rounding after the projection.
pub const VISIBLE: f64 = 1e-8;

/// Decrease of χ² without the equations of a pose, `rᵀ (I - H)⁻¹ r`, and the number of directions
/// that the other equations judge: those in which `H`, the part that the fit absorbs, is not 1.
#[must_use]
pub fn left_out(hat: &Mat<f64>, r: &[f64]) -> Option<(f64, f64)> {
    if r.is_empty() {
        return None;
    }
    let left = Mat::<f64>::identity(r.len(), r.len()) - hat;
    let eigen = left.self_adjoint_eigen(Side::Lower).ok()?;
    let (values, vectors) = (eigen.S().column_vector(), eigen.U());
    let (mut score, mut width) = (0.0, 0.0);
    for k in (0..r.len()).filter(|&k| values[k] > SEEN) {
        let along: f64 = r.iter().enumerate().map(|(e, r)| vectors[(e, k)] * r).sum();
        score += along * along / values[k];
        width += 1.0;
    }
    (width > 0.0).then_some((score, width))
}

/// `aᵀ b`
pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[cfg(test)]
mod tests {
    use faer::Mat;

    use super::{nowhere, seen_everywhere};

    /// Gram matrix of three columns, the last of which is the sum of the others but for `apart`.
    fn gram(apart: f64) -> Mat<f64> {
        let x = |i: usize, j: usize| ((i * i + 3 * j * i + j) as f64).sin();
        let columns = Mat::from_fn(9, 3, |i, j| match j {
            2 => x(i, 0) + x(i, 1) + apart * x(i, 5),
            _ => x(i, j),
        });
        columns.transpose() * &columns
    }

    fn unit(gram: &Mat<f64>) -> Mat<f64> {
        Mat::from_fn(3, 3, |i, j| gram[(i, j)] / (gram[(i, i)] * gram[(j, j)]).sqrt())
    }

    #[test]
    fn a_step_along_what_nothing_tells_is_nowhere_and_another_is_not() {
        let dependent = gram(0.0);
        assert!(!seen_everywhere(&unit(&dependent)));
        let part = nowhere(&dependent, &[1.0, 1.0, -1.0]);
        for (part, step) in part.iter().zip([1.0, 1.0, -1.0]) {
            assert!((part - step).abs() < 1e-6, "{part} {step}");
        }
        let independent = gram(0.1);
        assert!(seen_everywhere(&unit(&independent)));
        assert_eq!(nowhere(&independent, &[1.0, 1.0, -1.0]), vec![0.0; 3]);
    }

    #[test]
    fn where_the_factor_proves_nothing_the_eigenvalues_decide() {
        // Eigenvalues about 1e-10 of the largest: above the limit, but not proved by the factor.
        let weak = gram(1e-5);
        assert!(!seen_everywhere(&unit(&weak)));
        assert_eq!(nowhere(&weak, &[1.0, 1.0, -1.0]), vec![0.0; 3]);
    }
}
