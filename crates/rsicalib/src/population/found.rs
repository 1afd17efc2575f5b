//! What a fleet has in common, in the shape of `population.json`.

use faer::Mat;

use crate::Error;
use crate::model::Spec;
use crate::numerics::distributions::chi2_quantile;
use crate::population::joint::{Joint, LEAST, Told, solve, solve_told};
use crate::population::levels::{Levels, Spread};
use crate::population::naming::{Candidate, named};
use crate::population::share::Share;

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
    /// that of the level of devices, and none where it cannot be told.
    pub between: Option<f64>,
    /// Interval of 95 % of `between`; the upper end is null where the fleet hardly tells.
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
    let Some(first) = shares.first() else {
        return Ok(Found {
            devices: 0,
            design: Vec::new(),
            parameters: Vec::new(),
            outliers: Vec::new(),
            with_others: Vec::new(),
            device_of: Vec::new(),
            level: None,
        });
    };
    let mut kinds: Vec<(&str, &str)> = Vec::new();
    let mut class = Vec::new();
    for p in &first.parameters {
        let own = (p.term.as_str(), p.name.as_str());
        let at = kinds.iter().position(|k| *k == own).unwrap_or_else(|| {
            kinds.push(own);
            kinds.len() - 1
        });
        class.push(at);
    }
    let n = first.told.len();
    let matrix = |s: &Share| Mat::from_fn(n, n, |i, j| s.information[i * n + j]);
    let information: Vec<Mat<f64>> = shares.iter().map(matrix).collect();
    let told: Vec<Vec<f64>> = shares.iter().map(|s| s.told.clone()).collect();
    let (joint, differ, device_of, level) = if levels.is_empty() || n == 0 {
        let joint = solve(&information, &told, tolerances, &class);
        let differ = (0..joint.between.len()).map(|c| Differ::of(&joint, c)).collect();
        (joint, differ, (0..shares.len()).collect(), None)
    } else {
        // In tolerances, as the joint estimate has them.
        let by = |i: usize| tolerances[i];
        let scaled = |h: &Mat<f64>| Mat::from_fn(n, n, |i, j| h[(i, j)] * by(i) * by(j));
        let information: Vec<Mat<f64>> = information.iter().map(scaled).collect();
        let scaled = |h: &Vec<f64>| h.iter().enumerate().map(|(i, h)| h * by(i)).collect();
        let told: Vec<Vec<f64>> = told.iter().map(scaled).collect();
        let all = Levels::new(&information, &told, &class, levels, 1.0)?;
        if !all.nests() {
            let expected = "levels that nest, for what devices share";
            return Err(Error::option("levels", "levels that cross", expected));
        }
        let device_of = all.largest();
        let devices = device_of.iter().max().map_or(0, |d| d + 1);
        let mut others = None;
        let joint = solve_told(devices, tolerances, &class, |used| {
            let out: Vec<bool> = used.iter().map(|used| !used).collect();
            let others = others.insert(all.without(&out));
            let (information, told) = all.devices(others).into_iter().unzip();
            Told { information, told, variance: Some(others.top()) }
        });
        let others = others.unwrap_or(all);
        (joint, Differ::of_levels(&others), device_of, others.level())
    };
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
        device_of,
        level,
    })
}

/// How a class differs, in tolerances.
struct Differ {
    devices: Spread,
    /// Standard deviation of all levels together.
    spread: f64,
    levels: Vec<Spread>,
}

impl Differ {
    /// Of devices without levels.
    fn of(joint: &Joint, c: usize) -> Self {
        let (spread, known) = (joint.between[c], joint.known[c]);
        let (groups, interval) = (joint.devices_used(), Some(interval(spread, known)));
        let devices = Spread { groups, sd: Some(spread), interval, same_as: None };
        Self { devices, spread, levels: Vec::new() }
    }

    /// Of all classes.
    fn of_levels(levels: &Levels) -> Vec<Self> {
        let spreads = levels.spreads();
        let devices = levels.level().map_or(0, |level| level + 1);
        let one = |(c, total): (usize, f64)| Self {
            devices: spreads[devices][c],
            spread: total.max(LEAST).sqrt(),
            levels: spreads.iter().map(|own| own[c]).collect(),
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

/// Interval of 95 % of a standard deviation that so many deviations have determined; no upper end
/// for less than one.
fn interval(sd: f64, known: f64) -> (f64, Option<f64>) {
    if known < 1.0 {
        return (0.0, None);
    }
    // `chi2_quantile` counts from above.
    let end = |p: f64| sd * (known / chi2_quantile(p, known)).sqrt();
    (end(0.025), Some(end(0.975)))
}
