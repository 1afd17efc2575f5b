//! What a sample that is left out touches in place of what its row names.

use crate::numerics::order::Ends;
use nalgebra::Vector3;

use crate::estimate::{Fit, Observations};
use crate::mechanism::Mechanism;
use crate::model::{Model, Thing, Want, Workspace};
use crate::readings::Readings;

/// A place is touched in place of another where it is nearer by this factor.
const NEARER: f64 = 20.0;

/// The keys of the place at which a carried point stands in a row, where that is by far not the one that the row names.
pub(super) fn touched_instead(
    observations: &Observations,
    fit: &Fit,
    row: usize,
) -> Option<String> {
    let Observations { mechanism, readings, .. } = observations;
    let model = Model::like(&fit.model, mechanism, readings).ok()?;
    if model.parameters != fit.beta.len() || model.pose_unknowns() > 0 {
        return None;
    }
    let points = points_of(&model, readings, &fit.beta, row)?;
    let closed = mechanism.closures.iter().filter(|closure| closure.kind.facts().is_vector);
    closed
        .flat_map(|closure| {
            let [one, other] = &closure.between;
            [(one, other), (other, one)]
        })
        .find_map(|(carried, touched)| {
            let number = |name: &String| mechanism.points.iter().position(|p| p.name == *name);
            let (carried, touched) = (number(carried)?, number(touched)?);
            mechanism.points[carried].chain.as_ref()?;
            let own = keys_of(mechanism, readings, touched, row)?;
            nearest(&model, &fit.beta, touched, &own, points[carried]?)
        })
}

/// Where points are in one row.
fn points_of(
    model: &Model,
    readings: &Readings,
    beta: &[f64],
    row: usize,
) -> Option<Vec<Option<Vector3<f64>>>> {
    let lane_in = |rows: &[usize]| rows.iter().position(|other| *other == row);
    let mut blocks = readings.blocks().iter().enumerate();
    let (block, lane) = blocks.find_map(|(block, meta)| {
        lane_in(&meta.rows[..meta.live.min(meta.rows.len())]).map(|lane| (block, lane))
    })?;
    let mut ws = Workspace::default();
    let want = Want { x: false, a: false };
    model.evaluate(readings, block, readings.raw(block), beta, want, &mut ws);
    let points = model.points(&ws, beta).into_iter();
    Some(points.map(|at| at.map(|at| Vector3::from(at.map(|v| v.0[lane])))).collect())
}

/// What a row names of a point whose places are told apart; none where nothing is.
fn keys_of(
    mechanism: &Mechanism,
    readings: &Readings,
    point: usize,
    row: usize,
) -> Option<Vec<String>> {
    let all = mechanism.key_columns();
    let own = mechanism.points[point].keys().iter().map(|name| {
        let column = all.iter().position(|column| column == name)?;
        Some(readings.table.keys.get(column)?.get(row)?.clone())
    });
    let own: Vec<String> = own.collect::<Option<_>>()?;
    (!own.is_empty()).then_some(own)
}

/// The keys of the place that is by far nearer than the own one.
fn nearest(
    model: &Model,
    beta: &[f64],
    point: usize,
    own: &[String],
    at: Vector3<f64>,
) -> Option<String> {
    let places = model.unknowns.iter().filter(|unknown| {
        matches!(unknown.thing, Thing::Point(p) if p == point) && unknown.width == 3
    });
    let off = |first: usize| {
        let first = model.term_parameters + first;
        (Vector3::from_column_slice(&beta[first..first + 3]) - at).norm()
    };
    let (named, others): (Vec<_>, Vec<_>) = places.partition(|unknown| unknown.keys == own);
    let named = off(named.first()?.first);
    let other = others.into_iter().least_by(|a| off(a.first))?;
    (NEARER * off(other.first) < named).then(|| other.keys.join(", "))
}
