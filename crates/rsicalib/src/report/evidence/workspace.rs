//! How well a fit places what is carried, all over where it can be.
//!
//! A platform whose workspace is declared is placed on a grid of two planes through it. Anything
//! else is drawn at random within the limits of its joints; a cell is the root mean square over all
//! that lies behind it. Nothing moves: each is a held pose.

use crate::numerics::order::Ends;
use nalgebra::Vector3;

use crate::Error;
use crate::design::plan::MARGIN;
use crate::design::reach::readings_at;
use crate::design::within_limits::within_limits;
use crate::estimate::directions::{parameter_names, reported};
use crate::estimate::{Fit, Observations};
use crate::mechanism::Mechanism;
use crate::model::{Model, Want, Workspace};
use crate::readings::{Readings, Table};
use crate::report::evidence::points::{has_platform, of_chain, points};
use crate::report::evidence::shapes::{ParameterName, Slice, Weakest};
use crate::report::evidence::uncertain::{Uncertain, principal};
use crate::terms::term::Role;

/// Cells along each side of a plane.
const CELLS: usize = 13;

/// Random configurations that are open, and that are closed.
const CONFIGURATIONS: usize = 1500;

/// Chains whose points are drawn, and those that are drawn from two sides.
const MOST_CHAINS: usize = 4;
const FROM_TWO_SIDES: usize = 2;

/// Seed of the random configurations.
const SEED: u64 = 11;

/// Extents below this part of the largest are those of a plane.
const FLAT: f64 = 1e-6;

const AXES: [&str; 3] = ["x", "y", "z"];

/// Pictures of a workspace, and the place in it that is known least.
pub type Pictures = (Vec<Slice>, Option<Weakest>);

/// How well a fit places what is carried; nothing where no chain carries a point.
///
/// # Errors
///
/// As [`readings_at`] and [`Readings::beside`].
pub fn workspace(observations: &Observations, fit: &Fit) -> Result<Pictures, Error> {
    let mechanism = &observations.mechanism;
    if (0..mechanism.chains.len()).all(|chain| of_chain(&fit.model, chain).next().is_none()) {
        return Ok((Vec::new(), None));
    }
    match mechanism.workspace.filter(|_| !mechanism.platform.is_empty()) {
        Some(declared) => planes(observations, fit, declared.bounds()),
        None => at_random(observations, fit),
    }
}

/// The mechanism with offsets and gains of a fit.
fn with_sensors(mechanism: &Mechanism, fit: &Fit) -> Mechanism {
    let (values, _) = reported(fit);
    let mut out = mechanism.clone();
    for (c, channel) in out.channels.iter_mut().enumerate() {
        let of = |role: Role, declared: f64| {
            fit.model.column(role, c).map_or(declared, |column| values[column])
        };
        channel.offset = of(Role::Offset, channel.offset);
        channel.gain = of(Role::Gain, channel.gain);
    }
    out
}

/// Two planes through the rest position of a platform, or through the middle of its workspace: from
/// above, and from the side.
fn planes(
    observations: &Observations,
    fit: &Fit,
    within: [[f64; 2]; 6],
) -> Result<Pictures, Error> {
    let mechanism = &observations.mechanism;
    let channels = with_sensors(mechanism, fit).channels;
    let (offsets, gains): (Vec<f64>, Vec<f64>) =
        channels.iter().map(|channel| (channel.offset, channel.gain)).unzip();
    let centre: [f64; 3] = match &mechanism.rest {
        Some(rest) => [rest.pose[0], rest.pose[1], rest.pose[2]],
        None => std::array::from_fn(|i| 0.5 * (within[i][0] + within[i][1])),
    };
    let (mut slices, mut weakest) = (Vec::new(), None);
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
        let pose = Some((1..=cells.len() as i64).collect());
        let table = Table { values: table, pose, ..Table::default() };
        let readings = Readings::beside(mechanism, table, &observations.readings)?;
        let model = Model::like(&fit.model, mechanism, &readings)?;
        let places = Places { of: None, points: platform(&model, &readings, fit, &fit.beta) };
        let known = Uncertain::of(fit, |beta| platform(&model, &readings, fit, beta));
        let sd = deviations(&known, &[0], places.points.len(), 1);
        slices.push(Slice {
            of: None,
            axes: [AXES[u].into(), AXES[v].into()],
            fixed: AXES[w].into(),
            value: Some(centre[w]),
            step,
            cells: cells.iter().zip(&sd).map(|([x, y], sd)| [*x, *y, *sd]).collect(),
        });
        worse(&mut weakest, places.least(observations, fit, &known, &[0], 1, &sd));
    }
    Ok((slices, weakest))
}

/// Where the platform is, row by row.
fn platform(model: &Model, readings: &Readings, fit: &Fit, beta: &[f64]) -> Vec<Vector3<f64>> {
    let mut rows = points(model, readings, beta, &fit.assumed(), 1);
    rows.sort_by_key(|row| row.row);
    rows.iter().map(|row| Vector3::from(row.place)).collect()
}

/// Random configurations, seen from above and from the side.
fn at_random(observations: &Observations, fit: &Fit) -> Result<Pictures, Error> {
    let mechanism = &observations.mechanism;
    let Ok(values) = within_limits(&with_sensors(mechanism, fit), CONFIGURATIONS, SEED) else {
        return Ok((Vec::new(), None)); // no loop that closes, or channels without bounds
    };
    let rows = values.len() / mechanism.channels.len();
    if rows == 0 {
        return Ok((Vec::new(), None));
    }
    // Where unknown points are is no part of where chains carry theirs: any will do.
    let key = |c: usize| observations.readings.groups.first().map(|g| vec![g[c].clone(); rows]);
    let table = Table {
        values,
        pose: Some((1..=rows as i64).collect()),
        keys: (0..mechanism.key_columns().len()).filter_map(key).collect(),
        columns: vec![vec![1.0; rows]; mechanism.value_columns().len()],
        ..Table::default()
    };
    let readings = Readings::beside(mechanism, table, &observations.readings)?;
    let model = Model::like(&fit.model, mechanism, &readings)?;
    if has_platform(&model) {
        let known = Uncertain::of(fit, |beta| platform(&model, &readings, fit, beta));
        let places = Places { of: None, points: platform(&model, &readings, fit, &fit.beta) };
        let sd = deviations(&known, &[0], rows, 1);
        let weakest = places.least(observations, fit, &known, &[0], 1, &sd);
        return Ok((places.sides(&sd, FROM_TWO_SIDES), weakest));
    }
    let mut own = model.nominal();
    own.truncate(model.parameters);
    let terms = model.term_parameters;
    let at = |beta: &[f64]| {
        let mut own = own.clone();
        own[..terms].copy_from_slice(&beta[..terms]);
        carried(&model, &readings, &own)
    };
    let (here, known) = (at(&fit.beta), Uncertain::of(fit, at));
    let drawn = apart(&model);
    let sides = if drawn.len() > FROM_TWO_SIDES { 1 } else { 2 };
    let all: usize = (0..mechanism.chains.len()).map(|c| of_chain(&model, c).count()).sum();
    let (mut slices, mut weakest) = (Vec::new(), None);
    for (chain, of_points) in drawn.into_iter().take(MOST_CHAINS) {
        let name = match of_chain(&model, chain).collect::<Vec<_>>()[..] {
            [only] => mechanism.points[only].name.clone(),
            _ => mechanism.chains[chain].name.clone(),
        };
        let mean = |row: usize| {
            let sum: Vector3<f64> = of_points.iter().map(|k| here[row * all + k]).sum();
            sum / of_points.len() as f64
        };
        let places = Places { of: Some(name), points: (0..rows).map(mean).collect() };
        let sd = deviations(&known, &of_points, rows, all);
        worse(&mut weakest, places.least(observations, fit, &known, &of_points, all, &sd));
        slices.extend(places.sides(&sd, sides));
    }
    Ok((slices, weakest))
}

/// Points that chains carry, row by row, chain by chain.
fn carried(model: &Model, readings: &Readings, beta: &[f64]) -> Vec<Vector3<f64>> {
    let chains = 0..model.mechanism.chains.len();
    let own: Vec<usize> = chains.flat_map(|c| of_chain(model, c)).collect();
    let mut out = vec![Vector3::zeros(); readings.samples * own.len()];
    let mut ws = Workspace::default();
    for (block, meta) in readings.blocks().iter().enumerate() {
        let want = Want { x: false, a: false };
        model.evaluate(readings, block, readings.raw(block), beta, want, &mut ws);
        let points = model.points(&ws, beta);
        for (k, at) in own.iter().enumerate().filter_map(|(k, &p)| Some((k, points[p]?))) {
            for (lane, &row) in meta.rows.iter().enumerate().take(meta.live) {
                out[row * own.len() + k] = Vector3::from(at.map(|v| v.0[lane]));
            }
        }
    }
    out
}

/// Chains with the numbers of their points among all carried ones, without those whose points
/// all touch one of an earlier chain.
fn apart(model: &Model) -> Vec<(usize, Vec<usize>)> {
    let mechanism = &model.mechanism;
    let (mut found, mut earlier, mut first) = (Vec::new(), Vec::<&String>::new(), 0);
    for chain in 0..mechanism.chains.len() {
        let names: Vec<&String> =
            of_chain(model, chain).map(|p| &mechanism.points[p].name).collect();
        let touches = |name: &&String| {
            let touching = mechanism.closures.iter().filter(|c| c.kind.facts().is_vector);
            let [a, b] = [0, 1].map(|end| touching.clone().map(move |c| &c.between[end]));
            a.clone()
                .zip(b.clone())
                .chain(b.zip(a))
                .any(|(a, b)| a == *name && earlier.contains(&b))
        };
        if !names.iter().all(touches) {
            found.push((chain, (first..first + names.len()).collect()));
        }
        first += names.len();
        earlier.extend(names);
    }
    found
}

/// Standard deviation of a coordinate of some points, row by row: root mean square over points,
/// x, y and z.
fn deviations(known: &Uncertain, points: &[usize], rows: usize, all: usize) -> Vec<f64> {
    let of = |row: usize| {
        let traces = points.iter().map(|k| known.covariance(row * all + k).trace());
        (traces.sum::<f64>() / (3 * points.len()) as f64).max(0.0).sqrt()
    };
    (0..rows).map(of).collect()
}

/// Where something is, row by row.
struct Places {
    of: Option<String>,
    points: Vec<Vector3<f64>>,
}

impl Places {
    /// Cells of planes that are looked at from above and from the side.
    fn sides(&self, sd: &[f64], most: usize) -> Vec<Slice> {
        let column = |i: usize| self.points.iter().map(move |p| p[i]);
        let bounds: [[f64; 2]; 3] = std::array::from_fn(|i| {
            column(i).fold([f64::MAX, f64::MIN], |[l, h], v| [l.min(v), h.max(v)])
        });
        let extents = bounds.map(|[low, high]| high - low);
        let largest = extents.iter().copied().fold(0.0, f64::max);
        let flat = (0..3).rev().find(|&i| extents[i] <= FLAT * largest);
        let planes = match flat {
            Some(0) => vec![[1, 2]],
            Some(1) => vec![[0, 2]],
            Some(_) => vec![[0, 1]],
            None => vec![[0, 1], [0, 2]],
        };
        let slice = |&[u, v]: &[usize; 2]| {
            let w = 3 - u - v;
            let step = [u, v].map(|i| extents[i].max(0.1 * largest) / CELLS as f64);
            let mut sums = vec![(0.0, 0_u32); CELLS * CELLS];
            for (place, sd) in self.points.iter().zip(sd) {
                let [i, j] = [(u, step[0]), (v, step[1])].map(|(axis, step)| {
                    (((place[axis] - bounds[axis][0]) / step) as usize).min(CELLS - 1)
                });
                let cell = &mut sums[i * CELLS + j];
                *cell = (cell.0 + sd * sd, cell.1 + 1);
            }
            let middle =
                |k: usize, axis: usize, step: f64| bounds[axis][0] + step * (k as f64 + 0.5);
            let cell = |(k, (sum, count)): (usize, &(f64, u32))| {
                let sd = (sum / f64::from(*count)).sqrt();
                [middle(k / CELLS, u, step[0]), middle(k % CELLS, v, step[1]), sd]
            };
            Slice {
                of: self.of.clone(),
                axes: [AXES[u].into(), AXES[v].into()],
                fixed: AXES[w].into(),
                value: (flat == Some(w)).then_some(0.5 * (bounds[w][0] + bounds[w][1])),
                step,
                cells: sums.iter().enumerate().filter(|c| c.1.1 > 0).map(cell).collect(),
            }
        };
        if largest > 0.0 { planes.iter().take(most).map(slice).collect() } else { Vec::new() }
    }

    /// The row that is known least.
    fn least(
        &self,
        observations: &Observations,
        fit: &Fit,
        known: &Uncertain,
        points: &[usize],
        all: usize,
        sd: &[f64],
    ) -> Option<Weakest> {
        let finite = (0..sd.len()).filter(|&row| sd[row].is_finite() && sd[row] > 0.0);
        let row = finite.greatest_by(|&a| sd[a])?;
        let of = |k: &usize| principal(&known.covariance(row * all + k));
        let each = points.iter().map(|k| (row * all + k, of(k)));
        let (point, along) = each.greatest_by(|(_, along)| along.norm())?;
        let (parameter, correlation) = known.goes_with(point, &along.normalize())?;
        let name = parameter_names(observations, fit).into_iter().nth(parameter)?;
        Some(Weakest {
            of: self.of.clone(),
            place: self.points[row].into(),
            sd: sd[row],
            along: along.into(),
            parameter: ParameterName::from(name),
            correlation: correlation.abs(),
        })
    }
}

/// Keeps the place that is known less.
fn worse(least: &mut Option<Weakest>, other: Option<Weakest>) {
    let sd = |of: &Option<Weakest>| of.as_ref().map_or(0.0, |found| found.sd);
    if sd(&other) > sd(least) {
        *least = other;
    }
}
