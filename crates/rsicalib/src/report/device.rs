//! One device of many: what a row about it says.

use crate::Error;
use crate::diagnosis::calibrate::calibrate;
use crate::diagnosis::options::SearchOptions;
use crate::diagnosis::verdict::Verdict;
use crate::estimate::Observations;
use crate::estimate::directions::ParameterReport;
use crate::estimate::progress::{Job, Progress};
use crate::report::calibrated;
use crate::report::result::{ExcludedReport, FitReport};
use crate::report::trace_report::StepReport;
use crate::report::traced;
use crate::report::warned::Warned;

/// A calibration of one device of many, and what was missing from it.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct DeviceReport {
    /// The verdict: of the trace where there is one, else of the calibration.
    pub verdict: Verdict,
    /// What a reader of the verdict must know, in sentences; empty where all is well.
    pub message: String,
    /// How well the final model fits.
    pub fit: FitReport,
    /// Estimates of the final model, without the parameters of `steps`.
    pub parameters: Vec<ParameterReport>,
    /// Effects that were found missing.
    pub steps: Vec<StepReport>,
    /// The listener ended the trace: the calibration stands.
    pub ended: bool,
}

/// What to compute beside the calibration of a device.
#[derive(Debug, Clone, Default)]
pub struct DeviceOptions {
    /// Trace the residual where it is significant.
    pub trace: Option<SearchOptions>,
    /// Error on poses that are left out in turn, which takes as long as the calibration.
    pub held_out: bool,
}

/// Calibrates one device of many.
///
/// The numbers are those of [`calibrated::report`], and of [`traced::report`] where the
/// calibration leaves a significant residual and [`DeviceOptions::trace`] asks for it. Where the
/// listener of the progress ends the trace, they are those of the calibration.
///
/// # Errors
///
/// As [`calibrate`]; [`Error::Ended`] where the listener ended the calibration.
pub fn report(observations: &Observations, options: &DeviceOptions) -> Result<DeviceReport, Error> {
    let progress = &observations.options.progress;
    progress.begin(Job::Calibrate);
    let calibrated = calibrate(observations)?;
    let held_out = match options.held_out {
        true => calibrated::error_held_out(&calibrated)?,
        false => None,
    };
    let found = calibrated::of(observations, &calibrated, held_out, None)?;
    progress.goes_on()?;
    let mut ended = false;
    if found.verdict == Verdict::Unexplained
        && let Some(search) = &options.trace
    {
        match traced(observations, search, progress) {
            Err(Error::Ended) => ended = true,
            traced => return traced,
        }
    }
    let message = message(&[
        &found.estimates.unobservable,
        &texts(&found.implausible),
        &texts(&found.warnings),
        &reasons(&found.excluded),
    ]);
    let parameters = found.estimates.parameters;
    Ok(DeviceReport {
        verdict: found.verdict,
        message,
        fit: found.fit,
        parameters,
        steps: Vec::new(),
        ended,
    })
}

fn traced(
    observations: &Observations,
    search: &SearchOptions,
    progress: &Progress,
) -> Result<DeviceReport, Error> {
    let found = traced::report(observations, search, None)?;
    progress.goes_on()?;
    let left = match found.verdict {
        Verdict::Explained | Verdict::Adequate => Vec::new(),
        _ => vec![found.unexplained.text],
    };
    let message = message(&[
        &found.estimates.unobservable,
        &texts(&found.implausible),
        &left,
        &texts(&found.warnings),
        &reasons(&found.excluded),
    ]);
    let of_step = |p: &ParameterReport| {
        found
            .steps
            .iter()
            .any(|step| (&step.term, &step.target, &step.place) == (&p.term, &p.target, &p.place))
    };
    let parameters = found.estimates.parameters.iter().filter(|p| !of_step(p)).cloned().collect();
    let (verdict, fit, steps) = (found.verdict, found.after, found.steps);
    Ok(DeviceReport { verdict, message, fit, parameters, steps, ended: false })
}

fn texts(warnings: &[Warned]) -> Vec<String> {
    warnings.iter().map(|w| w.text.clone()).collect()
}

fn reasons(excluded: &[ExcludedReport]) -> Vec<String> {
    excluded.iter().map(left_out).collect()
}

/// Which reading was left out, and why.
fn left_out(excluded: &ExcludedReport) -> String {
    let ExcludedReport { session, pose, sample, group, chain, channel, reason, .. } = excluded;
    let mut place: Vec<String> = Vec::new();
    place.extend(session.map(|session| format!("session {session}")));
    place.extend(pose.map(|pose| format!("pose {pose}")));
    place.extend(sample.map(|sample| format!("sample {sample}")));
    place.extend(group.as_ref().map(|group| format!("group {group}")));
    place.extend(chain.clone());
    place.extend(channel.clone());
    format!("left out: {}: {reason}", place.join(" "))
}

fn message(parts: &[&[String]]) -> String {
    parts.concat().join("; ")
}
