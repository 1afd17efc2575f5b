//! An earlier result, applied to readings that it has not seen.

use crate::apply::check::{Check, compare};
use crate::apply::poses::poses_of;
use crate::mechanism::{Closure, ClosureKind, Mechanism, Point};
use crate::model::{Model, Want, Workspace, parse};
use crate::readings::{Readings, Table};
use crate::terms::term::Per;
use crate::{Error, terms};

/// What the parameters of a result refer to, beside the mechanism.
///
/// Offsets are told apart from gains about `centre`, a free curve runs over
/// `span`, and temperatures count from `temperature`: all of the readings that
/// the result was found with.
#[derive(Debug, Clone, PartialEq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
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

/// Error of a result on known poses, as [`crate::apply::check::check`] has it of a fit.
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
/// As [`crate::apply::poses::platform_poses`], and [`Error::Unknown`] where a parameter
/// has no such term, target or name.
pub fn platform_poses(
    mechanism: &Mechanism,
    applied: &Applied,
    table: Table,
) -> Result<Vec<[f64; 6]>, Error> {
    if mechanism.platform.is_empty() {
        return Err(Error::Missing {
            mechanism: mechanism.name.clone(),
            needs: "platform",
            why: "poses need the points that carry it",
        });
    }
    let (model, readings, beta) = under(mechanism, applied, table)?;
    Ok(poses_of(&model, &readings, &beta, &applied.sigma, 1.0))
}

/// Where the chains carry their points under a result, row by row of a table.
///
/// One entry for each point of the mechanism that a chain carries, in order; the
/// readings as they are. Nothing else of the closures is needed: the table has no
/// columns beside those of the channels.
///
/// # Errors
///
/// As [`platform_poses`]; [`Error::Missing`] where no chain carries a point.
pub fn points(
    mechanism: &Mechanism,
    applied: &Applied,
    table: Table,
) -> Result<Vec<Vec<[f64; 3]>>, Error> {
    let open = opened(mechanism)?;
    let applied = Applied {
        parameters: applied.parameters.iter().filter(|p| !closes(p)).cloned().collect(),
        ..applied.clone()
    };
    let table = Table { keys: Vec::new(), columns: Vec::new(), ..table };
    let (model, readings, beta) = under(&open, &applied, table)?;
    let carried: Vec<usize> =
        (0..open.points.len()).filter(|&p| open.points[p].chain.is_some()).collect();
    let mut out = vec![vec![[f64::NAN; 3]; readings.samples]; carried.len()];
    let mut ws = Workspace::default();
    for (block, meta) in readings.blocks().iter().enumerate() {
        let want = Want { x: false, a: false };
        model.evaluate(&readings, block, readings.raw(block), &beta, want, &mut ws);
        let points = model.points(&ws);
        for (out, &p) in out.iter_mut().zip(&carried) {
            let Some(at) = points[p] else { continue };
            for (lane, &row) in meta.rows.iter().enumerate().take(meta.live) {
                out[row] = at.map(|v| v.0[lane]);
            }
        }
    }
    Ok(out)
}

/// The same chains with their points, closed on nothing that readings would have to name.
fn opened(mechanism: &Mechanism) -> Result<Mechanism, Error> {
    let mut points: Vec<Point> =
        mechanism.points.iter().filter(|p| p.unknown.is_empty()).cloned().collect();
    let Some(carried) = points.iter().find(|p| p.chain.is_some()).map(|p| p.name.clone()) else {
        return Err(Error::Missing {
            mechanism: mechanism.name.clone(),
            needs: "point on a chain",
            why: "there is nothing whose place could be told",
        });
    };
    let mut anchor = String::from("base");
    while points.iter().any(|p| p.name == anchor) {
        anchor.push('_');
    }
    points.push(Point { name: anchor.clone(), at: Some([0.0; 3]), ..Point::default() });
    let closure = Closure {
        name: anchor.clone(),
        kind: ClosureKind::Touch,
        between: [carried, anchor],
        value: None,
        noise: None,
        sd: None,
    };
    let platform = std::collections::BTreeMap::new();
    Ok(Mechanism { points, closures: vec![closure], platform, rest: None, ..mechanism.clone() })
}

/// True for a parameter that belongs to a closure.
fn closes(parameter: &Reported) -> bool {
    let id = parameter.term.split('@').next().unwrap_or_default();
    terms::find(id).is_ok_and(|term| term.info().per == Per::Closure)
}

/// A model of these readings, with the parameters that a result has of it.
fn under(
    mechanism: &Mechanism,
    applied: &Applied,
    table: Table,
) -> Result<(Model, Readings, Vec<f64>), Error> {
    let Applied { parameters, reference, sigma } = applied;
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
    Ok((model, readings, beta))
}

/// The inverse of [`crate::estimate::directions::reported`].
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
