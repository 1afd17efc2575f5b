//! Ranks of matrices whose columns are in different units.
//!
//! A tall matrix `X` is first made square by orthogonal reflections and then
//! taken apart,
//!
//! ```text
//! X = Q R,    R = U diag(s) [V₁ V₀]ᵀ
//! ```
//!
//! where `V₁` belongs to the singular values that count and `V₀` spans what `X` does not see.

use faer::linalg::solvers::{Qr, Svd};
use faer::{Mat, MatRef};

/// Singular values below this fraction of the largest are zero; rounding leaves 1e-13.
pub const RANK: f64 = 1e-9;

/// Row space and null space of a matrix.
#[derive(Debug, Clone)]
pub struct Spaces {
    /// Singular values that count, largest first.
    pub singular: Vec<f64>,
    /// `V₁`, one column for each singular value that counts.
    pub rows: Mat<f64>,
    /// `V₀`: combinations of columns that vanish.
    pub null: Mat<f64>,
    /// `U` of the singular values that count, in the coordinates of `R`.
    left: Mat<f64>,
}

/// Shortest solutions, one per column, and how far each is off as a fraction of its target.
pub type Solved = (Mat<f64>, Vec<f64>);

impl Spaces {
    /// Of a matrix; none where an entry is not a number.
    #[must_use]
    pub fn of(x: &Mat<f64>) -> Option<Self> {
        Self::beside(x, &Mat::zeros(x.nrows(), 0)).map(|(spaces, _)| spaces)
    }

    /// Also solves `X z = target` for each column of `targets` with the shortest `z`:
    /// returns the solutions, and how far each is off as a fraction of its target.
    #[must_use]
    pub fn beside(x: &Mat<f64>, targets: &Mat<f64>) -> Option<(Self, Solved)> {
        let (n, k) = (x.ncols(), targets.ncols());
        if !finite(x) || !finite(targets) {
            return None;
        }
        let joined = Mat::from_fn(x.nrows(), n + k, |i, j| match j < n {
            true => x[(i, j)],
            false => targets[(i, j - n)],
        });
        let r = square(joined);
        let svd = Svd::new(r.submatrix(0, 0, n, n)).ok()?;
        let values = svd.S().column_vector();
        let least = RANK * if n > 0 { values[0] } else { 0.0 };
        let singular: Vec<f64> = (0..n).map(|i| values[i]).filter(|s| *s > least).collect();
        let rank = singular.len();
        let spaces = Self {
            rows: svd.V().subcols(0, rank).to_owned(),
            null: svd.V().subcols(rank, n - rank).to_owned(),
            left: svd.U().subcols(0, rank).to_owned(),
            singular,
        };
        let solved = spaces.solve(r.subcols(n, k));
        Some((spaces, solved))
    }

    /// Number of singular values that count.
    #[must_use]
    pub fn rank(&self) -> usize {
        self.singular.len()
    }

    fn solve(&self, targets: MatRef<'_, f64>) -> (Mat<f64>, Vec<f64>) {
        let n = self.left.nrows();
        let inside = self.left.transpose() * targets.subrows(0, n);
        let scaled =
            Mat::from_fn(self.rank(), targets.ncols(), |i, j| inside[(i, j)] / self.singular[i]);
        let rest = targets.subrows(0, n) - &self.left * &inside;
        let below = targets.subrows(n, targets.nrows() - n);
        let missed = (0..targets.ncols()).map(|j| {
            let missed = rest.col(j).norm_l2().hypot(below.col(j).norm_l2());
            missed / targets.col(j).norm_l2().max(f64::MIN_POSITIVE)
        });
        let missed = missed.collect();
        (&self.rows * scaled, missed)
    }
}

/// `R` of `X = Q R` with at least as many rows as columns: what is left of `X` but for a rotation.
fn square(x: Mat<f64>) -> Mat<f64> {
    let n = x.ncols();
    if x.nrows() <= n {
        return Mat::from_fn(n, n, |i, j| if i < x.nrows() { x[(i, j)] } else { 0.0 });
    }
    Qr::new(x.as_ref()).thin_R().to_owned()
}

/// Singular values above [`RANK`] of the largest, or above `least` where given.
///
/// None where an entry is not a number.
#[must_use]
pub fn rank(x: &Mat<f64>, least: Option<f64>) -> Option<usize> {
    if !finite(x) {
        return None;
    }
    if x.nrows() == 0 || x.ncols() == 0 {
        return Some(0);
    }
    let tall = if x.nrows() < x.ncols() { x.transpose().to_owned() } else { x.clone() };
    let singular = square(tall).singular_values().ok()?;
    let least = least.unwrap_or_else(|| RANK * singular.iter().copied().fold(0.0, f64::max));
    Some(singular.iter().filter(|s| **s > least).count())
}

/// Factors that make columns as long as one; zero for a column that is only rounding.
#[must_use]
pub fn unit(x: &Mat<f64>) -> Vec<f64> {
    let norms: Vec<f64> = (0..x.ncols()).map(|j| x.col(j).norm_l2()).collect();
    let largest = norms.iter().copied().fold(0.0, f64::max);
    norms.iter().map(|n| if *n > 1e-12 * largest { n.recip() } else { 0.0 }).collect()
}

/// Columns multiplied by factors.
#[must_use]
pub fn scaled(x: &Mat<f64>, by: &[f64]) -> Mat<f64> {
    Mat::from_fn(x.nrows(), x.ncols(), |i, j| x[(i, j)] * by[j])
}

/// What is left of columns when `others` are free; none where an entry is not a number.
#[must_use]
pub fn eliminated(x: Mat<f64>, others: &Mat<f64>) -> Option<Mat<f64>> {
    if others.ncols() == 0 || others.nrows() == 0 {
        return Some(x);
    }
    if !finite(others) {
        return None;
    }
    let svd = Svd::new_thin(scaled(others, &unit(others)).as_ref()).ok()?;
    let values = svd.S().column_vector();
    let rank = (0..values.nrows()).filter(|&i| values[i] > RANK * values[0]).count();
    let u = svd.U().subcols(0, rank);
    let inside = u.transpose() * &x;
    Some(x - u * inside)
}

fn finite(x: &Mat<f64>) -> bool {
    (0..x.ncols()).all(|j| x.col(j).iter().all(|v| v.is_finite()))
}

#[cfg(test)]
mod tests {
    use faer::Mat;

    use super::{Spaces, eliminated, rank};

    /// Columns 1, 2, their sum, and one in another unit.
    fn four() -> Mat<f64> {
        let base = |i: usize, j: usize| ((i * i + 3 * j * i + j) as f64).sin();
        Mat::from_fn(9, 4, |i, j| match j {
            2 => base(i, 0) + base(i, 1),
            3 => 1e-3 * base(i, 3),
            _ => base(i, j),
        })
    }

    #[test]
    fn a_sum_of_columns_is_in_the_null_space() {
        let x = four();
        let found = Spaces::of(&x).expect("numbers");
        assert_eq!((found.rank(), found.null.ncols()), (3, 1));
        assert_eq!(rank(&x, None), Some(3));
        let null = &found.null;
        assert!((null[(0, 0)] + null[(2, 0)]).abs() < 1e-12);
        assert!((null[(0, 0)] - null[(1, 0)]).abs() < 1e-12);
        assert!(null[(3, 0)].abs() < 1e-9);
    }

    #[test]
    fn a_target_inside_is_met_and_one_outside_is_not() {
        let x = four();
        let targets = Mat::from_fn(9, 2, |i, j| if j == 0 { 2.0 * x[(i, 3)] } else { 1.0 });
        let (_, (found, missed)) = Spaces::beside(&x, &targets).expect("numbers");
        assert!(missed[0] < 1e-12 && missed[1] > 0.1);
        assert!((found[(3, 0)] - 2.0).abs() < 1e-9);
    }

    #[test]
    fn elimination_leaves_what_others_cannot_make() {
        let x = four();
        let others = x.subcols(0, 2).to_owned();
        let left = eliminated(x, &others).expect("numbers");
        assert!(left.subcols(0, 3).norm_l2() < 1e-12);
        assert_eq!(rank(&left, Some(1e-9)), Some(1));
    }

    #[test]
    fn fewer_rows_than_columns_and_no_numbers() {
        let wide = four().subrows(0, 2).to_owned();
        let found = Spaces::of(&wide).expect("numbers");
        assert_eq!((found.rank(), found.null.ncols()), (2, 2));
        assert_eq!(Spaces::of(&Mat::zeros(3, 0)).map(|s| s.rank()), Some(0));
        assert!(Spaces::of(&Mat::from_fn(2, 2, |_, _| f64::NAN)).is_none());
        assert_eq!(rank(&Mat::from_fn(2, 2, |_, _| f64::NAN), None), None);
    }
}
