//! Symmetric eigenproblems: rank, pseudo-inverse, roots and quadratic forms.

use faer::linalg::solvers::DenseSolveCore;
use faer::{Mat, MatRef, Side};

/// Eigenvalues below this fraction of the largest count as zero, in unit columns.
pub(crate) const RANK: f64 = 1e-11;

/// Pseudo-inverse of a Gram matrix, a flag for each parameter that takes part in an unobservable
/// direction, and the condition number of the Jacobian with unit columns.
#[must_use]
pub fn invert(gram: &Mat<f64>) -> (Mat<f64>, Vec<bool>, f64) {
    let (root, unknowable, condition) = inverse_root(gram);
    (&root * root.transpose(), unknowable, condition)
}

/// A symmetric matrix in units of its diagonal: `S = N U Λ Uᵀ N`, `N` diagonal. Parameters differ by many orders of
/// magnitude; so do the sizes of eigenvalues of `S`, which tell nothing of its rank.
pub(crate) struct Unit {
    /// Rows that have something on the diagonal; no other row takes part.
    pub(crate) live: Vec<usize>,
    /// `N`: the root of the diagonal, of each of these rows.
    pub(crate) norms: Vec<f64>,
    /// `Λ`, ascending.
    pub(crate) values: Vec<f64>,
    /// `U`, column by column.
    pub(crate) vectors: Mat<f64>,
}

impl Unit {
    /// None where the matrix holds what is no number.
    pub(crate) fn of(square: MatRef<'_, f64>) -> Option<Self> {
        Self::among(square, 0..square.nrows())
    }

    /// Of some rows and columns of a matrix.
    pub(crate) fn among(
        square: MatRef<'_, f64>,
        rows: impl Iterator<Item = usize>,
    ) -> Option<Self> {
        let (live, norms, unit) = unit_columns(square, rows);
        let (values, vectors) = eigenvalues(unit.as_ref())?;
        Some(Self { live, norms, values, vectors })
    }

    /// The largest eigenvalue.
    pub(crate) fn largest(&self) -> f64 {
        self.values.last().copied().unwrap_or(0.0)
    }

    /// Numbers of the eigenvalues that are rounding beside the largest, and of the others.
    pub(crate) fn lost_and_told(&self) -> [Vec<usize>; 2] {
        let least = RANK * self.largest();
        let (lost, told) = (0..self.values.len()).partition(|&k| self.values[k] < least);
        [lost, told]
    }

    /// `wᵀ u_k` of a vector of all rows, each in units of its norm to the power of `power`.
    fn along(&self, k: usize, vector: &[f64], power: i32) -> f64 {
        let each = self.live.iter().zip(&self.norms).enumerate();
        each.map(|(i, (&row, norm))| self.vectors[(i, k)] * norm.powi(power) * vector[row]).sum()
    }
}

/// Rows of a symmetric matrix that have something on the diagonal, its roots, and the matrix of these rows with a
/// diagonal of ones.
fn unit_columns(
    square: MatRef<'_, f64>,
    rows: impl Iterator<Item = usize>,
) -> (Vec<usize>, Vec<f64>, Mat<f64>) {
    let live: Vec<usize> = rows.filter(|&i| is_seen(square[(i, i)])).collect();
    let norms: Vec<f64> = live.iter().map(|&i| square[(i, i)].sqrt()).collect();
    let unit = Mat::from_fn(live.len(), live.len(), |i, j| {
        square[(live[i], live[j])] / (norms[i] * norms[j])
    });
    (live, norms, unit)
}

/// True for an entry of a diagonal that tells something.
pub(crate) fn is_seen(entry: f64) -> bool {
    entry > 0.0 && entry.is_finite()
}

/// A root `R` of the pseudo-inverse `R Rᵀ` of a Gram matrix, with a column for each direction that
/// is observable; flags and condition number as of [`invert`].
#[must_use]
pub fn inverse_root(gram: &Mat<f64>) -> (Mat<f64>, Vec<bool>, f64) {
    let n = gram.nrows();
    if n == 0 {
        return (Mat::zeros(0, 0), Vec::new(), 1.0);
    }
    let finite = (0..n).all(|i| gram[(i, i)].is_finite());
    let Some(unit) = Unit::of(gram.as_ref()).filter(|_| finite) else {
        return (Mat::zeros(n, 0), vec![true; n], f64::INFINITY);
    };
    let [lost, told] = unit.lost_and_told();
    let mut unknowable = vec![true; n];
    for (i, &row) in unit.live.iter().enumerate() {
        unknowable[row] = lost.iter().any(|&k| unit.vectors[(i, k)].abs() > 1e-3);
    }
    let mut root = Mat::zeros(n, told.len());
    for (column, &k) in told.iter().enumerate() {
        let by = unit.values[k].sqrt();
        for (i, &row) in unit.live.iter().enumerate() {
            root[(row, column)] = unit.vectors[(i, k)] / (unit.norms[i] * by);
        }
    }
    let whole = unit.live.len() == n;
    let smallest = if whole { unit.values[0].max(0.0) } else { 0.0 };
    (root, unknowable, (unit.largest() / smallest).sqrt())
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
        let Some(unit) = Unit::of(gram.as_ref()) else {
            return Self { ways: Mat::zeros(0, n), holds: Mat::zeros(0, n) };
        };
        let [lost, _] = unit.lost_and_told();
        let absent: Vec<usize> = (0..n).filter(|row| !unit.live.contains(row)).collect();
        let mut ways = Mat::zeros(absent.len() + lost.len(), n);
        let mut holds = ways.clone();
        for (k, &row) in absent.iter().enumerate() {
            (ways[(k, row)], holds[(k, row)]) = (1.0, 1.0);
        }
        for (k, &own) in lost.iter().enumerate() {
            for (i, (&row, norm)) in unit.live.iter().zip(&unit.norms).enumerate() {
                ways[(absent.len() + k, row)] = unit.vectors[(i, own)] / norm;
                holds[(absent.len() + k, row)] = unit.vectors[(i, own)] * norm;
            }
        }
        Self { ways, holds }
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
    let Some(unit) = Unit::of(covariance) else { return (0.0, 0.0) };
    let kept = (0..unit.values.len()).filter(|&k| unit.values[k] > 1e-6);
    let of = |k: usize| unit.along(k, d, -1).powi(2) / unit.values[k];
    kept.fold((0.0, 0.0), |(sum, count), k| (sum + of(k), count + 1.0))
}

/// The part of a step that lies in directions of which a Gram matrix tells nothing.
#[must_use]
pub fn nowhere(gram: &Mat<f64>, step: &[f64]) -> Vec<f64> {
    let (live, norms, unit) = unit_columns(gram.as_ref(), 0..gram.nrows());
    let mut part = step.to_vec();
    live.iter().for_each(|&row| part[row] = 0.0);
    if seen_everywhere(&unit) {
        return part;
    }
    let Some((values, vectors)) = eigenvalues(unit.as_ref()) else { return part };
    let unit = Unit { live, norms, values, vectors };
    let [lost, _] = unit.lost_and_told();
    for k in lost {
        let along = unit.along(k, step, 1);
        for (i, (&row, norm)) in unit.live.iter().zip(&unit.norms).enumerate() {
            part[row] += unit.vectors[(i, k)] * along / norm;
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
