//! Error of platform poses against known ones.

use nalgebra::{Rotation3, Vector3};

use crate::Error;
use crate::apply::accuracy::{Expected, Wanted, is_placed, slopes_at};
use crate::apply::known::{Known, rows_of_known};
pub(crate) use crate::apply::misread::Pair;
use crate::apply::misread::{Misread, misread};
use crate::apply::poses::{carried_points, platform_poses, short_way};
use crate::estimate::{Fit, Observations};
use crate::kinematics::rigid::rigid_fit;
use crate::mechanism::Mechanism;
use crate::readings::{Table, average};

/// Error of the platform pose: root mean square over components, as in Table VI.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
pub struct Check {
    /// Poses compared.
    pub poses: usize,
    /// Of the position, length units.
    pub position_rms: f64,
    /// Of roll, pitch and yaw, rad; null where places alone are known.
    pub orientation_rms: Option<f64>,
    /// Where it is largest.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub largest: Option<Largest>,
    /// The same as a calibration predicts it; none of what has no covariance.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub predicted: Option<Expected>,
    /// What would make known poses agree that do not.
    #[cfg_attr(feature = "serde", serde(skip))]
    pub misread: Option<Misread>,
}

/// Readings in known poses, the mean of each: they tell how large errors are elsewhere.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
pub struct CheckReadings {
    /// Pose by pose, channel by channel: 200 poses at the most, evenly spread over their order.
    pub readings: Vec<Vec<f64>>,
    /// Temperature (°C), where it was measured.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub temperature_c: Option<Vec<f64>>,
    /// The point whose places are known, where it was named.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub point: Option<String>,
}

/// Known poses whose readings are kept.
const KEPT: usize = 200;

impl CheckReadings {
    /// Of known poses.
    #[must_use]
    pub(crate) fn of(mechanism: &Mechanism, known: &Known) -> Self {
        let channels = mechanism.channels.len();
        let all = rows_of_known(&known.table, channels, &known.poses).concat();
        let count = all.len().min(KEPT);
        let parts: Vec<_> = (0..count).map(|k| all[k * all.len() / count].clone()).collect();
        let Table { values, temperature, .. } = average(&known.table, channels, &parts);
        let readings = values.chunks_exact(channels).map(<[f64]>::to_vec).collect();
        Self { readings, temperature_c: temperature, point: known.point.clone() }
    }
}

/// The largest errors of the platform pose, and what noise does to each.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
pub struct Largest {
    /// Length of the error of the position, length units.
    pub position: f64,
    /// Length of the errors of roll, pitch and yaw together, rad; null where places alone are known.
    pub orientation: Option<f64>,
    /// Standard deviation of a coordinate of the position by the noise of the readings and of the known pose alone.
    #[cfg_attr(feature = "serde", serde(default))]
    pub position_noise: Option<f64>,
    /// The same of roll, pitch and yaw, rad.
    #[cfg_attr(feature = "serde", serde(default))]
    pub orientation_noise: Option<f64>,
}

/// Error of a fit on known poses; with `align`, after the best rigid motion of
/// the instrument that gave them.
///
/// # Errors
///
/// As [`platform_poses`] and [`carried_points`]; [`Error::Shape`] unless there is a pose for each row.
pub fn check(
    observations: &Observations,
    fit: &Fit,
    known: &Known,
    align: bool,
) -> Result<Check, Error> {
    let mechanism = &observations.mechanism;
    let (found, pairs) = compare(mechanism, known, align, |t| found(observations, fit, known, t))?;
    let channels = mechanism.channels.len();
    let parts = rows_of_known(&known.table, channels, &known.poses).concat();
    let samples: Vec<f64> = parts.iter().map(|rows| rows.len() as f64).collect();
    let carried = known.carried(mechanism)?;
    let placed = carried.is_none() && is_placed(observations, fit);
    let points = mechanism.points.iter().filter(|p| p.chain.is_some()).count();
    let positions = match carried {
        Some(point) => 3 * point..3 * point + 3,
        None => 0..3 * if placed { 1 } else { points },
    };
    let moved: Vec<_> = pairs.iter().filter(|_| align).map(|(_, found)| at(found)).collect();
    let (seen, turns) = (average(&known.table, channels, &parts), found.orientation_rms);
    let wanted = |samples| {
        let turns = turns.filter(|_| placed).map_or(0..0, |_| 3..6);
        let known = known.noise;
        Wanted { positions: positions.clone(), turns, samples, known, moved: &moved }
    };
    let slopes = slopes_at(observations, fit, &seen, placed)?;
    let (error, quiet) = (wanted(&samples).of(fit, &slopes), wanted(&[]).of(fit, &slopes));
    let (position, orientation) = (found.position_rms, found.orientation_rms);
    let judged = error.judge(position, orientation, fit.noise.dof);
    // What an effect of the way or of the time does at one known pose is not known as well as at those fitted.
    let judged = match fit.model.instances.iter().all(|i| i.term.of_pose()) {
        true => {
            let (alone, motion) = (wanted(&samples), motion_of(&pairs, align));
            let each = alone.of_each(fit, &slopes).zip(&pairs).map(|(predicted, pair)| {
                let off = error_after(std::slice::from_ref(pair), &motion);
                let one = predicted.judge(off.position_rms, off.orientation_rms, fit.noise.dof);
                (off.position_rms, off.orientation_rms, one)
            });
            judged.with_each(&each.collect::<Vec<_>>())
        }
        false => judged,
    };
    let finite = judged.chi2.is_finite() && judged.position_sd > 0.0 && found.poses > 0;
    let noise = |all: f64, parameters: f64| {
        let square = all * all - parameters * parameters;
        square.is_finite().then(|| square.max(0.0).sqrt())
    };
    let largest = found.largest.map(|largest| Largest {
        position_noise: noise(error.position_sd, quiet.position_sd),
        orientation_noise: error
            .orientation_sd
            .zip(quiet.orientation_sd)
            .and_then(|(all, parameters)| noise(all, parameters)),
        ..largest
    });
    let errors = |pairs: &[Pair]| {
        let Check { position_rms, orientation_rms, .. } = error_of(pairs, align);
        (position_rms, orientation_rms)
    };
    let moved = (!align).then(|| error_of(&pairs, true).position_rms);
    let misread = misread(&pairs, errors, moved);
    Ok(Check { predicted: finite.then_some(judged), largest, misread, ..found })
}

/// Where a fit puts what is known, row by row of a table: places have no orientation.
///
/// # Errors
///
/// As [`platform_poses`] and [`carried_points`].
pub(crate) fn found(
    observations: &Observations,
    fit: &Fit,
    known: &Known,
    table: Table,
) -> Result<Vec<[f64; 6]>, Error> {
    match known.carried(&observations.mechanism)? {
        None => platform_poses(observations, fit, &fit.beta, table),
        Some(point) => {
            let mut points = carried_points(observations, fit, table)?;
            Ok(points.swap_remove(point).into_iter().map(unturned).collect())
        }
    }
}

/// A place as a pose without an orientation.
pub(crate) fn unturned([x, y, z]: [f64; 3]) -> [f64; 6] {
    [x, y, z, f64::NAN, f64::NAN, f64::NAN]
}

/// Error of the poses that `found` gives for the mean readings of each known pose; where the known
/// pose differs from sample to sample, each sample is compared with its own.
///
/// # Errors
///
/// Those of `found`; [`Error::Shape`] unless there is a pose for each row.
pub(crate) fn compare(
    mechanism: &Mechanism,
    known: &Known,
    align: bool,
    found: impl Fn(Table) -> Result<Vec<[f64; 6]>, Error>,
) -> Result<(Check, Vec<Pair>), Error> {
    let Known { table, poses: known, .. } = known;
    let channels = mechanism.channels.len();
    let rows = table.values.len() / channels;
    Error::same("poses", known.len(), rows)?;
    let runs = rows_of_known(table, channels, known);
    let parts = runs.concat();
    if parts.is_empty() {
        return Ok((error_of(&[], align), Vec::new()));
    }
    let poses = found(average(table, channels, &parts))?;
    let pairs: Vec<_> =
        parts.iter().zip(poses).map(|(rows, pose)| (known[rows.start], pose)).collect();
    Ok((Check { poses: runs.len(), ..error_of(&pairs, align) }, pairs))
}

fn at(p: &[f64; 6]) -> Vector3<f64> {
    Vector3::new(p[0], p[1], p[2])
}

fn turn(p: &[f64; 6]) -> Rotation3<f64> {
    Rotation3::from_euler_angles(p[3], p[4], p[5])
}

/// Pairs that determine a rigid motion.
pub(crate) const PAIRS: usize = 3;

/// The rigid motion that brings found positions nearest to known ones, pairs of known and found;
/// none at all unless one is asked for and three pairs determine it.
pub(crate) fn motion_of(pairs: &[Pair], align: bool) -> (Rotation3<f64>, Vector3<f64>) {
    if !align || pairs.len() < PAIRS {
        return (Rotation3::identity(), Vector3::zeros());
    }
    let (from, to): (Vec<_>, Vec<_>) = pairs.iter().map(|(k, f)| (at(f), at(k))).unzip();
    let pose = rigid_fit(&from, &to);
    (turn(&pose), at(&pose))
}

/// Root mean square difference of pairs of poses, known first; of orientations where all are known.
#[must_use]
pub fn error_of(pairs: &[Pair], align: bool) -> Check {
    error_after(pairs, &motion_of(pairs, align))
}

/// The same after a motion of what was found.
fn error_after(pairs: &[Pair], motion: &(Rotation3<f64>, Vector3<f64>)) -> Check {
    let (mut position, mut orientation) = (0.0, 0.0);
    let (mut farthest, mut most_turned) = (0.0_f64, 0.0_f64);
    let whole = |pose: &[f64; 6]| pose[3..].iter().all(|v| v.is_finite());
    let posed = pairs.iter().all(|(known, found)| whole(known) && whole(found));
    for (known, found) in pairs {
        let square = (motion.0 * at(found) + motion.1 - at(known)).norm_squared();
        position += square;
        farthest = farthest.max(square.sqrt());
        let mut turned = 0.0;
        let (rx, ry, rz) = (motion.0 * turn(found)).euler_angles();
        for (angle, known) in [rx, ry, rz].into_iter().zip(&known[3..]) {
            turned += short_way(angle - known).powi(2);
        }
        orientation += turned;
        most_turned = most_turned.max(turned.sqrt());
    }
    let components = 3.0 * pairs.len().max(1) as f64;
    let largest = Largest {
        position: farthest,
        orientation: posed.then_some(most_turned),
        ..Largest::default()
    };
    Check {
        poses: pairs.len(),
        position_rms: (position / components).sqrt(),
        orientation_rms: posed.then(|| (orientation / components).sqrt()),
        largest: (!pairs.is_empty()).then_some(largest),
        predicted: None,
        misread: None,
    }
}
