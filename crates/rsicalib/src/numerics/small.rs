//! Equation (31) for few parameters: `LDLᵀ` in columns of a fixed length, without allocation.
//!
//! The overhead of faer's general Cholesky exceeds the work for so few.

use faer::Mat;

use crate::numerics::lanes::{Lanes, WIDTH, dispatch};

/// Rows of a column: one per parameter, and one for the right-hand side.
const ROWS: usize = 3 * WIDTH;

/// Largest number of parameters.
pub const MOST_PARAMETERS: usize = ROWS - 1;

type Columns = [[f64; ROWS]; MOST_PARAMETERS];

/// Solves (31) from `JᵀJ` in unit columns; `None` where the matrix is not positive definite.
pub fn solve_damped(
    h: &Mat<f64>,
    gradient: &[f64],
    damping: f64,
    scale: &[f64],
) -> Option<Vec<f64>> {
    let n = gradient.len();
    let (mut s, mut inverse) = ([0.0; ROWS], [0.0; ROWS]);
    let solved = dispatch(
        #[inline(always)]
        || {
            for (inverse, scale) in inverse.iter_mut().zip(scale) {
                *inverse = 1.0 / scale;
            }
            let (mut columns, mut rows) =
                ([[0.0; ROWS]; MOST_PARAMETERS], [[0.0; ROWS]; MOST_PARAMETERS]);
            for (j, column) in columns[..n].iter_mut().enumerate() {
                let own = inverse[j];
                for ((value, h), inverse) in column.iter_mut().zip(h.col_as_slice(j)).zip(&inverse)
                {
                    *value = h * inverse * own;
                }
                column[j] += damping;
                column[n] = -gradient[j] * own;
            }
            let mut state =
                State { columns: &mut columns, rows: &mut rows, pivots: [0.0; MOST_PARAMETERS] };
            let first = state.eliminate::<0>(&mut s, n);
            let second = first && state.eliminate::<1>(&mut s, n);
            if !(second && state.eliminate::<2>(&mut s, n)) {
                return false;
            }
            for k in (1..n).rev() {
                let known = s[k];
                for (s, l) in s.iter_mut().zip(&rows[k]) {
                    *s = l.mul_add(-known, *s);
                }
            }
            true
        },
    );
    solved.then(|| s[..n].iter().zip(&inverse).map(|(s, inverse)| s * inverse).collect())
}

/// Vectors of one column.
const BLOCKS: usize = ROWS / WIDTH;

/// A factorisation on its way.
struct State<'a> {
    /// `L D` column by column as far as it is known, with the right-hand side in row `n`.
    columns: &'a mut Columns,
    /// `L`, row by row.
    rows: &'a mut Columns,
    /// Reciprocals of `D`.
    pivots: [f64; MOST_PARAMETERS],
}

impl State<'_> {
    /// Subtracts from each column of one block what all columns before take of it, and puts
    /// `D⁻¹ L⁻¹` of the right-hand side into `rhs`. False for a pivot that is not positive.
    ///
    /// A column stays in registers meanwhile. Two sums of it take turns: each waits for itself only.
    #[expect(clippy::neg_cmp_op_on_partial_ord, reason = "a NaN is no pivot either")]
    #[inline(always)]
    fn eliminate<const BLOCK: usize>(&mut self, rhs: &mut [f64; ROWS], n: usize) -> bool {
        for k in BLOCK * WIDTH..((BLOCK + 1) * WIDTH).min(n) {
            let (done, rest) = self.columns.split_at_mut(k);
            let (own, row) = (&mut rest[0], &mut self.rows[k]);
            let (mut even, mut odd) = ([Lanes::ZERO; BLOCKS], [Lanes::ZERO; BLOCKS]);
            for c in BLOCK..BLOCKS {
                even[c].0.copy_from_slice(&own[c * WIDTH..(c + 1) * WIDTH]);
            }
            let mut j = 0;
            while j + 1 < k {
                row[j] = done[j][k] * self.pivots[j];
                row[j + 1] = done[j + 1][k] * self.pivots[j + 1];
                subtract::<BLOCK>(&mut even, &done[j], row[j]);
                subtract::<BLOCK>(&mut odd, &done[j + 1], row[j + 1]);
                j += 2;
            }
            if j < k {
                row[j] = done[j][k] * self.pivots[j];
                subtract::<BLOCK>(&mut even, &done[j], row[j]);
            }
            for c in BLOCK..BLOCKS {
                let sum = even[c] + odd[c];
                own[c * WIDTH..(c + 1) * WIDTH].copy_from_slice(&sum.0);
            }
            if !(own[k] > 0.0) {
                return false;
            }
            self.pivots[k] = 1.0 / own[k];
            rhs[k] = own[n] * self.pivots[k];
        }
        true
    }
}

/// `sums -= factor column`, from a block on.
#[inline(always)]
fn subtract<const BLOCK: usize>(sums: &mut [Lanes; BLOCKS], column: &[f64; ROWS], factor: f64) {
    let (column, _) = column.as_chunks::<WIDTH>();
    for c in BLOCK..BLOCKS {
        sums[c] = Lanes(column[c]).mul_add(Lanes::splat(-factor), sums[c]);
    }
}

#[cfg(test)]
mod tests {
    use faer::linalg::solvers::{Llt, Solve};
    use faer::{Mat, Side};

    use super::*;
    use crate::numerics::random::Random;

    #[test]
    fn agrees_with_the_general_cholesky_for_every_size() {
        let mut random = Random::new(5);
        for n in 1..=MOST_PARAMETERS {
            let root = Mat::from_fn(n + 4, n, |_, _| random.uniform(-0.5, 0.5));
            let h = root.transpose() * &root;
            let gradient: Vec<f64> = (0..n).map(|_| random.uniform(-0.5, 0.5)).collect();
            let scale: Vec<f64> = (0..n).map(|_| random.uniform(0.1, 1.1)).collect();
            let damping = 0.01;
            let s = solve_damped(&h, &gradient, damping, &scale).expect("positive definite");
            let damped = Mat::from_fn(n, n, |i, j| {
                h[(i, j)] + if i == j { damping * scale[i] * scale[i] } else { 0.0 }
            });
            let factor = Llt::new(damped.as_ref(), Side::Lower).expect("positive definite");
            let expected = factor.solve(Mat::from_fn(n, 1, |i, _| -gradient[i]));
            for i in 0..n {
                // Condition numbers are below 1e4: twelve digits less four, and some to spare.
                assert!((s[i] - expected[(i, 0)]).abs() < 1e-8 * (1.0 + s[i].abs()), "{n} {i}");
            }
        }
    }

    #[test]
    fn a_matrix_that_is_not_positive_definite_has_no_step() {
        let h = Mat::from_fn(2, 2, |i, j| if i == j { 1.0 } else { 2.0 });
        assert!(solve_damped(&h, &[1.0, 1.0], 0.0, &[1.0, 1.0]).is_none());
        let undefined = Mat::from_fn(2, 2, |_, _| f64::NAN);
        assert!(solve_damped(&undefined, &[1.0, 1.0], 0.0, &[1.0, 1.0]).is_none());
    }
}
