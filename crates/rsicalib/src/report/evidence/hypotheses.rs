//! What a session may be explained by: nothing, what was found, its rivals, and any smooth curve in
//! place of the law of a sensor.

use crate::Error;
use crate::apply::check::check;
use crate::diagnosis::score::scored::is_data;
use crate::diagnosis::trace::Traced;
use crate::estimate::directions::{parameter_names, reported};
use crate::estimate::{Fit, fit};
use crate::model::Instance;
use crate::report::evidence::drawing::places;
use crate::report::evidence::known::{place, positions};
use crate::report::evidence::shapes::{Hypothesis, HypothesisKind, ParameterName, SwitchFit};
use crate::report::evidence::workspace::workspace;
use crate::report::result::Known;
use crate::report::traced::Place;
use crate::report::traced::by_pose;
use crate::terms::find;
use crate::terms::term::Acts;

/// Samples that all fits together may have.
const MOST_SAMPLES: usize = 16 * 800;

/// The smooth curve that stands for a law that no term has.
const ANY_CURVE: &str = "free_curve";

/// The hypotheses of a trace, nothing first; none where nothing was found, or where a session is too
/// long to be fitted again.
///
/// # Errors
///
/// As [`check`] and [`workspace`].
pub fn hypotheses(traced: &Traced, known: Option<&Known>) -> Result<Vec<Hypothesis>, Error> {
    let Traced { small, last, .. } = traced;
    let found: Vec<Instance> =
        traced.found.iter().map(|f| f.instance).filter(|i| !is_data(i)).collect();
    if found.is_empty() || small.readings.samples * (traced.rivals.len() + 3) > MOST_SAMPLES {
        return Ok(Vec::new());
    }
    let base: Vec<Instance> =
        last.model.instances.iter().filter(|i| !found.contains(i)).copied().collect();
    let probability = |effects: &[Instance]| {
        traced.rivals.iter().find(|r| alike(&r.effects, effects)).map(|r| r.probability)
    };
    let mut all = vec![
        (HypothesisKind::Nothing, Vec::new(), None),
        (HypothesisKind::Found, found.clone(), probability(&found)),
    ];
    let others = traced.rivals.iter().filter(|r| !alike(&r.effects, &found));
    all.extend(others.map(|r| (HypothesisKind::Rival, r.effects.clone(), Some(r.probability))));
    let curves = any_curve(&found);
    if !all.iter().any(|(_, effects, _)| alike(effects, &curves)) {
        all.push((HypothesisKind::AnyCurve, curves, None));
    }
    let mut out = Vec::with_capacity(all.len());
    for (kind, effects, probability) in all {
        let instances = base.iter().chain(&effects).copied().collect();
        // What these readings cannot fit is no hypothesis of them.
        let Ok(one) = fit(small, instances, Some(last)) else { continue };
        let effects = effects.iter().map(|i| Place::of(small, i)).collect();
        out.push(Hypothesis { kind, effects, probability, ..of_fit(traced, &one, known)? });
    }
    Ok(out)
}

/// True where both have the same effects.
fn alike(a: &[Instance], b: &[Instance]) -> bool {
    a.len() == b.len() && a.iter().all(|i| b.contains(i))
}

/// The effects with a smooth curve in place of the law of each sensor.
fn any_curve(found: &[Instance]) -> Vec<Instance> {
    let Ok(curve) = find(ANY_CURVE) else { return found.to_vec() };
    let one = |i: &Instance| match i.term.acts() {
        Acts::Sensor(_) => Instance { term: curve, ..*i },
        _ => *i,
    };
    found.iter().map(one).collect()
}

/// What a fit says, without a name.
fn of_fit(traced: &Traced, one: &Fit, known: Option<&Known>) -> Result<Hypothesis, Error> {
    let Traced { small, judge, .. } = traced;
    let (values, covariance) = reported(one);
    let terms = one.model.term_parameters;
    let sd = |c: usize| (!one.unknowable[c]).then(|| covariance[(c, c)].max(0.0).sqrt());
    let names = parameter_names(small, one).into_iter().take(terms);
    let there = known.map(|known| positions(small, one, &one.beta, known)).transpose()?.flatten();
    let checked = known.map(|k| check(small, one, k, k.align)).transpose()?;
    Ok(Hypothesis {
        effects: Vec::new(),
        probability: None,
        kind: HypothesisKind::Nothing,
        parameters: names.map(ParameterName::from).collect(),
        fit: SwitchFit {
            chi2: one.chi2,
            dof: one.dof,
            p_value: judge.lack_of_fit(one),
            rms_misclosure: one.rms_misclosure,
            values: values.into_iter().take(terms).map(Some).collect(),
            sd: (0..terms).map(sd).collect(),
            residuals: by_pose(small, one),
        },
        check: checked,
        places: places(small, one, &one.beta),
        known: there.map(|p| p.found.iter().map(place).collect()).unwrap_or_default(),
        workspace: workspace(small, one)?.0,
    })
}
