//! What closures touch: unknown things whose places the columns of the readings tell apart.

use crate::closures::kind::Part;
use crate::mechanism::drawing::{Mechanism, Value};
use crate::mechanism::place_name::{PlaceName, place_name};
use crate::mechanism::queries::keys_of;
use crate::mechanism::target::Target;

impl Mechanism {
    /// What a closure is between that is unknown and stands, with the columns that tell its places
    /// apart: planes, lines, points, and frames of measured points. None have no columns here.
    pub(crate) fn keyed_things(&self, closure: usize) -> Vec<(&str, &[String])> {
        let Some(closure) = self.closures.get(closure) else { return Vec::new() };
        let parts = closure.kind.facts().between;
        let thing = |(part, name): (&Part, &String)| match part {
            Part::Point => {
                let point = self.points.iter().find(|p| p.name == *name)?;
                let frame = point.frame.as_ref().filter(|_| point.columns.is_some());
                match frame.and_then(|name| self.frames.iter().find(|f| f.name == *name)) {
                    Some(frame) => Some((frame.name.as_str(), frame.keys())),
                    None => Some((point.name.as_str(), point.keys())),
                }
            }
            Part::Plane => {
                let plane = self.planes.iter().find(|p| p.name == *name)?;
                Some((plane.name.as_str(), plane.keys()))
            }
            Part::Line => {
                let line = self.lines.iter().find(|l| l.name == *name)?;
                Some((line.name.as_str(), line.keys()))
            }
            Part::Channel => None,
        };
        let things = parts.iter().zip(&closure.between).filter_map(thing);
        things.filter(|(_, keys)| !keys.is_empty()).collect()
    }

    /// The columns that are a closure's own: what tells its unknown places apart, what measures its
    /// length, what measures its points. Where one of them is blank in a row, the closure does not hold
    /// there. A column that is declared for laws is never blank.
    #[must_use]
    pub fn own_columns(&self, closure: usize) -> Vec<String> {
        let Some(drawn) = self.closures.get(closure).filter(|c| !self.is_link(c)) else {
            return Vec::new();
        };
        let keys = self.keyed_things(closure).into_iter().flat_map(|(_, columns)| columns);
        let mut own: Vec<String> = keys.cloned().collect();
        if let Some(Value::Column(name)) = &drawn.value {
            own.push(name.clone());
        }
        let ends = self.points.iter().filter(|p| drawn.between.contains(&p.name));
        own.extend(ends.filter_map(|p| p.columns.as_ref()).flatten().cloned());
        own.retain(|name| self.columns.iter().all(|declared| declared.name != *name));
        own
    }

    /// Columns of numbers that no closure has of its own: what laws and drives use, and lengths between places.
    #[must_use]
    pub fn law_columns(&self) -> Vec<String> {
        let own: Vec<String> = (0..self.closures.len()).flat_map(|k| self.own_columns(k)).collect();
        let mut columns = self.value_columns();
        columns.retain(|name| !own.contains(name));
        columns
    }

    /// The name of a place that closures of this mechanism may touch, its columns in their order; none
    /// for another text.
    pub(crate) fn named_place(&self, text: &str) -> Option<PlaceName> {
        let things = (0..self.closures.len()).flat_map(|k| self.keyed_things(k));
        let own = |(thing, columns): (&str, &[String])| {
            let inside = text.strip_prefix(thing)?.strip_prefix('[')?.strip_suffix(']')?;
            let mut given = keys_of(inside, columns)?;
            given.sort_unstable();
            let each_once = given.iter().map(|(k, _)| *k).eq(0..columns.len());
            let keys: Vec<String> = given.into_iter().map(|(_, key)| key).collect();
            each_once.then(|| place_name(thing, columns, &keys))
        };
        things.filter_map(own).next().map(|name| PlaceName::of(&name))
    }

    /// The closures that a target is of: one, those of one make, or those that touch a place.
    pub(crate) fn closures_of(&self, target: Target) -> impl Iterator<Item = usize> {
        let own = self.parts(target).into_iter();
        let own = own.filter_map(|part| if let Target::Closure(k) = part { Some(k) } else { None });
        let place = if let Target::Place(place) = target { Some(place) } else { None };
        own.chain(place.into_iter().flat_map(|place| self.closures_at(place)))
    }

    /// The closures that touch a place.
    pub(crate) fn closures_at(&self, place: PlaceName) -> impl Iterator<Item = usize> {
        let touches = move |k: &usize| {
            let mut things = self.keyed_things(*k).into_iter();
            things.any(|(thing, _)| {
                place.text().strip_prefix(thing).is_some_and(|rest| rest.starts_with('['))
            })
        };
        (0..self.closures.len()).filter(touches)
    }
}
