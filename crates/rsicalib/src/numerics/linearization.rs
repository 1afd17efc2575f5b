//! A least-squares problem at one point: cost, gradient, curvature and damped step.
//!
//! A problem gives its linearisation either as a triangular factor of `J`
//! ([`Curvature::Factor`], for accuracy) or as `JᵀJ` ([`Curvature::Gram`], in
//! one pass over the data and O(n²) memory).

use faer::linalg::solvers::{Llt, Qr, Solve};
use faer::{Mat, Side};

use crate::numerics::schur;
use crate::numerics::small;

/// A least-squares problem.
pub trait Problem {
    /// Number of parameters.
    fn parameters(&self) -> usize;

    /// Cost, gradient and curvature at `x`, which holds one number per parameter. The cost is not
    /// finite where the residual is not defined.
    fn linearize(&self, x: &[f64]) -> Linearization;

    /// The parameters a step away from `x`.
    fn moved(&self, x: &[f64], step: &[f64]) -> Vec<f64> {
        x.iter().zip(step).map(|(x, s)| x + s).collect()
    }

    /// [`Problem::linearize`], in the room of an earlier linearisation of the same problem where
    /// that saves its allocation.
    fn linearize_in(&self, x: &[f64], _room: Option<Linearization>) -> Linearization {
        self.linearize(x)
    }
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
    /// One of so many parameters where the residual is not defined.
    pub(crate) fn undefined(parameters: usize) -> Self {
        let curvature = Curvature::Gram(Mat::zeros(parameters, parameters));
        let gradient = vec![0.0; parameters];
        Self { cost: f64::NAN, gradient, curvature, islands: Vec::new() }
    }

    /// Norm of each column of `J`.
    #[must_use]
    pub fn column_norms(&self) -> Vec<f64> {
        let mut norms = Vec::new();
        self.column_norms_in(&mut norms);
        norms
    }

    /// [`Linearization::column_norms`] in a vector that there is.
    pub(crate) fn column_norms_in(&self, norms: &mut Vec<f64>) {
        norms.clear();
        norms.extend((0..self.gradient.len()).map(|j| match &self.curvature {
            Curvature::Gram(h) => h[(j, j)].max(0.0).sqrt(),
            Curvature::Factor(r, _) => r.col(j).norm_l2(),
        }));
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
    if n <= small::MOST_PARAMETERS {
        return small::solve_damped(h, gradient, damping, scale);
    }
    let inverse: Vec<f64> = scale.iter().map(|scale| 1.0 / scale).collect();
    let mut damped = h.clone();
    for (j, own) in inverse.iter().enumerate() {
        let column = damped.col_as_slice_mut(j);
        column.iter_mut().zip(&inverse).for_each(|(h, other)| *h *= other * own);
        column[j] += damping;
    }
    let factor = Llt::new(damped.as_ref(), Side::Lower).ok()?;
    let s = factor.solve(Mat::from_fn(n, 1, |i, _| -gradient[i] * inverse[i]));
    Some(inverse.iter().enumerate().map(|(i, inverse)| s[(i, 0)] * inverse).collect())
}

/// Least squares by Householder QR; `a` has full column rank.
fn solve_tall(a: &Mat<f64>, b: &Mat<f64>) -> Mat<f64> {
    use faer::linalg::solvers::SolveLstsq;
    Qr::new(a.as_ref()).solve_lstsq(b)
}
