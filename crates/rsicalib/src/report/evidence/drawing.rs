//! The mechanism in its poses, and the workspace, with what the parameters leave open.

use nalgebra::{Matrix3, SymmetricEigen, Vector3};

use crate::Error;
use crate::design::plan::MARGIN;
use crate::design::reach::readings_at;
use crate::estimate::directions::reported;
use crate::estimate::{Fit, Observations};
use crate::model::Model;
use crate::readings::{Readings, Table};
use crate::report::evidence::points::{Row, of_chain, points};
use crate::report::evidence::shapes::{Drawing, Node, Slice};
use crate::terms::term::Role;

/// Poses that are drawn.
const MOST_POSES: usize = 200;

/// Cells along each side of a slice.
const CELLS: usize = 13;

/// The mechanism in its poses; none where no chain carries a point.
pub fn drawing(observations: &Observations, fit: &Fit) -> Option<Drawing> {
    let readings = &observations.readings;
    let (nodes, edges) = skeleton(&fit.model);
    if nodes.iter().all(|node| node.joint) {
        return None;
    }
    let stride = readings.blocks().len().div_ceil(MOST_POSES / 8 + 1).max(1);
    let (mut rows, spread) = uncertain(&fit.model, readings, fit, stride);
    let live = |row: &Row| observations.weights[row.row] > 0.0;
    let kept: Vec<usize> = (0..rows.len()).filter(|&i| live(&rows[i])).collect();
    let weakest = kept.iter().map(|&i| principal(&spread[i])).collect();
    let rows: Vec<Row> = {
        let mut keep = rows.iter().map(live).collect::<Vec<_>>().into_iter();
        rows.retain(|_| keep.next().unwrap_or(false));
        rows
    };
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

/// Nodes of readings, and the covariance of each place that the parameters leave open, to first
/// order by differences of one standard deviation.
fn uncertain(
    model: &Model,
    readings: &Readings,
    fit: &Fit,
    stride: usize,
) -> (Vec<Row>, Vec<Matrix3<f64>>) {
    let noise = fit.assumed();
    let rows = points(model, readings, &fit.beta, &noise, stride);
    let n = model.term_parameters;
    let sd: Vec<f64> = (0..n).map(|i| fit.covariance[(i, i)].max(0.0).sqrt()).collect();
    let moved = |i: usize| -> Vec<Vector3<f64>> {
        let mut beta = fit.beta.clone();
        beta[i] += sd[i];
        let there = points(model, readings, &beta, &noise, stride);
        let pairs = there.iter().zip(&rows);
        pairs.map(|(a, b)| Vector3::from(a.place) - Vector3::from(b.place)).collect()
    };
    let moves: Vec<Vec<Vector3<f64>>> = (0..n).map(moved).collect();
    let mut spread = vec![Matrix3::zeros(); rows.len()];
    for i in 0..n {
        for j in 0..n {
            let correlation = fit.covariance[(i, j)] / (sd[i] * sd[j]).max(f64::MIN_POSITIVE);
            for (sum, (a, b)) in spread.iter_mut().zip(moves[i].iter().zip(&moves[j])) {
                *sum += a * b.transpose() * correlation;
            }
        }
    }
    (rows, spread)
}

/// Longest axis of a covariance, one standard deviation long.
fn principal(covariance: &Matrix3<f64>) -> [f64; 3] {
    if covariance.iter().any(|v| !v.is_finite()) {
        return [0.0; 3];
    }
    let eigen = SymmetricEigen::new(*covariance);
    let longest = eigen.eigenvalues.imax();
    let axis = eigen.eigenvectors.column(longest) * eigen.eigenvalues[longest].max(0.0).sqrt();
    [axis.x, axis.y, axis.z]
}

/// Two slices of a workspace that comes with the mechanism, through its rest position or its
/// middle: from above, and from the side.
///
/// # Errors
///
/// As [`readings_at`] and [`Readings::beside`].
pub fn workspace(observations: &Observations, fit: &Fit) -> Result<Vec<Slice>, Error> {
    let mechanism = &observations.mechanism;
    let Some(within) = mechanism.workspace.map(|w| w.bounds()) else { return Ok(Vec::new()) };
    let (values, _) = reported(fit);
    let of = |role: Role, c: usize, declared: f64| {
        fit.model.column(role, c).map_or(declared, |column| values[column])
    };
    let channels = mechanism.channels.iter().enumerate();
    let (offsets, gains): (Vec<f64>, Vec<f64>) = channels
        .map(|(c, channel)| (of(Role::Offset, c, channel.offset), of(Role::Gain, c, channel.gain)))
        .unzip();
    let centre: [f64; 3] = match &mechanism.rest {
        Some(rest) => [rest.pose[0], rest.pose[1], rest.pose[2]],
        None => std::array::from_fn(|i| 0.5 * (within[i][0] + within[i][1])),
    };
    let mut slices = Vec::new();
    for [u, v] in [[0, 1], [0, 2]] {
        let w = 3 - u - v;
        let step = [u, v].map(|i| (within[i][1] - within[i][0]) / (CELLS - 1) as f64);
        let (mut cells, mut table) = (Vec::new(), Vec::new());
        for cell in 0..CELLS * CELLS {
            let mut pose = [0.0; 6];
            pose[u] = within[u][0] + step[0] * (cell / CELLS) as f64;
            pose[v] = within[v][0] + step[1] * (cell % CELLS) as f64;
            pose[w] = centre[w];
            if let Some(row) = readings_at(mechanism, &pose, &offsets, &gains, MARGIN)? {
                cells.push([pose[u], pose[v]]);
                table.extend(row);
            }
        }
        if cells.is_empty() {
            continue;
        }
        let table = Table { values: table, ..Table::default() };
        let readings = Readings::beside(mechanism, table, &observations.readings)?;
        let model = Model::like(&fit.model, mechanism, &readings)?;
        let (rows, spread) = uncertain(&model, &readings, fit, 1);
        let sd = rows.iter().zip(&spread).map(|(row, s)| (row.row, (s.trace() / 3.0).sqrt()));
        let names = ["x", "y", "z"];
        slices.push(Slice {
            axes: [names[u].into(), names[v].into()],
            fixed: names[w].into(),
            value: centre[w],
            step,
            cells: sd.map(|(row, sd)| [cells[row][0], cells[row][1], sd]).collect(),
        });
    }
    Ok(slices)
}
