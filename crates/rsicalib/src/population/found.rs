//! What a fleet has in common, in the shape of `population.json`.

use faer::Mat;

use crate::Error;
use crate::model::Spec;
use crate::population::joint::{Joint, solve};
use crate::population::levels::{Levels, Spread};
use crate::population::naming::{Candidate, named};
use crate::population::share::Share;

/// Least variance that is expected of a device that is yet to come, in tolerances squared: a hundredth of
/// the tolerance. What devices are found to differ by has no such floor.
const LEAST: f64 = 1e-4;

/// What devices of one design share.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[non_exhaustive]
pub struct Found {
    /// Devices that take part.
    pub devices: usize,
    /// Errors of the drawing that they share, the most significant first.
    pub design: Vec<DesignError>,
    /// Each parameter.
    pub parameters: Vec<Common>,
    /// Devices unlike the others, by their places; they keep their own calibration.
    pub outliers: Vec<usize>,
    /// The parameters of each device with what the others tell; empty for outliers.
    #[cfg_attr(feature = "serde", serde(skip))]
    pub with_others: Vec<Vec<(f64, f64)>>,
    /// Of each share the device that it is of: the largest of its groups, numbered as they come.
    #[cfg_attr(feature = "serde", serde(skip))]
    pub device_of: Vec<usize>,
    /// The level of these groups among those that were given; none where shares are devices.
    #[cfg_attr(feature = "serde", serde(skip))]
    pub level: Option<usize>,
}

/// An error of the drawing.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[non_exhaustive]
pub struct DesignError {
    /// Id of the term.
    pub term: String,
    /// Target; `all` channels alike where the term has no other.
    pub target: String,
    /// Name of the parameter.
    pub name: String,
    /// What is to be added to the drawing, in `unit`.
    pub value: f64,
    /// Standard deviation, in `unit`.
    pub sd: f64,
    /// Unit.
    pub unit: String,
    /// Probability of as much by chance, for the whole fleet.
    pub p_value: f64,
    /// What would explain the fleet as well.
    pub also_fits: Vec<String>,
}

/// A parameter over the fleet.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[non_exhaustive]
pub struct Common {
    /// Id of the term.
    pub term: String,
    /// Target.
    pub target: String,
    /// Name of the parameter.
    pub name: String,
    /// Unit of the numbers.
    pub unit: String,
    /// `sd` of the drawing.
    pub tolerance: f64,
    /// Mean of the devices from the drawing.
    pub shift: f64,
    /// Standard deviation of the shift.
    pub sd: f64,
    /// Standard deviation between devices; one for all parameters of a term and name. With levels it is
    /// that of the level of devices. None where it cannot be told.
    pub between: Option<f64>,
    /// Interval of 95 % of `between`; the upper end is none where the fleet hardly tells, and both are where
    /// devices differ by less than their errors make them.
    pub between_interval: Option<(f64, Option<f64>)>,
    /// Standard deviation that is expected from one calibration to another of the design: of all levels
    /// together, and at least a hundredth of the tolerance.
    pub spread: f64,
    /// How groups of each level differ, what was given first; empty without levels.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Vec::is_empty"))]
    pub levels: Vec<Spread>,
}

/// The joint estimate of devices that have told their shares; `tolerances` belong to the terms by
/// the order of the parameters of a share. `levels` says for each level in which group each share is:
/// the largest groups are then the devices, and tell what the shares in them do beside the variances
/// of the smaller ones, (161).
///
/// # Errors
///
/// [`Error::Shape`] for a level that does not have a group for each share, [`Error::Option`] for levels
/// that cross.
pub fn found(shares: &[Share], tolerances: &[f64], levels: &[Vec<usize>]) -> Result<Found, Error> {
    let Some(first) = shares.first().filter(|first| !first.told.is_empty()) else {
        return Ok(Found::nothing(shares.len()));
    };
    let n = first.told.len();
    let matrix = |s: &Share| Mat::from_fn(n, n, |i, j| s.information[i * n + j]);
    let information: Vec<Mat<f64>> = shares.iter().map(matrix).collect();
    let told: Vec<Vec<f64>> = shares.iter().map(|s| s.told.clone()).collect();
    let class = classes(first);
    let (joint, of_used) = solve(&information, &told, tolerances, &class, levels)?;
    let differ = Differ::of(&of_used);
    let parameter = |(k, p): (usize, &crate::estimate::directions::ParameterReport)| {
        let (tolerance, c) = (tolerances[k], class[k]);
        let Differ { devices, spread, levels } = &differ[c];
        let devices = devices.times(tolerance);
        Common {
            term: p.term.clone(),
            target: p.target.clone(),
            name: p.name.clone(),
            unit: p.unit.clone(),
            tolerance,
            shift: joint.shift[k] * tolerance,
            sd: joint.covariance[(k, k)].max(0.0).sqrt() * tolerance,
            between: devices.sd,
            between_interval: devices.interval,
            spread: spread * tolerance,
            levels: levels.iter().map(|own| own.times(tolerance)).collect(),
        }
    };
    let with_others = joint.devices.iter().map(|d| {
        let own = d.mean.iter().zip(&d.sd).zip(tolerances);
        own.map(|((mean, sd), t)| (mean * t, sd * t)).collect()
    });
    Ok(Found {
        devices: joint.devices_used(),
        design: design(&joint, first),
        parameters: first.parameters.iter().enumerate().map(parameter).collect(),
        outliers: (0..joint.devices.len()).filter(|&d| joint.devices[d].outlier).collect(),
        with_others: with_others.collect(),
        device_of: of_used.largest(),
        level: of_used.level(),
    })
}

impl Found {
    /// Of devices that have no parameters.
    fn nothing(devices: usize) -> Self {
        Self {
            devices,
            design: Vec::new(),
            parameters: Vec::new(),
            outliers: Vec::new(),
            with_others: vec![Vec::new(); devices],
            device_of: (0..devices).collect(),
            level: None,
        }
    }
}

/// The variance that each parameter has: one for each name of a term.
fn classes(share: &Share) -> Vec<usize> {
    let mut kinds: Vec<(&str, &str)> = Vec::new();
    let mut class = Vec::new();
    for p in &share.parameters {
        let own = (p.term.as_str(), p.name.as_str());
        let at = kinds.iter().position(|k| *k == own).unwrap_or_else(|| {
            kinds.push(own);
            kinds.len() - 1
        });
        class.push(at);
    }
    class
}

/// How a class differs, in tolerances.
struct Differ {
    devices: Spread,
    /// Standard deviation of all levels together.
    spread: f64,
    levels: Vec<Spread>,
}

impl Differ {
    /// Of all classes.
    fn of(levels: &Levels) -> Vec<Self> {
        let spreads = levels.spreads();
        let devices = levels.level().map_or(0, |level| level + 1);
        // Units alone are no levels.
        let told = if spreads.len() > 1 { &spreads[..] } else { &[] };
        let one = |(c, total): (usize, f64)| Self {
            devices: spreads[devices][c],
            spread: total.max(LEAST).sqrt(),
            levels: told.iter().map(|own| own[c]).collect(),
        };
        levels.total().into_iter().enumerate().map(one).collect()
    }
}

fn design(joint: &Joint, share: &Share) -> Vec<DesignError> {
    let spec = |c: &Candidate| {
        let Spec { term, target, .. } = &c.spec;
        (term.clone(), target.clone().unwrap_or_else(|| "all".into()))
    };
    let called = |&k: &usize| {
        let (term, target) = spec(&share.candidates[k]);
        format!("{term}@{target}")
    };
    let of = |one: &crate::population::naming::Named| {
        let candidate = &share.candidates[one.candidate];
        let (term, target) = spec(candidate);
        let column = candidate.columns[0];
        let tolerance = joint.tolerances[column];
        DesignError {
            term,
            target,
            name: candidate.name.clone(),
            value: one.size * tolerance,
            sd: one.sd * tolerance,
            unit: share.parameters[column].unit.clone(),
            p_value: one.p_value,
            also_fits: one.also_fits.iter().map(called).collect(),
        }
    };
    named(joint, &share.candidates).iter().map(of).collect()
}
