//! [`Touch`].

use crate::closures::kind::{At, Given, Kind, Part};
use crate::numerics::lanes::{Lanes, Vec3};

/// Two points coincide.
///
/// ```text
/// f = a - b
/// ```
#[derive(Debug, Clone, Copy)]
pub struct Touch;

impl Kind for Touch {
    fn equations(&self) -> usize {
        3
    }

    fn between(&self) -> [Part; 2] {
        [Part::Point; 2]
    }

    fn given(&self) -> Given {
        Given::Nothing
    }

    fn is_vector(&self) -> bool {
        true
    }

    fn words(&self) -> &'static str {
        "two points coincide"
    }

    #[inline(always)]
    fn misclosure(at: &At, row: usize) -> Lanes {
        at.along(row, &at.apart)
    }

    #[inline(always)]
    fn by_end(at: &At, row: usize, moved: &Vec3, sign: f64) -> Lanes {
        at.along(row, moved) * sign
    }

    #[inline(always)]
    fn by_value(_at: &At, _row: usize) -> Lanes {
        Lanes::ZERO
    }
}
