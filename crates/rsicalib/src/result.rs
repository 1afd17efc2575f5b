//! Results as users hold them: plain structs in the shape of the JSON.

use faer::Mat;

use crate::check::Check;
use crate::fit::Fit;
use crate::model::{Instance, place_name};
use crate::session::Session;
use crate::terms::Placed;

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

/// Error on poses that were left out, the terms refitted without them.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct HeldOut {
    /// χ² of the poses left out, per equation.
    pub chi2_per_dof: f64,
    /// Error of their closures, length units.
    pub rms_misclosure: f64,
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

/// An estimated parameter.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct ParameterReport {
    /// Id of its term.
    pub term: String,
    /// What it belongs to.
    pub target: String,
    /// Where a searched term acts.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub place: Option<String>,
    /// Its name.
    pub name: String,
    /// Its value.
    pub value: f64,
    /// Standard deviation; none where these poses cannot determine it.
    pub sd: Option<f64>,
    /// Its unit.
    pub unit: String,
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

/// Values and covariance as they are reported: offsets at reading zero, gains
/// absolute, everything else as in the model.
///
/// ```text
/// θ_off = θ0 + p_off - (k0 + p_gain) a_c,    k = k0 + p_gain
/// ```
#[must_use]
pub fn reported(fit: &Fit) -> (Vec<f64>, Mat<f64>) {
    let model = &fit.model;
    let n = model.parameters;
    let mut values = fit.beta.clone();
    let mut map = Mat::<f64>::identity(n, n);
    for (c, scale) in model.scales.iter().enumerate() {
        let gain = model.column("gain", c);
        let slope = gain.map_or(0.0, |g| fit.beta[g]) + scale.gain;
        if let Some(offset) = model.column("offset", c) {
            values[offset] = fit.beta[offset] + scale.angle - slope * scale.centre;
            if let Some(gain) = gain {
                map[(offset, gain)] = -scale.centre;
            }
        }
        if let Some(gain) = gain {
            values[gain] = slope;
        }
    }
    let covariance = &map * &fit.covariance * map.transpose();
    (values, covariance)
}

/// The same in words and numbers.
#[must_use]
pub fn estimates(session: &Session, fit: &Fit) -> Estimates {
    let (values, covariance) = reported(fit);
    let mechanism = &session.mechanism;
    let n = values.len();
    let sigma =
        mechanism.channels.iter().map(|c| c.name.clone()).zip(fit.noise.sigma.iter().copied());
    let names = parameter_names(session, fit);
    let parameters = names.into_iter().enumerate().map(|(k, mut p)| {
        p.value = values[k];
        p.sd = (!fit.unknowable[k]).then(|| covariance[(k, k)].max(0.0).sqrt());
        p
    });
    let directions = crate::observability::directions(session, fit);
    Estimates {
        noise: NoiseReport {
            source: fit.noise.words(),
            sigma: Named(sigma.collect()),
            dof: fit.noise.dof.is_finite().then_some(fit.noise.dof),
            correlation: fit.noise.correlation,
        },
        parameters: parameters.collect(),
        covariance: (0..n).map(|i| (0..n).map(|j| covariance[(i, j)]).collect()).collect(),
        unobservable: directions.unobservable,
        weak: directions.weak,
        condition: fit.condition,
        condition_uncentred: crate::observability::uncentred_condition(fit),
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

/// Name, target and unit of every parameter, in order; values and deviations empty.
#[must_use]
pub fn parameter_names(session: &Session, fit: &Fit) -> Vec<ParameterReport> {
    let mechanism = &session.mechanism;
    let mut names = Vec::new();
    for instance in &fit.model.instances {
        for parameter in instance.term.info().parameters {
            names.push(ParameterReport {
                term: instance.term.info().id.into(),
                target: instance.target.name(mechanism),
                place: place(session, instance),
                name: parameter.name.into(),
                value: f64::NAN,
                sd: None,
                unit: unit(session, instance, parameter.unit),
            });
        }
    }
    for point in &fit.model.unknown_names {
        for axis in ["x", "y", "z"] {
            names.push(ParameterReport {
                term: "unknown_point".into(),
                target: point.clone(),
                place: None,
                name: axis.into(),
                value: f64::NAN,
                sd: None,
                unit: mechanism.length_unit.clone(),
            });
        }
    }
    names
}

/// The place of a term that has several, as users call it.
#[must_use]
pub fn place(session: &Session, instance: &Instance) -> Option<String> {
    let bound = session.readings.sessions > 1 && crate::model::bound_to_session(instance.term);
    (bound || instance.term.placed() != Placed::Once)
        .then(|| place_name(instance.term, &session.mechanism, &session.readings, instance.place))
}

/// A unit with the mechanism's and the channel's own put in.
#[must_use]
pub fn unit(session: &Session, instance: &Instance, unit: &str) -> String {
    let reading = match instance.target {
        crate::Target::Channel(c) => session.mechanism.channels[c].unit.as_str(),
        _ => "reading",
    };
    let slides =
        matches!(instance.target, crate::Target::Channel(c) if session.mechanism.slides(c));
    let unit = if slides { unit.replace("rad", "length") } else { unit.into() };
    unit.replace("reading", reading).replace("length", &session.mechanism.length_unit)
}
