//! Sums over the rows from one on, to score what moved at that row.

use faer::{Mat, Side};

/// Rows on either side of a move: fewer are single samples.
pub const SIDE: usize = 4;

/// Fraction of a column's length that must be left after the projection, and of the longest
/// column's that a column must have: less is rounding.
const VISIBLE: f64 = 1e-8;

/// What a move is worth, from the sums at its row.
pub struct StepScore {
    /// Fall of χ², to first order.
    pub score: f64,
    /// Number of directions that the rows tell.
    pub rank: usize,
    /// How far all columns together moved, were they fitted.
    pub by: f64,
}

/// Sums for (83) over the rows from one on.
pub struct StepSums {
    u: Vec<f64>,
    zz: Mat<f64>,
    zx: Mat<f64>,
}

impl StepSums {
    /// Of no row, for so many parameters and columns of what moved.
    #[must_use]
    pub fn new(parameters: usize, columns: usize) -> Self {
        let zz = Mat::zeros(columns, columns);
        Self { u: vec![0.0; columns], zz, zx: Mat::zeros(parameters, columns) }
    }

    /// Adds a row: its `X` and its residual, equation by equation. What moved is in `columns`.
    pub fn add(&mut self, x: &[f64], r: &[f64], columns: &[usize]) {
        let n = self.zx.nrows();
        for (x, r) in x.chunks_exact(n).zip(r) {
            for (i, &a) in columns.iter().enumerate() {
                self.u[i] += x[a] * r;
                for (sum, &b) in self.zz.col_as_slice_mut(i).iter_mut().zip(columns) {
                    *sum += x[a] * x[b];
                }
                for (sum, other) in self.zx.col_as_slice_mut(i).iter_mut().zip(x) {
                    *sum += x[a] * other;
                }
            }
        }
    }

    /// The score of a move here, in the directions that the rows tell; `inverse` is `(XᵀX)⁻¹`.
    #[must_use]
    pub fn score(&self, inverse: &Mat<f64>) -> Option<StepScore> {
        let columns = self.u.len();
        let absorbed = self.zx.transpose() * (inverse * &self.zx);
        let norms: Vec<f64> = (0..columns).map(|i| self.zz[(i, i)].max(0.0).sqrt()).collect();
        let longest = norms.iter().fold(0.0_f64, |most, norm| most.max(*norm));
        let unit = |i: usize| match norms[i] > VISIBLE * longest {
            true => 1.0 / norms[i],
            false => 0.0,
        };
        let square = Mat::from_fn(columns, columns, |i, j| {
            (self.zz[(i, j)] - absorbed[(i, j)]) * unit(i) * unit(j)
        });
        let eigen = square.self_adjoint_eigen(Side::Lower).ok()?;
        let (values, vectors) = (eigen.S().column_vector(), eigen.U());
        let (mut score, mut rank, mut moved) = (0.0, 0, vec![0.0; columns]);
        for k in (0..columns).filter(|&k| values[k] > VISIBLE) {
            let along: f64 =
                (0..columns).map(|i| vectors[(i, k)] * self.u[i] * unit(i)).sum::<f64>();
            score += along * along / values[k];
            rank += 1;
            for (i, m) in moved.iter_mut().enumerate() {
                *m += vectors[(i, k)] * unit(i) * along / values[k];
            }
        }
        let by = moved.iter().map(|m| m * m).sum::<f64>().sqrt();
        (rank > 0).then_some(StepScore { score, rank, by })
    }
}
