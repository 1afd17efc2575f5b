//! A change whose name is open: the evidence for each.
//!
//! All suspects are estimated together, each parameter `θ` with a variance `Σ₀` beforehand that is
//! as large as the first rows say of it alone. With the mean `d` and covariance `V` of later rows,
//! these say `Λ = V⁻¹ - Σ₀⁻¹` and `h = V⁻¹ d`. The evidence for a name that lets `θ` have the
//! variances `Σ`, zero for the parameters of the others, is
//!
//! ```text
//! 2 ln Z = hᵀ Σ (1 + Λ Σ)⁻¹ h - ln |1 + Σ Λ|                             (105)
//! ```

use nalgebra::{DMatrix, DVector};

use crate::monitor::alarm::Alarm;
use crate::monitor::state::State;
use crate::monitor::watched::Watched;

/// A change whose name is open.
#[derive(Debug, Clone)]
pub(crate) struct Open {
    /// Candidates that are estimated together, the one that was named first.
    pub(crate) suspects: Vec<usize>,
    /// Their columns, candidate by candidate, as places in the state.
    pub(crate) places: Vec<usize>,
    /// Variance of each beforehand.
    pub(crate) width: Vec<f64>,
    /// All parameters before the change.
    pub(crate) was: Vec<f64>,
    /// Covariance of the state before the change, row by row.
    pub(crate) known: DMatrix<f64>,
    pub(crate) alarm: Alarm,
}

impl Open {
    /// Where the columns of a suspect begin, and how many there are.
    pub(crate) fn columns(&self, watched: &Watched, candidate: usize) -> std::ops::Range<usize> {
        let width = |c: &usize| watched.candidates[*c].columns.len();
        let before = self.suspects.iter().take_while(|c| **c != candidate);
        let first = before.map(width).sum();
        first..first + width(&candidate)
    }

    /// Covariance of the state beforehand, if these columns may have changed.
    pub(crate) fn prior(&self, columns: impl Iterator<Item = usize>) -> DMatrix<f64> {
        let mut prior = self.known.clone();
        columns.for_each(|i| prior[(self.places[i], self.places[i])] += self.width[i]);
        prior
    }

    /// Change of each column since before, and its covariance, in units of [`Watched::scale`].
    pub(crate) fn difference(
        &self,
        watched: &Watched,
        state: &State,
    ) -> (DVector<f64>, DMatrix<f64>) {
        let q = self.places.len();
        let values = DVector::from_fn(q, |i, _| {
            let (place, column) = (self.places[i], watched.order[self.places[i]]);
            state.mean[place] + (watched.at[column] - self.was[column]) / watched.scale[place]
        });
        let entry = |i: usize, j: usize| self.places[i] * state.size + self.places[j];
        (values, DMatrix::from_fn(q, q, |i, j| state.covariance[entry(i, j)]))
    }

    /// What the rows say, `Λ` and `h`, and the covariance beforehand of all columns that may have
    /// changed.
    fn told(&self, watched: &Watched, state: &State) -> Option<(DMatrix<f64>, DVector<f64>)> {
        let (d, v) = self.difference(watched, state);
        let inverse = v.cholesky()?.inverse();
        let before = self.own(&self.prior(0..self.places.len())).cholesky()?.inverse();
        Some((&inverse - before, inverse * d))
    }

    /// The part of a covariance of the state that belongs to the columns.
    fn own(&self, state: &DMatrix<f64>) -> DMatrix<f64> {
        let q = self.places.len();
        DMatrix::from_fn(q, q, |i, j| state[(self.places[i], self.places[j])])
    }

    /// Names by their evidence, the best first, as twice its logarithm.
    pub(crate) fn evidence(&self, watched: &Watched, state: &State) -> Option<Vec<(f64, usize)>> {
        let q = self.places.len();
        let (told, h) = self.told(watched, state)?;
        let mut names = Vec::with_capacity(self.suspects.len());
        for &candidate in &self.suspects {
            let sigma = self.own(&self.prior(self.columns(watched, candidate)));
            let factor = (DMatrix::identity(q, q) + &told * &sigma).lu();
            let fit = h.dot(&(&sigma * factor.solve(&h)?));
            names.push((fit - factor.determinant().abs().ln(), candidate));
        }
        names.sort_by(|a, b| b.0.total_cmp(&a.0));
        Some(names)
    }

    /// Change of one suspect and its covariance if nothing else has changed, in units of
    /// [`Watched::scale`].
    pub(crate) fn alone(
        &self,
        watched: &Watched,
        state: &State,
        candidate: usize,
    ) -> Option<(DVector<f64>, DMatrix<f64>)> {
        let (q, columns) = (self.places.len(), self.columns(watched, candidate));
        let (first, width) = (columns.start, columns.len());
        let (told, h) = self.told(watched, state)?;
        let sigma = self.own(&self.prior(columns));
        let factor = (DMatrix::identity(q, q) + &told * &sigma).lu();
        let values = &sigma * factor.solve(&h)?;
        let covariance = &sigma * factor.try_inverse()?;
        let block = covariance.view((first, first), (width, width)).into_owned();
        Some((values.rows(first, width).into_owned(), block))
    }
}
