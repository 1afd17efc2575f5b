//! Sums over the rows from one on, to score what moved at that row.

use faer::linalg::solvers::Llt;
use faer::{Mat, Side};

use crate::estimate::at_fit::add_scaled;
use crate::numerics::symmetric::{VISIBLE, dot, inverse_above};

/// Rows on either side of a move: fewer are single samples.
pub const SIDE: usize = 4;

/// What a move is worth, from the sums at its row.
pub struct StepScore {
    /// Fall of χ², to first order.
    pub score: f64,
    /// Number of directions that the rows tell.
    pub rank: usize,
    /// How far all columns together moved, were they fitted.
    pub by: f64,
}

/// Sums for (83) over the rows from one on, of the columns `Z` of what moved.
pub struct StepSums {
    /// `Zᵀr`
    zr: Vec<f64>,
    /// `ZᵀZ`
    zz: Mat<f64>,
    /// `QᵀZ`
    qz: Mat<f64>,
}

impl StepSums {
    /// Of no row, for so many columns, beside so many directions that the fit absorbs.
    #[must_use]
    pub fn new(rank: usize, columns: usize) -> Self {
        let zz = Mat::zeros(columns, columns);
        Self { zr: vec![0.0; columns], zz, qz: Mat::zeros(rank, columns) }
    }

    /// Adds an equation: its row of `Q`, its row of `Z` and its residual.
    pub fn add(&mut self, q: &[f64], z: &[f64], r: f64) {
        add_scaled(&mut self.zr, r, z);
        for (i, &value) in z.iter().enumerate() {
            add_scaled(self.zz.col_as_slice_mut(i), value, z);
            add_scaled(self.qz.col_as_slice_mut(i), value, q);
        }
    }

    /// The score of a move here, in the directions that the rows tell; `pull` is `p` of the fit.
    #[must_use]
    pub fn score(&self, pull: &[f64]) -> Option<StepScore> {
        let columns = self.zr.len();
        let u: Vec<f64> =
            (0..columns).map(|i| self.zr[i] - dot(self.qz.col_as_slice(i), pull)).collect();
        let absorbed = self.qz.transpose() * &self.qz;
        let norms: Vec<f64> = (0..columns).map(|i| self.zz[(i, i)].max(0.0).sqrt()).collect();
        let longest = norms.iter().fold(0.0_f64, |most, norm| most.max(*norm));
        // A column of which less than rounding is left moves nothing.
        let unit = |i: usize| match norms[i] > VISIBLE * longest {
            true => 1.0 / norms[i],
            false => 0.0,
        };
        let square = Mat::from_fn(columns, columns, |i, j| {
            (self.zz[(i, j)] - absorbed[(i, j)]) * unit(i) * unit(j)
        });
        if let Some(inverse) = inverse_above(&square, VISIBLE) {
            // Most often: all directions.
            let u: Vec<f64> = u.iter().enumerate().map(|(i, u)| u * unit(i)).collect();
            let moved: Vec<f64> = (0..columns).map(|i| dot(inverse.col_as_slice(i), &u)).collect();
            let own = moved.iter().enumerate().map(|(i, m)| (m * unit(i)).powi(2));
            let by = own.sum::<f64>().sqrt();
            return Some(StepScore { score: dot(&u, &moved), rank: columns, by });
        }
        let eigen = square.self_adjoint_eigen(Side::Lower).ok()?;
        let (values, vectors) = (eigen.S().column_vector(), eigen.U());
        let (mut score, mut rank, mut moved) = (0.0, 0, vec![0.0; columns]);
        for k in (0..columns).filter(|&k| values[k] > VISIBLE) {
            let along: f64 = (0..columns).map(|i| vectors[(i, k)] * u[i] * unit(i)).sum::<f64>();
            score += along * along / values[k];
            rank += 1;
            for (i, m) in moved.iter_mut().enumerate() {
                *m += vectors[(i, k)] * unit(i) * along / values[k];
            }
        }
        let by = moved.iter().map(|m| m * m).sum::<f64>().sqrt();
        (rank > 0).then_some(StepScore { score, rank, by })
    }

    /// In how many directions the rows tell of a move that is so large where they tell most, and elsewhere as these
    /// typical sizes say, `T`: all count where each is told as well, and what hardly shows does not.
    ///
    /// ```text
    /// k = ln |1 + g R| / ln(1 + g),    R = T S T / max diag(T S T),    S = ZᵀZ - (QᵀZ)ᵀ QᵀZ       (153)
    /// ```
    #[must_use]
    pub fn directions(&self, typical: &[f64], g: f64) -> f64 {
        let columns = typical.len();
        let absorbed = self.qz.transpose() * &self.qz;
        let told =
            |i: usize, j: usize| (self.zz[(i, j)] - absorbed[(i, j)]) * typical[i] * typical[j];
        let most = (0..columns).map(|i| told(i, i)).fold(f64::MIN_POSITIVE, f64::max);
        let square = Mat::from_fn(columns, columns, |i, j| {
            f64::from(u8::from(i == j)) + g * told(i, j) / most
        });
        let all = columns as f64;
        let Ok(factor) = Llt::new(square.as_ref(), Side::Lower) else { return all };
        let volume: f64 = (0..columns).map(|i| 2.0 * factor.L()[(i, i)].ln()).sum();
        (volume / g.ln_1p()).clamp(1.0, all)
    }
}
