//! Two results of one device, compared by their parameters.
//!
//! Loops that touch unknown points are not those of another session: the readings of one session are not tested
//! under the calibration of the other. The results are: with the estimates `β₁`, `β₂` of what both determine, the
//! earlier ones as its session left them, and their covariances,
//!
//! ```text
//! d = β₂ - β₁ ~ N(0, C),    C = C₁ + C₂,    T = dᵀ C⁻¹ d ~ χ²(k)
//! T - T_R ~ χ²(k - k_R),    T_R = d_Rᵀ C_RR⁻¹ d_R
//! δ_S = d_S - C_SR C_RR⁻¹ d_R,    cov δ_S = C_SS - C_SR C_RR⁻¹ C_RS                            (175)
//! ```
//!
//! if nothing has changed, or the parameters `S` alone and none of the others, `R`.

use std::ops::Range;

use nalgebra::{DMatrix, DVector};

use crate::Error;
use crate::apply::change::{PlatformRms, apart, platform_difference};
use crate::apply::earlier::{Applied, outlasts};
use crate::apply::moved::parts_of;
use crate::diagnosis::options::LEVEL;
use crate::estimate::directions::{as_reported, parameter_names, reported_means};
use crate::estimate::{Fit, Implicit, Observations, Part, Residuals};
use crate::model::Spec;
use crate::monitor::compare::{
    Comparison, Found, Judged, LINEARISATIONS, MOST_CHANGES, Named, Ranked, choose_again,
};
use crate::monitor::covariance::inverse;
use crate::monitor::watched::displacement;
use crate::numerics::order;
use crate::terms::term::Outlasts;

/// What both results determine.
struct Both {
    /// Terms at their targets, each with its parameters.
    terms: Vec<(Spec, Range<usize>)>,
    names: Vec<String>,
    units: Vec<String>,
    /// Numbers among the parameters of the later fit.
    columns: Vec<usize>,
    difference: DVector<f64>,
    covariance: DMatrix<f64>,
}

/// What has changed since the calibration `earlier`, whose parameters have this covariance, row by row: told by the
/// parameters that it shares with a later fit.
///
/// # Errors
///
/// [`Error::Missing`] where they share none, and as [`outlasts`].
pub fn compare_results(
    earlier: &Applied,
    covariance: Option<&[f64]>,
    (observations, fit): (&Observations, &Fit),
    judged: &Judged,
) -> Result<Comparison, Error> {
    let both = Both::new(earlier, covariance, (observations, fit))?;
    let left_by = |changed: &[usize]| {
        let (chi2, count) = both.left(changed);
        let count = count.max(1) as f64;
        (chi2 / count, judged.p_value(chi2, count))
    };
    let (chi2_per_dof, p_value) = left_by(&[]);
    let open = fit.p_value.is_some_and(|p| p <= LEVEL);
    let mut changes: Vec<Named> = Vec::new();
    for _ in 0..if open { 0 } else { MOST_CHANGES } {
        let Some(best) = both.first(&changes, judged) else { break };
        changes.push(best);
        choose_again(&mut changes, |others| both.first(others, judged));
    }
    let numbers: Vec<usize> = changes.iter().map(|one| one.candidate).collect();
    let (_, left) = left_by(&numbers);
    let (values, spread) = both.estimates(&numbers);
    order::ascending(&mut changes, |a| a.p_value);
    let found =
        changes.into_iter().map(|one| both.found(one, (&values, &spread), (observations, fit)));
    let (rms_misclosure, changes) = (both.misclosure(observations, fit), found.collect());
    Ok(Comparison { chi2_per_dof, p_value, rms_misclosure, changes, left, open })
}

impl Both {
    fn new(
        earlier: &Applied,
        covariance: Option<&[f64]>,
        (observations, fit): (&Observations, &Fit),
    ) -> Result<Self, Error> {
        let mechanism = &observations.mechanism;
        let (values, later) = reported_means(fit);
        let (n, known) = (earlier.parameters.len(), &earlier.parameters);
        let before = |i: usize, j: usize| covariance.map_or(0.0, |c| c[i * n + j]);
        let told = |i: &usize| before(*i, *i).is_finite() && known[*i].value.is_finite();
        let mut terms: Vec<(Spec, Range<usize>)> = Vec::new();
        let (mut names, mut units) = (Vec::new(), Vec::new());
        let (mut columns, mut parts) = (Vec::new(), Vec::new());
        for (column, p) in parameter_names(observations, fit).into_iter().enumerate() {
            let spec = p.spec();
            let own = parts_of(known.iter().map(|one| (&one.spec, &*one.name)), &spec, &p.name);
            let lasts = outlasts(mechanism, &spec)? == Outlasts::Whole;
            if !lasts || own.is_empty() || !own.iter().all(told) || fit.unknowable[column] {
                continue;
            }
            let end = columns.len() + 1;
            match terms.last_mut().filter(|(last, _)| *last == spec) {
                Some((_, range)) => range.end = end,
                None => terms.push((spec, end - 1..end)),
            }
            names.push(p.name);
            units.push(p.unit);
            columns.push(column);
            parts.push(own);
        }
        if terms.is_empty() {
            let why = "what has changed is told by parameters that both results have";
            return Err(Error::missing(&mechanism.name, "parameter of both results", why));
        }
        let k = columns.len();
        let was = |i: usize| parts[i].iter().map(|&own| known[own].value).sum::<f64>();
        let earlier = DMatrix::from_fn(k, k, |i, j| {
            let pairs = parts[i].iter().flat_map(|&a| parts[j].iter().map(move |&b| (a, b)));
            pairs.map(|(a, b)| before(a, b)).sum()
        });
        let later = DMatrix::from_fn(k, k, |i, j| later[(columns[i], columns[j])]);
        let difference = DVector::from_fn(k, |i, _| values[columns[i]] - was(i));
        Ok(Self { terms, names, units, difference, covariance: earlier + later, columns })
    }

    /// Parameters of all terms but these.
    fn others(&self, terms: &[usize]) -> Vec<usize> {
        let changed = |k: &usize| terms.iter().any(|&term| self.terms[term].1.contains(k));
        (0..self.columns.len()).filter(|k| !changed(k)).collect()
    }

    /// Covariance of some of the differences.
    fn of(&self, some: &[usize]) -> DMatrix<f64> {
        self.covariance.select_rows(some).select_columns(some)
    }

    /// `T_R` of (175) where these terms have changed, and its degrees of freedom.
    fn left(&self, changed: &[usize]) -> (f64, usize) {
        let rest = self.others(changed);
        let (inverse, rank) = inverse(&self.of(&rest));
        let d = self.difference.select_rows(&rest);
        (d.dot(&(inverse * &d)), rank)
    }

    /// The term that has changed beside `others`, the most certain; none where chance makes as much.
    fn first(&self, others: &[Named], judged: &Judged) -> Option<Named> {
        let mut taken: Vec<usize> = others.iter().map(|one| one.candidate).collect();
        let (all, k) = self.left(&taken);
        let mut ranked = Vec::new();
        for candidate in
            (0..self.terms.len()).filter(|term| !taken.contains(term)).collect::<Vec<_>>()
        {
            taken.push(candidate);
            let (rest, less) = self.left(&taken);
            taken.pop();
            if k > less {
                let log_p = judged.log_p(all - rest, k - less);
                let p_value = log_p.exp() * self.terms.len() as f64;
                ranked.push(Ranked { candidate, fit: all - rest, log_p, p_value });
            }
        }
        order::ascending(&mut ranked, |a| a.log_p);
        Named::first(&ranked, |term| self.name(term))
    }

    fn name(&self, term: usize) -> [String; 2] {
        let Spec { term, target, .. } = &self.terms[term].0;
        [term.clone(), target.clone().unwrap_or_default()]
    }

    /// `δ_S` of (175) and its covariance, in the place of all parameters.
    fn estimates(&self, changed: &[usize]) -> (DVector<f64>, DMatrix<f64>) {
        let rest = self.others(changed);
        let by = self.covariance.select_columns(&rest) * inverse(&self.of(&rest)).0;
        let values = &self.difference - &by * self.difference.select_rows(&rest);
        (values, &self.covariance - &by * self.covariance.select_rows(&rest))
    }

    fn found(
        &self,
        Named { candidate, p_value, also_fits }: Named,
        (values, covariance): (&DVector<f64>, &DMatrix<f64>),
        later: (&Observations, &Fit),
    ) -> Found {
        let own: Vec<usize> = self.terms[candidate].1.clone().collect();
        let named = own.iter().map(|&k| (&*self.names[k], &*self.units[k]));
        let values = values.select_rows(&own);
        let covariance = covariance.select_rows(&own).select_columns(&own);
        let (parameters, [size, sd], unit) = displacement(named, &values, &covariance);
        let [term, target] = self.name(candidate);
        let platform_rms = self.moved(&own, &values, later);
        Found { term, target, size, sd, unit, parameters, p_value, platform_rms, also_fits }
    }

    /// What a change does to the platform, or to the points that chains carry.
    fn moved(
        &self,
        own: &[usize],
        values: &DVector<f64>,
        (observations, fit): (&Observations, &Fit),
    ) -> Option<PlatformRms> {
        let mut back = DVector::zeros(fit.beta.len());
        own.iter().zip(values.iter()).for_each(|(&k, by)| back[self.columns[k]] = -by);
        let without = Fit { beta: shifted(fit, &back), ..fit.clone() };
        platform_difference(observations, fit, &without)
            .or_else(|| apart(observations, fit, &without).map(PlatformRms::of_points))
    }

    /// Misclosure of the later readings under the earlier result, where all that this does not say is as it closes
    /// their loops best.
    fn misclosure(&self, observations: &Observations, fit: &Fit) -> f64 {
        let mut back = DVector::zeros(fit.beta.len());
        self.columns.iter().zip(&self.difference).for_each(|(&k, by)| back[k] = -by);
        let mut beta = shifted(fit, &back);
        let free: Vec<usize> = (0..beta.len()).filter(|k| !self.columns.contains(k)).collect();
        let (readings, weights) = (&observations.readings, Some(&observations.weights[..]));
        let part = Part { model: &fit.model, readings, weights };
        let problem = Implicit::of(part, fit.assumed());
        for _ in 0..LINEARISATIONS {
            for (&k, by) in free.iter().zip(&step(&problem.residuals(&beta, true), &free)) {
                beta[k] -= by;
            }
        }
        part.rms_misclosure(&beta)
    }
}

/// What some parameters are too large by, to first order.
fn step(here: &Residuals, free: &[usize]) -> DVector<f64> {
    let rows = here.whitened.len();
    let width = here.by_parameter.len() / rows.max(1);
    let x = DMatrix::from_fn(rows, free.len(), |row, k| here.by_parameter[row * width + free[k]]);
    let w = DVector::from_column_slice(&here.whitened);
    inverse(&x.tr_mul(&x)).0 * x.tr_mul(&w)
}

/// The parameters of a fit where those that are reported differ by these.
fn shifted(fit: &Fit, by: &DVector<f64>) -> Vec<f64> {
    let (_, map) = as_reported(fit);
    let map = DMatrix::from_fn(map.nrows(), map.ncols(), |i, j| map[(i, j)]);
    let own = map.lu().solve(by).unwrap_or_else(|| by.clone());
    fit.beta.iter().zip(own.iter()).map(|(beta, by)| beta + by).collect()
}
