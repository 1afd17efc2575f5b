//! Results as users hold them: plain structs in the shape of the JSON.

use crate::Error;
use crate::apply::accuracy::{PREDICTED, Predicted, predicted};
use crate::apply::check::{Check, check};
use crate::apply::earlier::{Applied, Reference, Reported};
pub use crate::apply::known::Known;
use crate::diagnosis::held_out::HeldOut;
use crate::diagnosis::verdict::Compared;
use crate::estimate::directions::{
    Directions, ParameterReport, as_reported, parameter_names, reported,
};
use crate::estimate::noise::source::Source;
use crate::estimate::tried::{Gains, Origin, Try};
use crate::estimate::{AnchorKind, Fit, Observations, Part, intervals, times};
use crate::numerics::lm::Termination;
use crate::numerics::order;
use crate::readings::Readings;
use crate::report::between::{self, BetweenReport};
use crate::report::named::Named;
use crate::report::touched_instead::touched_instead;
use crate::report::warned::{self, Warned};
use crate::report::words;
use crate::screening::excluded::{Cause, Excluded};

/// Noise of one sample, by channel, and where it is known from.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(rename = "Noise")
)]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
pub struct NoiseReport {
    /// Where the noise is known from, in words.
    pub source: String,
    /// Standard deviation by channel, in each channel's unit, quantisation included.
    pub sigma: Named,
    /// Degrees of freedom; null where the noise was declared.
    pub dof: Option<f64>,
    /// Correlation of neighbouring samples.
    pub correlation: Option<f64>,
    /// Unit of the readings, by channel.
    #[cfg_attr(feature = "serde", serde(default))]
    pub unit: Named<String>,
    /// Where the noise is known from; null in results of earlier versions.
    #[cfg_attr(feature = "serde", serde(default))]
    pub kind: Option<Source>,
    /// How well what is touched holds its place, where only the fit tells it, in `length_unit`.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub seating: Option<f64>,
    /// How well each closure holds, one draw for each seating: the standard deviation as it is
    /// declared, or as only the fit tells it, in `length_unit` or as equal coordinates count.
    /// Closures that hold exactly are not listed.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Named::is_empty"))]
    pub closures: Named,
}

/// How well a model fits.
#[derive(Debug, Clone, PartialEq, Default)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(rename = "FitQuality")
)]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
pub struct FitReport {
    /// χ² between poses.
    pub chi2: Option<f64>,
    /// Its degrees of freedom.
    pub dof: Option<f64>,
    /// Probability of a larger χ² by chance; null where lack of fit cannot be judged.
    pub p_value: Option<f64>,
    /// Error of the closures of single samples, in `misclosure_unit`; that of `held_out` is of the means of
    /// held poses.
    pub rms_misclosure: Option<f64>,
    /// Unit of `rms_misclosure`: of length, or of the coordinates that closures make equal.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub misclosure_unit: Option<String>,
    /// Error on poses left out.
    #[cfg_attr(feature = "serde", serde(default))]
    pub held_out: Option<HeldOut>,
    /// Error on known poses.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub check: Option<Check>,
    /// As `check`, after the best rigid motion of the instrument.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub aligned: Option<Check>,
}

impl FitReport {
    /// Of a fit.
    #[must_use]
    pub fn of(fit: &Fit) -> Self {
        Self {
            chi2: Some(fit.chi2),
            dof: Some(fit.dof),
            p_value: fit.p_value,
            rms_misclosure: Some(fit.rms_misclosure),
            misclosure_unit: Some(fit.model.misclosure_unit().into()),
            ..Self::default()
        }
    }

    /// χ² per degree of freedom, where there are any.
    #[must_use]
    pub fn chi2_per_dof(&self) -> Option<f64> {
        self.dof.filter(|dof| *dof >= 1.0).and_then(|dof| Some(self.chi2? / dof))
    }

    /// Error on known poses, after the best rigid motion of the instrument where that was asked for.
    #[must_use]
    pub fn checked(&self) -> Option<Check> {
        self.aligned.or(self.check)
    }

    /// How this fit compares with another, the mechanism as it is declared for one.
    #[must_use]
    pub fn beside(&self, other: &Self) -> Option<Compared> {
        Some(Compared::of(&self.checked()?, &other.checked()?))
    }
}

/// A start that was tried.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(rename = "Start")
)]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
pub struct StartReport {
    /// Where the start began.
    pub from: String,
    /// `fᵀf` where the start ended.
    pub cost: Option<f64>,
    /// χ² where it ended, by the noise that is assumed, of the samples that the search of starts uses; null where a
    /// gain went to zero.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub chi2: Option<f64>,
    /// True where a gain went to zero: the trivial solution.
    #[cfg_attr(feature = "serde", serde(default))]
    pub collapsed: Option<bool>,
    /// The reading of each channel whose coordinate is known or presumed; null in results of earlier
    /// versions, as `gains`.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub anchor: Option<AnchorKind>,
    /// Gains from which it began.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub gains: Option<StartGains>,
}

/// Gains from which a start began.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
#[non_exhaustive]
pub enum StartGains {
    /// As they are declared.
    Declared,
    /// All of them times one factor, with offsets tied to the anchor.
    Scaled,
    /// Each times a factor of its own, with offsets tied to the anchor.
    Scattered,
}

impl StartReport {
    fn of(tried: &Try) -> Self {
        let (anchor, gains) = match tried.from {
            Origin::Anchor(anchor) => (anchor, StartGains::Declared),
            Origin::Tied(anchor, Gains::Times(_)) => (anchor, StartGains::Scaled),
            Origin::Tied(anchor, Gains::Scattered(_)) => (anchor, StartGains::Scattered),
        };
        Self {
            from: words::origin(tried.from),
            cost: Some(tried.cost),
            chi2: Some(tried.chi2).filter(|chi2| chi2.is_finite()),
            collapsed: Some(tried.collapsed),
            anchor: Some(anchor),
            gains: Some(gains),
        }
    }
}

/// Reference statistics of the misclosure: how the loops close under a result.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(rename = "Misclosure")
)]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
pub struct MisclosureReport {
    /// Root mean square by closure, in units of length.
    pub rms: Named,
    /// Degrees of freedom of the noise; null where it was declared.
    pub dof: Option<f64>,
    /// Correlation of neighbouring samples.
    pub correlation: f64,
    /// Usual time between neighbouring samples, in seconds; null without times.
    pub interval_s: Option<f64>,
}

/// Reference statistics of the misclosure of a fit.
#[must_use]
pub fn misclosure(observations: &Observations, fit: &Fit) -> MisclosureReport {
    let Observations { readings, mechanism, weights, .. } = observations;
    let part = Part { model: &fit.model, readings, weights: Some(weights) };
    let squares = part.mean_square_lengths(&fit.beta);
    let mut first = 0;
    let mut rms = Vec::with_capacity(mechanism.closures.len());
    for (number, closure) in mechanism.closures.iter().enumerate() {
        let own = first..first + fit.model.equations_of(number);
        first = own.end;
        let count = own.len().max(1) as f64;
        let mean = squares[own].iter().sum::<f64>() / count;
        rms.push((closure.name.clone(), mean.sqrt()));
    }
    MisclosureReport {
        rms: Named(rms),
        dof: fit.noise.dof.is_finite().then_some(fit.noise.dof),
        correlation: fit.noise.correlation,
        interval_s: interval(readings),
    }
}

/// Median time between neighbouring rows of one pose, or of a recording.
fn interval(readings: &Readings) -> Option<f64> {
    let time = readings.table.time.as_ref()?;
    let same = |row: &usize| !readings.held || readings.pose[*row] == readings.pose[row - 1];
    let steps = (1..readings.samples).filter(same).map(|row| time[row] - time[row - 1]);
    let mut steps: Vec<f64> = steps.filter(|step| *step > 0.0).collect();
    order::sort(&mut steps);
    steps.get(steps.len() / 2).copied()
}

/// Everything about one fit.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Estimates {
    /// Noise.
    pub noise: NoiseReport,
    /// How the loops close.
    pub misclosure: MisclosureReport,
    /// Parameters.
    pub parameters: Vec<ParameterReport>,
    /// What must be noted of them.
    pub remarks: Vec<Warned>,
    /// Their covariance, row by row.
    pub covariance: Vec<Vec<f64>>,
    /// What changes from group to group.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub between: Option<BetweenReport>,
    /// Predicted error at the poses of the session; none where the data determine no calibration.
    pub predicted: Option<Predicted>,
    /// What these poses cannot tell apart, in words.
    pub unobservable: Vec<String>,
    /// Terms without which these poses would determine the rest.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Vec::is_empty"))]
    pub too_many: Vec<String>,
    /// What they hardly tell apart.
    pub weak: Vec<String>,
    /// What the parameters refer to.
    pub reference: Reference,
    /// Condition number, offsets about the mean reading.
    pub condition: f64,
    /// Condition number with offsets at reading zero.
    pub condition_uncentred: f64,
    /// Starts tried.
    pub starts: Vec<StartReport>,
    /// Why the search ended, in words.
    pub termination: String,
    /// Why the search ended.
    pub termination_kind: Termination,
    /// True where it ended at a minimum in which every joint moves.
    pub converged: bool,
    /// Linearisations made.
    pub iterations: usize,
}

impl Estimates {
    /// The result on its way to other readings, and the covariance of its parameters, row by row.
    pub(crate) fn applied(&self) -> (Applied, Vec<f64>) {
        (Applied::from(self), self.covariance.concat())
    }

    /// Predicted error of positions, and that by what is known without readings.
    pub(crate) fn beforehand(&self) -> Option<[f64; 2]> {
        let predicted = self.predicted?;
        Some([predicted.position_sd, predicted.beforehand?])
    }

    /// Says first that nothing is left to check the parameters with, where that is so.
    pub(crate) fn say_what_is_left(&mut self, observations: &Observations, fit: &Fit) {
        if fit.dof < 1.0 {
            let poses = observations.readings.poses() - observations.copies.len();
            self.unobservable.insert(0, words::nothing_left(fit.beta.len(), poses));
        }
    }
}

/// A result on its way to other readings than its own.
impl From<&Estimates> for Applied {
    fn from(found: &Estimates) -> Self {
        let of =
            |p: &ParameterReport| Reported { spec: p.spec(), name: p.name.clone(), value: p.value };
        Self {
            parameters: found.parameters.iter().map(of).collect(),
            reference: found.reference.clone(),
            sigma: found.noise.sigma.0.iter().map(|(_, sigma)| *sigma).collect(),
            closures: found.noise.closures.0.clone(),
            declared: found.noise.kind.is_some_and(Source::is_declared),
            own: false,
        }
    }
}

/// Every parameter with its value and its standard deviation.
#[must_use]
pub fn parameters(observations: &Observations, fit: &Fit) -> Vec<ParameterReport> {
    let (values, covariance) = reported(fit);
    let mut parameters = parameter_names(observations, fit);
    let (_, map) = as_reported(fit);
    let between = fit.between.as_ref().map(|b| &map * &b.covariance * map.transpose());
    for (k, p) in parameters.iter_mut().enumerate() {
        p.value = values[k];
        let told = between.as_ref().filter(|_| !fit.unknowable[k]);
        p.sd_between = told.map(|covariance| covariance[(k, k)].max(0.0).sqrt());
        p.sd = (!fit.unknowable[k]).then(|| covariance[(k, k)].max(0.0).sqrt());
    }
    parameters.into_iter().map(ParameterReport::noted).collect()
}

/// The same in words and numbers.
#[must_use]
pub fn estimates(observations: &Observations, fit: &Fit, directions: &Directions) -> Estimates {
    let (_, covariance) = reported(fit);
    let mechanism = &observations.mechanism;
    let n = covariance.nrows();
    let names = || mechanism.channels.iter().map(|c| c.name.clone());
    let sigma = names().zip(fit.noise.sigma.iter().copied());
    let unit = names().zip(mechanism.channels.iter().map(|c| c.unit.clone()));
    let mut parameters = parameters(observations, fit);
    for (p, ends) in parameters.iter_mut().zip(intervals(observations, fit)) {
        let bound = |end: f64| Some(p.value + end).filter(|bound| bound.is_finite());
        p.interval = ends.map(|ends| ends.map(bound));
    }
    let labels = &observations.readings.labels;
    let instances = fit.model.instances.iter().zip(&fit.model.first);
    for ((instance, first), times) in instances.zip(times(observations, fit)) {
        let names = times.map(|ends| ends.map(|pose| labels[pose].to_string()));
        for p in &mut parameters[*first..first + instance.width()] {
            p.place_interval.clone_from(&names);
        }
    }
    Estimates {
        noise: NoiseReport {
            kind: Some(fit.noise.source),
            source: words::noise(&fit.noise),
            sigma: Named(sigma.collect()),
            dof: fit.noise.dof.is_finite().then_some(fit.noise.dof),
            correlation: Some(fit.noise.correlation),
            unit: Named(unit.collect()),
            seating: fit.noise.largest_seating(),
            closures: Named(fit.noise.of_closures(&fit.model)),
        },
        misclosure: misclosure(observations, fit),
        remarks: parameters.iter().filter_map(warned::of_parameter).collect(),
        parameters,
        covariance: (0..n).map(|i| (0..n).map(|j| covariance[(i, j)]).collect()).collect(),
        between: fit.between.as_ref().map(|between| between::report(observations, fit, between)),
        predicted: fit
            .stands()
            .then(|| predicted(observations, fit, &observations.readings.table, PREDICTED).ok())
            .flatten()
            // Where nothing was fitted that moves the points, they are as declared.
            .filter(|error| error.position_sd.is_finite() && error.position_sd > 0.0),
        unobservable: words::directions(directions),
        too_many: directions.too_many.iter().map(ToString::to_string).collect(),
        reference: Reference::of(observations),
        weak: directions.weak.iter().map(words::direction).collect(),
        condition: fit.condition,
        condition_uncentred: crate::estimate::directions::uncentred_condition(fit),
        starts: fit.starts.iter().map(StartReport::of).collect(),
        termination: words::termination(fit.termination).into(),
        termination_kind: fit.termination,
        converged: fit.converged(),
        iterations: fit.iterations,
    }
}

/// A reading that was found to be bad; null: all of them.
#[derive(Debug, Clone, PartialEq, Eq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(rename = "Excluded")
)]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
pub struct ExcludedReport {
    /// Label of the pose.
    pub pose: Option<i64>,
    /// Sample of the pose, counted from 1.
    pub sample: Option<i64>,
    /// Values of the columns that tell its unknown points apart.
    pub group: Option<String>,
    /// The chain at fault.
    pub chain: Option<String>,
    /// The channel at fault.
    pub channel: Option<String>,
    /// Why.
    pub reason: String,
    /// How many samples that are.
    #[cfg_attr(feature = "serde", serde(default))]
    pub samples: Option<u64>,
    /// Why, for programs.
    #[cfg_attr(feature = "serde", serde(default))]
    pub kind: ExcludedKind,
    /// Session of the pose, counted from 1, where there are several.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub session: Option<u64>,
    /// What a sample touches, by the values of its columns, where that is by far not what its row names.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub touches: Option<String>,
}

/// Why readings are left out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
#[non_exhaustive]
pub enum ExcludedKind {
    /// Bits of the converter are stuck: the readings stay, and count as noisier.
    StuckBits,
    /// The converter is clipped.
    Clipped,
    /// A sample stands off the other samples of its pose.
    Outlier,
    /// The pose moved while it was sampled.
    Unsteady,
    /// One reading of the pose is wrong.
    Reading,
    /// The pose is wrong, and no single channel explains it.
    Pose,
    /// The placement does not fit its siblings.
    Placement,
    /// The point that is touched moved half-way.
    PointMoved,
    /// The tool moved half-way.
    ToolMoved,
    /// A single sample of a run stands off.
    Sample,
    /// A kind of a later version, or of an earlier one that has the reason alone.
    #[default]
    #[cfg_attr(feature = "serde", serde(other))]
    Other,
}

impl ExcludedKind {
    fn of(cause: &Cause) -> Self {
        match cause {
            Cause::StuckBits { .. } => Self::StuckBits,
            Cause::Clipped { .. } => Self::Clipped,
            Cause::Outlier { .. } => Self::Outlier,
            Cause::Unsteady { .. } => Self::Unsteady,
            Cause::Reading(_) => Self::Reading,
            Cause::Pose { .. } => Self::Pose,
            Cause::Placement { .. } => Self::Placement,
            Cause::Moved { tool: false, .. } => Self::PointMoved,
            Cause::Moved { tool: true, .. } => Self::ToolMoved,
            Cause::Sample { .. } => Self::Sample,
        }
    }
}

/// The calibration of all readings, where some were left out.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
pub struct WithExcluded {
    /// How well the model fits.
    pub fit: FitReport,
    /// Estimates.
    pub parameters: Vec<ParameterReport>,
}

/// A reading that was left out, as users call it.
#[must_use]
pub fn excluded(observations: &Observations, fit: &Fit, excluded: &Excluded) -> ExcludedReport {
    let Observations { readings, mechanism, .. } = observations;
    let rows = readings.rows_of_poses();
    let first = excluded.pose.map(|p| rows[p][0]).or(excluded.placement);
    let keys =
        first.map(|row| readings.table.keys.iter().map(|k| k[row].as_str()).collect::<Vec<_>>());
    let sample = |pose: usize| {
        excluded.row.and_then(|row| rows[pose].iter().position(|r| *r == row)).map(|s| s as i64 + 1)
    };
    let row = excluded.row.or(excluded.pose.map(|p| rows[p][0]));
    let touches = row.and_then(|row| touched_instead(observations, fit, row));
    let cause = words::cause(mechanism, &excluded.cause, excluded.samples, readings.held);
    let label = touches.as_ref().map(|touched| words::touches(touched));
    ExcludedReport {
        pose: excluded.pose.map(|p| readings.labels[p]),
        sample: excluded.pose.and_then(sample),
        // A whole placement is named by its first key, a sample by all of them.
        group: keys.filter(|k| !k.is_empty()).map(|k| match excluded.pose {
            Some(_) => k.into_iter().filter(|k| !k.is_empty()).collect::<Vec<_>>().join(", "),
            None => k[0].into(),
        }),
        chain: excluded.chain.map(|c| mechanism.chains[c].name.clone()),
        channel: excluded.channel.map(|c| mechanism.channels[c].name.clone()),
        samples: Some(excluded.samples as u64),
        session: excluded
            .pose
            .filter(|_| readings.sessions > 1)
            .map(|p| readings.session_of_pose[p] as u64 + 1),
        kind: ExcludedKind::of(&excluded.cause),
        reason: cause + &label.unwrap_or_default(),
        touches,
    }
}

impl MisclosureReport {
    /// Root mean square over all closures; none where there are none.
    pub(crate) fn whole(&self) -> Option<f64> {
        let rms = &self.rms.0;
        let squares: f64 = rms.iter().map(|(_, rms)| rms * rms).sum();
        (squares > 0.0).then(|| (squares / rms.len() as f64).sqrt())
    }
}

impl Known {
    /// Error of a fit on these poses: as measured, and after the best rigid motion of the
    /// instrument where that is asked for.
    ///
    /// # Errors
    ///
    /// As [`check`].
    pub fn judge(
        &self,
        observations: &Observations,
        fit: &Fit,
        report: &mut FitReport,
    ) -> Result<(), Error> {
        report.check = Some(check(observations, fit, self, false)?);
        if self.align {
            report.aligned = Some(check(observations, fit, self, true)?);
        }
        Ok(())
    }
}
