//! How the platform moves with the parameters: means of products of derivatives.

use faer::Mat;

use crate::Error;
use crate::apply::poses::{poses_of, short_way};
use crate::design::candidates::Candidates;
use crate::design::linearised::Linearised;
use crate::estimate::Fit;
use crate::model::{Instance, Model, Want, Workspace};
use crate::numerics::workers;
use crate::readings::Readings;

/// Means over poses and components of products of the derivatives of the platform by parameters:
/// `eᵀ M e` is the mean square of what a small change `e` of the parameters does to a component.
#[derive(Debug, Clone)]
pub(crate) struct Moments {
    /// Of x, y, z.
    pub(crate) position: Mat<f64>,
    /// Of rx, ry, rz.
    pub(crate) orientation: Mat<f64>,
}

/// Derivatives of poses by one parameter, pose by pose.
type PoseSlopes = Vec<[f64; 6]>;

/// Derivatives of the poses that `place` gives for parameters `beta`, by some of these, by
/// differences of these steps: parameter by parameter.
fn slopes_of(
    beta: &[f64],
    some: &[(usize, f64)],
    place: impl Fn(&[f64]) -> Vec<[f64; 6]> + Sync,
) -> Vec<PoseSlopes> {
    let slope_of = |&(own, step): &(usize, f64)| -> PoseSlopes {
        let moved = |sign: f64| {
            let mut there = beta.to_vec();
            there[own] += sign * step;
            place(&there)
        };
        let slope = |(a, b): (&[f64; 6], &[f64; 6])| -> [f64; 6] {
            std::array::from_fn(|i| {
                let d = if i < 3 { a[i] - b[i] } else { short_way(a[i] - b[i]) };
                d / (2.0 * step)
            })
        };
        let (up, down) = (moved(1.0), moved(-1.0));
        up.iter().zip(&down).map(slope).collect()
    };
    workers::map(some, slope_of)
}

/// Moments by derivatives of so many parameters; those that are not among `columns` do not act.
fn moments_of(slopes: &[PoseSlopes], columns: &[usize], n: usize) -> Moments {
    let rows = slopes.first().map_or(0, Vec::len);
    let share = 1.0 / (3 * rows).max(1) as f64;
    let product = |first: usize| {
        let mut j = Mat::<f64>::zeros(3 * rows, n);
        for (slope, &column) in slopes.iter().zip(columns) {
            for (r, d) in slope.iter().enumerate() {
                (0..3).for_each(|i| j[(3 * r + i, column)] = d[first + i]);
            }
        }
        (j.transpose() * &j) * share
    };
    Moments { position: product(0), orientation: product(3) }
}

/// Mean products of the derivatives of the platform, or of the carried points without one, by all
/// parameters, over some poses; `told` is the information of the session.
pub(crate) fn moments(
    at: &Linearised<'_>,
    told: &Mat<f64>,
    judged: &Candidates,
) -> Result<Moments, Error> {
    let all: Vec<usize> = (0..at.model.parameters).collect();
    let (columns, slopes) = slopes(at, &all, &steps_of(told), judged)?;
    Ok(moments_of(&slopes, &columns, at.model.parameters))
}

/// The same for a model of many absent effects, each in a small model of its own: what one does
/// does not depend on the others while they are absent.
pub(crate) fn moments_of_absent(
    at: &Linearised<'_>,
    told: &Mat<f64>,
    (best, named): (&Fit, &[Instance]),
    judged: &Candidates,
) -> Result<Moments, Error> {
    let steps = steps_of(told);
    let one = |effect: &[Instance]| {
        let small = Linearised::new(at.session, best, effect, &[])?;
        let columns = at.columns_of(&small.model);
        let own = columns.iter().map(|&c| steps[c]).collect::<Vec<_>>();
        let own_terms = best.model.term_parameters..small.model.term_parameters;
        let some: Vec<usize> = match effect.is_empty() {
            true => (0..columns.len()).collect(),
            false => own_terms.collect(),
        };
        let (found, slopes) = slopes(&small, &some, &own, judged)?;
        Ok((found.iter().map(|&k| columns[k]).collect::<Vec<_>>(), slopes))
    };
    let effects = named.iter().map(std::slice::from_ref).chain([&[][..]]);
    let found: Vec<_> = workers::map(effects, one).into_iter().collect::<Result<_, Error>>()?;
    let (columns, slopes): (Vec<_>, Vec<_>) = found.into_iter().unzip();
    Ok(moments_of(&slopes.concat(), &columns.concat(), at.model.parameters))
}

/// Steps that the session would hardly notice: linear, and far above rounding.
fn steps_of(told: &Mat<f64>) -> Vec<f64> {
    let step = |column: usize| {
        let size = told[(column, column)].max(0.0).sqrt();
        if size > 0.0 { 1.0 / size } else { 1e-6 }
    };
    (0..told.nrows()).map(step).collect()
}

/// Derivatives by some parameters of a model, of those that act on these poses: their numbers, and
/// the derivatives over the poses.
fn slopes(
    at: &Linearised<'_>,
    some: &[usize],
    steps: &[f64],
    judged: &Candidates,
) -> Result<(Vec<usize>, Vec<PoseSlopes>), Error> {
    let readings = at.readings(&judged.table)?;
    let (model, columns) = at.under(&at.session.mechanism, &readings)?;
    let beta = at.beta_of(&columns);
    let platform = !judged.poses.is_empty();
    let place = |beta: &[f64]| -> Vec<[f64; 6]> {
        match platform {
            true => poses_of(&model, &readings, beta, &at.noise),
            false => carried(&model, &readings, beta),
        }
    };
    let acting = (0..columns.len()).filter(|&own| some.contains(&columns[own]));
    let acting: Vec<(usize, f64)> = acting.map(|own| (own, steps[columns[own]])).collect();
    let found = acting.iter().map(|&(own, _)| columns[own]).collect();
    Ok((found, slopes_of(&beta, &acting, place)))
}

/// Places of the first carried point that a closure holds, row by row.
fn carried(model: &Model, readings: &Readings, beta: &[f64]) -> Vec<[f64; 6]> {
    let mut out = vec![[0.0; 6]; readings.samples];
    let mut ws = Workspace::default();
    let points = &model.mechanism.points;
    let tip = (0..points.len()).find(|&p| points[p].chain.is_some());
    for (block, meta) in readings.blocks().iter().enumerate() {
        let want = Want { x: false, a: false };
        model.evaluate(readings, block, readings.raw(block), beta, want, &mut ws);
        let Some(at) = tip.and_then(|p| model.points(&ws, beta)[p]) else { continue };
        for (lane, &row) in meta.rows.iter().enumerate().take(meta.live) {
            (0..3).for_each(|i| out[row][i] = at[i].0[lane]);
        }
    }
    out
}
