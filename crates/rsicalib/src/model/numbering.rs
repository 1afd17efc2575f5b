//! Numbers of what is unknown and no term, one for each distinct combination of key values. Their
//! coordinates come after the parameters of the terms.

use crate::mechanism::{Mechanism, place_name};
use crate::model::thing::Thing;
use crate::readings::Readings;

/// One unknown place of a thing.
#[derive(Debug, Clone, PartialEq)]
pub struct Unknown {
    /// The thing.
    pub thing: Thing,
    /// Values of the columns that tell its places apart.
    pub keys: Vec<String>,
    /// `socket[group=front,at=socket0]`; the name alone where there is one for all rows.
    pub name: String,
    /// Its first parameter, counted from the first after those of the terms.
    pub first: usize,
    /// Number of its parameters.
    pub width: usize,
}

/// A thing among the columns of `X`.
#[derive(Debug, Clone)]
pub(crate) struct Owned {
    pub(crate) thing: Thing,
    /// Its first column, counted from the first after those of the terms.
    pub(crate) column: usize,
    pub(crate) width: usize,
    /// For each combination of keys, the number of its unknown.
    pub(crate) numbers: Vec<usize>,
}

fn name_of(thing: Thing, mechanism: &Mechanism, keys: &[String]) -> String {
    let (name, columns) = thing.identity(mechanism);
    place_name(name, columns, keys)
}

/// Numbers what is unknown: each thing with its numbers by combination of keys, and each number.
pub(crate) fn number_unknowns(
    mechanism: &Mechanism,
    readings: &Readings,
) -> (Vec<Owned>, Vec<Unknown>) {
    let columns = mechanism.key_columns();
    let mut owned = Vec::new();
    let mut unknowns: Vec<Unknown> = Vec::new();
    let (mut column, mut first) = (0, 0);
    for thing in Thing::all(mechanism) {
        let width = thing.coordinates(mechanism).len();
        let (_, own) = thing.identity(mechanism);
        let keys_of = |group: &Vec<String>| -> Vec<String> {
            let key = |c: &String| columns.iter().position(|k| k == c).map(|i| group[i].clone());
            own.iter().filter_map(key).collect()
        };
        let blank = |keys: &[String]| keys.iter().any(String::is_empty);
        let mut number = |keys: Vec<String>| {
            let known = unknowns.iter().position(|u| u.thing == thing && u.keys == keys);
            known.unwrap_or_else(|| {
                let name = name_of(thing, mechanism, &keys);
                unknowns.push(Unknown { thing, keys, name, first, width });
                first += width;
                unknowns.len() - 1
            })
        };
        let of_group = |group: &Vec<String>| {
            let keys = keys_of(group);
            if blank(&keys) { None } else { Some(number(keys)) }
        };
        let numbers: Vec<Option<usize>> = readings.groups.iter().map(of_group).collect();
        // What does not hold counts nowhere: any place will do.
        let any = numbers.iter().find_map(|n| *n);
        let any = any.or_else(|| readings.groups.first().map(|group| number(keys_of(group))));
        let numbers = numbers.into_iter().map(|n| n.or(any).unwrap_or_default()).collect();
        owned.push(Owned { thing, column, width, numbers });
        column += width;
    }
    (owned, unknowns)
}
