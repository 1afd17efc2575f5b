//! Gathers the evidence of a trace, and of a calibration.

use crate::Error;
use crate::diagnosis::held_out::averaged;
use crate::diagnosis::score::scored::is_data;
use crate::diagnosis::trace::{Found, Traced};
use crate::estimate::progress::Progress;
use crate::estimate::{Fit, Observations, fit};
use crate::model::Instance;
use crate::report::evidence::added_variable::added_variable;
use crate::report::evidence::against::against;
use crate::report::evidence::drawing::drawing;
use crate::report::evidence::hypotheses::hypotheses;
use crate::report::evidence::laws::law;
use crate::report::evidence::reliability::reliability;
use crate::report::evidence::scores::scores;
use crate::report::evidence::shapes::{EffectEvidence, Evidence};
use crate::report::evidence::switchboard::{Full, switchboard};
use crate::report::evidence::thinned::MOST_DOTS;
use crate::report::evidence::workspace::workspace;
use crate::report::result::Known;
use crate::screening::excluded::Excluded;

/// Evidence of a trace.
///
/// # Errors
///
/// As [`crate::fit`].
pub fn of_trace(traced: &Traced, known: Option<&Known>) -> Result<Evidence, Error> {
    let (session, answer) = traced.answer();
    let without = traced.found.first().map(|_| without(traced)).transpose()?;
    let evidence = of_fit(session, answer, without.as_ref(), known)?;
    let effects = traced.found.iter().map(|found| effect(traced, found));
    let full = Full {
        small: &traced.small,
        last: &traced.last,
        found: traced.found.iter().map(|found| found.instance).collect(),
        excluded: &traced.excluded,
        judge: traced.judge,
    };
    Ok(Evidence {
        effects: effects.collect::<Result<_, _>>()?,
        left: scores(&traced.small, &traced.scores, &[]),
        // A long recording is not fitted again.
        switchboard: if traced.stretches.is_some() { None } else { switchboard(&full)? },
        hypotheses: match traced.stretches {
            Some(_) => Vec::new(),
            None => hypotheses(traced, known)?,
        },
        ..evidence
    })
}

/// The fit without what was found, readings that are wrong still left out.
fn without(traced: &Traced) -> Result<Fit, Error> {
    let (session, answer) = traced.answer();
    let found = |i: &Instance| {
        let own = traced.found.iter().map(|found| found.instance);
        own.filter(|own| !is_data(own)).any(|own| own == *i || traced.in_all(&own) == *i)
    };
    let kept = answer.model.instances.iter().filter(|i| !found(i)).copied().collect();
    fit(session, kept, Some(answer))
}

/// Evidence of a calibration without the readings that were left out.
///
/// # Errors
///
/// As [`crate::fit`].
pub fn of_calibration(
    observations: &Observations,
    fit: &Fit,
    excluded: &[Excluded],
    known: Option<&Known>,
) -> Result<Evidence, Error> {
    // Whoever listened has been told that the job is done.
    let mut observations = observations.clone();
    observations.options.progress = Progress::default();
    let (small, last, judge) = averaged(&observations, fit)?;
    let full = Full { small: &small, last: &last, found: Vec::new(), excluded, judge };
    Ok(Evidence { switchboard: switchboard(&full)?, ..of_fit(&small, &last, None, known)? })
}

fn of_fit(
    small: &Observations,
    fit: &Fit,
    before: Option<&Fit>,
    known: Option<&Known>,
) -> Result<Evidence, Error> {
    let readings = &small.readings;
    let (workspace, weakest) = workspace(small, fit)?;
    Ok(Evidence {
        equations: equations(fit),
        poses: if readings.held { readings.labels.clone() } else { Vec::new() },
        channels: small.mechanism.channels.iter().map(|c| c.name.clone()).collect(),
        // Of rows that are poses of their own, as long as each has a dot.
        readings: match readings.held || readings.samples <= MOST_DOTS {
            true => readings
                .table
                .values
                .chunks(readings.channels.max(1))
                .map(<[f64]>::to_vec)
                .collect(),
            false => Vec::new(),
        },
        effects: Vec::new(),
        left: Vec::new(),
        reliability: reliability(small, fit),
        drawing: drawing(small, fit, before, known)?,
        workspace,
        weakest,
        switchboard: None,
        hypotheses: Vec::new(),
    })
}

fn effect(traced: &Traced, found: &Found) -> Result<EffectEvidence, Error> {
    let (small, last) = (&traced.small, &traced.last);
    let law = law(small, found, last)?;
    let against = law.is_none().then(|| against(small, &found.instance, &found.without, last));
    let added = added_variable(small, &found.without, last);
    let chosen: Vec<Instance> =
        std::iter::once(found.instance).chain(found.also.iter().copied()).collect();
    let scores = scores(small, &found.scores, &chosen);
    Ok(EffectEvidence {
        law,
        against,
        added_variable: added.dots,
        per_dot: added.per_dot,
        of_pose: added.rows,
        scores,
    })
}

/// Name of the closure of each equation.
fn equations(fit: &Fit) -> Vec<String> {
    if fit.model.pose_unknowns() > 0 {
        // Each is a combination of closures.
        return (1..=fit.model.equations()).map(|k| format!("loop {k}")).collect();
    }
    let closures = fit.model.mechanism.closures.iter().enumerate();
    let names = closures.flat_map(|(k, closure)| {
        std::iter::repeat_n(closure.name.clone(), fit.model.equations_of(k))
    });
    names.collect()
}
