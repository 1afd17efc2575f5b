//! Sums over the rows from one on, to score what moved at that row.

use faer::Mat;

/// Rows on either side of a move: fewer are single samples.
pub const SIDE: usize = 4;

/// Sums for (83) over the rows from one on.
pub struct StepSums {
    u: [f64; 3],
    zz: [[f64; 3]; 3],
    zx: Mat<f64>,
}

impl StepSums {
    /// Of no row, for so many parameters.
    #[must_use]
    pub fn new(parameters: usize) -> Self {
        Self { u: [0.0; 3], zz: [[0.0; 3]; 3], zx: Mat::zeros(parameters, 3) }
    }

    /// Adds a row: its `X` and its residual, equation by equation.
    pub fn add(&mut self, x: &[f64], r: &[f64], columns: &[usize; 3]) {
        let n = self.zx.nrows();
        for (x, r) in x.chunks_exact(n).zip(r) {
            for (i, &a) in columns.iter().enumerate() {
                self.u[i] += x[a] * r;
                for (j, &b) in columns.iter().enumerate() {
                    self.zz[i][j] += x[a] * x[b];
                }
                for (sum, value) in self.zx.col_as_slice_mut(i).iter_mut().zip(x) {
                    *sum += value * x[a];
                }
            }
        }
    }

    /// The score, and how far the three columns moved, were they fitted; `inverse` is
    /// `(XᵀX)⁻¹`. None where the rows do not tell all three.
    #[must_use]
    pub fn score(&self, inverse: &Mat<f64>) -> Option<(f64, f64)> {
        let absorbed = self.zx.transpose() * (inverse * &self.zx);
        let m = Mat::from_fn(3, 3, |i, j| self.zz[i][j] - absorbed[(i, j)]);
        let (inverse, unknowable, _) = crate::numerics::symmetric::invert(&m);
        if unknowable.iter().any(|u| *u) {
            return None;
        }
        let by: Vec<f64> =
            (0..3).map(|i| (0..3).map(|j| inverse[(i, j)] * self.u[j]).sum()).collect();
        let score = by.iter().zip(&self.u).map(|(b, u)| b * u).sum();
        Some((score, by.iter().map(|b| b * b).sum::<f64>().sqrt()))
    }
}
