//! What a fleet has in common, in the shape of `population.json`.

use faer::Mat;

use crate::Error;
use crate::model::Spec;
use crate::numerics::distributions::chi2_quantile;
use crate::population::joint::{Joint, solve};
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
    /// Standard deviation between devices; one for all parameters of a term and name.
    pub between: f64,
    /// Interval of 95 % of `between`; the upper end is null where the fleet hardly tells.
    pub between_interval: (f64, Option<f64>),
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
/// As [`Levels::new`]; [`Error::Option`] for levels that cross.
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
    let mut information: Vec<Mat<f64>> = shares.iter().map(matrix).collect();
    let mut told: Vec<Vec<f64>> = shares.iter().map(|s| s.told.clone()).collect();
    let (mut spreads, mut device_of, mut level) = (Vec::new(), (0..shares.len()).collect(), None);
    if !levels.is_empty() {
        // In tolerances, as the joint estimate has them.
        let by = |i: usize| tolerances[i];
        let scaled: Vec<Mat<f64>> = information
            .iter()
            .map(|h| Mat::from_fn(n, n, |i, j| h[(i, j)] * by(i) * by(j)))
            .collect();
        let own: Vec<Vec<f64>> =
            told.iter().map(|h| h.iter().enumerate().map(|(i, h)| h * by(i)).collect()).collect();
        let of = Levels::new(&scaled, &own, &class, levels, 1.0)?;
        let Some(sums) = of.devices() else {
            let expected = "levels that nest, for what devices share";
            return Err(Error::option("levels", "levels that cross", expected));
        };
        spreads = of.spreads();
        (device_of, level) = (of.largest(), of.level());
        let unscaled = |(h, _): &(Vec<f64>, Vec<f64>)| {
            Mat::from_fn(n, n, |i, j| h[i * n + j] / (by(i) * by(j)))
        };
        information = sums.iter().map(unscaled).collect();
        told = sums.iter().map(|(_, h)| (0..n).map(|i| h[i] / by(i)).collect()).collect();
    }
    let joint = solve(&information, &told, tolerances, &class);
    let parameter = |(k, p): (usize, &crate::estimate::directions::ParameterReport)| {
        let (tolerance, c) = (tolerances[k], class[k]);
        let (low, high) = interval(joint.between[c], joint.known[c]);
        Common {
            term: p.term.clone(),
            target: p.target.clone(),
            name: p.name.clone(),
            unit: p.unit.clone(),
            tolerance,
            shift: joint.shift[k] * tolerance,
            sd: joint.covariance[(k, k)].max(0.0).sqrt() * tolerance,
            between: joint.between[c] * tolerance,
            between_interval: (low * tolerance, high.map(|high| high * tolerance)),
            levels: spreads.iter().map(|own: &Vec<Spread>| own[c].times(tolerance)).collect(),
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
