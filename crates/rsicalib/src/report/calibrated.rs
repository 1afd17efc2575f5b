//! What a calibration says, in the shape of the JSON.

use crate::Error;
use crate::diagnosis::calibrate::{Calibrated, calibrate};
use crate::diagnosis::held_out::{HeldOut, averaged, held_out};
use crate::diagnosis::plausibility::{Absurdity, absurdities};
use crate::diagnosis::verdict::{self, Determined, Evidence, Judgement, Reason, Verdict};
use crate::estimate::Observations;
use crate::estimate::directions::directions;
use crate::estimate::progress::{Job, Stage};
use crate::report::beside::{Beside, GroupsReport};
use crate::report::by_pose::by_pose;
use crate::report::result::{
    self, Estimates, ExcludedReport, FitReport, WithExcluded, estimates, excluded,
};
use crate::report::warned::{self, Warned};

/// The result of a calibration.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[non_exhaustive]
pub struct CalibrationReport {
    /// The verdict.
    pub verdict: Verdict,
    /// Why it is not better; the first says most.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Vec::is_empty"))]
    pub reasons: Vec<Reason>,
    /// What is absurd beside the size of the mechanism.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Vec::is_empty"))]
    pub implausible: Vec<Warned>,
    /// Suspicious things.
    pub warnings: Vec<Warned>,
    /// Readings left out.
    pub excluded: Vec<ExcludedReport>,
    /// The calibration with them.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub with_excluded: Option<WithExcluded>,
    /// How well the model fits.
    pub fit: FitReport,
    /// The known poses with the mechanism as it is declared.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub nominal: Option<FitReport>,
    /// How well points that are touched are repeated.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub groups: Option<GroupsReport>,
    /// Noise, parameters, covariance and the rest.
    #[cfg_attr(feature = "serde", serde(flatten))]
    pub estimates: Estimates,
    /// Residual of each pose in units of its noise, equation by equation.
    #[cfg_attr(feature = "serde", serde(skip))]
    pub after_residuals: Vec<f64>,
}

/// A calibration from more poses is not fitted again without some of them.
const MOST_HELD_OUT: usize = 5000;

/// Calibrates and reports; the calibration stands beside the report.
///
/// # Errors
///
/// As [`calibrate`], [`crate::apply::check::check`] and [`Beside::groups`].
pub fn report(
    observations: &Observations,
    beside: Option<&Beside>,
) -> Result<(CalibrationReport, Calibrated), Error> {
    let progress = &observations.options.progress;
    progress.begin(Job::Calibrate);
    let calibrated = calibrate(observations)?;
    progress.enter(Stage::HeldOut);
    let held_out = error_held_out(&calibrated)?;
    let report = of(observations, &calibrated, held_out, beside)?;
    Ok((report, calibrated))
}

/// Error on poses that are left out in turn; none where nothing was fitted, or where there are
/// too many poses to fit without some of them again.
///
/// # Errors
///
/// As [`calibrate`].
pub fn error_held_out(calibrated: &Calibrated) -> Result<Option<HeldOut>, Error> {
    let Calibrated { observations, fit, .. } = calibrated;
    let few = observations.readings.poses() <= MOST_HELD_OUT;
    if !(fit.stands() && fit.dof >= 1.0 && few) {
        return Ok(None);
    }
    let (small, fitted, judge) = averaged(observations, fit)?;
    Ok(held_out(&small, &fitted, &judge))
}

/// The report of a calibration, with its error on poses that were left out in turn.
///
/// # Errors
///
/// As [`report`].
pub fn of(
    observations: &Observations,
    calibrated: &Calibrated,
    held_out: Option<HeldOut>,
    beside: Option<&Beside>,
) -> Result<CalibrationReport, Error> {
    let Calibrated { observations: used, fit, excluded: out, with } = calibrated;
    let directions = directions(used, fit);
    let absurd = absurdities(used, fit, &[]);
    let mut quality = FitReport { held_out, ..FitReport::of(fit) };
    let mut with_excluded = with.as_ref().map(|whole| WithExcluded {
        fit: FitReport::of(whole),
        parameters: result::parameters(observations, whole),
    });
    if let Some(known) = beside.and_then(|beside| beside.known.as_ref()) {
        known.judge(used, fit, &mut quality)?;
        if let (Some(whole), Some(with)) = (with, &mut with_excluded) {
            known.judge(observations, whole, &mut with.fit)?;
        }
    }
    let nominal = beside.map(Beside::nominal).transpose()?.flatten();
    let groups = beside.map(|beside| beside.groups((used, fit), None)).transpose()?.flatten();
    let mut estimates = estimates(used, fit, &directions);
    let determined = Determined::of(fit, &directions);
    let open_loops =
        Beside::open_loops(beside, determined, (used, fit), &estimates, quality.checked())?;
    let Judgement { verdict, reasons } = verdict::judge(&Evidence {
        determined,
        absurd: !absurd.is_empty(),
        open: absurd.iter().any(Absurdity::is_of_readings),
        p_value: quality.p_value,
        chi2_per_dof: quality.chi2_per_dof(),
        mistaken: fit.is_unlike_drawn(),
        loose: fit.is_loose(),
        held_out,
        open_loops,
        check: quality.checked(),
        check_declared: nominal.as_ref().and_then(|nominal| quality.beside(nominal)),
        groups: groups.as_ref().and_then(GroupsReport::expected),
        groups_declared: groups.as_ref().and_then(|groups| groups.compared()[0]),
        predicted: estimates.beforehand(),
        contradicted: fit.contradicts_knowledge(),
        ..Evidence::default()
    });
    estimates.say_what_is_left(used, fit);
    Ok(CalibrationReport {
        verdict,
        reasons,
        implausible: warned::implausible(used, &absurd),
        warnings: warned::warnings(used, fit, fit)
            .into_iter()
            .chain(warned::known_poses(used, quality.aligned.or(quality.check)))
            .chain(warned::clocks(used, fit, beside.and_then(|beside| beside.known.as_ref())))
            .chain(open_loops.map(|open| warned::open_loops(&used.mechanism, &open)))
            .collect(),
        excluded: out.iter().map(|e| excluded(used, fit, e)).collect(),
        with_excluded,
        fit: quality,
        nominal,
        groups,
        estimates,
        after_residuals: by_pose(used, fit),
    })
}
