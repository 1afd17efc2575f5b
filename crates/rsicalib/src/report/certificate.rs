//! Whether the largest error of a result is within a limit: all that a certificate states.

use crate::Error;
use crate::apply::budget::{Budget, Checked, Drawing, Errors, Quantity, budget};
use crate::apply::change::PlatformRms;
use crate::apply::decision::{Decision, Seen, decide};
use crate::apply::earlier::{Applied, Reported};
use crate::diagnosis::verdict::Verdict;
use crate::estimate::directions::ParameterReport;
use crate::estimate::noise::source::Source;
use crate::mechanism::Mechanism;
use crate::model::Spec;
use crate::readings::Table;
use crate::report::between::ChangingReport;
use crate::report::document::{Parts, Trace};
use crate::report::read::Document;
use crate::report::trace_report::StepReport;

/// Draws of the largest error, and their seed: the quantile has a relative standard error of 1 to 2 %.
const DRAWS: (usize, u64) = (2000, 1);

/// What is asked of a result.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limit {
    /// What the limit is of.
    pub quantity: Quantity,
    /// The largest error that is allowed [length unit or rad].
    pub limit: f64,
    /// Probability of the expanded uncertainty.
    pub confidence: f64,
}

/// The decision, and what it rests on.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
#[non_exhaustive]
pub struct Certificate {
    /// By ISO 14253-1.
    pub decision: Decision,
    /// Why the result cannot show that anything is within a limit; empty where it can.
    pub unfit: Vec<Unfit>,
    /// Effects that were found, from 0, that are not applied, and of which nobody knows how large they are.
    pub unsized_steps: Vec<usize>,
    /// The budget; none without a covariance.
    pub uncertainty: Option<Budget>,
    /// How many times as large as predicted errors are by check points; none where those do not
    /// stand in for an explanation.
    pub times: Option<f64>,
    /// Errors that are known.
    pub known: Vec<Known>,
}

/// Why a result cannot show that anything is within a limit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Unfit {
    /// A calibration is not searched for effects that could hide.
    NotTraced,
    /// Its verdict: something is not understood.
    Verdict,
    /// It does not hold what its session leaves open.
    NothingOpen,
}

/// An error that is known.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Known {
    /// `check points`, or `effects not applied`.
    pub source: &'static str,
    /// The largest that was seen, or what the effects do [length unit or rad].
    pub error: f64,
    /// Its expanded uncertainty by the noise of the readings; none where that of the budget holds.
    pub expanded: Option<f64>,
    /// Number of known poses; 0 for effects.
    pub poses: usize,
}

/// The certificate of a result, for the places of a table.
///
/// # Errors
///
/// As [`budget`]; [`Error::Empty`] of a result that says nothing of its noise or its readings.
pub fn certify(
    mechanism: &Mechanism,
    result: &Document,
    places: Table,
    asked: Limit,
) -> Result<Certificate, Error> {
    let (parts, trace) = (result.parts(), result.trace());
    let checked = trace.and_then(|trace| checked(mechanism, trace, asked.quantity));
    let unfit = if checked.is_some() { Vec::new() } else { unfit(parts.verdict(), trace) };
    let by_points = checked.is_some();
    let uncertainty = match errors(mechanism, result, checked) {
        Some(errors) => {
            let applied = applied(mechanism, parts)?;
            let Limit { quantity, confidence, .. } = asked;
            let drawing = Drawing { quantity, confidence, draws: DRAWS.0, seed: DRAWS.1 };
            Some(budget(mechanism, &applied, &errors, places, &drawing)?)
        }
        None => None,
    };
    let least = uncertainty.as_ref().map_or(0.0, |found| found.least);
    let seen = seen(parts, asked, least);
    let bound = uncertainty.as_ref().map_or(&[][..], |found| &found.of_its_session);
    let effects = effects(parts.steps(), bound, asked.quantity);
    let unsized_steps = unsized_steps(parts.steps(), asked.quantity);
    let expanded = match &uncertainty {
        Some(found) if unfit.is_empty() && unsized_steps.is_empty() => found.expanded,
        _ => f64::NAN,
    };
    let of_effects = effects.map_or(0.0, |known| known.error);
    let decision = decide(asked.limit, expanded, of_effects, seen.map(|(seen, _)| seen));
    let times = uncertainty.as_ref().filter(|_| by_points).map(|found| found.times);
    let known = seen.map(|(_, known)| known).into_iter().chain(effects).collect();
    Ok(Certificate { decision, unfit, unsized_steps, uncertainty, times, known })
}

/// True of a result that leaves something: check points say how large it is elsewhere.
fn leaves_something(verdict: Verdict) -> bool {
    matches!(verdict, Verdict::PartlyExplained | Verdict::Unexplained)
}

/// True where a result holds what its session leaves open of effects that were not found.
fn knows_what_is_open(trace: &Trace) -> bool {
    trace.could_hide.iter().any(|hidden| hidden.unseen.is_some())
}

fn unfit(verdict: Verdict, trace: Option<&Trace>) -> Vec<Unfit> {
    let understood = matches!(verdict, Verdict::Adequate | Verdict::Explained);
    let open = trace.is_none_or(knows_what_is_open);
    let reasons = [
        (trace.is_none(), Unfit::NotTraced),
        (!understood, Unfit::Verdict),
        (understood && !open, Unfit::NothingOpen),
    ];
    reasons.into_iter().filter(|(holds, _)| *holds).map(|(_, reason)| reason).collect()
}

/// A size of what is asked; none where it is not known.
fn size_of(rms: Option<PlatformRms>, quantity: Quantity) -> Option<f64> {
    let size = rms.map(|rms| match quantity {
        Quantity::Position => rms.position,
        Quantity::Orientation => rms.orientation,
    });
    size.filter(|size| !size.is_nan())
}

fn unsized_steps(steps: &[StepReport], quantity: Quantity) -> Vec<usize> {
    let of = |k: &usize| !steps[*k].applied && size_of(steps[*k].platform_rms, quantity).is_none();
    (0..steps.len()).filter(of).collect()
}

/// What effects do that are not applied elsewhere: those that were not taken into the result, and those that
/// are `bound` to its session.
fn effects(steps: &[StepReport], bound: &[String], quantity: Quantity) -> Option<Known> {
    let size = |step: &StepReport| {
        let (target, place) = (Some(step.target.clone()), step.place.clone());
        let spec = Spec { term: step.term.clone(), target, place };
        let of_its_session = bound.contains(&spec.to_string());
        // Of three coordinates; and a drift is √3 times its root mean square at its end.
        let times = if of_its_session { 3.0 } else { 3.0_f64.sqrt() };
        let counts = of_its_session || !step.applied;
        Some(times * size_of(step.platform_rms.filter(|_| counts), quantity)?)
    };
    let sizes: Vec<f64> = steps.iter().filter_map(size).collect();
    let error = sizes.iter().map(|size| size * size).sum::<f64>().sqrt();
    let source = "effects not applied";
    (!sizes.is_empty()).then_some(Known { source, error, expanded: None, poses: 0 })
}

/// The largest error at check points; noise elsewhere makes the largest at least `least`.
fn seen(parts: &dyn Parts, asked: Limit, least: f64) -> Option<(Seen, Known)> {
    let (_, fit) = parts.fits().pop()?;
    let check = fit.checked()?;
    let largest = check.largest?;
    let (error, sd) = match asked.quantity {
        Quantity::Position => (largest.position, largest.position_noise?),
        Quantity::Orientation => (largest.orientation?, largest.orientation_noise?),
    };
    let seen = Seen::at_poses(error, sd, check.poses, least, asked.confidence);
    let (source, expanded) = ("check points", Some(seen.expanded));
    Some((seen, Known { source, error, expanded, poses: check.poses }))
}

/// What check points show of a result that leaves something.
fn checked(mechanism: &Mechanism, trace: &Trace, quantity: Quantity) -> Option<Checked> {
    let (check, kept) = (trace.after.checked()?, trace.check_readings.as_ref()?);
    let largest = check.largest?;
    let (rms, noise) = match quantity {
        Quantity::Position => (check.position_rms, largest.position_noise?),
        Quantity::Orientation => (check.orientation_rms?, largest.orientation_noise?),
    };
    if !leaves_something(trace.verdict) || !knows_what_is_open(trace) {
        return None;
    }
    let point = match &kept.point {
        None => None,
        // Of a point of the platform, the orientation is part of the error.
        Some(_) if !mechanism.platform.is_empty() => return None,
        Some(name) => {
            let mut carried = mechanism.points.iter().filter(|p| p.chain.is_some());
            Some(carried.position(|p| p.name == *name)?)
        }
    };
    let table = Table {
        values: kept.readings.concat(),
        pose: Some((1..=kept.readings.len() as i64).collect()),
        temperature: kept.temperature_c.clone(),
        ..Table::default()
    };
    let aligned = trace.after.aligned.is_some();
    Some(Checked { table, point, square: rms * rms, noise: noise * noise, aligned })
}

/// Numbers of the parameters that have a value.
fn valued(parts: &dyn Parts) -> Vec<usize> {
    let parameters = parts.parameters();
    (0..parameters.len()).filter(|&k| !parameters[k].value.is_nan()).collect()
}

/// The result as it is applied elsewhere.
fn applied(mechanism: &Mechanism, parts: &dyn Parts) -> Result<Applied, Error> {
    let (Some(reference), Some(noise)) = (parts.reference(), parts.noise()) else {
        return Err(Error::Empty("the result has no 'reference' or no 'noise'".into()));
    };
    let parameters = parts.parameters();
    let reported = |k: usize| {
        let ParameterReport { name, value, .. } = &parameters[k];
        Reported { spec: parameters[k].spec(), name: name.clone(), value: *value }
    };
    let sigma = |name: &String| noise.sigma.0.iter().find(|(own, _)| own == name);
    let channels = mechanism.channels.iter();
    Ok(Applied {
        parameters: valued(parts).into_iter().map(reported).collect(),
        reference: reference.clone(),
        sigma: channels.filter_map(|c| Some(sigma(&c.name)?.1)).collect(),
        declared: noise.kind.is_some_and(Source::is_declared),
        closures: noise.closures.0.clone(),
        own: false,
    })
}

/// What is known of its errors; none without a covariance.
fn errors(mechanism: &Mechanism, result: &Document, checked: Option<Checked>) -> Option<Errors> {
    let (parts, valued) = (result.parts(), valued(result.parts()));
    let (parameters, between) = (parts.parameters(), parts.between());
    // Of means over groups, where parameters change between those.
    let whole = between.map_or(parts.covariance(), |between| &between.covariance);
    let entry = |(i, j): (usize, usize)| whole.get(i)?.get(j).copied().flatten();
    let pairs = valued.iter().flat_map(|&i| valued.iter().map(move |&j| (i, j)));
    let covariance: Vec<f64> = pairs.map(entry).collect::<Option<_>>()?;
    if covariance.is_empty() {
        return None;
    }
    let changes = |&k: &usize| {
        let p = &parameters[k];
        let same = |c: &&ChangingReport| {
            let ChangingReport { term, target, name, .. } = c;
            (term, target, name) == (&p.term, &p.target, &p.name)
        };
        let found = between.and_then(|between| between.parameters.iter().find(same));
        found.map_or(0.0, |changing| changing.sd * changing.sd)
    };
    let noise = parts.noise();
    // How what is touched sits: declared, or found by the fit.
    let declared = mechanism.closures.iter().filter_map(|closure| closure.noise);
    let play = declared.chain(noise.and_then(|noise| noise.seating)).fold(0.0, f64::max);
    let hidden = result.trace().map_or(&[][..], |trace| &trace.could_hide);
    let unseen = hidden.iter().filter_map(|h| {
        let (term, target) = (h.term.clone(), Some(h.target.clone()));
        Some((Spec { term, target, place: h.place.clone() }, h.unseen.clone()?))
    });
    Some(Errors {
        covariance,
        between: between.map_or_else(Vec::new, |_| valued.iter().map(changes).collect()),
        dof: noise.and_then(|noise| noise.dof).unwrap_or(f64::INFINITY),
        play,
        unseen: unseen.collect(),
        checked,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn step(term: &str, applied: bool, position: Option<f64>) -> StepReport {
        let rms = serde_json::json!({"position": position, "orientation": null});
        let step = serde_json::json!({
            "term": term, "class": "sensor", "target": "a22", "p_value": 1e-9, "applied": applied,
            "parameters": [], "platform_rms": rms,
        });
        serde_json::from_value(step).expect("a step")
    }

    #[test]
    fn effects_that_are_not_applied_add_up_as_the_lengths_of_three_coordinates() {
        let steps = [
            step("curvature", false, Some(0.1)),
            step("cubic", true, Some(9.0)),
            step("drift", true, Some(0.2)),
            step("kink", false, None),
        ];
        let bound = ["drift@a22".to_owned()];
        // √3 · 0.1 of each coordinate, and a drift, whose mean square is a third of that at its end: 3 · 0.2.
        let known = effects(&steps, &bound, Quantity::Position);
        assert!(known.is_some_and(|known| (known.error - 0.39_f64.sqrt()).abs() < 1e-12));
        assert_eq!(unsized_steps(&steps, Quantity::Position), [3]);
        assert_eq!(unsized_steps(&steps, Quantity::Orientation), [0, 3]);
        assert_eq!(effects(&steps[1..2], &[], Quantity::Position), None);
    }

    #[test]
    fn a_calibration_and_what_is_not_understood_are_unfit() {
        assert_eq!(unfit(Verdict::Adequate, None), [Unfit::NotTraced]);
        assert_eq!(unfit(Verdict::Unjudged, None), [Unfit::NotTraced, Unfit::Verdict]);
    }
}
