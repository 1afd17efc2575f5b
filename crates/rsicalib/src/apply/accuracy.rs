//! Predicted error of the platform, or of the points that chains carry.
//!
//! Closure is not accuracy: loops may close well where readings do not determine the parameters
//! that place the platform. With the covariance `C` of the parameters and the derivative `J` of
//! the positions by them, (100),
//!
//! ```text
//! E |e|² = tr(C JᵀJ),    var |e|² = 2 tr((C JᵀJ)²)                        (97)
//! ```
//!
//! to which noise of the readings adds where known poses are compared with. Where these are known up to a
//! rigid motion of an instrument, what moves all of them rigidly is taken out of `J`. There position and
//! orientation are each divided by their predicted deviation, and their squares `q` together are
//! judged by
//!
//! ```text
//! χ² = ν q / n,    ν = 2 (E q)² / var q                                   (110)
//! ```
//!
//! with `E q = n`, the number of coordinates; one pose alone by `ν = E q / λ`, with `λ` the largest eigenvalue of
//! the covariance of its coordinates. What the readings do not determine at all has no
//! variance in `C`: it is named among the unobservable directions, and is not in the figure.

use faer::Mat;
use nalgebra::{DMatrix, Vector3};

use crate::Error;
use crate::apply::slopes::{Slopes, carried_slopes, platform_slopes};
use crate::estimate::significance::LEVEL;
use crate::estimate::{Fit, Observations};
use crate::model::Model;
use crate::numerics::distributions;
use crate::readings::{Readings, Table, along, ascending, average, runs_of_poses};

/// Rigid motions that move places by less than this fraction of the most are none: rounding.
const RANK: f64 = 1e-9;

/// Level of each of the two looks at known poses: at all of them, and at each.
pub(crate) const KNOWN: f64 = LEVEL / 2.0;

/// Poses of a session at which errors are predicted, at the most.
pub(crate) const PREDICTED: usize = 16;

/// Predicted error, root mean square over components.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
pub struct Predicted {
    /// Poses for which the error is predicted.
    pub poses: usize,
    /// Standard deviation of a coordinate of the platform's position, or of carried points, by
    /// the errors of the parameters [length unit].
    pub position_sd: f64,
    /// Standard deviation of roll, pitch and yaw (rad); null without a platform.
    pub orientation_sd: Option<f64>,
    /// The same as `position_sd` before there are readings: by the typical sizes of the parameters, or
    /// how well they are declared to be known. None of what is not at the poses of a session.
    #[cfg_attr(feature = "serde", serde(skip))]
    pub beforehand: Option<f64>,
    /// Degrees of freedom of the mean square of all coordinates, each in its deviations.
    #[cfg_attr(feature = "serde", serde(skip))]
    pub dof: f64,
}

/// An error of known poses against what is predicted of it.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
pub struct Expected {
    /// Predicted standard deviation of a coordinate of the position, the noise of its readings and of the known
    /// pose counted in [length unit].
    pub position_sd: f64,
    /// The same of roll, pitch and yaw (rad).
    pub orientation_sd: Option<f64>,
    /// χ² of the errors by their predicted covariance.
    pub chi2: f64,
    /// Its degrees of freedom: all poses share the errors of the parameters.
    pub dof: f64,
    /// Probability of a larger one by chance.
    pub p_value: f64,
    /// The least probable of the poses by itself.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub worst: Option<Worst>,
}

/// The least probable of known poses, judged by itself.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
pub struct Worst {
    /// Error of a coordinate of its position, root mean square [length unit].
    pub position_rms: f64,
    /// Predicted standard deviation of that [length unit].
    pub position_sd: f64,
    /// Probability that one of so many poses is as improbable by chance.
    pub p_value: f64,
    /// Error of its orientation, root mean square of the three angles (rad).
    #[cfg_attr(feature = "serde", serde(default))]
    pub orientation_rms: Option<f64>,
    /// Predicted standard deviation of that (rad).
    #[cfg_attr(feature = "serde", serde(default))]
    pub orientation_sd: Option<f64>,
    /// Its label; null in a result of an earlier version.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub pose: Option<i64>,
    /// Probability of the errors of all others together; null where there are none, or this one is not off.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub others_p_value: Option<f64>,
}

impl Worst {
    /// True where it is off, and the others are off by no more than is predicted.
    fn is_alone(&self) -> bool {
        self.p_value <= KNOWN && self.others_p_value.is_some_and(|p| p > KNOWN)
    }

    /// Error and predicted standard deviation of what is off by more of these, and whether that is the
    /// orientation.
    #[must_use]
    pub fn numbers(&self) -> ([f64; 2], bool) {
        let position = [self.position_rms, self.position_sd];
        let turned = self.orientation_rms.zip(self.orientation_sd).map(<[f64; 2]>::from);
        let times = |[found, expected]: [f64; 2]| found / expected;
        match turned {
            Some(turned) if times(turned) > times(position) => (turned, true),
            _ => (position, false),
        }
    }
}

impl Predicted {
    /// (110) of errors of the positions and the orientations, root mean squares; `noise` are the
    /// degrees of freedom of the noise.
    #[must_use]
    pub fn judge(&self, position_rms: f64, orientation_rms: Option<f64>, noise: f64) -> Expected {
        let Self { position_sd, orientation_sd, dof, .. } = *self;
        let times = |rms: f64, sd: f64| (rms / sd.max(f64::MIN_POSITIVE)).powi(2);
        let position = times(position_rms, position_sd);
        let turned = orientation_rms.zip(orientation_sd).map(|(rms, sd)| times(rms, sd));
        let mean = turned.map_or(position, |turned| 0.5 * (position + turned));
        let p_value = distributions::f_tail(mean, dof, noise);
        Expected { position_sd, orientation_sd, chi2: mean * dof, dof, p_value, worst: None }
    }
}

impl Expected {
    /// The same with the least probable of the poses: one that is off alone is lost among errors that all share.
    /// What an effect of the way or of the time does at one known pose is not known as well as at those fitted:
    /// there a pose is told only where all are off, and no longer without it.
    #[must_use]
    pub fn with_worst(self, worst: Option<Worst>, of_pose: bool) -> Self {
        let told = |worst: &Worst| of_pose || self.p_value <= KNOWN && worst.is_alone();
        Self { worst: worst.filter(told), ..self }
    }

    /// The pose that is off alone, where all of them are off together and no longer without it.
    #[must_use]
    pub fn alone(&self) -> Option<Worst> {
        self.worst.filter(|worst| self.p_value <= KNOWN && worst.is_alone())
    }
}

/// The predicted error of a fit at the poses of a table, at most `most` of them, evenly spread, by the
/// errors of the parameters.
///
/// Positions are those of the platform, or, without a platform, of the points that chains carry.
///
/// # Errors
///
/// As [`Readings::new`].
pub fn predicted(
    observations: &Observations,
    fit: &Fit,
    table: &Table,
    most: usize,
) -> Result<Predicted, Error> {
    let slopes = slopes_of_some(observations, fit, table, most)?;
    let coordinates = slopes.first().map_or(0, |s| s.by_parameter.nrows());
    let placed = is_placed(observations, fit);
    let positions = if placed { 3 } else { coordinates };
    let wanted =
        Wanted { positions: 0..positions, turns: positions..coordinates, ..Wanted::default() };
    let sd = fit.model.sd_beforehand();
    let size = (slopes.len() * positions).max(1) as f64;
    let square = |by: &DMatrix<f64>| {
        let column =
            |(p, sd): (usize, &f64)| by.view((0, p), (positions, 1)).norm_squared() * sd * sd;
        sd.iter().enumerate().map(column).sum::<f64>()
    };
    let mean = slopes.iter().map(|s| square(&s.by_parameter)).sum::<f64>() / size;
    Ok(Predicted { beforehand: Some(mean.sqrt()), ..wanted.of(fit, &slopes) })
}

/// What of the derivatives an error is predicted of.
#[derive(Default)]
pub(crate) struct Wanted<'a> {
    /// Coordinates of positions.
    pub positions: std::ops::Range<usize>,
    /// Those of an orientation.
    pub turns: std::ops::Range<usize>,
    /// Samples whose mean the readings of each row are, where their noise counts; else none.
    pub samples: &'a [f64],
    /// Standard deviations of what each row is compared with: of a coordinate of a position, of an angle.
    pub known: [f64; 2],
    /// Where the positions are, from which a rigid motion of an instrument is taken out; none: it is not.
    pub moved: &'a [Vector3<f64>],
}

impl Wanted<'_> {
    /// The predicted error of each row by itself; a motion of the instrument is of all of them.
    pub fn of_each(&self, fit: &Fit, slopes: &[Slopes]) -> impl Iterator<Item = Predicted> {
        slopes.iter().enumerate().map(|(row, slopes)| {
            let samples = self.samples.get(row..=row).unwrap_or_default();
            let (positions, turns) = (self.positions.clone(), self.turns.clone());
            let one = Wanted { positions, turns, samples, moved: &[], ..*self };
            one.of(fit, std::slice::from_ref(slopes))
        })
    }

    /// The predicted error at the rows that have these derivatives.
    pub fn of(&self, fit: &Fit, slopes: &[Slopes]) -> Predicted {
        let terms = fit.model.term_parameters;
        let covariance = fit.elsewhere();
        let sd: Vec<f64> = (0..terms).map(|i| covariance[(i, i)].max(0.0).sqrt()).collect();
        let free: Vec<usize> = (0..terms).filter(|&i| sd[i] > 0.0).collect();
        let correlation = DMatrix::from_fn(free.len(), free.len(), |i, j| {
            covariance[(free[i], free[j])] / (sd[free[i]] * sd[free[j]])
        });
        let motions = rigid_motions(self.moved);
        let square = |coordinates: [&std::ops::Range<usize>; 2], unit: [f64; 2]| {
            let each = coordinates[0].len() + coordinates[1].len();
            let of: Vec<(usize, f64)> =
                (0..2).flat_map(|k| coordinates[k].clone().map(move |i| (i, unit[k]))).collect();
            let size = slopes.len() * each;
            // A motion of the instrument is found from places alone.
            let of_places = |row: usize| {
                let (pose, i) = (row / each, row % each);
                (i < coordinates[0].len()).then(|| pose * coordinates[0].len() + i)
            };
            let fits = motions.nrows() == slopes.len() * coordinates[0].len();
            let columns = if fits { motions.ncols() } else { 0 };
            let moved = DMatrix::from_fn(size, columns, |row, k| {
                of_places(row).map_or(0.0, |place| motions[(place, k)])
            });
            let by_parameter = DMatrix::from_fn(size, free.len(), |row, k| {
                let (i, unit) = of[row % each];
                slopes[row / each].by_parameter[(i, free[k])] * sd[free[k]] / unit
            });
            // Of readings, and of each known coordinate by itself.
            let sensors = fit.noise.sigma.len();
            let known = if self.known == [0.0; 2] { 0 } else { each };
            let noisy = |(pose, samples): (usize, &f64)| {
                // Samples that resemble their neighbours average out less, (64).
                let share = (fit.noise.inflation.min(*samples) / samples).sqrt();
                DMatrix::from_fn(each, sensors + known, |row, c| {
                    let (i, unit) = of[row];
                    let own = match c.checked_sub(sensors) {
                        None => slopes[pose].by_reading[(i, c)] * fit.noise.sigma[c] * share,
                        Some(k) if k == row => self.known[usize::from(row >= coordinates[0].len())],
                        Some(_) => 0.0,
                    };
                    own / unit
                })
            };
            let noisy = self.samples.iter().enumerate().map(noisy);
            (size > 0).then(|| match slopes.len() {
                1 => Square::of_one(&by_parameter, &correlation, noisy),
                _ => Square::of(by_parameter, &correlation, noisy, &moved),
            })
        };
        // Nothing is predicted where no chain carries a point.
        let sd_of = |at: &std::ops::Range<usize>, k: usize| {
            let both = if k == 0 { [at, &(0..0)] } else { [&(0..0), at] };
            square(both, [1.0; 2]).map(|square| square.mean.sqrt())
        };
        let position_sd = sd_of(&self.positions, 0).unwrap_or(f64::NAN);
        let orientation_sd = sd_of(&self.turns, 1);
        let unit = [position_sd, orientation_sd.unwrap_or(1.0)].map(|u| u.max(f64::MIN_POSITIVE));
        let dof = square([&self.positions, &self.turns], unit).unwrap_or_default().dof;
        Predicted { poses: slopes.len(), position_sd, orientation_sd, beforehand: None, dof }
    }
}

/// Orthonormal rigid motions of some places to first order, coordinate by coordinate: six, or fewer
/// where the places lie on a line; none of no places.
pub(crate) fn rigid_motions(places: &[Vector3<f64>]) -> DMatrix<f64> {
    if places.is_empty() {
        return DMatrix::zeros(0, 0);
    }
    let mean = places.iter().sum::<Vector3<f64>>() / places.len() as f64;
    let size = places.iter().map(|p| (p - mean).norm()).fold(f64::MIN_POSITIVE, f64::max);
    let motions = DMatrix::from_fn(3 * places.len(), 6, |i, k| match k {
        0..3 => f64::from(u8::from(i % 3 == k)),
        _ => Vector3::ith(k - 3, 1.0).cross(&((places[i / 3] - mean) / size))[i % 3],
    });
    let parts = motions.svd(true, false);
    let most = parts.singular_values.iter().copied().fold(0.0, f64::max);
    let kept: Vec<usize> = (0..parts.singular_values.len())
        .filter(|&k| parts.singular_values[k] > RANK * most)
        .collect();
    parts.u.map_or_else(|| DMatrix::zeros(0, 0), |u| u.select_columns(&kept))
}

/// Root mean square over the coordinates of positions, at the most `most` poses of a table, by a step
/// of the parameters; and the same as each of these covariances of the step predicts it.
///
/// # Errors
///
/// As [`Readings::new`].
pub fn moved_by(
    observations: &Observations,
    fit: &Fit,
    (table, most): (&Table, usize),
    step: &[f64],
    covariances: [&Mat<f64>; 2],
) -> Result<[f64; 3], Error> {
    let slopes = slopes_of_some(observations, fit, table, most)?;
    let terms = fit.model.term_parameters;
    let (mut moved, mut predicted, mut count) = (0.0, [0.0; 2], 0.0);
    for by in slopes.iter().map(|s| &s.by_parameter) {
        let positions = if is_placed(observations, fit) { 3 } else { by.nrows() };
        for row in (0..positions).map(|i| by.row(i)) {
            moved += (0..terms).map(|p| row[p] * step[p]).sum::<f64>().powi(2);
            for (predicted, covariance) in predicted.iter_mut().zip(covariances) {
                let pairs = (0..terms).flat_map(|i| (0..terms).map(move |j| (i, j)));
                *predicted += pairs.map(|(i, j)| row[i] * covariance[(i, j)] * row[j]).sum::<f64>();
            }
            count += 1.0;
        }
    }
    let [within, between] = predicted;
    Ok([moved, within, between].map(|square| (square.max(0.0) / count).sqrt()))
}

/// Derivatives at some poses of a table, evenly spread along the direction in which readings vary most:
/// which ones they are does not depend on the order of rows.
fn slopes_of_some(
    observations: &Observations,
    fit: &Fit,
    table: &Table,
    most: usize,
) -> Result<Vec<Slopes>, Error> {
    let channels = observations.mechanism.channels.len();
    let poses = runs_of_poses(table, channels);
    let count = poses.len().min(most.max(1));
    let places = along(poses.iter().map(|rows| &table.values[rows.start * channels..][..channels]));
    let order = ascending(&places);
    let some: Vec<_> = (0..count).map(|k| poses[order[k * poses.len() / count]].clone()).collect();
    let mut few = average(table, channels, &some);
    // Rows with times of their own, of which no term asks for the way to them, need nothing of the others.
    if few.time.is_some() && !fit.model.instances.iter().any(|i| i.term.is_of_way()) {
        few.part = None;
    }
    slopes_at(observations, fit, &few, is_placed(observations, fit))
}

/// True where a pose of the platform follows from the readings.
pub(crate) fn is_placed(observations: &Observations, fit: &Fit) -> bool {
    !observations.mechanism.platform.is_empty() && fit.model.unknowns.is_empty()
}

/// Derivatives of the platform's pose, or of where chains carry points, at the rows of a table.
///
/// # Errors
///
/// As [`Readings::new`].
pub(crate) fn slopes_at(
    observations: &Observations,
    fit: &Fit,
    table: &Table,
    placed: bool,
) -> Result<Vec<Slopes>, Error> {
    let mechanism = &observations.mechanism;
    let readings = Readings::beside(mechanism, table.clone(), &observations.readings)?;
    let model = Model::like(&fit.model, mechanism, &readings)?;
    // Where unknown points are is no part of where chains carry their points.
    let mut own = model.nominal();
    let terms = model.term_parameters;
    own[..terms].copy_from_slice(&fit.beta[..terms]);
    match placed {
        true => platform_slopes(&model, &readings, &own, &fit.assumed(), 1),
        false => carried_slopes(&model, &readings, &own, 1),
    }
}

/// Mean square of a coordinate, and its degrees of freedom.
#[derive(Default)]
struct Square {
    mean: f64,
    dof: f64,
}

impl Square {
    /// (97) by parameters and by readings, whose noise `noisy` is pose by pose: what is along the
    /// orthonormal columns `motions` is taken out of all of them together.
    ///
    /// Poses share the errors of the parameters and none of the readings, so that the covariance is
    /// `J C Jᵀ + Σ` with a block of `Σ` for each pose, between projections `P = I - M Mᵀ`.
    fn of(
        mut moves: DMatrix<f64>,
        correlation: &DMatrix<f64>,
        noisy: impl Iterator<Item = DMatrix<f64>>,
        motions: &DMatrix<f64>,
    ) -> Self {
        let size = moves.nrows();
        if motions.ncols() > 0 {
            moves -= motions * (motions.transpose() * &moves);
        }
        let product = correlation * (moves.transpose() * &moves);
        let (mut mean, mut squares) = (product.trace(), (&product * &product).trace());
        let mut along = DMatrix::zeros(motions.ncols(), motions.ncols());
        let mut first = 0;
        for noise in noisy {
            let own = &noise * noise.transpose();
            let part = motions.rows(first, own.nrows());
            let by_parameter = noise.transpose() * moves.rows(first, own.nrows());
            let both = &by_parameter * correlation;
            mean += own.trace();
            squares += own.norm_squared() - 2.0 * (&own * part).norm_squared();
            squares += 2.0 * both.component_mul(&by_parameter).sum();
            along += part.transpose() * &own * part;
            first += own.nrows();
        }
        mean -= along.trace();
        squares += along.norm_squared();
        let dof = if squares > 0.0 { mean * mean / squares } else { 1.0 };
        Self { mean: mean / size as f64, dof }
    }

    /// The same of one pose: among many the far tail decides, which is that of the largest eigenvalue of the
    /// covariance, and (110) has less of it.
    fn of_one(
        moves: &DMatrix<f64>,
        correlation: &DMatrix<f64>,
        noisy: impl Iterator<Item = DMatrix<f64>>,
    ) -> Self {
        let covariance = noisy.fold(moves * correlation * moves.transpose(), |sum, noise| {
            sum + &noise * noise.transpose()
        });
        let (size, sum) = (moves.nrows() as f64, covariance.trace());
        let largest = covariance.symmetric_eigenvalues().max();
        Self { mean: sum / size, dof: if largest > 0.0 { sum / largest } else { 1.0 } }
    }
}
