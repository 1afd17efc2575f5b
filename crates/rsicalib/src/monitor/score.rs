//! The score test of one candidate in one window, (102).

use nalgebra::{DMatrix, DVector};

use crate::monitor::state::{State, dot, product};
use crate::monitor::windows::Sums;

/// Largest number of columns of a candidate, or of all suspects of a change together.
pub(crate) const MOST_COLUMNS: usize = 36;

/// Part of the information about a direction that the other parameters must leave, where the noise of
/// readings makes less.
const LEFT: f64 = 1e-7;

/// Buffers of a test, and what it has found.
#[derive(Debug, Clone)]
pub(crate) struct Score {
    /// `M`, row by row.
    pub(crate) information: [f64; MOST_COLUMNS * MOST_COLUMNS],
    /// `u`.
    pub(crate) score: [f64; MOST_COLUMNS],
    /// `D_zg J⁻¹`, row by row.
    pub(crate) absorbed: Vec<f64>,
    /// `D_zg` of one column.
    sums: Vec<f64>,
    /// Diagonal of `D_zz`.
    raw: [f64; MOST_COLUMNS],
    /// Part of the information about each that the others must leave.
    floor: [f64; MOST_COLUMNS],
    /// `ν` of each column of the state, (163).
    pub(crate) turned: Vec<f64>,
    factor: [f64; MOST_COLUMNS * MOST_COLUMNS],
    whitened: [f64; MOST_COLUMNS],
}

impl Score {
    /// Room for states up to `most` columns.
    pub(crate) fn new(most: usize) -> Self {
        let square = [0.0; MOST_COLUMNS * MOST_COLUMNS];
        Self {
            information: square,
            score: [0.0; MOST_COLUMNS],
            absorbed: vec![0.0; MOST_COLUMNS * most],
            sums: vec![0.0; most],
            raw: [0.0; MOST_COLUMNS],
            floor: [LEFT; MOST_COLUMNS],
            turned: vec![0.0; most],
            factor: square,
            whitened: [0.0; MOST_COLUMNS],
        }
    }

    /// Statistic `T` of the candidate with these columns of `G`, and its rank.
    #[inline(always)]
    pub(crate) fn test(
        &mut self,
        columns: &[usize],
        state: &State,
        now: &Sums,
        onset: &Sums,
    ) -> (f64, usize) {
        let (m, width) = (state.size, now.scores.len());
        let samples = now.mark.samples.saturating_sub(onset.mark.samples) as f64;
        for (i, &z) in columns.iter().enumerate() {
            self.floor[i] = LEFT.max(samples * self.turned[z]);
            let rows = (&now.products[z * width..], &onset.products[z * width..]);
            for ((d, now), onset) in self.sums[..m].iter_mut().zip(rows.0).zip(rows.1) {
                *d = now - onset;
            }
            product(&self.sums[..m], &state.covariance, &mut self.absorbed[i * m..(i + 1) * m]);
            self.score[i] =
                now.scores[z] - onset.scores[z] - dot(&self.sums[..m], &state.mean[..m]);
            self.raw[i] = rows.0[z] - rows.1[z];
            for (j, &other) in columns[..=i].iter().enumerate() {
                let value = rows.0[other]
                    - rows.1[other]
                    - dot(&self.sums[..m], &self.absorbed[j * m..(j + 1) * m]);
                self.information[i * MOST_COLUMNS + j] = value;
                self.information[j * MOST_COLUMNS + i] = value;
            }
        }
        self.statistic(columns.len())
    }

    /// `uᵀ M⁻¹ u`, directions of no information left out.
    #[inline(always)]
    fn statistic(&mut self, n: usize) -> (f64, usize) {
        const W: usize = MOST_COLUMNS;
        let (mut statistic, mut rank) = (0.0, 0);
        for i in 0..n {
            let mut left = self.score[i];
            for j in 0..i {
                let mut value = self.information[i * W + j];
                for b in 0..j {
                    value -= self.factor[i * W + b] * self.factor[j * W + b];
                }
                let diagonal = self.factor[j * W + j];
                let value = if diagonal > 0.0 { value / diagonal } else { 0.0 };
                self.factor[i * W + j] = value;
                left -= value * self.whitened[j];
            }
            let taken: f64 = self.factor[i * W..i * W + i].iter().map(|f| f * f).sum();
            let pivot = self.information[i * W + i] - taken;
            if pivot > self.floor[i] * self.raw[i] && pivot > 0.0 {
                self.factor[i * W + i] = pivot.sqrt();
                self.whitened[i] = left / pivot.sqrt();
                statistic += self.whitened[i].powi(2);
                rank += 1;
            } else {
                self.factor[i * W + i] = 0.0;
                self.whitened[i] = 0.0;
            }
        }
        (statistic, rank)
    }

    /// Estimate `(M + Λ)⁻¹ u` and covariance `(M + Λ)⁻¹` of the columns of the last test, with
    /// the precisions `Λ` of what is known of each beforehand; none where that is singular.
    pub(crate) fn estimate(&self, precision: &[f64]) -> Option<(DVector<f64>, DMatrix<f64>)> {
        let n = precision.len();
        let known = |i: usize, j| if i == j { precision[i] } else { 0.0 };
        let m = DMatrix::from_fn(n, n, |i, j| self.information[i * MOST_COLUMNS + j] + known(i, j));
        let covariance = m.cholesky()?.inverse();
        let u = DVector::from_fn(n, |i, _| self.score[i]);
        Some((&covariance * u, covariance))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::monitor::windows::Windows;
    use crate::numerics::random::Random;

    /// The test against generalised least squares of all samples with the prior as observations.
    #[test]
    fn statistic_and_estimate_are_those_of_least_squares() {
        let (m, n, samples, onset) = (3, 5, 40, 17);
        let mut random = Random::new(3);
        let mut draw = || random.uniform(-1.0, 1.0);
        let root = DMatrix::from_fn(m, m, |_, _| draw());
        let prior = &root * root.transpose() + DMatrix::identity(m, m) * 0.1;
        let g = DMatrix::from_fn(samples, n, |_, _| draw());
        let y = DVector::from_fn(samples, |_, _| 2.0 * draw());

        let mut state = State::new(prior.as_slice().to_vec(), m, n, 1);
        let mut windows = Windows::new(n, 4, (0..n).collect());
        let mut begin = windows.now.clone();
        for t in 0..samples {
            if t == onset {
                begin = windows.now.clone();
            }
            let row: Vec<f64> = g.row(t).iter().copied().collect();
            state.compare(&[y[t]], &row, n);
            state.absorb();
            windows.add(&[y[t]], &row, t as u64, None);
        }
        let mut score = Score::new(n);
        let (statistic, rank) = score.test(&[3, 4], &state, &windows.now, &begin);
        let (values, covariance) = score.estimate(&[0.0, 0.0]).expect("regular");

        let mut x = DMatrix::zeros(samples, m + 2);
        for t in 0..samples {
            for c in 0..m {
                x[(t, c)] = g[(t, c)];
            }
            if t >= onset {
                x[(t, m)] = g[(t, 3)];
                x[(t, m + 1)] = g[(t, 4)];
            }
        }
        let solve = |columns: usize| {
            let x = x.columns(0, columns);
            let mut normal = x.transpose() * x;
            let precision = prior.clone().try_inverse().expect("positive definite");
            let mut corner = normal.view_mut((0, 0), (m, m));
            corner += &precision;
            let cov = normal.try_inverse().expect("positive definite");
            let beta = &cov * x.transpose() * &y;
            let left = &y - x * &beta;
            let own = beta.rows(0, m);
            (left.norm_squared() + (own.transpose() * precision * own)[0], beta, cov)
        };
        let (without, ..) = solve(m);
        let (with, beta, cov) = solve(m + 2);
        assert_eq!(rank, 2);
        assert!((statistic - (without - with)).abs() < 1e-9);
        for i in 0..2 {
            assert!((values[i] - beta[m + i]).abs() < 1e-9);
            for j in 0..2 {
                assert!((covariance[(i, j)] - cov[(m + i, m + j)]).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn a_direction_without_information_does_not_count() {
        let state = State::new(vec![1.0], 1, 3, 1);
        let mut windows = Windows::new(3, 2, vec![0, 1, 2]);
        let begin = windows.now.clone();
        for t in 0..9 {
            // The last column is the one before it, twice.
            let z = f64::from(t % 3) - 1.0;
            windows.add(&[0.5 * z], &[0.0, z, 2.0 * z], t as u64, None);
        }
        let mut score = Score::new(3);
        let (statistic, rank) = score.test(&[1, 2], &state, &windows.now, &begin);
        assert_eq!(rank, 1);
        assert!((statistic - 1.5).abs() < 1e-12); // Σ (0.5 z)² = 6/4
    }
}
