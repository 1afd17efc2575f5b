//! Platform poses under a fit, and their error against known ones.

use nalgebra::{Rotation3, Vector3};

use crate::Error;
use crate::fit::Fit;
use crate::lanes::Vec3;
use crate::model::{Model, Want, Workspace};
use crate::objective::{Implicit, Noise, Part};
use crate::platform::rigid_fit;
use crate::readings::{Readings, Table};
use crate::session::Session;

/// Error of the platform pose: root mean square over components, as in Table VI.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Check {
    /// Poses compared.
    pub poses: usize,
    /// Of the position, length units.
    pub position_rms: f64,
    /// Of roll, pitch and yaw, rad.
    pub orientation_rms: f64,
}

/// One row for each pose: the mean of its samples.
#[must_use]
pub fn average(table: &Table, channels: usize) -> (Table, Vec<Vec<usize>>) {
    let rows = table.values.len() / channels;
    let mut poses: Vec<Vec<usize>> = Vec::new();
    match &table.pose {
        None => poses.extend((0..rows).map(|r| vec![r])),
        Some(labels) => {
            let mut last = None;
            for (row, label) in labels.iter().enumerate() {
                match poses.last_mut() {
                    Some(pose) if last == Some(label) => pose.push(row),
                    _ => poses.push(vec![row]),
                }
                last = Some(label);
            }
        }
    }
    let mean = |f: &dyn Fn(usize) -> f64, pose: &[usize]| {
        pose.iter().map(|&r| f(r)).sum::<f64>() / pose.len() as f64
    };
    let column = |values: &Option<Vec<f64>>| {
        values.as_ref().map(|v| poses.iter().map(|p| mean(&|r| v[r], p)).collect::<Vec<f64>>())
    };
    let first = |p: &Vec<usize>| p[0];
    let averaged = Table {
        values: poses
            .iter()
            .flat_map(|p| (0..channels).map(move |c| (p, c)))
            .map(|(p, c)| mean(&|r| table.values[r * channels + c], p))
            .collect(),
        pose: table.pose.as_ref().map(|labels| poses.iter().map(|p| labels[p[0]]).collect()),
        time: column(&table.time),
        temperature: column(&table.temperature),
        session: table.session.as_ref().map(|s| poses.iter().map(|p| s[p[0]]).collect()),
        keys: table
            .keys
            .iter()
            .map(|k| poses.iter().map(|p| k[first(p)].clone()).collect())
            .collect(),
        columns: table
            .columns
            .iter()
            .map(|v| poses.iter().map(|p| mean(&|r| v[r], p)).collect())
            .collect(),
    };
    (averaged, poses)
}

/// Platform pose of every row of a table, under parameters of a fit.
///
/// Each reading is first moved onto the closures, as far as its noise allows;
/// the platform is then the rigid fit to its points.
///
/// # Errors
///
/// [`Error::Missing`] without a platform, else as [`Readings::new`].
pub fn platform_poses(
    session: &Session,
    fit: &Fit,
    beta: &[f64],
    table: Table,
) -> Result<Vec<[f64; 6]>, Error> {
    let mechanism = &session.mechanism;
    if mechanism.platform.is_empty() {
        return Err(Error::Missing {
            mechanism: mechanism.name.clone(),
            needs: "platform",
            why: "poses need the points that carry it",
        });
    }
    let readings = Readings::beside(mechanism, table, &session.readings)?;
    let model = Model::like(&fit.model, mechanism, &readings)?;
    Ok(poses_of(&model, &readings, beta, &fit.noise.sigma, fit.noise.play))
}

/// Poses, and the standard deviations of their components.
pub type PosesAndSd = (Vec<[f64; 6]>, Vec<[f64; 6]>);

/// Platform pose of every row with its standard deviations: from the parameters
/// and from the noise of one reading, to first order by differences.
///
/// # Errors
///
/// As [`platform_poses`].
pub fn poses_with_sd(session: &Session, fit: &Fit, table: Table) -> Result<PosesAndSd, Error> {
    let at = |beta: &[f64], table: Table| platform_poses(session, fit, beta, table);
    let poses = at(&fit.beta, table.clone())?;
    let n = fit.beta.len();
    // How each pose moves with each parameter, per standard deviation of it.
    let mut moves: Vec<Vec<[f64; 6]>> = Vec::with_capacity(n);
    let sd: Vec<f64> = (0..n).map(|i| fit.covariance[(i, i)].max(0.0).sqrt()).collect();
    for i in 0..n {
        let mut beta = fit.beta.clone();
        beta[i] += sd[i];
        moves.push(apart(&at(&beta, table.clone())?, &poses));
    }
    let mut variance = vec![[0.0; 6]; poses.len()];
    for i in 0..n {
        for j in 0..n {
            let correlation = fit.covariance[(i, j)] / (sd[i] * sd[j]).max(f64::MIN_POSITIVE);
            for (sum, (a, b)) in variance.iter_mut().zip(moves[i].iter().zip(&moves[j])) {
                (0..6).for_each(|k| sum[k] += a[k] * b[k] * correlation);
            }
        }
    }
    let channels = session.mechanism.channels.len();
    for (c, sigma) in fit.noise.sigma.iter().enumerate() {
        let mut moved = table.clone();
        let [_, high] = session.mechanism.channels[c].range.unwrap_or([0.0, f64::INFINITY]);
        for value in moved.values.iter_mut().skip(c).step_by(channels) {
            *value += if *value + sigma > high { -sigma } else { *sigma };
        }
        for (sum, a) in variance.iter_mut().zip(apart(&at(&fit.beta, moved)?, &poses)) {
            (0..6).for_each(|k| sum[k] += a[k] * a[k]);
        }
    }
    let deviations = variance.into_iter().map(|v| v.map(|v: f64| v.max(0.0).sqrt())).collect();
    Ok((poses, deviations))
}

/// Differences of poses, angles the short way round.
fn apart(a: &[[f64; 6]], b: &[[f64; 6]]) -> Vec<[f64; 6]> {
    let turn = 2.0 * std::f64::consts::PI;
    let short = |d: f64| (d + 0.5 * turn).rem_euclid(turn) - 0.5 * turn;
    let one = |(a, b): (&[f64; 6], &[f64; 6])| {
        std::array::from_fn(|k| if k < 3 { a[k] - b[k] } else { short(a[k] - b[k]) })
    };
    a.iter().zip(b).map(one).collect()
}

/// Platform poses of readings that a model already knows.
#[must_use]
pub fn poses_of(
    model: &Model,
    readings: &Readings,
    beta: &[f64],
    sigma: &[f64],
    play: f64,
) -> Vec<[f64; 6]> {
    let mut poses = vec![[f64::NAN; 6]; readings.samples];
    for (row, pose) in some_poses(model, readings, beta, sigma, play, 1) {
        poses[row] = pose;
    }
    poses
}

/// Platform poses of every `stride`-th block of readings, with their rows.
#[must_use]
pub fn some_poses(
    model: &Model,
    readings: &Readings,
    beta: &[f64],
    sigma: &[f64],
    play: f64,
    stride: usize,
) -> Vec<(usize, [f64; 6])> {
    let noise = Noise { sigma: sigma.to_vec(), play };
    let problem = Implicit::new(vec![(Part { model, readings, weights: None }, noise)], &[]);
    let mut poses = Vec::with_capacity(readings.samples / stride + 1);
    let mut ws = Workspace::default();
    let names: Vec<usize> = (0..model.mechanism.points.len())
        .filter(|&p| model.mechanism.platform.contains_key(&model.mechanism.points[p].name))
        .collect();
    let q: Vec<Vector3<f64>> = names
        .iter()
        .map(|&p| Vector3::from(model.mechanism.platform[&model.mechanism.points[p].name]))
        .collect();
    for (block, meta) in readings.blocks().iter().enumerate().step_by(stride) {
        let a = problem.settled(block, beta);
        model.evaluate(readings, block, &a, beta, Want { x: false, a: false }, &mut ws);
        let points = model.points(&ws);
        for (lane, &row) in meta.rows.iter().enumerate().take(meta.live) {
            let place = |at: Vec3| Vector3::new(at[0].0[lane], at[1].0[lane], at[2].0[lane]);
            let r: Vec<Vector3<f64>> = names.iter().filter_map(|&p| points[p].map(place)).collect();
            poses.push((row, rigid_fit(&q, &r)));
        }
    }
    poses
}

/// Where the chains carry their points, row by row of a table, under a fit.
///
/// One entry for each point of the mechanism that a chain carries, in order; the
/// readings as they are, in groups that the fit need not have seen.
///
/// # Errors
///
/// As [`Readings::new`].
pub fn carried_points(
    session: &Session,
    fit: &Fit,
    table: Table,
) -> Result<Vec<Vec<[f64; 3]>>, Error> {
    let readings = Readings::beside(&session.mechanism, table, &session.readings)?;
    let model = Model::like(&fit.model, &session.mechanism, &readings)?;
    let mut beta = model.nominal();
    let terms = model.term_parameters;
    beta[..terms].copy_from_slice(&fit.beta[..terms]);
    let carried = |p: &&usize| session.mechanism.points[**p].chain.is_some();
    let names: Vec<usize> = (0..session.mechanism.points.len()).collect();
    let names: Vec<usize> = names.iter().filter(carried).copied().collect();
    let mut out = vec![vec![[f64::NAN; 3]; readings.samples]; names.len()];
    let mut ws = Workspace::default();
    for (block, meta) in readings.blocks().iter().enumerate() {
        let want = Want { x: false, a: false };
        model.evaluate(&readings, block, readings.raw(block), &beta, want, &mut ws);
        let points = model.points(&ws);
        for (out, &p) in out.iter_mut().zip(&names) {
            let Some(at) = points[p] else { continue };
            for (lane, &row) in meta.rows.iter().enumerate().take(meta.live) {
                out[row] = at.map(|v| v.0[lane]);
            }
        }
    }
    Ok(out)
}

/// Error of a fit on known poses; with `align`, after the best rigid motion of
/// the instrument that gave them.
///
/// # Errors
///
/// As [`platform_poses`]; [`Error::Shape`] unless there is a pose for each row.
pub fn check(
    session: &Session,
    fit: &Fit,
    table: &Table,
    known: &[[f64; 6]],
    align: bool,
) -> Result<Check, Error> {
    let channels = session.mechanism.channels.len();
    compare(channels, table, known, align, |t| platform_poses(session, fit, &fit.beta, t))
}

/// Error of the poses that `found` gives for the mean readings of each known pose.
///
/// # Errors
///
/// Those of `found`; [`Error::Shape`] unless there is a pose for each row.
pub fn compare(
    channels: usize,
    table: &Table,
    known: &[[f64; 6]],
    align: bool,
    found: impl Fn(Table) -> Result<Vec<[f64; 6]>, Error>,
) -> Result<Check, Error> {
    let rows = table.values.len() / channels;
    if known.len() != rows {
        return Err(Error::Shape { what: "poses".into(), found: known.len(), expected: rows });
    }
    let (averaged, groups) = average(table, channels);
    let pairs: Vec<([f64; 6], [f64; 6])> = groups
        .iter()
        .zip(found(averaged)?)
        .map(|(rows, pose)| (known[rows[0]], pose))
        .filter(|(known, _)| known.iter().all(|v| v.is_finite()))
        .collect();
    Ok(error_of(&pairs, align))
}

/// Root mean square difference of pairs of poses, known first.
#[must_use]
pub fn error_of(pairs: &[([f64; 6], [f64; 6])], align: bool) -> Check {
    let at = |p: &[f64; 6]| Vector3::new(p[0], p[1], p[2]);
    let turn = |p: &[f64; 6]| Rotation3::from_euler_angles(p[3], p[4], p[5]);
    let mut motion = (Rotation3::identity(), Vector3::zeros());
    if align && pairs.len() >= 3 {
        let (from, to): (Vec<_>, Vec<_>) = pairs.iter().map(|(k, f)| (at(f), at(k))).unzip();
        let pose = rigid_fit(&from, &to);
        motion = (turn(&pose), at(&pose));
    }
    let (mut position, mut orientation) = (0.0, 0.0);
    for (known, found) in pairs {
        position += (motion.0 * at(found) + motion.1 - at(known)).norm_squared();
        let (rx, ry, rz) = (motion.0 * turn(found)).euler_angles();
        for (angle, known) in [rx, ry, rz].into_iter().zip(&known[3..]) {
            let off = (angle - known + std::f64::consts::PI).rem_euclid(2.0 * std::f64::consts::PI);
            orientation += (off - std::f64::consts::PI).powi(2);
        }
    }
    let components = 3.0 * pairs.len().max(1) as f64;
    Check {
        poses: pairs.len(),
        position_rms: (position / components).sqrt(),
        orientation_rms: (orientation / components).sqrt(),
    }
}
