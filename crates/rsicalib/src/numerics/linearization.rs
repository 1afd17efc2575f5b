//! A least-squares problem at one point: cost, gradient, curvature and damped step.
//!
//! A problem gives its linearisation either as a triangular factor of `J`
//! ([`Curvature::Factor`], for accuracy) or as `JᵀJ` ([`Curvature::Gram`], in
//! one pass over the data and O(n²) memory).

use faer::linalg::solvers::{Llt, Qr, Solve};
use faer::{Mat, Side};

use crate::numerics::lanes::dispatch;
use crate::numerics::schur;

/// A least-squares problem.
pub trait Problem {
    /// Number of parameters.
    fn parameters(&self) -> usize;

    /// Cost, gradient and curvature at `x`, which holds one number per parameter. The cost is not
    /// finite where the residual is not defined.
    fn linearize(&self, x: &[f64]) -> Linearization;
}

/// A problem at one point.
#[derive(Debug, Clone)]
pub struct Linearization {
    /// `½‖r‖²`
    pub cost: f64,
    /// `Jᵀr`
    pub gradient: Vec<f64>,
    /// `JᵀJ`, in one of two forms.
    pub curvature: Curvature,
    /// Islands: sets of trailing parameters, where parameters of different sets share no entry of
    /// `JᵀJ`. Islands are eliminated first, eq. (33). Empty for [`Curvature::Factor`].
    pub islands: Vec<Vec<usize>>,
}

/// `JᵀJ`, or a factor of it.
#[derive(Debug, Clone)]
pub enum Curvature {
    /// `JᵀJ`, both triangles.
    Gram(Mat<f64>),
    /// `R` with `RᵀR = JᵀJ`, and `Qᵀr`.
    Factor(Mat<f64>, Vec<f64>),
}

impl Linearization {
    /// Norm of each column of `J`.
    #[must_use]
    pub fn column_norms(&self) -> Vec<f64> {
        let n = self.gradient.len();
        match &self.curvature {
            Curvature::Gram(h) => (0..n).map(|j| h[(j, j)].max(0.0).sqrt()).collect(),
            Curvature::Factor(r, _) => (0..n).map(|j| r.col(j).norm_l2()).collect(),
        }
    }

    /// `JᵀJ`.
    #[must_use]
    pub fn gram(&self) -> Mat<f64> {
        match &self.curvature {
            Curvature::Gram(h) => h.clone(),
            Curvature::Factor(r, _) => r.transpose() * r,
        }
    }

    /// `(JᵀJ)⁻¹`; `None` where `JᵀJ` is singular to rounding.
    #[must_use]
    pub fn covariance(&self) -> Option<Mat<f64>> {
        let n = self.gradient.len();
        if n == 0 {
            return Some(Mat::zeros(0, 0));
        }
        let norms = self.column_norms();
        let scaled = |m: &Mat<f64>| Mat::from_fn(m.nrows(), n, |i, j| m[(i, j)] / norms[j]);
        let inverse = match &self.curvature {
            Curvature::Gram(h) => {
                let unit = Mat::from_fn(n, n, |i, j| h[(i, j)] / (norms[i] * norms[j]));
                Llt::new(unit.as_ref(), Side::Lower).ok()?.solve(Mat::<f64>::identity(n, n))
            }
            Curvature::Factor(r, _) => {
                let back = scaled(r).svd().ok()?;
                let s = back.S().column_vector();
                if s[n - 1] <= s[0] * f64::EPSILON * n as f64 {
                    return None;
                }
                let v = back.V();
                Mat::from_fn(n, n, |i, j| {
                    (0..n).map(|k| v[(i, k)] * v[(j, k)] / (s[k] * s[k])).sum()
                })
            }
        };
        let inverse = Mat::from_fn(n, n, |i, j| inverse[(i, j)] / (norms[i] * norms[j]));
        (0..n).all(|j| inverse[(j, j)].is_finite()).then_some(inverse)
    }

    /// Solves (31).
    pub(crate) fn damped_step(&self, damping: f64, scale: &[f64]) -> Option<Vec<f64>> {
        let n = self.gradient.len();
        let step: Vec<f64> = match &self.curvature {
            Curvature::Gram(h) if !self.islands.is_empty() => {
                schur::solve(h, &self.gradient, damping, scale, &self.islands)?
            }
            Curvature::Gram(h) => solve_damped(h, &self.gradient, damping, scale)?,
            Curvature::Factor(r, qtr) => {
                let stacked = Mat::from_fn(r.nrows() + n, n, |i, j| {
                    if i < r.nrows() {
                        r[(i, j)] / scale[j]
                    } else if i - r.nrows() == j {
                        damping.sqrt()
                    } else {
                        0.0
                    }
                });
                let rhs = Mat::from_fn(
                    r.nrows() + n,
                    1,
                    |i, _| {
                        if i < r.nrows() { -qtr[i] } else { 0.0 }
                    },
                );
                let s = solve_tall(&stacked, &rhs);
                (0..n).map(|i| s[(i, 0)] / scale[i]).collect()
            }
        };
        step.iter().all(|s| s.is_finite()).then_some(step)
    }
}

/// Solves (31) from `JᵀJ` in unit columns; `None` where the matrix is not positive definite.
fn solve_damped(h: &Mat<f64>, gradient: &[f64], damping: f64, scale: &[f64]) -> Option<Vec<f64>> {
    let n = gradient.len();
    if n > SMALL {
        let unit = |i: usize, j: usize| h[(i, j)] / (scale[i] * scale[j]);
        let damped = Mat::from_fn(n, n, |i, j| unit(i, j) + if i == j { damping } else { 0.0 });
        let factor = Llt::new(damped.as_ref(), Side::Lower).ok()?;
        let s = factor.solve(Mat::from_fn(n, 1, |i, _| -gradient[i] / scale[i]));
        return Some((0..n).map(|i| s[(i, 0)] / scale[i]).collect());
    }
    // Columns of the lower triangle, the right-hand side as one more row below them.
    let rows = n + 1;
    let mut room = [0.0; (SMALL + 1) * SMALL];
    let l = &mut room[..rows * n];
    let mut s: Vec<f64> = scale.iter().map(|s| 1.0 / s).collect();
    for (j, column) in l.chunks_exact_mut(rows).enumerate() {
        let own = &h.col_as_slice(j)[j..];
        for ((value, h), inverse) in column[j..n].iter_mut().zip(own).zip(&s[j..]) {
            *value = h * inverse * s[j];
        }
        column[j] += damping;
        column[n] = -gradient[j] * s[j];
    }
    dispatch(
        #[inline(always)]
        || factor_in_place(l, n),
    )
    .then_some(())?;
    let inverse = std::mem::replace(&mut s, vec![0.0; n]);
    for j in (0..n).rev() {
        let column = &l[j * rows..(j + 1) * rows];
        let known: f64 = column[j + 1..n].iter().zip(&s[j + 1..]).map(|(l, s)| l * s).sum();
        s[j] = (column[n] - known) / column[j];
    }
    s.iter_mut().zip(&inverse).for_each(|(s, inverse)| *s *= inverse);
    Some(s)
}

/// For fewer parameters than this, the overhead of faer's general Cholesky exceeds the work.
const SMALL: usize = 24;

/// Cholesky of the columns of a lower triangle with one more row, right-looking.
#[expect(clippy::neg_cmp_op_on_partial_ord, reason = "a NaN is no pivot either")]
#[inline(always)]
fn factor_in_place(l: &mut [f64], n: usize) -> bool {
    let rows = n + 1;
    for j in 0..n {
        let (head, tail) = l.split_at_mut((j + 1) * rows);
        let column = &mut head[j * rows..];
        if !(column[j] > 0.0) {
            return false; // also for a NaN
        }
        let pivot = 1.0 / column[j].sqrt();
        column[j..].iter_mut().for_each(|v| *v *= pivot);
        for (k, next) in (j + 1..n).zip(tail.chunks_exact_mut(rows)) {
            let factor = column[k];
            for (a, b) in next[k..].iter_mut().zip(&column[k..]) {
                *a -= factor * b;
            }
        }
    }
    true
}

/// Least squares by Householder QR; `a` has full column rank.
fn solve_tall(a: &Mat<f64>, b: &Mat<f64>) -> Mat<f64> {
    use faer::linalg::solvers::SolveLstsq;
    Qr::new(a.as_ref()).solve_lstsq(b)
}
