//! Directions that no reading could ever show, taken out of what a session seems to tell.
//!
//! A turn of an arm about its first axis, together with all that it touches, does nothing where
//! the loops are closed, and something where noise has opened them: a fit tells it by that alone.

use faer::{Mat, Side};

use crate::Error;
use crate::estimate::observations::Observations;
use crate::mechanism::Point;
use crate::model::configurations::Configurations;
use crate::model::{Model, Prior, Thing};
use crate::numerics::random::Random;
use crate::numerics::rank::{Spaces, eliminated, scaled, unit};
use crate::numerics::symmetric::invert;
use crate::readings::Readings;
use crate::terms::term::{Needs, Placed};

/// Relative eigenvalues below this are small: what no reading could show is told by misclosures that
/// are not zero, as the part that they are of the machine, squared.
const HARDLY: f64 = 1e-4;

/// The most that misclosures, a thousandth of the machine at the most, tell of a convention.
const OPENED: f64 = 1e-6;

/// The Gram matrix of a session at these parameters without what it seems to tell of directions
/// that no reading could show: they do nothing where the loops are closed, and something where noise
/// has opened them.
pub(crate) fn without_conventions(
    observations: &Observations,
    model: &Model,
    priors: &[Prior],
    beta: &[f64],
    gram: Mat<f64>,
) -> Mat<f64> {
    let n = gram.nrows();
    let norms: Vec<f64> = (0..n).map(|i| gram[(i, i)].max(0.0).sqrt()).collect();
    let by: Vec<f64> =
        norms.iter().map(|v| if *v > 0.0 && v.is_finite() { v.recip() } else { 0.0 }).collect();
    let one = Mat::from_fn(n, n, |i, j| gram[(i, j)] * by[i] * by[j]);
    let weak = |values: &[f64]| values.first() < values.last().map(|v| HARDLY * v).as_ref();
    let told = one.self_adjoint_eigenvalues(Side::Lower).is_ok_and(|values| !weak(&values));
    // A rest pose, or a drawing with a standard deviation, may tell what readings cannot.
    let held = priors.iter().any(|prior| matches!(prior, Prior::Parameter { .. }));
    // A point in each pose has one row: rows of it that close would all be the same.
    let points = model.unknowns.iter().all(|u| matches!(u.thing, Thing::Point(_)));
    let placed = points && !observations.mechanism.points.iter().any(Point::moves);
    if told || held || !placed || observations.held.is_some() {
        return gram;
    }
    let Ok(Some(device)) = conventions(observations, model, beta) else { return gram };
    let terms = model.term_parameters;
    // The places of unknown points follow the device.
    let places = Mat::from_fn(n - terms, n - terms, |i, j| gram[(terms + i, terms + j)]);
    let cross = Mat::from_fn(n - terms, terms, |i, j| gram[(terms + i, j)]);
    let follow = invert(&places).0 * (cross * &device);
    let mut basis: Vec<Vec<f64>> = Vec::new();
    for k in 0..device.ncols() {
        let own = |i: usize| if i < terms { device[(i, k)] } else { -follow[(i - terms, k)] };
        let mut column: Vec<f64> = (0..n).map(|i| own(i) * norms[i]).collect();
        for other in &basis {
            let along: f64 = column.iter().zip(other).map(|(a, b)| a * b).sum();
            column.iter_mut().zip(other).for_each(|(a, b)| *a -= along * b);
        }
        let length = column.iter().map(|v| v * v).sum::<f64>().sqrt();
        column.iter_mut().for_each(|v| *v /= length);
        let told = |i: usize| (0..n).map(|j| one[(i, j)] * column[j]).sum::<f64>() * column[i];
        // What the data do tell is no convention, whatever random configurations say.
        if length > 0.0 && (0..n).map(told).sum::<f64>() < OPENED {
            basis.push(column);
        }
    }
    let left = Mat::from_fn(n, n, |i, j| {
        f64::from(u8::from(i == j)) - basis.iter().map(|b| b[i] * b[j]).sum::<f64>()
    });
    let one = &left * one * &left;
    Mat::from_fn(n, n, |i, j| 0.5 * (one[(i, j)] + one[(j, i)]) * norms[i] * norms[j])
}

/// Combinations of the parameters of a device that no reading could show, as columns: none of them
/// changes closed loops at unknown points wherever these are.
fn conventions(
    observations: &Observations,
    model: &Model,
    beta: &[f64],
) -> Result<Option<Mat<f64>>, Error> {
    let mut random = Random::new(0);
    let elsewhere = Configurations::new(&observations.mechanism, &mut random)?;
    let terms = model.term_parameters;
    let foreign = foreign(model);
    let own: Vec<usize> = (0..terms).filter(|i| !foreign.contains(i)).collect();
    let each = 6 + (3 * own.len()).div_ceil(2 * elsewhere.combinations());
    let under = |readings: &Readings| {
        let model = Model::like(model, elsewhere.mechanism(), readings)?;
        let mut at = elsewhere.nominal(&model);
        at[..terms].copy_from_slice(&beta[..terms]);
        Ok((model, at))
    };
    let readings = elsewhere.closed_by(each, &mut random, &under)?;
    let (there, at) = under(&readings)?;
    let x = elsewhere.slopes(&there, &readings, &at);
    let device = Mat::from_fn(x.nrows(), own.len(), |i, j| x[(i, own[j])]);
    let unknown = x.subcols(terms, x.ncols() - terms).to_owned();
    let by = unit(&device);
    let Some(seen) = eliminated(scaled(&device, &by), &unknown) else { return Ok(None) };
    let Some(spaces) = Spaces::of(&seen) else { return Ok(None) };
    let null = &spaces.null;
    let mut found = Mat::zeros(terms, null.ncols());
    for k in 0..null.ncols() {
        for (j, &column) in own.iter().enumerate() {
            found[(column, k)] = null[(j, k)] * if by[j] > 0.0 { by[j] } else { 1.0 };
        }
    }
    Ok(Some(found))
}

/// Parameters of what acts in some poses only, or by more than readings.
pub(crate) fn foreign(model: &Model) -> Vec<usize> {
    let own = |term: &dyn crate::terms::term::Term| {
        matches!(term.info().needs, Needs::Nothing | Needs::Gravity | Needs::Masses)
            && term.placed() == Placed::Once
    };
    let instances = model.instances.iter().zip(&model.first).filter(|(i, _)| !own(i.term));
    instances.flat_map(|(i, &first)| first..first + i.width()).collect()
}
