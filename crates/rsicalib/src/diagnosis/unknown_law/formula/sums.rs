//! Sums of few columns, and how much each explains.

use crate::numerics::order;
use nalgebra::{DMatrix, DVector};

/// Columns in a sum, at the most.
pub(super) const MOST: usize = 3;

/// Sums of fewer columns that are extended by every further one, cheapest first: a limit of time.
const EXTENDED: usize = 40;

/// Part of a column's length that is left beside what is fitted, below which it is rounding.
pub(in super::super) const SMALL: f64 = 1e-6;

/// A sum of columns, by their numbers, and by how much χ² falls with it.
#[derive(Debug, Clone)]
pub(super) struct Sum {
    pub(super) of: Vec<usize>,
    pub(super) fall: f64,
}

/// Sums of the columns that show: all of one and of two, and the cheapest of these with one more.
pub(super) fn sums(shows: &[usize], square: &DMatrix<f64>, gradient: &DVector<f64>) -> Vec<Sum> {
    let one = |of: Vec<usize>| Some(Sum { fall: fall(&of, square, gradient)?, of });
    let mut all: Vec<Sum> = shows.iter().filter_map(|&j| one(vec![j])).collect();
    let pairs =
        shows.iter().enumerate().flat_map(|(k, &i)| shows[..k].iter().map(move |&j| [j, i]));
    all.extend(pairs.filter_map(|pair| one(pair.to_vec())));
    for width in 3..=MOST {
        let mut best: Vec<&Sum> = all.iter().filter(|sum| sum.of.len() == width - 1).collect();
        order::descending(&mut best, |a| a.fall);
        best.truncate(EXTENDED);
        let longer = best.iter().flat_map(|sum| {
            let others = shows.iter().filter(|j| !sum.of.contains(j));
            others.map(|&j| sum.of.iter().copied().chain([j]).collect::<Vec<usize>>())
        });
        let longer: Vec<Sum> = longer.filter_map(one).collect();
        all.extend(longer);
    }
    all
}

/// `uᵀ M⁻¹ u` of up to [`MOST`] columns; none where they are alike.
pub(super) fn fall(of: &[usize], square: &DMatrix<f64>, gradient: &DVector<f64>) -> Option<f64> {
    // Cholesky's factor in units of each column, with the right-hand side below. Nothing is
    // allocated: it is done for each pair.
    let (mut l, mut long) = ([[0.0_f64; MOST + 1]; MOST], [0.0_f64; MOST]);
    let mut fall = 0.0;
    for (k, &j) in of.iter().enumerate() {
        long[k] = square[(j, j)].sqrt();
        let taken: [f64; MOST + 1] =
            std::array::from_fn(|other| (0..k).map(|c| l[c][other] * l[c][k]).sum());
        let pivot = 1.0 - taken[k];
        if pivot.is_nan() || pivot < SMALL {
            return None;
        }
        for (other, &i) in of.iter().enumerate().skip(k + 1) {
            let unit = square[(j.min(i), j.max(i))] / (long[k] * square[(i, i)].sqrt());
            l[k][other] = (unit - taken[other]) / pivot.sqrt();
        }
        l[k][MOST] = (gradient[j] / long[k] - taken[MOST]) / pivot.sqrt();
        fall += l[k][MOST].powi(2);
    }
    Some(fall)
}

/// `M⁻¹ u` and `M⁻¹` of some columns; none where they are alike.
pub(super) fn solved(
    of: &[usize],
    square: &DMatrix<f64>,
    gradient: &DVector<f64>,
) -> Option<(DVector<f64>, DMatrix<f64>)> {
    let k = of.len();
    let long: Vec<f64> = of.iter().map(|&j| square[(j, j)].sqrt()).collect();
    // In units of each column: a power of an angle and one of a length differ by orders.
    let unit = DMatrix::from_fn(k, k, |i, j| square[(of[i], of[j])] / (long[i] * long[j]));
    let root = unit.cholesky()?;
    if root.l_dirty().diagonal().iter().any(|d| d * d < SMALL) {
        return None;
    }
    let right = DVector::from_fn(k, |i, _| gradient[of[i]] / long[i]);
    let estimate = root.solve(&right);
    let inverse = root.inverse();
    Some((
        DVector::from_fn(k, |i, _| estimate[i] / long[i]),
        DMatrix::from_fn(k, k, |i, j| inverse[(i, j)] / (long[i] * long[j])),
    ))
}

/// In how many ways `k` of `n` can be chosen.
pub(super) fn choices(n: usize, k: usize) -> f64 {
    (0..k).map(|i| n.saturating_sub(i) as f64 / (i + 1) as f64).product::<f64>().max(1.0)
}

#[cfg(test)]
mod tests {
    use nalgebra::{DMatrix, DVector};

    use super::{fall, solved};

    #[test]
    fn a_fall_is_that_of_the_inverse() {
        let z = DMatrix::from_fn(9, 4, |i, j| ((i * i + 3 * i * j + j) as f64).sin());
        let (square, gradient) =
            (z.transpose() * &z, DVector::from_fn(4, |j, _| (j as f64 + 0.3).cos()));
        for of in [&[2][..], &[3, 1], &[0, 2, 3]] {
            let (own, inverse) = solved(of, &square, &gradient).expect("they are unlike");
            let u = DVector::from_fn(of.len(), |k, _| gradient[of[k]]);
            let expected = (u.transpose() * &inverse * &u)[(0, 0)];
            assert!((own.dot(&u) - expected).abs() < 1e-12 * expected);
            assert!(
                (fall(of, &square, &gradient).expect("they are unlike") - expected).abs()
                    < 1e-12 * expected
            );
        }
        let same = DMatrix::from_fn(9, 2, |i, j| ((i * i) as f64).sin() * (j + 1) as f64);
        assert!(fall(&[0, 1], &(same.transpose() * &same), &gradient).is_none());
    }
}
