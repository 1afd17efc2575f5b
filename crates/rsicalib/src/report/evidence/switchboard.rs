//! The fits with and without each suspect: effects that were found, and readings left out.

use crate::Error;
use crate::diagnosis::score::scored::Judge;
use crate::diagnosis::score::scored::is_data;
use crate::estimate::directions::{parameter_names, reported};
use crate::estimate::{Fit, Observations, fit, with_conventions};
use crate::model::Instance;
use crate::report::by_pose::by_pose;
use crate::report::evidence::shapes::{ParameterName, Switch, SwitchFit, Switchboard};
use crate::report::trace_report::Place;
use crate::screening::excluded::Excluded;

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

/// What a switchboard is made from.
pub struct Full<'a> {
    /// One sample for each held pose.
    pub small: &'a Observations,
    /// The fit with everything that was found.
    pub last: &'a Fit,
    /// Effects that were found.
    pub found: Vec<Instance>,
    /// Readings that were left out.
    pub excluded: &'a [Excluded],
    /// How lack of fit is judged.
    pub judge: Judge,
}

/// The fits with and without each suspect; none where nothing is suspected, or a session is too
/// long to be fitted again.
///
/// # Errors
///
/// As [`fit`].
pub fn switchboard(full: &Full) -> Result<Option<Switchboard>, Error> {
    let (small, last) = (full.small, full.last);
    let mut suspects = suspects(full);
    let samples = small.readings.samples.max(1);
    let most = (0..=MOST_SWITCHES).rev().find(|k| samples << k <= MOST_SAMPLES).unwrap_or(0);
    suspects.truncate(most);
    if suspects.is_empty() {
        return Ok(None);
    }
    let mut fits = Vec::with_capacity(1 << suspects.len());
    for set in 0..1_usize << suspects.len() {
        let on = |i: usize| (set >> i) & 1 == 1;
        let mut session = small.clone();
        let mut instances = last.model.instances.clone();
        for (i, suspect) in suspects.iter().enumerate() {
            match *suspect {
                Suspect::Instance(instance) if !on(i) => instances.retain(|i| *i != instance),
                Suspect::Pose(pose) if !on(i) => session.weights[pose] = 1.0,
                _ => {}
            }
        }
        let one = fit(&session, instances, Some(last))?;
        fits.push(summary(full, &session, &with_conventions(&session, one)));
    }
    let terms = last.model.term_parameters;
    let parameters = parameter_names(small, last).into_iter().take(terms);
    Ok(Some(Switchboard {
        switches: suspects.iter().map(|suspect| switch(small, suspect)).collect(),
        parameters: parameters.map(ParameterName::from).collect(),
        fits,
    }))
}

/// Effects, then readings that were left out, in the order of the result.
fn suspects(full: &Full) -> Vec<Suspect> {
    let last = &full.last.model.instances;
    let effects = full.found.iter().copied().filter(|i| last.contains(i)).map(Suspect::Instance);
    let readings = last.iter().filter(|i| is_data(i)).map(|i| (i.place, Suspect::Instance(*i)));
    let poses = full.excluded.iter().filter_map(|e| match (e.pose, e.row, e.channel) {
        (Some(pose), None, None) if full.small.weights[pose] == 0.0 => {
            Some((pose, Suspect::Pose(pose)))
        }
        _ => None,
    });
    let mut left_out: Vec<(usize, Suspect)> = readings.chain(poses).collect();
    left_out.sort_by_key(|(pose, _)| full.excluded.iter().position(|e| e.pose == Some(*pose)));
    effects.chain(left_out.into_iter().map(|(_, suspect)| suspect)).collect()
}

fn switch(small: &Observations, suspect: &Suspect) -> Switch {
    let label = |pose: usize| small.readings.labels.get(pose).copied();
    match *suspect {
        Suspect::Instance(instance) if is_data(&instance) => Switch {
            effect: None,
            pose: label(instance.place),
            channel: Some(instance.target.name(&small.mechanism)),
        },
        Suspect::Instance(instance) => {
            Switch { effect: Some(Place::of(small, &instance)), pose: None, channel: None }
        }
        Suspect::Pose(pose) => Switch { effect: None, pose: label(pose), channel: None },
    }
}

fn summary(full: &Full, session: &Observations, one: &Fit) -> SwitchFit {
    let (values, covariance) = reported(one);
    let model = &full.last.model;
    let column = |k: usize| -> Option<usize> {
        let at = model.first.iter().rposition(|first| *first <= k)?;
        let own = one.model.instances.iter().position(|i| *i == model.instances[at])?;
        Some(one.model.first[own] + k - model.first[at])
    };
    let columns: Vec<Option<usize>> = (0..model.term_parameters).map(column).collect();
    let deviation = |c: usize| (!one.unknowable[c]).then(|| covariance[(c, c)].max(0.0).sqrt());
    SwitchFit {
        chi2: one.chi2,
        dof: one.dof,
        p_value: full.judge.lack_of_fit(one),
        rms_misclosure: one.rms_misclosure,
        values: columns.iter().map(|c| c.map(|c| values[c])).collect(),
        sd: columns.iter().map(|c| c.and_then(deviation)).collect(),
        residuals: by_pose(session, one),
    }
}
