//! What changes from group to group, in the shape of the JSON.

use crate::apply::accuracy::{PREDICTED, moved_by};
use crate::estimate::between::{Between, Grouping, Halves};
use crate::estimate::directions::{as_reported, parameter_names};
use crate::estimate::{Fit, Observations};
use crate::numerics::symmetric::told;

/// What changes from group to group: placements, or sessions.
///
/// `covariance` holds within the groups of the session. Parameters as means over groups, as another
/// session has them, have the covariance of this table; in one other group each of `parameters`
/// differs from that mean by its `sd` beside.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(rename = "Between")
)]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
pub struct BetweenReport {
    /// What tells groups apart.
    pub kind: Grouping,
    /// Names of the groups.
    pub groups: Vec<String>,
    /// Most likely standard deviation of the changes, in typical sizes of their parameters.
    pub sd: f64,
    /// Standard deviations between which it lies with 95 % probability.
    pub interval: [f64; 2],
    /// Probability by chance of groups that differ so much, were nothing to change.
    pub p_value: f64,
    /// Parameters that may change, and by how much they are expected to.
    pub parameters: Vec<ChangingReport>,
    /// Covariance of the parameters between groups, in their order and units; null where unknown.
    pub covariance: Vec<Vec<Option<f64>>>,
    /// One half of the groups against the other.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub halves: Option<HalvesReport>,
}

/// A parameter that may change from group to group.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(rename = "Changing")
)]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
pub struct ChangingReport {
    /// Id of the term.
    pub term: String,
    /// What the term belongs to.
    pub target: String,
    /// Name of the parameter.
    pub name: String,
    /// Standard deviation from group to group that is counted with: more than the most likely one
    /// where few groups tell of it.
    pub sd: f64,
    /// Its unit.
    pub unit: String,
}

/// Estimates of every other group against those of the rest: what cross-validation says.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(rename = "Halves")
)]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
pub struct HalvesReport {
    /// Names of the groups of each half.
    pub groups: [Vec<String>; 2],
    /// Root mean square difference of a coordinate of predicted positions, in `length_unit`.
    pub difference: f64,
    /// The same as the intervals within groups predict it.
    pub within: f64,
    /// The same with what changes from group to group.
    pub between: f64,
    /// χ² of the difference of the parameters per parameter, by what is within groups.
    pub chi2_within: f64,
    /// The same with what changes from group to group.
    pub chi2_between: f64,
    /// True where each half has told on its own how much changes; else all groups have, the
    /// difference among them.
    pub own: bool,
}

/// In words and numbers.
#[must_use]
pub fn report(observations: &Observations, fit: &Fit, between: &Between) -> BetweenReport {
    let names = parameter_names(observations, fit);
    let shifts = between.shifts();
    let changing = between.changing.iter().map(|(column, _)| {
        let name = names[*column].clone();
        let sd = shifts[*column];
        ChangingReport {
            term: name.term,
            target: name.target,
            name: name.name,
            sd,
            unit: name.unit,
        }
    });
    let (_, map) = as_reported(fit);
    let covariance = &map * &between.covariance * map.transpose();
    let n = covariance.nrows();
    let known = |i, j| Some(covariance[(i, j)]).filter(|c: &f64| c.is_finite());
    BetweenReport {
        kind: between.grouping,
        groups: between.groups.clone(),
        sd: between.component.sd,
        interval: between.component.interval,
        p_value: between.component.p_value,
        parameters: changing.collect(),
        covariance: (0..n).map(|i| (0..n).map(|j| known(i, j)).collect()).collect(),
        halves: between.halves.as_ref().and_then(|it| halves(observations, fit, between, it)),
    }
}

fn halves(
    observations: &Observations,
    fit: &Fit,
    between: &Between,
    halves: &Halves,
) -> Option<HalvesReport> {
    let poses = (&observations.readings.table, PREDICTED);
    let covariances = [&halves.within, &halves.between];
    let moved = moved_by(observations, fit, poses, &halves.difference, covariances).ok()?;
    let terms = fit.model.term_parameters;
    let chi2 = covariances.map(|covariance| {
        let own = covariance.submatrix(0, 0, terms, terms);
        let (chi2, told) = told(own, &halves.difference[..terms]);
        chi2 / told
    });
    let names = |half: &Vec<usize>| half.iter().map(|g| between.groups[*g].clone()).collect();
    let [difference, within, between] = moved;
    let [chi2_within, chi2_between] = chi2;
    let finite = difference.is_finite() && chi2_within.is_finite() && chi2_between.is_finite();
    finite.then(|| HalvesReport {
        groups: halves.groups.each_ref().map(names),
        difference,
        within,
        between,
        chi2_within,
        chi2_between,
        own: halves.own,
    })
}
