//! Scores of two effects at once: each may hide what the other does, and then neither stands
//! out alone.
//!
//! Of candidates `i` and `j`, with `Q` that makes `Qᵀ M Q = 1` of each and `w = Qᵀ u`,
//!
//! ```text
//! T_ij = |w_i|² + vᵀ (1 - CᵀC)⁻¹ v,    C = Q_iᵀ M_ij Q_j,    v = w_j - Cᵀ w_i     (74)
//! ```

use std::ops::Range;

use faer::linalg::solvers::{Llt, Solve};
use faer::{Mat, MatRef, Side};

use crate::Error;
use crate::diagnosis::price::of_places;
use crate::diagnosis::score::projection::{self, Projected};
use crate::diagnosis::score::scored::{self, Family, Judge, Scored};
use crate::estimate::{Fit, Observations};
use crate::model::Instance;
use crate::numerics::symmetric::{VISIBLE, eigenvalues};
use crate::numerics::workers;

/// Two effects, and by how much χ² would fall with both.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pair {
    /// Each with the score that it adds to the other's.
    pub both: [Scored; 2],
    /// `T` of (74).
    pub score: f64,
}

impl Pair {
    /// What is left of the score after parameters and places of both are paid for.
    #[must_use]
    pub fn charged(&self) -> f64 {
        self.score - self.both.iter().map(Scored::paid).sum::<f64>()
    }
}

/// Share of the second of two that must not be the first's.
const APART: f64 = 1e-3;

/// Scores all pairs of named candidates, of which each stands out beside the other, that are worth
/// more than `needed` once paid for.
///
/// # Errors
///
/// As [`crate::model::Model::new`].
pub fn pairs(
    observations: &Observations,
    fit: &Fit,
    judge: &Judge,
    named: &[Instance],
    charge: &(dyn Fn(f64, f64) -> f64 + Sync),
    needed: f64,
) -> Result<Vec<Pair>, Error> {
    let widths: Vec<usize> = named.iter().map(Instance::width).collect();
    let all = [widths.iter().sum()];
    let projected = projection::project_blocks(observations, fit, named, &all)?;
    let Some(all) = projected.first() else { return Ok(Vec::new()) };
    let together = Together::new(all, &widths);
    let tests = named.len() as f64;
    let least = of_places(scored::named_places(tests));
    let worth = |(a, b): (&Unit, &Unit)| {
        let score = together.score(a, b)?;
        let added = [(a, score - b.score), (b, score - a.score)];
        if added.iter().any(|(_, added)| *added < least) {
            return None;
        }
        let pair = Pair {
            both: added.map(|(unit, added)| {
                let (instance, width) = (named[unit.candidate], unit.columns.len() as f64);
                let one = Scored::of(instance, Family::Named, added, width, 1.0, tests);
                Scored { charge: charge(width, added), ..one }
            }),
            score,
        };
        let stands = pair.both.iter().all(|one| one.charged() > 0.0);
        (stands && pair.charged() > needed)
            .then(|| Pair { both: pair.both.map(|one| one.judged(judge)), ..pair })
    };
    let units = &together.units;
    let with_later = |k: usize| -> Vec<Pair> {
        units[k + 1..].iter().filter_map(|b| worth((&units[k], b))).collect()
    };
    let pairs: Vec<Vec<Pair>> = workers::map(0..units.len(), with_later);
    Ok(pairs.concat())
}

/// One candidate in the coordinates in which its `M` is 1.
struct Unit {
    candidate: usize,
    /// Its columns among those of all.
    columns: Range<usize>,
    /// `|w|²`.
    score: f64,
}

/// All candidates in such coordinates.
struct Together {
    /// Those of which anything is to be seen.
    units: Vec<Unit>,
    /// `Qᵀ M Q`.
    shared: Mat<f64>,
    /// `w`.
    along: Vec<f64>,
}

impl Together {
    fn new(all: &Projected, widths: &[usize]) -> Self {
        // In units of the columns before the projection, so that rank is told apart.
        let scale = |r: &f64| r.max(f64::MIN_POSITIVE).sqrt().recip();
        let scales: Vec<f64> = all.raw.iter().map(scale).collect();
        let (n, mut square) = (scales.len(), all.square.clone());
        for (j, column) in scales.iter().enumerate() {
            for (value, row) in square.col_as_slice_mut(j).iter_mut().zip(&scales) {
                *value *= row * column;
            }
        }
        let gradient = Mat::from_fn(n, 1, |i, _| all.gradient[i] * scales[i]);
        let mut units: Vec<Unit> = Vec::with_capacity(widths.len());
        // `Q` of each, and the first row that it takes of `M`.
        let mut roots: Vec<(usize, Mat<f64>)> = Vec::with_capacity(widths.len());
        let (mut first, mut next) = (0, 0);
        for (candidate, &width) in widths.iter().enumerate() {
            let root = root(square.submatrix(first, first, width, width));
            let columns = next..next + root.ncols();
            next = columns.end;
            if !columns.is_empty() {
                units.push(Unit { candidate, columns, score: 0.0 });
                roots.push((first, root));
            }
            first += width;
        }
        // Each takes its own rows and columns only.
        let mut half = Mat::<f64>::zeros(n, next);
        let mut shared = Mat::<f64>::zeros(next, next);
        let mut along = vec![0.0; next];
        for (unit, (first, root)) in units.iter_mut().zip(&roots) {
            let (start, count, width) = (unit.columns.start, root.ncols(), root.nrows());
            let own = square.subcols(*first, width);
            half.subcols_mut(start, count).copy_from(own * root);
            let w = root.transpose() * gradient.subrows(*first, width);
            unit.score = (0..count).map(|k| w[(k, 0)].powi(2)).sum();
            along[start..start + count].copy_from_slice(w.col_as_slice(0));
        }
        for (unit, (first, root)) in units.iter().zip(&roots) {
            let own = root.transpose() * half.subrows(*first, root.nrows());
            shared.subrows_mut(unit.columns.start, root.ncols()).copy_from(own);
        }
        Self { units, shared, along }
    }

    /// `T` of (74); none where the two are all but the same.
    fn score(&self, a: &Unit, b: &Unit) -> Option<f64> {
        let Self { shared, along, .. } = self;
        let (wide, narrow) = if a.columns.len() < b.columns.len() { (b, a) } else { (a, b) };
        let (rows, columns) = (&wide.columns, &narrow.columns);
        if columns.len() == 1 {
            // Most pairs: nothing to factor.
            let (mut left, mut v) = (1.0, along[columns.start]);
            // The column of the wide one: those of the other follow each other in it.
            for row in rows.clone() {
                let c = shared.col_as_slice(row)[columns.start];
                left -= c * c;
                v -= c * along[row];
            }
            return (left > APART).then(|| wide.score + v * v / left);
        }
        let c = shared.submatrix(rows.start, columns.start, rows.len(), columns.len());
        let left = Mat::<f64>::identity(columns.len(), columns.len()) - c.transpose() * c;
        let w = |of: &Range<usize>| Mat::from_fn(of.len(), 1, |k, _| along[of.start + k]);
        let v = w(columns) - c.transpose() * w(rows);
        let factor = Llt::new(left.as_ref(), Side::Lower).ok()?;
        let apart = (0..columns.len()).all(|k| factor.L()[(k, k)].powi(2) > APART);
        apart.then(|| wide.score + (v.transpose() * factor.solve(&v))[(0, 0)])
    }
}

/// `Q`, of as many columns as are to be seen.
fn root(square: MatRef<'_, f64>) -> Mat<f64> {
    let Some((values, vectors)) = eigenvalues(square) else {
        return Mat::zeros(square.nrows(), 0);
    };
    let seen: Vec<usize> = (0..square.nrows()).filter(|&k| values[k] > VISIBLE).collect();
    Mat::from_fn(square.nrows(), seen.len(), |i, k| vectors[(i, seen[k])] / values[seen[k]].sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::DMatrix;
    use nalgebra::DVector;

    /// `uᵀ M⁻¹ u` of some columns.
    fn direct(square: &DMatrix<f64>, gradient: &DVector<f64>, columns: &[usize]) -> f64 {
        let m = square.select_rows(columns).select_columns(columns);
        let u = gradient.select_rows(columns);
        u.dot(&m.lu().solve(&u).expect("columns that are apart"))
    }

    #[test]
    fn two_score_what_both_together_take_of_the_residual() {
        let widths = [1, 3, 2, 1, 1];
        // Columns of no particular direction; the last repeats the first.
        let mut z = DMatrix::from_fn(40, 8, |i, j| ((1 + i * i + 7 * i * j) as f64).sin());
        let r = DVector::from_fn(40, |i, _| ((3 * i + 1) as f64).cos());
        z.set_column(7, &(-2.0 * z.column(0)));
        let (square, gradient) = (z.transpose() * &z, z.transpose() * r);
        let together = Together::new(
            &Projected {
                square: Mat::from_fn(8, 8, |i, j| square[(i, j)]),
                raw: square.diagonal().iter().copied().collect(),
                gradient: gradient.iter().copied().collect(),
                absorbed: Mat::zeros(0, 8),
            },
            &widths,
        );
        let first: Vec<usize> = (0..5).map(|k| widths[..k].iter().sum()).collect();
        let columns = |k: usize| first[k]..first[k] + widths[k];
        for a in 0..5 {
            for b in 0..a {
                let score = together.score(&together.units[a], &together.units[b]);
                if (a, b) == (4, 0) {
                    assert_eq!(score, None);
                    continue;
                }
                let both: Vec<usize> = columns(a).chain(columns(b)).collect();
                let wanted = direct(&square, &gradient, &both);
                let got = score.expect("two that are apart");
                assert!((got - wanted).abs() < 1e-10 * wanted, "{a} {b}: {got} for {wanted}");
            }
        }
    }
}
