//! [`Distance`].

use crate::closures::kind::{At, Kind};
use crate::numerics::lanes::{Lanes, Vec3, dot};

/// Two points are a known length apart, eq. (10).
///
/// ```text
/// f = |a - b|² - d²
/// ```
#[derive(Debug, Clone, Copy)]
pub struct Distance;

impl Kind for Distance {
    fn equations(&self) -> usize {
        1
    }

    fn has_value(&self) -> bool {
        true
    }

    /// To first order `f` is `2 d` times the error of the distance.
    fn per_length(&self, value: f64) -> f64 {
        2.0 * value
    }

    fn dimension(&self) -> i32 {
        2
    }

    fn words(&self) -> &'static str {
        "two points are a known length apart"
    }

    #[inline(always)]
    fn misclosure(at: &At, _row: usize) -> Lanes {
        dot(&at.apart, &at.apart) - at.value * at.value
    }

    #[inline(always)]
    fn by_end(at: &At, _row: usize, moved: &Vec3, sign: f64) -> Lanes {
        dot(&at.apart, moved) * (2.0 * sign)
    }

    #[inline(always)]
    fn by_value(at: &At, _row: usize) -> Lanes {
        at.value * -2.0
    }
}
