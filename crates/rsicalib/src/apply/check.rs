//! Error of platform poses against known ones.

use crate::numerics::order;
use std::ops::Range;

use nalgebra::{Rotation3, Vector3};

use crate::Error;
use crate::apply::accuracy::{Expected, KNOWN, Predicted, Wanted, Worst, is_placed, slopes_at};
use crate::apply::known::{Known, rows_of_known};
pub(crate) use crate::apply::misread::Pair;
use crate::apply::misread::{Misread, misread};
use crate::apply::poses::{carried_points, platform_poses, short_way};
use crate::apply::slopes::Slopes;
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
    let known = &known.after(&observations.readings.table);
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
    let seen = average(&known.table, channels, &parts);
    let slopes = slopes_at(observations, fit, &seen, placed)?;
    let of_pose = fit.model.instances.iter().all(|i| i.term.of_pose());
    let turned = placed && found.orientation_rms.is_some();
    let compared =
        Compared { fit, known: known.noise, positions, turned, align, pairs, samples, slopes };
    let (error, quiet) = (compared.predicted(true), compared.predicted(false));
    let labels: Vec<i64> = parts.iter().map(|rows| label(&known.table, rows.start)).collect();
    let judged = compared.judged(&error).with_worst(compared.worst(&labels), of_pose);
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
    let pairs = &compared.pairs;
    let moved = (!align).then(|| error_of(pairs, true).position_rms);
    let misread = misread(pairs, errors, moved);
    Ok(Check { predicted: finite.then_some(judged), largest, misread, ..found })
}

/// How a row of a table is called: by the label of its pose, or by its number, from 1.
fn label(table: &Table, row: usize) -> i64 {
    table.pose.as_ref().map_or(row as i64 + 1, |labels| labels[row])
}

/// Known poses beside what is found there, and what their errors are predicted from.
#[derive(Clone)]
struct Compared<'a> {
    fit: &'a Fit,
    /// Standard deviations of what is known.
    known: [f64; 2],
    /// Coordinates of the positions that are known.
    positions: Range<usize>,
    /// True where orientations are known too.
    turned: bool,
    align: bool,
    pairs: Vec<Pair>,
    /// Samples whose mean the readings of each are.
    samples: Vec<f64>,
    slopes: Vec<Slopes>,
}

impl Compared<'_> {
    /// What is predicted of all of them, of each known place with the noise of its readings or without.
    fn predicted(&self, noisy: bool) -> Predicted {
        let moved: Vec<_> =
            self.pairs.iter().filter(|_| self.align).map(|(_, found)| at(found)).collect();
        self.wanted(noisy, &moved).of(self.fit, &self.slopes)
    }

    fn wanted<'b>(&'b self, noisy: bool, moved: &'b [Vector3<f64>]) -> Wanted<'b> {
        let turns = if self.turned { 3..6 } else { 0..0 };
        let samples = if noisy { &self.samples[..] } else { &[] };
        Wanted { positions: self.positions.clone(), turns, samples, known: self.known, moved }
    }

    /// (110) of all of them.
    fn judged(&self, predicted: &Predicted) -> Expected {
        let found = error_of(&self.pairs, self.align);
        predicted.judge(found.position_rms, found.orientation_rms, self.fit.noise.dof)
    }

    /// The least probable of them, each judged by itself; where it is off, what the others are without it.
    fn worst(&self, labels: &[i64]) -> Option<Worst> {
        let motion = motion_of(&self.pairs, self.align);
        let alone = self.wanted(true, &[]);
        let each =
            alone.of_each(self.fit, &self.slopes).zip(&self.pairs).map(|(predicted, pair)| {
                let off = error_after(std::slice::from_ref(pair), &motion);
                (off, predicted.judge(off.position_rms, off.orientation_rms, self.fit.noise.dof))
            });
        let of = |(_, (_, one)): &(usize, (Check, Expected))| one.p_value;
        let least = each.enumerate().min_by(|a, b| {
            // Probabilities that underflow are alike.
            order::compare(of(a), of(b)).then(order::compare(-a.1.1.chi2, -b.1.1.chi2))
        });
        let (k, (off, one)) = least?;
        let p_value = (one.p_value * self.pairs.len() as f64).min(1.0);
        let others = (p_value <= KNOWN && self.pairs.len() > 1).then(|| self.without(k));
        Some(Worst {
            position_rms: off.position_rms,
            position_sd: one.position_sd,
            p_value,
            orientation_rms: off.orientation_rms,
            orientation_sd: one.orientation_sd,
            pose: Some(labels[k]),
            others_p_value: others.map(|others| others.judged(&others.predicted(true)).p_value),
        })
    }

    /// All but one.
    fn without(&self, k: usize) -> Self {
        let mut others = self.clone();
        others.pairs.remove(k);
        others.samples.remove(k);
        others.slopes.remove(k);
        others
    }
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
