//! Equation (31) for few parameters: `LDLᵀ` in columns of a fixed length, without allocation.
//!
//! The overhead of faer's general Cholesky exceeds the work for so few.

use faer::Mat;

use crate::numerics::lanes::{Lanes, WIDTH, dispatch};

/// Rows of a column: one per parameter, and one for the right-hand side.
const ROWS: usize = 3 * WIDTH;

/// Largest number of parameters.
pub const MOST: usize = ROWS - 1;

type Columns = [[f64; ROWS]; MOST];

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
            let mut columns = [[0.0; ROWS]; MOST];
            for (j, column) in columns[..n].iter_mut().enumerate() {
                let own = inverse[j];
                for ((value, h), inverse) in column.iter_mut().zip(h.col_as_slice(j)).zip(&inverse)
                {
                    *value = h * inverse * own;
                }
                column[j] += damping;
                column[n] = -gradient[j] * own;
            }
            let mut rows = [[0.0; ROWS]; MOST];
            let first = eliminate::<0>(&mut columns, &mut rows, &mut s, n);
            let second = first && eliminate::<1>(&mut columns, &mut rows, &mut s, n);
            if !(second && eliminate::<2>(&mut columns, &mut rows, &mut s, n)) {
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

/// Eliminates the columns of one block: the rows of `Lᵀ D` in `columns` give the columns of `L` as
/// `rows`, and the right-hand side as `D⁻¹ L⁻¹` of it. False for a pivot that is not positive.
#[expect(clippy::neg_cmp_op_on_partial_ord, reason = "a NaN is no pivot either")]
#[inline(always)]
fn eliminate<const BLOCK: usize>(
    columns: &mut Columns,
    rows: &mut Columns,
    rhs: &mut [f64; ROWS],
    n: usize,
) -> bool {
    for j in BLOCK * WIDTH..((BLOCK + 1) * WIDTH).min(n) {
        let own = columns[j];
        if !(own[j] > 0.0) {
            return false;
        }
        let inverse = 1.0 / own[j];
        let mut scaled = own;
        for value in &mut scaled {
            *value *= inverse;
        }
        rhs[j] = scaled[n];
        let nexts = columns[j + 1..n].iter_mut().zip(&mut rows[j + 1..n]);
        for ((next, row), factor) in nexts.zip(&scaled[j + 1..n]) {
            // Without this way out the compiler works on eight columns at once, by gathers, at
            // twice the time.
            if !factor.is_finite() {
                return false;
            }
            row[j] = *factor;
            subtract::<BLOCK>(next, &own, *factor);
        }
    }
    true
}

/// `next -= factor own`, from a block on.
#[inline(always)]
fn subtract<const BLOCK: usize>(next: &mut [f64; ROWS], own: &[f64; ROWS], factor: f64) {
    let (next, _) = next.as_chunks_mut::<WIDTH>();
    let (own, _) = own.as_chunks::<WIDTH>();
    for (next, own) in next[BLOCK..].iter_mut().zip(&own[BLOCK..]) {
        let sum = Lanes(*own).mul_add(Lanes::splat(-factor), Lanes(*next));
        *next = sum.0;
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
        for n in 1..=MOST {
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
