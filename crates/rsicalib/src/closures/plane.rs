//! [`Plane`].

use crate::closures::kind::{At, Facts, Given, Kind, Part};
use crate::numerics::lanes::{Lanes, Vec3};

/// A point is on a plane with unit normal `n`.
///
/// ```text
/// f = n · p - offset
/// ```
#[derive(Debug, Clone, Copy)]
pub struct Plane;

impl Kind for Plane {
    const FACTS: Facts = Facts {
        words: "a point is on a plane",
        equations: 1,
        between: [Part::Point, Part::Plane],
        given: Given::Offset,
        is_vector: false,
        dimension: 1,
    };

    #[inline(always)]
    fn misclosure(at: &At, row: usize) -> Lanes {
        at.along(row, &at.apart) - at.value
    }

    #[inline(always)]
    fn by_end(at: &At, row: usize, moved: &Vec3, sign: f64) -> Lanes {
        at.from_surface(row, moved) * sign
    }

    #[inline(always)]
    fn by_value(_at: &At, _row: usize) -> Lanes {
        -Lanes::ONE
    }
}
