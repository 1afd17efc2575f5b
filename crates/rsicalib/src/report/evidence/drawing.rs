//! The mechanism in its poses, with what the parameters leave open.

use nalgebra::Vector3;

use crate::Error;
use crate::estimate::{Fit, Observations};
use crate::model::Model;
use crate::report::evidence::known::{place, positions};
use crate::report::evidence::points::{Row, of_chain, points};
use crate::report::evidence::shapes::{Drawing, KnownPlace, Node};
use crate::report::evidence::uncertain::{Uncertain, principal};
use crate::report::result::Known;

/// Poses that are drawn.
const MOST_POSES: usize = 200;

/// The mechanism in its poses; none where nothing is carried, and nothing moves between closures.
///
/// `before` is the fit without what was found; without one it is the mechanism as it is declared.
///
/// # Errors
///
/// As [`positions`].
pub fn drawing(
    observations: &Observations,
    fit: &Fit,
    before: Option<&Fit>,
    known: Option<&Known>,
) -> Result<Option<Drawing>, Error> {
    let readings = &observations.readings;
    let (nodes, edges) = skeleton(&fit.model);
    if nodes.iter().all(|node| node.joint) {
        return Ok(None);
    }
    let stride = stride(observations);
    let at = |beta: &[f64]| points(&fit.model, readings, beta, &fit.assumed(), stride);
    let rows = at(&fit.beta);
    let place = |row: &Row| Vector3::from(row.place);
    let uncertain = Uncertain::of(fit, |beta| at(beta).iter().map(place).collect());
    let live = |i: &usize| observations.weights[rows[*i].row] > 0.0;
    let kept: Vec<usize> = (0..rows.len()).filter(live).collect();
    let declared = fit.model.nominal();
    let (earlier, beta) = before.map_or((fit, &declared), |before| (before, &before.beta));
    let known = known_places(observations, fit, (earlier, beta), known)?;
    let weakest = kept.iter().map(|&i| principal(&uncertain.covariance(i)).into()).collect();
    let rows: Vec<&Row> = kept.iter().map(|&i| &rows[i]).collect();
    Ok(Some(Drawing {
        nodes,
        edges,
        poses: rows.iter().map(|row| readings.pose[row.row]).collect(),
        at: rows.iter().map(|row| row.nodes.iter().flatten().copied().collect()).collect(),
        places: rows.iter().map(|row| row.place).collect(),
        weakest,
        before: places(observations, earlier, beta),
        known,
    }))
}

/// Of so many blocks one is drawn.
fn stride(observations: &Observations) -> usize {
    observations.readings.blocks().len().div_ceil(MOST_POSES / 8 + 1).max(1)
}

/// `places` of a drawing with other parameters, or another model.
pub fn places(observations: &Observations, fit: &Fit, beta: &[f64]) -> Vec<[f64; 3]> {
    let readings = &observations.readings;
    let rows = points(&fit.model, readings, beta, &fit.assumed(), stride(observations));
    let live = rows.iter().filter(|row| observations.weights[row.row] > 0.0);
    live.map(|row| row.place).collect()
}

/// Known poses before and with a fit.
fn known_places(
    observations: &Observations,
    fit: &Fit,
    (earlier, beta): (&Fit, &[f64]),
    known: Option<&Known>,
) -> Result<Vec<KnownPlace>, Error> {
    let Some(known) = known else { return Ok(Vec::new()) };
    let after = positions(observations, fit, &fit.beta, known)?;
    let before = positions(observations, earlier, beta, known)?;
    let Some((after, before)) = after.zip(before) else { return Ok(Vec::new()) };
    let both = after.found.iter().zip(&before.found);
    let one = |(at, (after, before)): (&[f64; 6], (&[f64; 6], &[f64; 6]))| KnownPlace {
        at: place(at),
        before: place(before),
        after: place(after),
    };
    Ok(after.known.iter().zip(both).map(one).collect())
}

/// Joints and carried points, and the bodies and closures that join them.
fn skeleton(model: &Model) -> (Vec<Node>, Vec<[usize; 2]>) {
    let mechanism = &model.mechanism;
    let (mut nodes, mut edges) = (Vec::<Node>::new(), Vec::new());
    for (c, chain) in mechanism.chains.iter().enumerate() {
        let joints = chain.rows.iter().filter_map(|row| row.channel.clone());
        let first = nodes.len();
        for name in joints {
            if nodes.len() > first {
                edges.push([nodes.len() - 1, nodes.len()]);
            }
            nodes.push(Node { name, chain: chain.name.clone(), joint: true });
        }
        let last = nodes.len().checked_sub(1).filter(|last| *last >= first);
        for point in of_chain(model, c) {
            edges.extend(last.map(|last| [last, nodes.len()]));
            let name = mechanism.points[point].name.clone();
            nodes.push(Node { name, chain: chain.name.clone(), joint: false });
        }
    }
    let first = nodes.len();
    let ends = model.between_closures();
    nodes.extend(ends.iter().map(|end| {
        let (name, chain) = (end.name.clone(), end.name.clone());
        Node { name, chain: if end.measured { chain } else { String::new() }, joint: end.measured }
    }));
    let of =
        |closure: usize| (first..).zip(&ends).filter(move |(_, e)| e.closures.contains(&closure));
    let point = |name: &String| nodes.iter().position(|n| !n.joint && n.name == *name);
    for (number, closure) in mechanism.closures.iter().enumerate() {
        match of(number).map(|(node, _)| node).collect::<Vec<_>>()[..] {
            [one, other] => edges.push([one, other]),
            _ => edges.extend(
                point(&closure.between[0]).zip(point(&closure.between[1])).map(|(a, b)| [a, b]),
            ),
        }
    }
    (nodes, edges)
}
