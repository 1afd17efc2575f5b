//! The directions in which loops are stiff at a place.

use nalgebra::{DMatrix, DVector};

use crate::model::near::RANK;

/// Misclosure `f` of the loops, and the directions in which they are stiff: `G = ∂f/∂q = U S Vᵀ`.
pub(super) struct Stiff {
    f: DVector<f64>,
    u: DMatrix<f64>,
    s: Vec<f64>,
    v: DMatrix<f64>,
}

impl Stiff {
    /// Without directions where something is not a number.
    pub(super) fn of(f: DVector<f64>, g: &DMatrix<f64>) -> Self {
        let (m, n) = g.shape();
        if g.iter().chain(f.iter()).any(|g| !g.is_finite()) {
            return Self { f, u: DMatrix::zeros(m, 0), s: vec![], v: DMatrix::zeros(n, 0) };
        }
        let eigen = (g * g.transpose()).symmetric_eigen();
        let least = RANK * RANK * eigen.eigenvalues.max();
        let kept: Vec<usize> = (0..m).filter(|&k| eigen.eigenvalues[k] > least).collect();
        let s: Vec<f64> = kept.iter().map(|&k| eigen.eigenvalues[k].sqrt()).collect();
        let u = eigen.eigenvectors.select_columns(&kept);
        let mut v = g.transpose() * &u;
        v.column_iter_mut().zip(&s).for_each(|(mut v, s)| v /= *s);
        Self { f, u, s, v }
    }

    /// The shortest step that closes.
    pub(super) fn correction(&self) -> DVector<f64> {
        let mut along = self.u.tr_mul(&self.f);
        along.iter_mut().zip(&self.s).for_each(|(along, s)| *along /= -s);
        &self.v * along
    }

    /// The part of a way along which the loops are not stiff.
    pub(super) fn free(&self, way: &DVector<f64>) -> DVector<f64> {
        way - &self.v * self.v.tr_mul(way)
    }

    /// The product of (174).
    pub(super) fn alike(&self, other: &Self) -> f64 {
        if self.s.len() != other.s.len() {
            return 0.0;
        }
        self.v.tr_mul(&other.v).determinant() * self.u.tr_mul(&other.u).determinant()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two lines that cross: `x y = 0`.
    fn cross(x: f64, y: f64) -> Stiff {
        Stiff::of(DVector::from_element(1, x * y), &DMatrix::from_row_slice(1, 2, &[y, x]))
    }

    /// The same with one equation that follows from the other.
    fn twice(x: f64, y: f64) -> Stiff {
        let g = DMatrix::from_row_slice(2, 2, &[y, x, -2.0 * y, -2.0 * x]);
        Stiff::of(DVector::from_vec(vec![x * y, -2.0 * x * y]), &g)
    }

    #[test]
    fn a_singular_configuration_is_seen_from_both_sides() {
        for of in [cross, twice] {
            assert!((of(-0.2, 0.0).alike(&of(-0.1, 0.0)) - 1.0).abs() < 1e-12);
            assert!((of(-0.1, 0.0).alike(&of(0.1, 0.0)) + 1.0).abs() < 1e-12);
            assert!(of(-0.1, 0.0).alike(&of(0.0, 0.1)).abs() < 1e-12);
        }
    }

    #[test]
    fn a_correction_is_the_shortest_step_that_closes() {
        // x² + y² = 1, from (2, 0): the slope is 4, the misclosure 3.
        let g = DMatrix::from_row_slice(1, 2, &[4.0, 0.0]);
        let stiff = Stiff::of(DVector::from_element(1, 3.0), &g);
        assert!((stiff.correction() - DVector::from_vec(vec![-0.75, 0.0])).amax() < 1e-12);
        assert_eq!(
            stiff.free(&DVector::from_vec(vec![1.0, 2.0])),
            DVector::from_vec(vec![0.0, 2.0])
        );
    }
}
