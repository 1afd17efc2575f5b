//! What is known beside the readings that are fitted, and what it says of a calibration.

use crate::Error;
use crate::apply::accuracy::{KNOWN, PREDICTED, predicted};
use crate::apply::check::Check;
use crate::apply::earlier::{self, Applied, Reference, Reported};
use crate::apply::groups::{groups_of, spread};
use crate::diagnosis::plausibility::is_open;
use crate::diagnosis::verdict::{Compared, Determined};
use crate::estimate::noise::source::Source;
use crate::estimate::{Fit, Observations};
use crate::mechanism::Mechanism;
use crate::monitor::closing::{Closing, OpenLoops, Scale, SomePoses, closing, times_open};
use crate::readings::{self, Table, runs_of_poses};
use crate::report::named::Named;
use crate::report::result::{Estimates, FitReport, Known, parameters};
use crate::terms::term::Placed;

/// What is known beside the readings that are fitted, to judge a calibration by.
#[derive(Debug, Clone)]
pub struct Beside {
    /// The mechanism as it is declared, or as an earlier result has it.
    pub mechanism: Mechanism,
    /// Nothing but that mechanism, applied to other readings.
    pub declared: Applied,
    /// Known poses.
    pub known: Option<Known>,
    /// Groups, those among them that were not fitted.
    pub touched: Option<Touched>,
}

/// All readings of a mechanism that touches unknown points, those included that are not fitted.
#[derive(Debug, Clone)]
pub struct Touched {
    /// The readings.
    pub table: Table,
    /// Group of each row; none: by the first column that tells unknown points apart.
    pub groups: Option<Vec<String>>,
    /// Groups that were fitted; none: all but those of `leave`.
    pub keep: Option<Vec<String>>,
    /// Groups that were not fitted; none: all but those of `keep`.
    pub leave: Option<Vec<String>>,
    /// True where sessions have the numbers here that they have in the fit.
    pub own: bool,
}

/// Mean distance of carried points from their own mean at what they touch, by placement.
///
/// `docs/measured.md` says how the measure is formed. Null where there are no such groups.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(rename = "Groups")
)]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
pub struct GroupsReport {
    /// Mean over the groups that were fitted [unit].
    pub fitted: Option<f64>,
    /// Mean over the groups that the fit has not seen [unit].
    pub others: Option<f64>,
    /// Group by group [unit].
    pub by_group: Named,
    /// Unit of all of them.
    pub unit: String,
    /// `fitted` with the mechanism as it is declared.
    #[cfg_attr(feature = "serde", serde(default))]
    pub nominal_fitted: Option<f64>,
    /// `others` with the mechanism as it is declared.
    #[cfg_attr(feature = "serde", serde(default))]
    pub nominal_others: Option<f64>,
    /// `fitted` before effects were traced.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub before_fitted: Option<f64>,
    /// `others` before effects were traced.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub before_others: Option<f64>,
    /// Coordinates that the poses of the groups that were not fitted have.
    #[cfg_attr(feature = "serde", serde(skip))]
    coordinates: f64,
    /// Predicted standard deviation of a coordinate of a carried point there.
    #[cfg_attr(feature = "serde", serde(skip))]
    predicted: Option<f64>,
}

impl Beside {
    /// Error of the mechanism as it is declared on the known poses, where there are any.
    ///
    /// # Errors
    ///
    /// As [`earlier::check`].
    pub fn nominal(&self) -> Result<Option<FitReport>, Error> {
        let Some(known) = &self.known else { return Ok(None) };
        let of = |align| earlier::check(&self.mechanism, &self.declared, known, align);
        let aligned = known.align.then(|| of(true)).transpose()?;
        Ok(Some(FitReport { check: Some(of(false)?), aligned, ..FitReport::default() }))
    }

    /// Loops of the known poses that do not close under a fit, reported as `estimates`, as those of its session
    /// do; none where they do, where they cannot be looked at, or where the arm is away from what it is held at. What
    /// happened once, or depends on the way,
    /// may be otherwise at known poses that were read before or after.
    ///
    /// # Errors
    ///
    /// As [`closing`].
    pub(crate) fn open_loops(
        beside: Option<&Self>,
        determined: Determined,
        (observations, fit): (&Observations, &Fit),
        estimates: &Estimates,
        check: Option<Check>,
    ) -> Result<Option<OpenLoops>, Error> {
        let known = beside.and_then(|beside| beside.known.as_ref());
        let known = known.filter(|known| known.closes && determined == Determined::Yes);
        let Some(Known { table, .. }) = known else { return Ok(None) };
        let (applied, covariance) = estimates.applied();
        // Where no parameter was determined nothing could have changed.
        let told = covariance.iter().any(|v| *v != 0.0);
        let lasts = fit
            .model
            .instances
            .iter()
            .all(|i| i.term.of_pose() && !matches!(i.term.placed(), Placed::AtPose));
        if !(told && lasts) {
            return Ok(None);
        }
        let mechanism = &observations.mechanism;
        let noise = &estimates.noise;
        let scale = Scale {
            residual: fit.chi2 / fit.dof.max(1.0),
            dof: noise.dof,
            correlation: noise.correlation.unwrap_or(0.0),
        };
        readings::check(mechanism, table)?;
        let readings = SomePoses::of_table(table, mechanism.channels.len());
        let found = closing(mechanism, &applied, Some(&covariance), readings, scale)?;
        let own = estimates.misclosure.whole();
        Ok(found.and_then(|found| open_loops(mechanism, &found, own, check)))
    }

    /// How well groups are repeated under a fit, and under the one before effects were traced; none
    /// where no unknown points are touched.
    ///
    /// # Errors
    ///
    /// As [`spread`].
    pub fn groups(
        &self,
        (observations, fit): (&Observations, &Fit),
        before: Option<(&Observations, &Fit)>,
    ) -> Result<Option<GroupsReport>, Error> {
        let Some(touched) = &self.touched else { return Ok(None) };
        let of = |applied: &Applied| {
            spread(&self.mechanism, applied, &touched.table, touched.groups.as_deref())
        };
        let by_group = of(&applied(observations, fit, touched.own))?;
        if by_group.is_empty() {
            return Ok(None);
        }
        let nominal = of(&self.declared)?;
        let before = before
            .map(|(observations, fit)| of(&applied(observations, fit, touched.own)))
            .transpose()?
            .unwrap_or_default();
        let others = by_group.iter().filter(|(name, _)| touched.is_other(name)).count();
        let predicted = match others {
            0 => None,
            _ => Some(predicted(observations, fit, &touched.table, PREDICTED)?.position_sd),
        };
        Ok(Some(GroupsReport {
            fitted: mean(&by_group, |name| touched.is_fitted(name)),
            others: mean(&by_group, |name| touched.is_other(name)),
            nominal_fitted: mean(&nominal, |name| touched.is_fitted(name)),
            nominal_others: mean(&nominal, |name| touched.is_other(name)),
            before_fitted: mean(&before, |name| touched.is_fitted(name)),
            before_others: mean(&before, |name| touched.is_other(name)),
            coordinates: touched.coordinates(&self.mechanism)?,
            predicted: predicted.filter(|sd| sd.is_finite()),
            by_group: Named(by_group),
            unit: self.mechanism.length_unit.clone(),
        }))
    }
}

impl Touched {
    /// Three for each pose of the groups that were not fitted.
    fn coordinates(&self, mechanism: &Mechanism) -> Result<f64, Error> {
        let groups = groups_of(mechanism, &self.table, self.groups.as_deref())?.unwrap_or(&[]);
        let poses = runs_of_poses(&self.table, mechanism.channels.len()).into_iter();
        let own = poses.filter(|run| groups.get(run.start).is_some_and(|g| self.is_other(g)));
        Ok((3 * own.count()) as f64)
    }

    fn is_fitted(&self, name: &String) -> bool {
        self.keep.as_ref().is_none_or(|keep| keep.contains(name))
            && self.leave.as_ref().is_none_or(|leave| !leave.contains(name))
    }

    fn is_other(&self, name: &String) -> bool {
        match (&self.keep, &self.leave) {
            (Some(_), Some(leave)) => leave.contains(name),
            _ => !self.is_fitted(name),
        }
    }
}

impl GroupsReport {
    /// Groups that were not fitted beside what the fitted ones leave and the parameters add: errors of these
    /// take as much from what a fit leaves of its own readings as they add to others, in each of three
    /// coordinates.
    #[must_use]
    pub fn expected(&self) -> Option<Compared> {
        let added = (2.0_f64 * 3.0).sqrt() * self.predicted?;
        let other = self.fitted?.hypot(added);
        Some(Compared::of_errors(self.others?, other, self.coordinates))
    }

    /// Groups that were not fitted beside the mechanism as it is declared, and beside the fit without
    /// the effects found.
    #[must_use]
    pub fn compared(&self) -> [Option<Compared>; 2] {
        let with =
            |other: Option<f64>| Some(Compared::of_errors(self.others?, other?, self.coordinates));
        [with(self.nominal_others), with(self.before_others)]
    }
}

fn mean(by_group: &[(String, f64)], wanted: impl Fn(&String) -> bool) -> Option<f64> {
    let values = by_group.iter().filter(|(name, _)| wanted(name)).map(|(_, value)| value);
    let (sum, count) = values.fold((0.0, 0.0), |(sum, count), value| (sum + value, count + 1.0));
    (count > 0.0).then_some(sum / count)
}

/// A fit on its way to readings that it has not seen.
fn applied(observations: &Observations, fit: &Fit, own: bool) -> Applied {
    let reported = parameters(observations, fit).into_iter();
    let known = reported.filter(|p| p.value.is_finite());
    let of = |p: crate::estimate::directions::ParameterReport| Reported {
        spec: p.spec(),
        name: p.name,
        value: p.value,
    };
    Applied {
        parameters: known.map(of).collect(),
        reference: Reference::of(observations),
        sigma: fit.noise.sigma.clone(),
        closures: fit.noise.of_closures(&fit.model),
        declared: fit.noise.source == Source::Declared,
        own,
    }
}

/// Loops that are open in readings that a result has not seen, beside the misclosure of its `own` session where it is
/// known; none of an arm that has left what it is held at. `check`: how far known poses are from where the result has
/// them.
#[doc(hidden)]
#[must_use]
pub fn open_loops(
    mechanism: &Mechanism,
    found: &Closing,
    own: Option<f64>,
    check: Option<Check>,
) -> Option<OpenLoops> {
    let left = |open: &OpenLoops| {
        mechanism.may_leave()
            && match check {
                Some(check) => is_away(open, &check),
                None => is_far(mechanism, open),
            }
    };
    found.open(own).filter(|open| !left(open))
}

/// True where an arm is where it should be, by known poses, and open by many times more than it is off there.
fn is_away(open: &OpenLoops, check: &Check) -> bool {
    let right = check.predicted.is_some_and(|expected| expected.p_value > KNOWN);
    right && open.rms_misclosure > times_open() * check.position_rms
}

/// True where an arm is far from closed that keeps three motions at what it is held at, and so can have its point
/// anywhere about. Of linkages, which keep fewer, loops that stay open by as much tell that they are others.
fn is_far(mechanism: &Mechanism, open: &OpenLoops) -> bool {
    let joints = mechanism.chains.iter().flat_map(|chain| &chain.rows);
    let joints = joints.filter(|row| row.channel.is_some()).count();
    joints >= mechanism.equations() + 3 && is_open(mechanism, open.rms_misclosure)
}
