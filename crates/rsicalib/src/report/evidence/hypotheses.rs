//! What a session may be explained by: nothing, what was found, its rivals, and a law that no term has, or
//! any smooth curve in place of the law of a sensor.

use std::sync::Arc;

use crate::Error;
use crate::apply::check::check;
use crate::diagnosis::score::scored::is_data;
use crate::diagnosis::trace::Traced;
use crate::diagnosis::unknown_law::UnknownLaw;
use crate::estimate::directions::{parameter_names, reported};
use crate::estimate::{Fit, Observations, fit, with_conventions};
use crate::mechanism::Target;
use crate::model::Instance;
use crate::report::by_pose::by_pose;
use crate::report::evidence::drawing::places;
use crate::report::evidence::known::{place, positions};
use crate::report::evidence::shapes::{Hypothesis, HypothesisKind, ParameterName, SwitchFit};
use crate::report::evidence::workspace::workspace;
use crate::report::result::Known;
use crate::report::trace_report::Place;
use crate::report::traced::with_law;
use crate::terms::find;
use crate::terms::law::term_of;
use crate::terms::term::Acts;

/// The smooth curve that stands for a law that no term has.
const ANY_CURVE: &str = "free_curve";

/// The hypotheses of a trace, nothing first; none where nothing is to be explained.
///
/// # Errors
///
/// As [`check`] and [`workspace`].
pub fn hypotheses(traced: &Traced, known: Option<&Known>) -> Result<Vec<Hypothesis>, Error> {
    let Traced { small, last, .. } = traced;
    let found: Vec<Instance> =
        traced.found.iter().map(|f| f.instance).filter(|i| !is_data(i)).collect();
    if !traced.lacks_something() {
        return Ok(Vec::new());
    }
    let base: Vec<Instance> =
        last.model.instances.iter().filter(|i| !found.contains(i)).copied().collect();
    let mut all = vec![(HypothesisKind::Nothing, Vec::new())];
    if !found.is_empty() {
        all.push((HypothesisKind::Found, found.clone()));
    }
    let listed = |effects: &[Instance]| !effects.is_empty() && !alike(effects, &found);
    let others = traced.rivals.iter().filter(|r| listed(&r.effects));
    all.extend(others.map(|r| (HypothesisKind::Rival, r.effects.clone())));
    let curves = any_curve(&found);
    let same = |(_, effects): &(_, Vec<Instance>)| alike(effects, &curves);
    if !curves.is_empty() && !all.iter().any(same) {
        all.push((HypothesisKind::AnyCurve, curves));
    }
    let mut out = Vec::with_capacity(all.len());
    for (kind, effects) in all {
        let instances = base.iter().chain(&effects).copied().collect();
        // What these readings cannot fit is no hypothesis of them.
        let Ok(one) = fit(small, instances, Some(last)) else { continue };
        let one = with_conventions(small, one);
        let effects = effects.iter().map(|i| Place::of(small, i)).collect();
        out.push(Hypothesis { kind, effects, ..of_fit(traced, small, &one, known)? });
    }
    if let Some(law) = &traced.unknown {
        out.extend(of_law(traced, law)?);
    }
    Ok(out)
}

/// A law that no term has: of a channel a fit to the readings less its likeliest errors, else one with its
/// formula. None where it cannot be fitted, or has no formula.
fn of_law(traced: &Traced, law: &UnknownLaw) -> Result<Option<Hypothesis>, Error> {
    let mut less = traced.small.clone();
    let kept = traced.last.model.instances.iter().filter(|i| !law.replaces.contains(i));
    let mut instances: Vec<Instance> = kept.copied().collect();
    match (law.whose.target, &law.written) {
        (Target::Channel(channel), _) => {
            less.readings = Arc::new(less.readings.less(channel, &law.errors));
        }
        (target, Some(written)) => {
            instances.push(Instance { term: term_of(&written.law)?, target, place: 0 });
        }
        _ => return Ok(None),
    }
    let Ok(one) = fit(&less, instances, Some(&traced.last)) else { return Ok(None) };
    let mut one = with_conventions(&less, one);
    if let Target::Channel(_) = law.whose.target {
        one.dof = (one.dof - law.told).max(0.0);
    }
    let (kind, effects) = (HypothesisKind::UnknownLaw, with_law(traced, law));
    Ok(Some(Hypothesis { kind, effects, ..of_fit(traced, &less, &one, None)? }))
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

/// What a fit of a session says, without a name.
fn of_fit(
    traced: &Traced,
    small: &Observations,
    one: &Fit,
    known: Option<&Known>,
) -> Result<Hypothesis, Error> {
    let (values, covariance) = reported(one);
    let terms = one.model.term_parameters;
    let sd = |c: usize| (!one.unknowable[c]).then(|| covariance[(c, c)].max(0.0).sqrt());
    let names = parameter_names(small, one).into_iter().take(terms);
    let there = known.map(|known| positions(small, one, &one.beta, known)).transpose()?.flatten();
    let checked = known.map(|k| check(small, one, k, k.align)).transpose()?;
    Ok(Hypothesis {
        effects: Vec::new(),
        kind: HypothesisKind::Nothing,
        parameters: names.map(ParameterName::from).collect(),
        fit: SwitchFit {
            chi2: one.chi2,
            dof: one.dof,
            p_value: traced.judge.lack_of_fit(one),
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
