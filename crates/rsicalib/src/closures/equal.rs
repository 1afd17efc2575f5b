//! [`Equal`].

use crate::closures::kind::{At, Facts, Given, Kind, Part};
use crate::numerics::lanes::{Lanes, Vec3};

/// The coordinates of two channels are equal.
///
/// ```text
/// f = q_a - q_b - value              with a value of zero, to which terms can add
/// ```
#[derive(Debug, Clone, Copy)]
pub struct Equal;

impl Kind for Equal {
    const FACTS: Facts = Facts {
        words: "two channels have one coordinate",
        equations: 1,
        between: [Part::Channel; 2],
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
        at.along(row, moved) * sign
    }

    #[inline(always)]
    fn by_value(_at: &At, _row: usize) -> Lanes {
        -Lanes::ONE
    }
}
