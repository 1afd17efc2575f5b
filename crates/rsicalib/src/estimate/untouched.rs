//! Places of unknown points that a fit has not seen.

use crate::estimate::fitted::Fit;
use crate::estimate::implicit::Implicit;
use crate::estimate::objective::{Noise, Part};
use crate::estimate::observations::Observations;
use crate::numerics::linearization::{Curvature, Linearization, Problem};
use crate::numerics::lm;

/// Places unknown points that no row of weight in `training` has touched where the other rows of the
/// session put them, all else as it was fitted; returns the columns.
pub fn place_untouched(
    observations: &Observations,
    fitted: &mut Fit,
    training: &[f64],
    noise: &Noise,
) -> Vec<usize> {
    let Observations { readings, weights, .. } = observations;
    let columns = fitted.model.untouched(readings, training);
    if columns.is_empty() {
        return columns;
    }
    let mut near = fitted.beta.clone();
    fitted.model.place_unknowns(readings, &mut near);
    let start: Vec<f64> = columns.iter().map(|column| near[*column]).collect();
    let rest = weights.iter().zip(training).map(|(all, seen)| if *seen > 0.0 { 0.0 } else { *all });
    let rest: Vec<f64> = rest.collect();
    let part = Part { model: &fitted.model, readings, weights: Some(&rest) };
    let whole = Implicit::new(vec![(part, noise.clone())], &fitted.priors);
    let some = SomeColumns { whole: &whole, fitted: &fitted.beta, columns: &columns };
    let found = lm::minimize(&some, &start, &lm::SolverOptions::default());
    let found = if found.termination.converged() { found.x } else { start };
    columns.iter().zip(found).for_each(|(column, at)| fitted.beta[*column] = at);
    columns
}

/// A problem of some columns of another, the others as they are.
struct SomeColumns<'a> {
    whole: &'a Implicit<'a>,
    fitted: &'a [f64],
    columns: &'a [usize],
}

impl Problem for SomeColumns<'_> {
    fn parameters(&self) -> usize {
        self.columns.len()
    }

    fn linearize(&self, x: &[f64]) -> Linearization {
        let columns = self.columns;
        let mut all = self.fitted.to_vec();
        columns.iter().zip(x).for_each(|(column, x)| all[*column] = *x);
        let whole = self.whole.linearize(&all);
        let gram = whole.gram();
        let n = columns.len();
        let own = faer::Mat::from_fn(n, n, |i, j| gram[(columns[i], columns[j])]);
        Linearization {
            cost: whole.cost,
            gradient: columns.iter().map(|column| whole.gradient[*column]).collect(),
            curvature: Curvature::Gram(own),
            islands: Vec::new(),
        }
    }
}
