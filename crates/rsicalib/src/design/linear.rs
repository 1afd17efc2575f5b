//! A model made linear about the mechanism as it is drawn: what readings could tell.
//!
//! ```text
//! f(a + δa, β) = f + A δa + X β                                      (12, 44)
//! ```
//!
//! Nothing is fitted and no noise is assumed, so this can be asked before a
//! single reading is taken.

use crate::Error;
use crate::mechanism::Mechanism;
use crate::model::{Model, Prior, UNKNOWN_POINT, Want, Workspace, parse};
use crate::readings::{Readings, Table};

/// Misclosure and its derivatives, all samples one after the other.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Linear {
    /// Scalar equations of one sample.
    pub equations: usize,
    /// `f`, sample by sample.
    pub f: Vec<f64>,
    /// `A`, equation by equation, one per channel.
    pub a: Vec<f64>,
    /// `X`, equation by equation, one per parameter.
    pub x: Vec<f64>,
    /// How far known distances between unknown points are off, in length units.
    pub links: Vec<f64>,
    /// Their derivatives by the parameters.
    pub apart: Vec<f64>,
    /// Term, target and name of each parameter.
    pub parameters: Vec<(String, String, String)>,
    /// Where the unknown points are, three numbers each.
    pub unknown: Vec<f64>,
}

/// Makes the model of `terms` linear about the mechanism as it is drawn.
///
/// Unknown points are where `unknown` has them, three numbers each in the order
/// of the parameters, or else where the chains touch them.
///
/// # Errors
///
/// As [`Model::new`] and [`parse`]; [`Error::Shape`] for unknown points of another number.
pub fn linearize(
    mechanism: &Mechanism,
    table: Table,
    terms: &[String],
    unknown: Option<&[f64]>,
) -> Result<Linear, Error> {
    let readings = Readings::new(mechanism, table)?;
    let model = Model::new(mechanism, &readings, parse(mechanism, &readings, terms)?)?;
    let mut beta = model.nominal();
    match unknown {
        None => model.place_unknowns(&readings, &mut beta),
        Some(places) if places.len() == beta.len() - model.term_parameters => {
            beta[model.term_parameters..].copy_from_slice(places);
        }
        Some(places) => {
            let expected = beta.len() - model.term_parameters;
            return Err(Error::Shape { what: "unknown".into(), found: places.len(), expected });
        }
    }
    let (equations, channels, n) = (model.equations(), readings.channels, model.parameters);
    let rows = readings.samples * equations;
    let mut out = Linear {
        equations,
        f: vec![0.0; rows],
        a: vec![0.0; rows * channels],
        x: vec![0.0; rows * n],
        unknown: beta[model.term_parameters..].to_vec(),
        parameters: names(&model),
        ..Linear::default()
    };
    let mut ws = Workspace::default();
    for (block, meta) in readings.blocks().iter().enumerate() {
        let want = Want { x: true, a: true };
        model.evaluate(&readings, block, readings.raw(block), &beta, want, &mut ws);
        for (lane, &row) in meta.rows.iter().enumerate().take(meta.live) {
            let first = row * equations;
            for k in 0..equations {
                out.f[first + k] = ws.f[k].0[lane];
            }
            for k in 0..equations * channels {
                out.a[first * channels + k] = ws.a[k].0[lane];
            }
            for k in 0..equations {
                let x = &ws.x[k * model.width()..];
                for (column, value) in model.columns()[meta.group].iter().zip(x) {
                    out.x[(first + k) * n + column] = value.0[lane];
                }
            }
        }
    }
    for link in model.links() {
        let Prior::Apart { sd, .. } = link else { continue };
        out.links.push(link.off(&beta) * sd);
        let start = out.apart.len();
        out.apart.resize(start + n, 0.0);
        for (column, slope) in link.slopes(&beta) {
            out.apart[start + column] += slope * sd;
        }
    }
    Ok(out)
}

fn names(model: &Model) -> Vec<(String, String, String)> {
    let of_terms = model.instances.iter().flat_map(|i| {
        let target = i.target.name(&model.mechanism);
        i.term
            .info()
            .parameters
            .iter()
            .map(move |p| (i.term.info().id.to_string(), target.clone(), p.name.to_string()))
    });
    let of_points = model.unknown_names.iter().flat_map(|point| {
        ["x", "y", "z"].map(|axis| (UNKNOWN_POINT.to_string(), point.clone(), axis.to_string()))
    });
    of_terms.chain(of_points).collect()
}
