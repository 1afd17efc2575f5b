//! The mechanism in its poses, with what the parameters leave open.

use nalgebra::Vector3;

use crate::estimate::{Fit, Observations};
use crate::model::Model;
use crate::report::evidence::points::{Row, of_chain, points};
use crate::report::evidence::shapes::{Drawing, Node};
use crate::report::evidence::uncertain::{Uncertain, principal};

/// Poses that are drawn.
const MOST_POSES: usize = 200;

/// The mechanism in its poses; none where no chain carries a point.
pub fn drawing(observations: &Observations, fit: &Fit) -> Option<Drawing> {
    let readings = &observations.readings;
    let (nodes, edges) = skeleton(&fit.model);
    if nodes.iter().all(|node| node.joint) {
        return None;
    }
    let stride = readings.blocks().len().div_ceil(MOST_POSES / 8 + 1).max(1);
    let at = |beta: &[f64]| points(&fit.model, readings, beta, &fit.assumed(), stride);
    let rows = at(&fit.beta);
    let place = |row: &Row| Vector3::from(row.place);
    let known = Uncertain::of(fit, |beta| at(beta).iter().map(place).collect());
    let live = |i: &usize| observations.weights[rows[*i].row] > 0.0;
    let kept: Vec<usize> = (0..rows.len()).filter(live).collect();
    let weakest = kept.iter().map(|&i| principal(&known.covariance(i)).into()).collect();
    let rows: Vec<&Row> = kept.iter().map(|&i| &rows[i]).collect();
    Some(Drawing {
        nodes,
        edges,
        poses: rows.iter().map(|row| readings.pose[row.row]).collect(),
        at: rows.iter().map(|row| row.nodes.iter().flatten().copied().collect()).collect(),
        places: rows.iter().map(|row| row.place).collect(),
        weakest,
    })
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
    let point = |name: &String| nodes.iter().position(|n| !n.joint && n.name == *name);
    let closures = mechanism.closures.iter();
    let joined = closures.filter_map(|c| Some([point(&c.between[0])?, point(&c.between[1])?]));
    edges.extend(joined.collect::<Vec<_>>());
    (nodes, edges)
}
