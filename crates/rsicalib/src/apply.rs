//! An earlier result, applied to readings that it has not seen.

use crate::check::{Check, compare, poses_of};
use crate::model::{Model, parse};
use crate::readings::{Readings, Table};
use crate::{Error, Mechanism};

/// What the parameters of a result refer to, beside the mechanism.
///
/// Offsets are told apart from gains about `centre`, a free curve runs over
/// `span`, and temperatures count from `temperature`: all of the readings that
/// the result was found with.
#[derive(Debug, Clone, PartialEq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Reference {
    /// Mean reading of each channel.
    pub centre: Vec<f64>,
    /// Lowest and highest reading of each channel.
    pub span: Vec<[f64; 2]>,
    /// Mean temperature [°C], where it was measured.
    pub temperature: Option<f64>,
}

impl Reference {
    /// Of the readings of a fit.
    #[must_use]
    pub fn of(readings: &Readings) -> Self {
        Self {
            centre: readings.mean.clone(),
            span: readings.span.clone(),
            temperature: readings.mean_temperature,
        }
    }
}

/// A parameter as a result reports it: offsets at reading zero, gains absolute.
#[derive(Debug, Clone, PartialEq)]
pub struct Reported {
    /// `curvature@a22`, as [`parse`] reads it.
    pub term: String,
    /// Its name.
    pub name: String,
    /// Its value.
    pub value: f64,
}

/// A result, as far as it bears on other readings than its own.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Applied {
    /// Its parameters; none: the mechanism as it is declared.
    pub parameters: Vec<Reported>,
    /// What they refer to.
    pub reference: Reference,
    /// Standard deviation of one reading of each channel.
    pub sigma: Vec<f64>,
}

/// Error of a result on known poses, as [`crate::check::check`] has it of a fit.
///
/// # Errors
///
/// As [`platform_poses`].
pub fn check(
    mechanism: &Mechanism,
    applied: &Applied,
    table: &Table,
    known: &[[f64; 6]],
    align: bool,
) -> Result<Check, Error> {
    let channels = mechanism.channels.len();
    compare(channels, table, known, align, |t| platform_poses(mechanism, applied, t))
}

/// Platform pose of every row of a table under a result.
///
/// # Errors
///
/// As [`crate::check::platform_poses`], and [`Error::Unknown`] where a parameter
/// has no such term, target or name.
pub fn platform_poses(
    mechanism: &Mechanism,
    applied: &Applied,
    table: Table,
) -> Result<Vec<[f64; 6]>, Error> {
    let Applied { parameters, reference, sigma } = applied;
    if mechanism.platform.is_empty() {
        return Err(Error::Missing {
            mechanism: mechanism.name.clone(),
            needs: "platform",
            why: "poses need the points that carry it",
        });
    }
    let channels = mechanism.channels.len();
    for (what, found) in
        [("centre", reference.centre.len()), ("span", reference.span.len()), ("sigma", sigma.len())]
    {
        if found != channels {
            return Err(Error::Shape { what: what.into(), found, expected: channels });
        }
    }
    let mut readings = Readings::new(mechanism, table)?;
    if let Some(mean) = reference.temperature {
        readings.count_temperature_from(mean);
    }
    let mut terms: Vec<String> = parameters.iter().map(|p| p.term.clone()).collect();
    terms.dedup();
    let instances = parse(mechanism, &readings, &terms)?;
    let mut model = Model::new(mechanism, &readings, instances)?;
    for ((scale, &centre), &span) in
        model.scales.iter_mut().zip(&reference.centre).zip(&reference.span)
    {
        scale.angle += scale.gain * (centre - scale.centre);
        (scale.centre, scale.span) = (centre, span);
    }
    let beta = internal(&model, mechanism, &readings, parameters)?;
    Ok(poses_of(&model, &readings, &beta, sigma, 1.0))
}

/// The inverse of [`crate::result::reported`].
fn internal(
    model: &Model,
    mechanism: &Mechanism,
    readings: &Readings,
    parameters: &[Reported],
) -> Result<Vec<f64>, Error> {
    let mut beta = model.nominal();
    for p in parameters {
        let instance = parse(mechanism, readings, std::slice::from_ref(&p.term))?;
        let known = instance[0].term.info().parameters;
        let k = known.iter().position(|k| k.name == p.name).ok_or_else(|| Error::Unknown {
            kind: "parameter",
            found: p.name.clone(),
            known: known.iter().map(|k| k.name).collect::<Vec<_>>().join(", "),
        })?;
        if let Some(i) = model.instances.iter().position(|i| *i == instance[0]) {
            beta[model.first[i] + k] = p.value;
        }
    }
    for (c, scale) in model.scales.iter().enumerate() {
        let gain = model.column("gain", c);
        let slope = gain.map_or(scale.gain, |g| beta[g]);
        if let Some(offset) = model.column("offset", c) {
            beta[offset] += slope * scale.centre - scale.angle;
        }
        if let Some(gain) = gain {
            beta[gain] = slope - scale.gain;
        }
    }
    Ok(beta)
}
