//! Specifications of instances: `offset`, `curvature@a22`, `slip@a22:17`.

use std::convert::Infallible;
use std::fmt;
use std::str::FromStr;

use crate::mechanism::{Mechanism, Target};
use crate::model::instance::{Instance, bound_to_session, place_name, places};
use crate::readings::Readings;
use crate::terms::targets::{has_places, shared, targets, targets_in};
use crate::terms::term::{ORDER_STEP, ORDERS, Per, Placed, Term};
use crate::text::quoted;
use crate::{Error, terms};

/// A term, where it acts, and which of its places that is: `curvature@a22`, `slip@a22:17`.
///
/// # Example
///
/// ```
/// use rsicalib::model::Spec;
///
/// let spec = Spec::from("slip@a22:17");
/// assert_eq!((spec.term.as_str(), spec.place.as_deref()), ("slip", Some("17")));
/// assert_eq!(spec.to_string(), "slip@a22:17");
/// ```
#[derive(Debug, Clone, PartialEq, Eq, Hash, Default)]
pub struct Spec {
    /// Id of the term.
    pub term: String,
    /// What it belongs to; none: every target that it may have.
    pub target: Option<String>,
    /// Which place of several there: a pose, another channel, a session.
    pub place: Option<String>,
}

impl From<&str> for Spec {
    fn from(text: &str) -> Self {
        let (term, at) = match text.split_once('@') {
            Some((term, at)) => (term, Some(at)),
            None => (text, None),
        };
        // A colon within brackets is of a name, and so are two: `arm::elbow`, as URDFs have them.
        let inside = at.and_then(|at| at.rfind(']')).map_or(0, |end| end + 1);
        let alone = |bytes: &[u8], k: usize| {
            let colon = |k: usize| bytes.get(k) == Some(&b':');
            colon(k) && !colon(k + 1) && !(k > 0 && colon(k - 1))
        };
        let colon = at.and_then(|at| (inside..at.len()).find(|k| alone(at.as_bytes(), *k)));
        let parts = at.zip(colon).map(|(at, colon)| at.split_at(colon));
        let (target, place) = match parts.map(|(target, place)| (target, &place[1..])) {
            Some((target, place)) => (Some(target), Some(place)),
            None => (at, None),
        };
        let own = |part: Option<&str>| part.map(String::from);
        Self { term: term.into(), target: own(target), place: own(place) }
    }
}

impl FromStr for Spec {
    type Err = Infallible;

    fn from_str(text: &str) -> Result<Self, Infallible> {
        Ok(Self::from(text))
    }
}

impl fmt::Display for Spec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.term)?;
        for (mark, part) in [('@', &self.target), (':', &self.place)] {
            if let Some(part) = part {
                write!(f, "{mark}{part}")?;
            }
        }
        Ok(())
    }
}

impl Spec {
    /// The term, and the targets that are meant: all that there may be where none is named.
    ///
    /// # Errors
    ///
    /// [`Error::Unknown`] with the names there are.
    pub fn targets(
        &self,
        mechanism: &Mechanism,
    ) -> Result<(&'static dyn Term, Vec<Target>), Error> {
        let term = terms::find_in(mechanism, &self.term)?;
        let mut all = targets(term, mechanism);
        if let Some(name) = &self.target {
            // One parameter for all of several is asked for by its name alone.
            all.extend(shared(term, mechanism));
            let named = all.iter().find(|t| t.name(mechanism) == *name).copied();
            let together = || match term.info().per {
                Per::Channel => Target::named_together(mechanism, name),
                _ => None,
            };
            let placed = || {
                let target = Target::Place(mechanism.named_place(name)?);
                (has_places(term) && term.suits_target(mechanism, target)).then_some(target)
            };
            let named = named.or_else(together).or_else(placed);
            let known = || all.iter().map(|t| t.name(mechanism)).collect::<Vec<_>>().join(", ");
            let unknown = || Error::Unknown { kind: "target", found: name.clone(), known: known() };
            all = vec![named.ok_or_else(unknown)?];
        }
        Ok((term, all))
    }
}

/// The instances of a list of specifications; none for an empty list.
///
/// `offset` is the term at every target, `curvature@a22` at one target; `crosstalk@a22:a21` and
/// `slip@a22:17` are a searched term at one place.
///
/// # Errors
///
/// [`Error::Unknown`] for a term, a target or a place that does not exist, with the known names;
/// [`Error::Option`] for a searched term without its place.
pub fn parse(
    mechanism: &Mechanism,
    readings: &Readings,
    specs: &[String],
) -> Result<Vec<Instance>, Error> {
    let mut instances: Vec<Instance> = Vec::new();
    for spec in specs {
        for instance in instances_of(mechanism, readings, &Spec::from(spec.as_str()))? {
            if !instances.contains(&instance) {
                instances.push(instance);
            }
        }
    }
    Ok(instances)
}

/// The instances that one specification asks for.
///
/// # Errors
///
/// As [`parse`].
pub fn instances_of(
    mechanism: &Mechanism,
    readings: &Readings,
    spec: &Spec,
) -> Result<Vec<Instance>, Error> {
    let (term, mut chosen) = spec.targets(mechanism)?;
    if spec.target.is_none() {
        chosen = targets_in(term, mechanism, readings);
    }
    let mut instances = Vec::new();
    for target in chosen {
        let channel = if let Target::Channel(c) = target { c } else { 0 };
        let places = places(term, mechanism, readings, channel);
        match &spec.place {
            None if bound_to_session(term) => {
                instances.extend(places.iter().map(|&place| Instance { term, target, place }));
            }
            None if places.len() > 1 => {
                let names: Vec<String> =
                    places.iter().map(|&p| place_name(term, mechanism, readings, p)).collect();
                return Err(without_place(term, &target.name(mechanism), &names));
            }
            None => {
                let place = places.first().copied().unwrap_or(0);
                instances.push(Instance { term, target, place });
            }
            Some(name) if term.placed() == Placed::AtOrder => {
                instances.push(Instance { term, target, place: nearest_order(name)? });
            }
            Some(name) => {
                let names = places.iter().map(|&p| place_name(term, mechanism, readings, p));
                let names: Vec<String> = names.collect();
                let at = names.iter().position(|n| n == name).ok_or_else(|| Error::Unknown {
                    kind: "place",
                    found: name.clone(),
                    known: names.join(", "),
                })?;
                instances.push(Instance { term, target, place: places[at] });
            }
        }
    }
    Ok(instances)
}

/// A term that is searched for, where nobody says which of its places is meant.
fn without_place(term: &dyn Term, target: &str, names: &[String]) -> Error {
    let id = term.info().id;
    let what = term.placed().words().unwrap_or_default();
    let (first, last) = (&names[0], &names[names.len() - 1]);
    Error::option(
        "terms",
        format!("{id}@{target} without a place"),
        format!("{id}@{target}:PLACE, the {what}, from {first} to {last}; a trace searches for it"),
    )
}

/// The place of the order that is nearest to a number of waves per turn.
fn nearest_order(name: &str) -> Result<usize, Error> {
    let [low, high] = [*ORDERS.start(), *ORDERS.end()].map(|place| ORDER_STEP * place as f64);
    let order = name.parse::<f64>().ok().filter(|n| (low..=high).contains(n));
    order.map(|n| (n / ORDER_STEP).round() as usize).ok_or_else(|| Error::Unknown {
        kind: "place",
        found: name.into(),
        known: format!("orders from {low} to {high} waves per turn"),
    })
}

/// Refuses a mechanism that names a term which there is not, or whose laws bear the names of
/// others.
///
/// Where the terms act is told by the readings, too, and is checked with them.
///
/// # Errors
///
/// [`Error::Mechanism`] with the ids there are.
pub fn check_names(mechanism: &Mechanism) -> Result<(), Error> {
    if let Some(law) = mechanism.laws.iter().find(|law| terms::find(&law.id).is_ok()) {
        return Err(Error::Mechanism {
            place: format!("term {}", quoted(&law.id)),
            found: "the id of a term of the catalogue".into(),
            expected: "an id of its own".into(),
        });
    }
    let ids = mechanism.model.terms.iter().map(|spec| ("terms", spec));
    for (key, spec) in ids.chain(mechanism.model.sd.keys().map(|id| ("sd", id))) {
        if let Err(Error::Unknown { found, known, .. }) =
            terms::find_in(mechanism, &Spec::from(spec.as_str()).term)
        {
            let place = format!("model, {key}");
            return Err(Error::Mechanism {
                place,
                found: format!("term {}", quoted(&found)),
                expected: known,
            });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::Spec;

    #[test]
    fn what_is_written_is_read_again() {
        let of = |target: &str, place: Option<&str>| Spec {
            term: "slip".into(),
            target: Some(target.into()),
            place: place.map(Into::into),
        };
        for spec in [
            of("a22", Some("17")),
            of("arm::elbow", None),
            of("robot::arm::elbow", Some("2/17")),
            of("socket[at=2026-11-29T10:00]", Some("3")),
        ] {
            assert_eq!(Spec::from(spec.to_string().as_str()), spec);
        }
    }
}
