//! Where a mechanism is under a result, and how well that is known.

use faer::{Mat, Side};

use crate::Error;
use crate::apply::earlier::{Applied, Under, opened};
use crate::apply::poses::short_way;
use crate::mechanism::{Mechanism, Point};
use crate::readings::Table;

/// Step of the differences, in standard deviations: small for linearity, large against rounding.
const STEP: f64 = 1e-2;

/// Principal variances below this fraction of the largest are zero.
const RANK: f64 = 1e-14;

/// Poses of a platform, points that chains carry, or points that are somewhere else in each pose, row
/// by row of a table.
#[derive(Debug, Clone, PartialEq)]
pub struct Places {
    /// `x y z rx ry rz` [length unit, rad], or `ball.x ball.y ball.z` of a point `ball`.
    pub names: Vec<String>,
    /// One value for each name, row by row.
    pub values: Vec<f64>,
    /// What the uncertainty of the result leaves open, noise of the readings not counted; none
    /// where nothing is known of it.
    pub sd: Option<Vec<f64>>,
    /// True for a row at which a shape of the result is held: beyond the readings at which it was
    /// seen.
    pub beyond: Vec<bool>,
}

/// Where a mechanism is: its platform, or the points that its chains carry, or, where no chain carries
/// one, those that are somewhere else in each pose (a sled on belts).
///
/// `covariance` is that of the result's parameters, row by row. With its principal axes `c_k`,
/// one standard deviation long, the variance of a place `p` is
///
/// ```text
/// var p = Σ_k (∂p/∂c_k)²
/// ```
///
/// by central differences, and, where a shape is held at the end of the readings at which it was seen,
/// the square of what it would change by going on.
///
/// # Errors
///
/// As [`crate::apply::earlier::platform_poses`] and [`crate::apply::earlier::points`];
/// [`Error::Shape`] where the covariance is of other parameters.
pub fn places(
    mechanism: &Mechanism,
    applied: &Applied,
    covariance: Option<&[f64]>,
    table: Table,
) -> Result<Places, Error> {
    let (what, names) = (Placed::of(mechanism), names_of(mechanism)?);
    let posed = what == Placed::Platform;
    let build = if what == Placed::Carried { Under::open } else { Under::new };
    let mut under = build(mechanism, applied, table, &[])?;
    let angle = |k: usize| posed && k % 6 >= 3;
    let sd = match covariance {
        Some(covariance) => {
            let at = |values: &[f64]| what.of_all(&under, values);
            deviations(&under.values, &under.columns, covariance, at, angle)?
        }
        None => None,
    };
    let values = what.of_all(&under, &under.values);
    let beyond = under.beyond();
    let sd = match sd {
        Some(sd) if beyond.contains(&true) => {
            under.hold_shapes(false);
            let on = what.of_all(&under, &under.values);
            let apart = on.iter().zip(&values).enumerate();
            let apart = apart.map(|(k, (a, b))| if angle(k) { short_way(a - b) } else { a - b });
            Some(sd.iter().zip(apart).map(|(sd, apart)| sd.hypot(apart)).collect())
        }
        sd => sd,
    };
    Ok(Places { names, values, sd, beyond })
}

/// What of a mechanism has a place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Placed {
    /// Its platform.
    Platform,
    /// The points that its chains carry.
    Carried,
    /// The points that are somewhere else in each pose.
    Moving,
}

impl Placed {
    /// The places of all rows where the result has these values, row by row.
    pub(crate) fn of_all(self, under: &Under, values: &[f64]) -> Vec<f64> {
        let points = match self {
            Self::Platform => return under.poses(values).concat(),
            Self::Carried => under.points(values),
            Self::Moving => under.moving(values),
        };
        let row = |row: usize| points.iter().flat_map(move |of_point| of_point[row]);
        (0..under.readings.samples).flat_map(row).collect()
    }

    pub(crate) fn of(mechanism: &Mechanism) -> Self {
        let mut points = mechanism.points.iter();
        match () {
            () if !mechanism.platform.is_empty() => Self::Platform,
            () if points.clone().any(|p| p.chain.is_some()) => Self::Carried,
            () if points.any(|p| mechanism.is_moving(p)) => Self::Moving,
            () => Self::Carried,
        }
    }
}

/// Names of what [`places`] gives.
///
/// # Errors
///
/// [`Error::Missing`] without a platform where no chain carries a point, and none moves.
pub(crate) fn names_of(mechanism: &Mechanism) -> Result<Vec<String>, Error> {
    let of_points = |points: &[Point], named: &dyn Fn(&Point) -> bool| -> Vec<String> {
        let named = points.iter().filter(|p| named(p));
        named.flat_map(|p| ["x", "y", "z"].map(|axis| format!("{}.{axis}", p.name))).collect()
    };
    Ok(match Placed::of(mechanism) {
        Placed::Platform => ["x", "y", "z", "rx", "ry", "rz"].map(String::from).to_vec(),
        Placed::Carried => of_points(&opened(mechanism)?.points, &|p| p.chain.is_some()),
        Placed::Moving => of_points(&mechanism.points, &|p| mechanism.is_moving(p)),
    })
}

/// Standard deviations of what `at` gives, by differences along the principal axes.
fn deviations(
    values: &[f64],
    columns: &[Vec<usize>],
    covariance: &[f64],
    at: impl Fn(&[f64]) -> Vec<f64>,
    angle: impl Fn(usize) -> bool,
) -> Result<Option<Vec<f64>>, Error> {
    let n = values.len();
    Error::same("covariance", covariance.len(), n * n)?;
    let own: Vec<usize> = (0..n).filter(|&i| !columns[i].is_empty()).collect();
    // Unit variances first: parameters differ by many orders of magnitude.
    let scale: Vec<f64> = own.iter().map(|&i| covariance[i * n + i].max(0.0).sqrt()).collect();
    let unit = Mat::from_fn(own.len(), own.len(), |i, j| {
        let by = scale[i] * scale[j];
        let value = covariance[own[i] * n + own[j]];
        if by == 0.0 && value.is_finite() { 0.0 } else { value / by }
    });
    let finite = (0..own.len()).all(|j| unit.col_as_slice(j).iter().all(|v| v.is_finite()));
    if own.is_empty() || !finite {
        return Ok(None);
    }
    let Ok(eigen) = unit.self_adjoint_eigen(Side::Lower) else { return Ok(None) };
    let (variances, axes) = (eigen.S().column_vector(), eigen.U());
    let mut total = vec![0.0; at(values).len()];
    for k in 0..own.len() {
        let variance = variances[k];
        if variance <= RANK * variances[own.len() - 1] {
            continue;
        }
        let moved = |sign: f64| -> Vec<f64> {
            let mut moved = values.to_vec();
            for (i, &p) in own.iter().enumerate() {
                moved[p] += sign * STEP * variance.sqrt() * axes[(i, k)] * scale[i];
            }
            at(&moved)
        };
        let pairs = moved(1.0).into_iter().zip(moved(-1.0));
        for (i, (sum, (ahead, behind))) in total.iter_mut().zip(pairs).enumerate() {
            let change = if angle(i) { short_way(ahead - behind) } else { ahead - behind };
            *sum += (change / (2.0 * STEP)).powi(2);
        }
    }
    Ok(Some(total.into_iter().map(f64::sqrt).collect()))
}
