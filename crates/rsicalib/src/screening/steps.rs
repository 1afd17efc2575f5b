//! Sums over the rows from one on, to score what moved at that row.

use faer::linalg::solvers::{Llt, Solve};
use faer::{Mat, Side};

use crate::estimate::at_fit::add_scaled;
use crate::numerics::symmetric::{VISIBLE, dot, inverse_above, invert};

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

/// Columns that a fit has: of what happened at another time.
pub struct Fitted {
    /// Their parameters, `β`.
    pub values: Vec<f64>,
    /// Their covariance, `B`, of `N⁻¹`.
    pub covariance: Mat<f64>,
    /// Their rows of `R`, where `N⁻¹ = R Rᵀ`.
    pub root: Mat<f64>,
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

    /// `u` and `M` of (71), `S` in (154): what the fit leaves of `Zᵀr` and of `ZᵀZ`.
    fn beside(&self, pull: &[f64]) -> (Vec<f64>, Mat<f64>) {
        let u = self.zr.iter().enumerate();
        let u = u.map(|(i, zr)| zr - dot(self.qz.col_as_slice(i), pull)).collect();
        (u, &self.zz - self.qz.transpose() * &self.qz)
    }

    /// The score of a move here, in the directions that the rows tell; `pull` is `p` of the fit.
    #[must_use]
    pub fn score(&self, pull: &[f64]) -> Option<StepScore> {
        let columns = self.zr.len();
        let (u, left) = self.beside(pull);
        let norms: Vec<f64> = (0..columns).map(|i| self.zz[(i, i)].max(0.0).sqrt()).collect();
        let longest = norms.iter().fold(0.0_f64, |most, norm| most.max(*norm));
        // A column of which less than rounding is left moves nothing.
        let unit = |i: usize| match norms[i] > VISIBLE * longest {
            true => 1.0 / norms[i],
            false => 0.0,
        };
        let square = Mat::from_fn(columns, columns, |i, j| left[(i, j)] * unit(i) * unit(j));
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

    /// By how much χ² rises with these columns in place of fitted ones, to first order. None where they do
    /// not tell all directions.
    ///
    /// ```text
    /// bᵀV⁻¹b - uᵀM⁻¹u,    b = β + C M⁻¹u,  V = B + C M⁻¹Cᵀ,  C = R_t QᵀZ                          (159)
    /// ```
    ///
    /// `β` and `B` are the fitted parameters and their covariance, `R_t` their rows of the root of `N⁻¹`; `b` and `V`
    /// are the same with both free.
    #[must_use]
    pub fn in_place_of(&self, own: &Fitted, pull: &[f64]) -> Option<f64> {
        let (u, left) = self.beside(pull);
        let inverse = inverse_of(&left, &self.zz)?;
        let columns = u.len();
        let u = Mat::from_fn(columns, 1, |i, _| u[i]);
        let (moved, taken) = (&inverse * &u, &own.root * &self.qz);
        let values = Mat::from_fn(own.values.len(), 1, |i, _| own.values[i]) + &taken * &moved;
        let covariance = &own.covariance + &taken * &inverse * taken.transpose();
        let needed = values.transpose() * invert(&covariance).0 * &values;
        Some(needed[(0, 0)] - (u.transpose() * &moved)[(0, 0)])
    }

    /// What a move with this score costs, in directions that are told as well as the best one, where its
    /// components are as large among each other as these typical sizes: what hardly shows costs
    /// little, and what a move explains by that is given back.
    ///
    /// ```text
    /// k ln(1 + g) + T/(1 + g) = ln |1 + g R| + uᵀ S⁻¹ u - g uᵀ D (1 + g R)⁻¹ D u / r              (154)
    ///     u = Zᵀr - (QᵀZ)ᵀ p,   S = ZᵀZ - (QᵀZ)ᵀ QᵀZ,   r = max diag(D S D),   R = D S D / r,   g = T/rank
    /// ```
    ///
    /// With `T = uᵀ S⁻¹ u`, the cost of (118) at its likeliest amplitude; `D` are the sizes on a diagonal.
    #[must_use]
    pub fn directions(&self, typical: &[f64], pull: &[f64], found: &StepScore) -> f64 {
        let (columns, rank) = (typical.len(), found.rank as f64);
        let g = (found.score / rank).max(1.0);
        let (u, left) = self.beside(pull);
        let told = |i: usize, j: usize| left[(i, j)] * typical[i] * typical[j];
        let most = (0..columns).map(|i| told(i, i)).fold(f64::MIN_POSITIVE, f64::max);
        let square = Mat::from_fn(columns, columns, |i, j| {
            f64::from(u8::from(i == j)) + g * told(i, j) / most
        });
        let Ok(factor) = Llt::new(square.as_ref(), Side::Lower) else { return rank };
        let volume: f64 = (0..columns).map(|i| 2.0 * factor.L()[(i, i)].ln()).sum();
        let u = Mat::from_fn(columns, 1, |i, _| u[i] * typical[i]);
        let kept = g / most * (u.transpose() * factor.solve(&u))[(0, 0)];
        let given_back = found.score - kept - found.score / (1.0 + g);
        ((volume + given_back) / g.ln_1p()).clamp(1.0, rank)
    }
}

/// The inverse of a square of columns, with lengths of `of`; none where a direction is not told.
fn inverse_of(square: &Mat<f64>, of: &Mat<f64>) -> Option<Mat<f64>> {
    let n = square.nrows();
    let unit: Vec<f64> = (0..n).map(|i| of[(i, i)].max(0.0).sqrt().recip()).collect();
    if !unit.iter().all(|unit| unit.is_finite()) {
        return None;
    }
    let scaled = Mat::from_fn(n, n, |i, j| square[(i, j)] * unit[i] * unit[j]);
    let inverse = inverse_above(&scaled, VISIBLE)?;
    Some(Mat::from_fn(n, n, |i, j| inverse[(i, j)] * unit[i] * unit[j]))
}

#[cfg(test)]
mod tests {
    use nalgebra::{DMatrix, DVector};

    use faer::Mat;

    use super::{Fitted, StepSums};

    #[test]
    fn columns_in_place_of_others_leave_what_their_own_fit_leaves() {
        let odd = |i: usize, j: usize| ((1 + i * i + 7 * i * j + 3 * j) as f64).sin();
        let fixed = DMatrix::from_fn(30, 4, odd);
        let own = DMatrix::from_fn(30, 2, |i, j| if i < 11 { 0.0 } else { odd(i, 5 + j) });
        let other = DMatrix::from_fn(30, 2, |i, j| if i < 14 { 0.0 } else { odd(i, 5 + j) });
        let r = DVector::from_fn(30, |i, _| odd(i, 9) + 3.0 * other[(i, 0)]);
        // Least squares by QR: what is left, and the parameters, of `r + X β`.
        let fit = |x: &DMatrix<f64>| {
            let (q, triangle) = x.clone().qr().unpack();
            let along = q.transpose() * &r;
            let beta = -triangle.solve_upper_triangular(&along).expect("independent columns");
            (&r + x * &beta, beta)
        };
        let join = |a: &DMatrix<f64>, b: &DMatrix<f64>| {
            DMatrix::from_fn(30, a.ncols() + b.ncols(), |i, j| match j.checked_sub(a.ncols()) {
                None => a[(i, j)],
                Some(j) => b[(i, j)],
            })
        };
        let x = join(&fixed, &own);
        let ((left, beta), (wanted, _)) = (fit(&x), fit(&join(&fixed, &other)));
        // The last rows of a root of N⁻¹, and N⁻¹ itself.
        let covariance = (x.transpose() * &x).try_inverse().expect("independent columns");
        let root = covariance.clone().cholesky().expect("positive").l();
        let q = &x * &root;
        let mut sums = StepSums::new(6, 2);
        (0..30).for_each(|i| {
            let row = |m: &DMatrix<f64>| m.row(i).iter().copied().collect::<Vec<_>>();
            sums.add(&row(&q), &row(&other), left[i]);
        });
        let own = Fitted {
            values: vec![beta[4], beta[5]],
            covariance: Mat::from_fn(2, 2, |i, j| covariance[(4 + i, 4 + j)]),
            root: Mat::from_fn(2, 6, |i, j| root[(4 + i, j)]),
        };
        let rises = sums.in_place_of(&own, &[0.0; 6]).expect("all directions");
        let wanted = wanted.norm_squared() - left.norm_squared();
        assert!((rises - wanted).abs() < 1e-9 * left.norm_squared(), "{rises} for {wanted}");
        assert!(rises < -1.0, "the other time is the right one");
    }

    #[test]
    fn directions_cost_what_the_density_of_the_residuals_says() {
        let odd = |i: usize, j: usize| ((1 + i * i + 7 * i * j + j) as f64).sin();
        // The third column hardly shows.
        let shows = [1.0, 0.4, 0.01];
        let z = DMatrix::from_fn(30, 3, |i, j| shows[j] * odd(i, j));
        let r = DVector::from_fn(30, |i, _| odd(i, 7) + 9.0 * z[(i, 0)]);
        let mut sums = StepSums::new(0, 3);
        (0..30).for_each(|i| sums.add(&[], z.row(i).transpose().as_slice(), r[i]));
        let found = sums.score(&[]).expect("a score");
        let typical = [0.5, 2.0, 1.0];
        let k = sums.directions(&typical, &[], &found);
        assert!(1.0 < k && k < 3.0, "{k}");
        // By the inverse and the determinant of the whole covariance.
        let g = found.score / 3.0;
        let columns = &z * DMatrix::from_diagonal(&DVector::from_row_slice(&typical));
        let square = columns.transpose() * &columns;
        let most = square.diagonal().max();
        let cover = DMatrix::identity(30, 30) + &columns * columns.transpose() * (g / most);
        let log = cover.determinant().ln();
        let left = (r.transpose() * cover.try_inverse().expect("an inverse") * &r)[(0, 0)];
        let wanted = found.score + log + left - r.norm_squared();
        let got = k * g.ln_1p() + found.score / (1.0 + g);
        assert!((got - wanted).abs() < 1e-9 * wanted, "{got} for {wanted}");
    }
}
