//! A change whose name is open: the evidence for each.
//!
//! All suspects are estimated together, each parameter `θ` with a variance beforehand. With the
//! covariance `P` of the whole state beforehand, its mean `d` and covariance `V` after later rows,
//! these say `Λ = V⁻¹ - P⁻¹` and `h = V⁻¹ d`. A name for the change lets the parameters of one
//! suspect have their variances, and those of the others none; a suspect may be named as a step, or
//! with its rate as a drift. With its covariance `Σ` of the state beforehand, the evidence for it is
//!
//! ```text
//! 2 ln Z = hᵀ Σ (1 + Λ Σ)⁻¹ h - ln |1 + Λ Σ|                             (105)
//! ```
//!
//! A name may be of two steps in one row, too; it is charged as if the second were drawn from all candidates, by
//! twice the logarithm of their number.
//!
//! The first part is the fit, by how much `χ²` falls. The second charges it for what it could also
//! have fitted; a drift is charged [`AS_WELL`] more. Mean and covariance of the state under this name are `Σ (1 + Λ Σ)⁻¹ h` and
//! `Σ (1 + Λ Σ)⁻¹`.

use nalgebra::{DMatrix, DVector};

use crate::monitor::alarm::Alarm;
use crate::monitor::state::State;
use crate::monitor::watched::Watched;
use crate::numerics::credible_set::AS_WELL;
use crate::numerics::order;

/// A change whose name is open.
#[derive(Debug, Clone)]
pub(crate) struct Open {
    /// Candidates that are estimated together.
    pub(crate) suspects: Vec<Suspected>,
    /// What is named.
    pub(crate) named: Kinds,
    /// Their columns, candidate by candidate, and the rate of one that may drift at its end, as
    /// places in the state.
    pub(crate) places: Vec<usize>,
    /// Variance of each beforehand.
    pub(crate) width: Vec<f64>,
    /// All parameters before the change.
    pub(crate) was: Vec<f64>,
    /// Covariance of the state before the change.
    pub(crate) known: DMatrix<f64>,
    pub(crate) alarm: Alarm,
    /// What the name that was fitted last leaves of the rows up to one.
    pub(crate) left: Option<Left>,
}

/// What a name leaves of the rows of a change up to one.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Left {
    pub(crate) kinds: Kinds,
    pub(crate) last: u64,
    pub(crate) rest: Rest,
}

/// A candidate that is estimated.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Suspected {
    pub(crate) candidate: usize,
    /// Number of its columns, and whether its rate follows them.
    pub(crate) columns: usize,
    pub(crate) drifts: bool,
}

/// A candidate that has changed once, or that goes on.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct Kind {
    pub(crate) candidate: usize,
    pub(crate) drifts: bool,
}

/// What a name is of: one candidate, or two that have changed in one row.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct Kinds {
    pub(crate) first: Kind,
    pub(crate) second: Option<Kind>,
}

impl From<Kind> for Kinds {
    fn from(first: Kind) -> Self {
        Self { first, second: None }
    }
}

impl Kinds {
    pub(crate) fn each(self) -> impl Iterator<Item = Kind> {
        std::iter::once(self.first).chain(self.second)
    }

    /// True where the candidate is one of them.
    pub(crate) fn has(self, candidate: usize) -> bool {
        self.each().any(|kind| kind.candidate == candidate)
    }

    fn drift(self) -> bool {
        self.each().any(|kind| kind.drifts)
    }
}

/// What is left of some rows.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Rest {
    pub(crate) squares: f64,
    pub(crate) rows: f64,
}

impl Rest {
    pub(crate) fn add(&mut self, squared: f64) {
        self.squares += squared;
        self.rows += 1.0;
    }
}

/// One name for a change.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Name {
    pub(crate) kinds: Kinds,
    /// By how much `χ²` falls.
    pub(crate) fit: f64,
    /// Twice the logarithm of the evidence.
    pub(crate) evidence: f64,
}

impl Name {
    /// True where the rows cannot tell this name from `named`: by its evidence, or as it fits as
    /// well. A link bent in one direction can be the same as an offset of its sensor.
    pub(crate) fn ties(&self, named: &Self) -> bool {
        let alike = self.kinds.drift() == named.kinds.drift()
            && self.kinds.second.is_some() == named.kinds.second.is_some();
        (alike && self.fit > named.fit - AS_WELL) || self.evidence > named.evidence - AS_WELL
    }
}

/// What the rows say of the state: `Λ` and `h` of the parameters that may differ from before.
pub(crate) struct Told {
    live: Vec<usize>,
    information: DMatrix<f64>,
    score: DVector<f64>,
}

impl Told {
    /// Fit, evidence, and mean and covariance of the live part of the state, with the covariance
    /// `prior` of the state beforehand.
    fn under(&self, prior: &DMatrix<f64>) -> Option<(f64, f64, DVector<f64>, DMatrix<f64>)> {
        let sigma = part(prior, &self.live);
        let n = sigma.nrows();
        let factor = (DMatrix::identity(n, n) + &self.information * &sigma).lu();
        let mean = &sigma * factor.solve(&self.score)?;
        let fit = self.score.dot(&mean);
        let evidence = fit - factor.determinant().abs().ln();
        let covariance = sigma * factor.try_inverse()?;
        Some((fit, evidence, mean, (&covariance + covariance.transpose()) * 0.5))
    }
}

/// Rows and columns of a covariance.
fn part(all: &DMatrix<f64>, live: &[usize]) -> DMatrix<f64> {
    DMatrix::from_fn(live.len(), live.len(), |i, j| all[(live[i], live[j])])
}

impl Open {
    /// The columns of a suspect, and its rate where it goes on.
    pub(crate) fn columns(&self, kind: Kind) -> std::ops::Range<usize> {
        let mut first = 0;
        for one in &self.suspects {
            if one.candidate == kind.candidate {
                return first..first + one.columns + usize::from(kind.drifts && one.drifts);
            }
            first += one.columns + usize::from(one.drifts);
        }
        first..first
    }

    /// The columns of all that is named.
    pub(crate) fn all_columns(&self, kinds: Kinds) -> impl Iterator<Item = usize> {
        kinds.each().flat_map(|kind| self.columns(kind))
    }

    /// All that a suspect can be named.
    pub(crate) fn kinds(&self) -> impl Iterator<Item = Kind> {
        let kind = |one: &Suspected, drifts| Kind { candidate: one.candidate, drifts };
        self.suspects
            .iter()
            .flat_map(move |one| [Some(kind(one, false)), one.drifts.then(|| kind(one, true))])
            .flatten()
    }

    /// Covariance of the state beforehand, if these columns may have changed.
    pub(crate) fn prior(&self, columns: impl Iterator<Item = usize>) -> DMatrix<f64> {
        let mut prior = self.known.clone();
        columns.for_each(|i| prior[(self.places[i], self.places[i])] += self.width[i]);
        prior
    }

    /// By how much a parameter of the state has been moved since before the change, in units of
    /// [`Watched::scale`].
    pub(crate) fn moved(&self, watched: &Watched, place: usize) -> f64 {
        let column = watched.order[place];
        (watched.at[column] - self.was[column]) / watched.scale[place]
    }

    /// What the rows say if their noise has the variance `scale`.
    pub(crate) fn told(&self, watched: &Watched, state: &State, scale: f64) -> Option<Told> {
        let prior = self.prior(0..self.places.len());
        let live: Vec<usize> = (0..state.size).filter(|&k| prior[(k, k)] > 0.0).collect();
        let covariance = DMatrix::from_row_slice(state.size, state.size, &state.covariance);
        let inverse = part(&covariance, &live).cholesky()?.inverse();
        let before = part(&prior, &live).cholesky()?.inverse();
        let mean =
            DVector::from_fn(live.len(), |i, _| state.mean[live[i]] + self.moved(watched, live[i]));
        let (information, score) = ((&inverse - before) / scale, inverse * mean / scale);
        Some(Told { live, information, score })
    }

    /// Twice the logarithm of the evidence that nothing has changed.
    pub(crate) fn unchanged(&self, told: &Told) -> f64 {
        told.under(&self.known).map_or(f64::NEG_INFINITY, |(_, evidence, ..)| evidence)
    }

    /// Names by their evidence, the best first: one of the candidates has changed, or two that are
    /// not of one place.
    pub(crate) fn names(&self, told: &Told, watched: &Watched) -> Vec<Name> {
        let second = 2.0 * (watched.candidates.len() as f64).ln();
        let name = |kinds: Kinds| {
            let (fit, evidence, ..) = told.under(&self.prior(self.all_columns(kinds)))?;
            let drift = if kinds.drift() { AS_WELL } else { 0.0 };
            let charged = drift + if kinds.second.is_some() { second } else { 0.0 };
            Some(Name { kinds, fit, evidence: evidence - charged })
        };
        let apart = |one: usize, other: usize| {
            let target = |k: usize| &watched.candidates[k].spec.target;
            target(one) != target(other)
        };
        let step = |one: &Suspected| Kind { candidate: one.candidate, drifts: false };
        let pairs = self.suspects.iter().enumerate().flat_map(|(n, one)| {
            let others = self.suspects[..n].iter();
            let others = others.filter(|other| apart(one.candidate, other.candidate));
            others.map(move |other| Kinds { first: step(other), second: Some(step(one)) })
        });
        let mut names: Vec<Name> =
            self.kinds().map(Kinds::from).chain(pairs).filter_map(name).collect();
        order::descending(&mut names, |a| a.evidence);
        names
    }

    /// Mean of the state, counted from before the change, and its covariance, if nothing else has
    /// changed.
    pub(crate) fn alone(
        &self,
        watched: &Watched,
        state: &State,
        kinds: Kinds,
    ) -> Option<(DVector<f64>, DMatrix<f64>)> {
        let told = self.told(watched, state, 1.0)?;
        let prior = self.prior(self.all_columns(kinds));
        let (.., mean, covariance) = told.under(&prior)?;
        let n = state.size;
        let (mut all, mut square) = (DVector::zeros(n), DMatrix::zeros(n, n));
        // What has not changed stays as it is, without a trace of rounding.
        let free = |&(_, place): &(usize, &usize)| prior[(*place, *place)] > 0.0;
        for (i, &row) in told.live.iter().enumerate().filter(free) {
            all[row] = mean[i];
            for (j, &column) in told.live.iter().enumerate().filter(free) {
                square[(row, column)] = covariance[(i, j)];
            }
        }
        Some((all, square))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::random::Random;

    /// The evidence against the density of all readings, `y ~ N(0, 1 + G Σ Gᵀ)`.
    #[test]
    fn the_evidence_of_a_name_is_the_density_of_the_readings() {
        let (rows, columns) = (12, 4);
        let mut random = Random::new(5);
        let mut draw = || random.uniform(-1.0, 1.0);
        let g = DMatrix::from_fn(rows, columns, |_, _| draw());
        let y = DVector::from_fn(rows, |_, _| 3.0 * draw());
        // The first two are known beforehand somewhat, the others may have changed.
        let wide = DMatrix::from_diagonal(&DVector::from_vec(vec![0.3, 0.1, 9.0, 4.0]));
        let before = wide.clone().cholesky().expect("positive").inverse();
        let inverse = &before + g.transpose() * &g;
        let told = Told {
            live: (0..columns).collect(),
            information: &inverse - &before,
            score: g.transpose() * &y,
        };
        for named in [2, 3] {
            let mut sigma = wide.clone();
            sigma[(5 - named, 5 - named)] = 0.0;
            let (fit, evidence, mean, _) = told.under(&sigma).expect("regular");

            let density = DMatrix::identity(rows, rows) + &g * &sigma * g.transpose();
            let inverse = density.clone().try_inverse().expect("regular");
            let squares = y.norm_squared() - y.dot(&(&inverse * &y));
            assert!((fit - squares).abs() < 1e-9);
            assert!((evidence - (squares - density.determinant().ln())).abs() < 1e-9);
            let expected = &sigma * g.transpose() * inverse * &y;
            assert!((mean - expected).norm() < 1e-9);
        }
    }
}
