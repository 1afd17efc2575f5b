//! [`Plane`].

use crate::closures::kind::{At, Given, Kind, Part};
use crate::numerics::lanes::{Lanes, Vec3};

/// A point is on a plane with unit normal `n`.
///
/// ```text
/// f = n · p - offset
/// ```
#[derive(Debug, Clone, Copy)]
pub struct Plane;

impl Kind for Plane {
    fn equations(&self) -> usize {
        1
    }

    fn between(&self) -> [Part; 2] {
        [Part::Point, Part::Plane]
    }

    fn given(&self) -> Given {
        Given::Offset
    }

    fn words(&self) -> &'static str {
        "a point is on a plane"
    }

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
