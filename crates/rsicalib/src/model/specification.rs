//! Specifications of instances: `offset`, `curvature@a22`, `slip@a22:17`.

use crate::mechanism::{Mechanism, Target};
use crate::model::instance::{Instance, bound_to_session, place_name, places};
use crate::readings::Readings;
use crate::terms::targets::targets;
use crate::{Error, terms};

/// The instances of a list of specifications; none for an empty list.
///
/// `offset` is the term at every target, `curvature@a22` at one target; `crosstalk@a22:a21` and
/// `slip@a22:17` are a searched term at one place.
///
/// # Errors
///
/// [`Error::Unknown`] for a term, a target or a place that does not exist, with the known names.
pub fn parse(
    mechanism: &Mechanism,
    readings: &Readings,
    specs: &[String],
) -> Result<Vec<Instance>, Error> {
    let mut instances: Vec<Instance> = Vec::new();
    for spec in specs {
        let (id, at) = spec.split_once('@').map_or((spec.as_str(), None), |(i, t)| (i, Some(t)));
        let term = terms::find(id)?;
        let (at, place) = match at.and_then(|t| t.split_once(':')) {
            Some((t, p)) => (Some(t), Some(p)),
            None => (at, None),
        };
        let all = targets(term, mechanism);
        let known = || all.iter().map(|t| t.name(mechanism)).collect::<Vec<_>>().join(", ");
        let unknown =
            |found: &str| Error::Unknown { kind: "target", found: found.into(), known: known() };
        let chosen: Vec<Target> = match at {
            None => all.clone(),
            Some(name) => {
                vec![*all.iter().find(|t| t.name(mechanism) == name).ok_or_else(|| unknown(name))?]
            }
        };
        for target in chosen {
            let channel = if let Target::Channel(c) = target { c } else { 0 };
            let places = places(term, mechanism, readings, channel);
            if place.is_none() && bound_to_session(term) {
                for &place in &places {
                    let instance = Instance { term, target, place };
                    if !instances.contains(&instance) {
                        instances.push(instance);
                    }
                }
                continue;
            }
            let place = match place {
                None => places.first().copied().unwrap_or(0),
                Some(name) => {
                    let names = places.iter().map(|&p| place_name(term, mechanism, readings, p));
                    let names: Vec<String> = names.collect();
                    let at = names.iter().position(|n| n == name);
                    places[at.ok_or_else(|| Error::Unknown {
                        kind: "place",
                        found: name.into(),
                        known: names.join(", "),
                    })?]
                }
            };
            let instance = Instance { term, target, place };
            if !instances.contains(&instance) {
                instances.push(instance);
            }
        }
    }
    Ok(instances)
}
