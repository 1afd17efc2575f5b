//! Schur complement of normal equations in arrow form.
//!
//! There are many unknown points, but the parameters of a point share entries of `JᵀJ` only with
//! the terms and with the points that known distances link to that point: an *island* `b`. The
//! islands are eliminated one by one, and the Schur complement has the size of the terms `t`:
//!
//! ```text
//! H_bb = L_b L_bᵀ,   W_b = L_b⁻¹ H_bt,   z_b = L_b⁻¹ g_b
//! (H_tt - Σ W_bᵀ W_b) s_t = -(g_t - Σ W_bᵀ z_b),   s_b = -L_b⁻ᵀ (z_b + W_b s_t)     (33)
//! ```

use faer::linalg::solvers::{Llt, Solve};
use faer::{Mat, Side};

/// Islands of the parameters from `first` on: sets whose mutual entries of `gram` are zero.
#[must_use]
pub fn islands(gram: &Mat<f64>, first: usize) -> Vec<Vec<usize>> {
    let n = gram.nrows();
    let mut island: Vec<usize> = (first..n).collect();
    for j in first..n {
        for i in j + 1..n {
            let (a, b) = (island[j - first], island[i - first]);
            if gram[(i, j)] != 0.0 && a != b {
                island.iter_mut().filter(|k| **k == b).for_each(|k| *k = a);
            }
        }
    }
    let members = |name: usize| (first..n).filter(|i| island[i - first] == name).collect();
    (first..n).map(members).filter(|m: &Vec<usize>| !m.is_empty()).collect()
}

/// Solves `(D⁻¹ h D⁻¹ + λ) D s = -D⁻¹ g` by (33) with `D = scale`; `None` where the matrix is not
/// positive definite.
#[must_use]
pub fn solve(
    h: &Mat<f64>,
    g: &[f64],
    damping: f64,
    scale: &[f64],
    islands: &[Vec<usize>],
) -> Option<Vec<f64>> {
    let apart: usize = islands.iter().map(Vec::len).sum();
    let terms = g.len() - apart;
    let inverse: Vec<f64> = scale.iter().map(|scale| 1.0 / scale).collect();
    let unit = |i: usize, j: usize| h[(i, j)] * inverse[i] * inverse[j];
    // `W` and `z` of all islands, stacked; `z` is the last column.
    let mut w = Mat::<f64>::zeros(apart, terms + 1);
    let mut factors = Vec::with_capacity(islands.len());
    let mut first = 0;
    for members in islands {
        let l = factor(members.len(), |i, j| {
            unit(members[i], members[j]) + if i == j { damping } else { 0.0 }
        })?;
        for j in 0..=terms {
            let column = &mut w.col_as_slice_mut(j)[first..first + members.len()];
            for (value, &b) in column.iter_mut().zip(members) {
                *value = if j < terms { unit(b, j) } else { g[b] * inverse[b] };
            }
            forward(&l, column);
        }
        factors.push(l);
        first += members.len();
    }
    let (left, z) = (w.subcols(0, terms), w.subcols(terms, 1));
    let mut rest = left.transpose() * left;
    for j in 0..terms {
        let column = h.col_as_slice(j).iter().zip(&inverse).map(|(h, i)| h * i * inverse[j]);
        let rest = &mut rest.col_as_slice_mut(j)[..terms];
        rest.iter_mut().zip(column).for_each(|(rest, of_all)| *rest = of_all - *rest);
        rest[j] += damping;
    }
    let pulled = left.transpose() * z;
    let rhs = Mat::from_fn(terms, 1, |i, _| pulled[(i, 0)] - g[i] * inverse[i]);
    let s = Llt::new(rest.as_ref(), Side::Lower).ok()?.solve(rhs);
    let back = left * &s + z;
    let mut step: Vec<f64> =
        (0..g.len()).map(|i| if i < terms { s[(i, 0)] } else { 0.0 }).collect();
    let mut first = 0;
    for (members, l) in islands.iter().zip(&factors) {
        let mut own: Vec<f64> = (0..members.len()).map(|i| -back[(first + i, 0)]).collect();
        backward(l, &mut own);
        members.iter().zip(own).for_each(|(&b, s)| step[b] = s);
        first += members.len();
    }
    step.iter_mut().zip(inverse).for_each(|(s, inverse)| *s *= inverse);
    Some(step)
}

/// Cholesky factor of a small matrix, row by row of the lower triangle.
#[expect(clippy::neg_cmp_op_on_partial_ord, reason = "a NaN is no pivot either")]
fn factor(n: usize, entry: impl Fn(usize, usize) -> f64) -> Option<Vec<Vec<f64>>> {
    let mut l: Vec<Vec<f64>> = Vec::with_capacity(n);
    for i in 0..n {
        let mut row: Vec<f64> = Vec::with_capacity(i + 1);
        for (j, above) in l.iter().enumerate() {
            let known: f64 = row.iter().zip(above).map(|(a, b)| a * b).sum();
            row.push((entry(i, j) - known) / above[j]);
        }
        let left = entry(i, i) - row.iter().map(|a| a * a).sum::<f64>();
        if !(left > 0.0) {
            return None;
        }
        row.push(left.sqrt());
        l.push(row);
    }
    Some(l)
}

/// `b ← L⁻¹ b`
fn forward(l: &[Vec<f64>], b: &mut [f64]) {
    for (i, row) in l.iter().enumerate() {
        let known: f64 = row[..i].iter().zip(&b[..i]).map(|(l, b)| l * b).sum();
        b[i] = (b[i] - known) / row[i];
    }
}

/// `b ← L⁻ᵀ b`
fn backward(l: &[Vec<f64>], b: &mut [f64]) {
    for i in (0..l.len()).rev() {
        let known: f64 = (i + 1..l.len()).map(|k| l[k][i] * b[k]).sum();
        b[i] = (b[i] - known) / l[i][i];
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `JᵀJ` of a dense `J` whose last columns form two islands of two columns and one of one.
    fn bordered() -> (Mat<f64>, Vec<f64>) {
        let n = 9;
        let mut h = Mat::<f64>::zeros(n, n);
        let mut random = 17_u64;
        for row in 0..60 {
            let live = [4 + 2 * (row % 2), 5 + 2 * (row % 2), 8];
            let live = if row % 3 == 0 { &live[2..] } else { &live[..2] };
            let mut j = [0.0; 9];
            for (k, value) in j.iter_mut().enumerate() {
                random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                let here = k < 4 || live.contains(&k);
                *value = if here { (random >> 33) as f64 / 1e9 - 1.0 } else { 0.0 };
            }
            for a in 0..n {
                for b in 0..n {
                    h[(a, b)] += j[a] * j[b];
                }
            }
        }
        let g = (0..n).map(|i| (i as f64 - 3.3).sin()).collect();
        (h, g)
    }

    #[test]
    fn islands_are_what_never_meets() {
        let (h, _) = bordered();
        assert_eq!(islands(&h, 4), [vec![4, 5], vec![6, 7], vec![8]]);
    }

    #[test]
    fn elimination_solves_the_same_equations() {
        let (h, g) = bordered();
        let scale: Vec<f64> = (0..9).map(|i| h[(i, i)].sqrt()).collect();
        for damping in [0.0, 0.3] {
            let s = solve(&h, &g, damping, &scale, &islands(&h, 4)).expect("positive definite");
            for i in 0..9 {
                let left: f64 = (0..9).map(|j| h[(i, j)] * s[j]).sum();
                let left = left + damping * scale[i] * scale[i] * s[i] + g[i];
                // Condition below 1e3 (60 random rows of 9): rounding of 1e-13 of |g|.
                assert!(left.abs() < 1e-12, "equation {i} is off by {left:e}");
            }
        }
    }

    #[test]
    fn a_matrix_that_is_not_positive_definite_has_no_solution() {
        let (mut h, g) = bordered();
        h[(8, 8)] = -1.0;
        assert!(solve(&h, &g, 0.0, &[1.0; 9], &islands(&h, 4)).is_none());
    }
}
