//! What one device tells of its parameters.

use faer::Mat;

use crate::Error;
use crate::diagnosis::calibrate::calibrate;
use crate::estimate::directions::{ParameterReport, parameter_names};
use crate::estimate::intervals::wider;
use crate::estimate::{Expected, Fit, FitOptions, Observations, fit};
use crate::mechanism::{Mechanism, Target};
use crate::model::{Prior, bound_to_session};
use crate::numerics::symmetric::invert;
use crate::population::naming::Candidate;
use crate::readings::Table;

/// What one device tells of its parameters, as corrections of the drawing.
#[derive(Debug, Clone)]
pub struct Share {
    /// Name, target and unit of each parameter.
    pub parameters: Vec<ParameterReport>,
    /// Information `H` of the readings alone, without priors, row by row.
    pub information: Vec<f64>,
    /// `h = H (β̂ - β₀)`, of the same units.
    pub told: Vec<f64>,
    /// Sets of parameters that a drawing may have wrong together.
    pub candidates: Vec<Candidate>,
}

/// Readings from which offsets of a population are counted: the middle of each channel.
#[must_use]
pub fn middles(mechanism: &Mechanism) -> Vec<f64> {
    mechanism.channels.iter().map(|channel| channel.middle()).collect()
}

/// What a device tells of `terms`, linearised where the readings and what is `expected` agree.
///
/// The priors take part in the fit, so that a parameter which one device hardly tells stays where
/// the population has it; they are taken out of what the device tells:
/// with `N` the Gram matrix, `P` the priors' part and `μ` their mean, `H = N - P` and
/// `h = N (β̂ - β₀) - P μ`, for the gradient is zero at `β̂`.
///
/// # Errors
///
/// As [`calibrate`]; [`Error::Option`] for a term that each session has anew.
pub fn share(
    mechanism: &Mechanism,
    table: Table,
    rest: Option<Vec<f64>>,
    options: &FitOptions,
    terms: &[String],
    expected: Expected,
) -> Result<Share, Error> {
    let options = FitOptions { expected: Some(expected), ..options.clone() };
    let first = calibrate(&Observations::new(mechanism, table, rest, options)?)?;
    let observations = first.observations;
    let instances = crate::model::parse(&observations.mechanism, &observations.readings, terms)?;
    if let Some(own) = instances.iter().find(|i| bound_to_session(i.term)) {
        let expected = "terms that a device keeps";
        return Err(Error::option("terms", own.term.info().id, expected));
    }
    let found = fit(&observations, instances, Some(&first.fit))?;
    let (information, told) = without_priors(&found);
    let parameters = parameter_names(&observations, &found);
    let parameters = parameters.into_iter().take(found.model.term_parameters).collect();
    let candidates = candidates(&observations.mechanism, &found);
    Ok(Share { parameters, information, told, candidates })
}

/// `H` and `h` of the parameters of terms; unknown points are eliminated.
fn without_priors(fit: &Fit) -> (Vec<f64>, Vec<f64>) {
    let (n, m) = (fit.model.parameters, fit.model.term_parameters);
    let mut gram = fit.gram.clone();
    let mut told: Vec<f64> =
        (0..n).map(|i| (0..n).map(|j| gram[(i, j)] * fit.beta[j]).sum()).collect();
    for prior in &fit.priors {
        if let Prior::Parameter { column, mean, sd } = *prior
            && column < m
        {
            // As the Gram matrix has it. A prior that holds tightly leaves little beside it.
            let precision = (sd * fit.scale).powi(-2);
            gram[(column, column)] -= precision;
            told[column] -= mean * precision;
        }
    }
    let by = wider(fit).recip();
    let places = Mat::from_fn(n - m, n - m, |i, j| gram[(m + i, m + j)]);
    let cross = Mat::from_fn(m, n - m, |i, j| gram[(i, m + j)]);
    let through = &cross * invert(&places).0;
    let seen = &through * cross.transpose();
    let of = |i: usize, j: usize| 0.5 * (gram[(i, j)] + gram[(j, i)]) - seen[(i, j)];
    let information = (0..m * m).map(|ij| by * of(ij / m, ij % m)).collect();
    let own = |i: usize| (0..n - m).map(|k| through[(i, k)] * told[m + k]).sum::<f64>();
    (information, (0..m).map(|i| by * (told[i] - own(i))).collect())
}

/// What a drawing may have wrong: each parameter, those of chains that are drawn alike together,
/// and all channels of one make together.
#[must_use]
pub fn candidates(mechanism: &Mechanism, fit: &Fit) -> Vec<Candidate> {
    let model = &fit.model;
    let mut found = Vec::new();
    for (instance, &first) in model.instances.iter().zip(&model.first) {
        let target = instance.target.name(mechanism);
        for (k, parameter) in instance.term.info().parameters.iter().enumerate() {
            found.push(Candidate::of(
                instance.term,
                Some(&target),
                parameter.name,
                vec![first + k],
            ));
        }
    }
    let channels: Vec<Target> = (0..mechanism.channels.len()).map(Target::Channel).collect();
    let whole = (None, channels);
    let shared = mechanism.shared_targets().into_iter();
    let groups = shared.map(|t| (Some(t.name(mechanism)), mechanism.parts(t))).chain([whole]);
    let mut terms: Vec<&'static str> = Vec::new();
    for instance in &model.instances {
        if !terms.contains(&instance.term.info().id) {
            terms.push(instance.term.info().id);
        }
    }
    for (name, parts) in groups.filter(|(_, parts)| parts.len() > 1) {
        for &id in &terms {
            let at = |target: &Target| {
                let same = |(i, _): &(&crate::model::Instance, &usize)| {
                    i.term.info().id == id && i.target == *target
                };
                model.instances.iter().zip(&model.first).find(same)
            };
            let all: Option<Vec<_>> = parts.iter().map(at).collect();
            for (instance, _) in all.iter().flat_map(|all| all.first()) {
                for (k, parameter) in instance.term.info().parameters.iter().enumerate() {
                    let columns = all.iter().flatten().map(|(_, first)| *first + k).collect();
                    found.push(Candidate::of(
                        instance.term,
                        name.as_deref(),
                        parameter.name,
                        columns,
                    ));
                }
            }
        }
    }
    found
}
