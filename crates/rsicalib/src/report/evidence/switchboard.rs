//! The fits with and without each suspect: effects that were found, and readings left out.

use crate::Error;
use crate::diagnosis::score::scored::is_data;
use crate::diagnosis::trace::Traced;
use crate::estimate::directions::{parameter_names, reported};
use crate::estimate::{Fit, fit};
use crate::model::Instance;
use crate::report::evidence::scores::name;
use crate::report::evidence::shapes::{Switch, SwitchFit, SwitchParameter, Switchboard};

/// Most switches.
const MOST_SWITCHES: usize = 6;

/// Samples that all fits together may have.
const MOST_SAMPLES: usize = 64 * 800;

/// What a switch changes.
#[derive(Clone, Copy)]
enum Suspect {
    /// An effect, or a bad reading that has a parameter of its own: on, it is in the model.
    Instance(Instance),
    /// A pose: on, it is left out.
    Pose(usize),
}

/// The fits with and without each suspect; none where nothing is suspected, or a session is too
/// long to be fitted again.
///
/// # Errors
///
/// As [`fit`].
pub fn switchboard(traced: &Traced) -> Result<Option<Switchboard>, Error> {
    let small = &traced.small;
    let mut suspects = suspects(traced);
    let samples = small.readings.samples.max(1);
    let most = (0..=MOST_SWITCHES).rev().find(|k| samples << k <= MOST_SAMPLES).unwrap_or(0);
    suspects.truncate(most);
    if suspects.is_empty() {
        return Ok(None);
    }
    let mut fits = Vec::with_capacity(1 << suspects.len());
    for set in 0..1_usize << suspects.len() {
        let on = |i: usize| set >> i & 1 == 1;
        let mut session = small.clone();
        let mut instances = traced.last.model.instances.clone();
        for (i, suspect) in suspects.iter().enumerate() {
            match *suspect {
                Suspect::Instance(instance) if !on(i) => instances.retain(|i| *i != instance),
                Suspect::Pose(pose) if !on(i) => session.weights[pose] = 1.0,
                _ => {}
            }
        }
        fits.push(fit(&session, instances, Some(&traced.last))?);
    }
    let full = &traced.last;
    let terms = full.model.term_parameters;
    let parameters = parameter_names(small, full).into_iter().take(terms);
    let named = |p: crate::estimate::directions::ParameterReport| SwitchParameter {
        term: p.term,
        target: p.target,
        name: p.name,
        unit: p.unit,
    };
    Ok(Some(Switchboard {
        switches: suspects.iter().map(|suspect| switch(traced, suspect)).collect(),
        parameters: parameters.map(named).collect(),
        fits: fits.iter().map(|one| summary(traced, full, one)).collect(),
    }))
}

/// Effects, then readings that were left out.
fn suspects(traced: &Traced) -> Vec<Suspect> {
    let last = &traced.last.model.instances;
    let effects = traced.found.iter().map(|found| found.instance).filter(|i| last.contains(i));
    let readings = last.iter().copied().filter(is_data);
    let poses = traced.excluded.iter().filter_map(|e| match (e.pose, e.row, e.channel) {
        (Some(pose), None, None) if traced.small.weights[pose] == 0.0 => Some(Suspect::Pose(pose)),
        _ => None,
    });
    let readings = readings.map(Suspect::Instance);
    effects.map(Suspect::Instance).chain(readings).chain(poses).collect()
}

fn switch(traced: &Traced, suspect: &Suspect) -> Switch {
    let (small, mechanism) = (&traced.small, &traced.small.mechanism);
    let label = |pose: usize| small.readings.labels.get(pose).copied();
    match *suspect {
        Suspect::Instance(instance) if is_data(&instance) => Switch {
            effect: None,
            pose: label(instance.place),
            channel: Some(instance.target.name(mechanism)),
        },
        Suspect::Instance(instance) => {
            Switch { effect: Some(name(small, &instance)), pose: None, channel: None }
        }
        Suspect::Pose(pose) => Switch { effect: None, pose: label(pose), channel: None },
    }
}

fn summary(traced: &Traced, full: &Fit, one: &Fit) -> SwitchFit {
    let (values, covariance) = reported(one);
    let column = |k: usize| -> Option<usize> {
        let at = full.model.first.iter().rposition(|first| *first <= k)?;
        let own = one.model.instances.iter().position(|i| *i == full.model.instances[at])?;
        Some(one.model.first[own] + k - full.model.first[at])
    };
    let columns: Vec<Option<usize>> = (0..full.model.term_parameters).map(column).collect();
    let deviation = |c: usize| (!one.unknowable[c]).then(|| covariance[(c, c)].max(0.0).sqrt());
    SwitchFit {
        chi2: one.chi2,
        dof: one.dof,
        p_value: traced.judge.lack_of_fit(one),
        rms_misclosure: one.rms_misclosure,
        values: columns.iter().map(|c| c.map(|c| values[c])).collect(),
        sd: columns.iter().map(|c| c.and_then(deviation)).collect(),
        residuals: one.residuals.whitened.clone(),
    }
}
