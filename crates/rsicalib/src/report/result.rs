//! Results as users hold them: plain structs in the shape of the JSON.

use crate::apply::check::Check;
use crate::diagnosis::held_out::HeldOut;
use crate::estimate::directions::{ParameterReport, parameter_names, reported};
use crate::estimate::{Fit, Observations};

/// Name and number, in the order of the mechanism.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Named(pub Vec<(String, f64)>);

#[cfg(feature = "serde")]
impl serde::Serialize for Named {
    fn serialize<S: serde::Serializer>(&self, s: S) -> Result<S::Ok, S::Error> {
        s.collect_map(self.0.iter().map(|(k, v)| (k, v)))
    }
}

/// Noise of one reading.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct NoiseReport {
    /// Where it is from.
    pub source: String,
    /// Standard deviation per sample, quantisation included.
    pub sigma: Named,
    /// Degrees of freedom; none where it was declared.
    pub dof: Option<f64>,
    /// Between neighbouring samples.
    pub correlation: f64,
}

/// How well a model fits.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct FitReport {
    /// χ² between poses.
    pub chi2: f64,
    /// Its degrees of freedom.
    pub dof: f64,
    /// Probability of a larger one by chance.
    pub p_value: Option<f64>,
    /// Error of the closures, length units.
    pub rms_misclosure: f64,
    /// Error on poses left out.
    pub held_out: Option<HeldOut>,
    /// Error on known poses.
    pub check: Option<Check>,
    /// The same after a rigid motion of the instrument.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub aligned: Option<Check>,
}

impl FitReport {
    /// Of a fit.
    #[must_use]
    pub fn of(fit: &Fit) -> Self {
        Self {
            chi2: fit.chi2,
            dof: fit.dof,
            p_value: fit.p_value,
            rms_misclosure: fit.rms_misclosure,
            held_out: None,
            check: None,
            aligned: None,
        }
    }
}

/// A start that was tried.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct StartReport {
    /// Where it began.
    pub from: String,
    /// `fᵀf` where it ended.
    pub cost: f64,
    /// True where a gain went to zero.
    pub collapsed: bool,
}

/// Everything about one fit.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Estimates {
    /// Noise.
    pub noise: NoiseReport,
    /// Parameters.
    pub parameters: Vec<ParameterReport>,
    /// What must be noted of them, in sentences.
    pub remarks: Vec<String>,
    /// Their covariance, row by row.
    pub covariance: Vec<Vec<f64>>,
    /// What these poses cannot tell apart, in words.
    pub unobservable: Vec<String>,
    /// What they hardly tell apart.
    pub weak: Vec<String>,
    /// Condition number, offsets about the mean reading.
    pub condition: f64,
    /// Condition number with offsets at reading zero.
    pub condition_uncentred: f64,
    /// Starts tried.
    pub starts: Vec<StartReport>,
    /// Why the search ended.
    pub termination: String,
    /// True where it ended at a minimum in which every joint moves.
    pub converged: bool,
    /// Linearisations made.
    pub iterations: usize,
}

/// The same in words and numbers.
#[must_use]
pub fn estimates(observations: &Observations, fit: &Fit) -> Estimates {
    let (values, covariance) = reported(fit);
    let mechanism = &observations.mechanism;
    let n = values.len();
    let sigma =
        mechanism.channels.iter().map(|c| c.name.clone()).zip(fit.noise.sigma.iter().copied());
    let names = parameter_names(observations, fit);
    let parameters = names.into_iter().enumerate().map(|(k, mut p)| {
        p.value = values[k];
        p.sd = (!fit.unknowable[k]).then(|| covariance[(k, k)].max(0.0).sqrt());
        p.noted()
    });
    let parameters: Vec<ParameterReport> = parameters.collect();
    let directions = crate::estimate::directions::directions(observations, fit);
    Estimates {
        noise: NoiseReport {
            source: fit.noise.words(),
            sigma: Named(sigma.collect()),
            dof: fit.noise.dof.is_finite().then_some(fit.noise.dof),
            correlation: fit.noise.correlation,
        },
        remarks: parameters.iter().filter_map(ParameterReport::remark).collect(),
        parameters,
        covariance: (0..n).map(|i| (0..n).map(|j| covariance[(i, j)]).collect()).collect(),
        unobservable: directions.unobservable,
        weak: directions.weak,
        condition: fit.condition,
        condition_uncentred: crate::estimate::directions::uncentred_condition(fit),
        starts: fit
            .starts
            .iter()
            .map(|t| StartReport { from: t.from.clone(), cost: t.cost, collapsed: t.collapsed })
            .collect(),
        termination: fit.termination.message().into(),
        converged: fit.termination.converged() && fit.plausible,
        iterations: fit.iterations,
    }
}
