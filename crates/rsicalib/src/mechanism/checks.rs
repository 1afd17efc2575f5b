//! What is checked of a number or a name of a mechanism.

use std::f64::consts::TAU;

use crate::Error;
use crate::numerics::bounds;
use crate::text::{number, quoted, significant};

/// Beyond this an angle of a drawing is none in radians: programs that write drawings add angles of
/// half a turn up, to more than one turn and to less than two.
const TWO_TURNS: f64 = 2.0 * TAU;

pub(super) fn refuse(place: String, found: String, expected: String) -> Error {
    Error::Mechanism { place, found, expected }
}

/// The error of an unknown name, with the entry in which the name stands.
pub(crate) fn known(found: Result<usize, Error>, place: impl Fn() -> String) -> Result<(), Error> {
    match found {
        Err(Error::Unknown { kind, found, known }) => {
            let expected = match known.is_empty() {
                true => format!("one that is declared, and no {kind} is"),
                false => known,
            };
            Err(refuse(place(), format!("{kind} {}", quoted(&found)), expected))
        }
        other => other.map(|_| ()),
    }
}

pub(super) fn finite<'a>(
    mut numbers: impl Iterator<Item = &'a f64>,
    place: impl Fn() -> String,
) -> Result<(), Error> {
    match numbers.find(|n| !bounds::usable(**n)) {
        Some(n) => Err(refuse(place(), number(*n), bounds::expected(*n))),
        None => Ok(()),
    }
}

/// Refuses angles of more than two turns, which a drawing has none of: they are in degrees.
pub(super) fn angles<'a>(
    mut numbers: impl Iterator<Item = &'a f64>,
    place: impl Fn() -> String,
) -> Result<(), Error> {
    match numbers.find(|n| n.abs() > TWO_TURNS) {
        Some(n) => {
            let [found, radians] = [*n, n.to_radians()].map(|angle| significant(angle, 6));
            let expected = format!("radians within two turns: {found} degrees are {radians}");
            Err(refuse(place(), format!("an angle of {found}"), expected))
        }
        None => Ok(()),
    }
}
