//! What is unknown and no term: points, planes and frames, one for each distinct combination of key
//! values. Their coordinates come after the parameters of the terms.

use crate::mechanism::{Mechanism, around, place_name};
use crate::readings::Readings;

/// What results call unknown things, in the place of a term.
pub const UNKNOWN_THINGS: [&str; 3] = ["unknown_point", "unknown_plane", "unknown_frame"];

/// True for what results call an unknown thing, which is no term.
#[must_use]
pub fn is_unknown_thing(id: &str) -> bool {
    UNKNOWN_THINGS.contains(&id)
}

/// A part of a mechanism whose place is not known: its index among those of its kind.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Thing {
    /// A point.
    Point(usize),
    /// A plane.
    Plane(usize),
    /// A frame in which points are measured.
    Frame(usize),
}

impl Thing {
    /// What results call it, in the place of a term.
    #[must_use]
    pub fn term(self) -> &'static str {
        let [point, plane, frame] = UNKNOWN_THINGS;
        match self {
            Self::Point(_) => point,
            Self::Plane(_) => plane,
            Self::Frame(_) => frame,
        }
    }

    /// Its unknown coordinates, and whether each is a length; tilts and turns are angles.
    #[must_use]
    pub fn coordinates(self, mechanism: &Mechanism) -> Vec<(&'static str, bool)> {
        match self {
            Self::Point(p) => {
                let axes = ["x", "y", "z"].into_iter().zip(mechanism.points[p].frees());
                axes.filter(|(_, free)| *free).map(|(axis, _)| (axis, true)).collect()
            }
            Self::Plane(_) => vec![("tilt1", false), ("tilt2", false), ("offset", true)],
            Self::Frame(_) => {
                let place = ["x", "y", "z"].map(|axis| (axis, true));
                let turn = ["rx", "ry", "rz"].map(|axis| (axis, false));
                place.into_iter().chain(turn).collect()
            }
        }
    }

    /// Its unknown coordinates where it is drawn; zeros where it is not.
    pub(crate) fn drawn(self, mechanism: &Mechanism) -> Vec<f64> {
        match self {
            Self::Point(p) => {
                let point = &mechanism.points[p];
                let at = point.at.unwrap_or_default().into_iter().zip(point.frees());
                at.filter(|(_, free)| *free).map(|(at, _)| at).collect()
            }
            Self::Plane(p) => {
                let known = mechanism.planes[p].known();
                vec![0.0, 0.0, known.map_or(0.0, |(_, offset)| offset)]
            }
            Self::Frame(f) => mechanism.frames[f].pose.unwrap_or_default().to_vec(),
        }
    }

    /// The axes from which the normal of a plane leans, as drawn.
    pub(crate) fn leans_from(self, mechanism: &Mechanism) -> [[f64; 3]; 3] {
        let drawn = match self {
            Self::Plane(p) => mechanism.planes[p].normal,
            Self::Point(_) | Self::Frame(_) => None,
        };
        around(drawn.unwrap_or([0.0, 0.0, 1.0]))
    }

    /// True for a plane whose normal nobody has drawn.
    pub(crate) fn faces_anywhere(self, mechanism: &Mechanism) -> bool {
        matches!(self, Self::Plane(p) if mechanism.planes[p].normal.is_none())
    }

    /// Its name, and the columns that tell its places apart.
    fn identity(self, mechanism: &Mechanism) -> (&str, &[String]) {
        match self {
            Self::Point(p) => (&mechanism.points[p].name, mechanism.points[p].keys()),
            Self::Plane(p) => (&mechanism.planes[p].name, mechanism.planes[p].keys()),
            Self::Frame(f) => (&mechanism.frames[f].name, mechanism.frames[f].keys()),
        }
    }

    /// All of a mechanism, points first.
    fn all(mechanism: &Mechanism) -> impl Iterator<Item = Self> {
        let points = mechanism.points.iter().enumerate().filter(|(_, p)| p.is_unknown());
        let points = points.filter(|(_, p)| !p.moves()).map(|(k, _)| Self::Point(k));
        let planes = mechanism.planes.iter().enumerate().filter(|(_, p)| p.unknown.is_some());
        let frames = mechanism.frames.iter().enumerate().filter(|(_, f)| f.unknown.is_some());
        points.chain(planes.map(|(k, _)| Self::Plane(k))).chain(frames.map(|(k, _)| Self::Frame(k)))
    }
}

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
