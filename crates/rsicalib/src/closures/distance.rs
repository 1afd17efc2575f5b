//! [`Distance`].

use crate::closures::kind::{At, Facts, Given, Kind, Part};
use crate::numerics::lanes::{Lanes, Vec3, dot};

/// Two points are a known length apart, eq. (10).
///
/// ```text
/// f = |a - b|² - d²
/// f = |a - b| - d             where a channel, or a column of the readings, measures d
/// ```
///
/// A length that is measured differs from pose to pose, and so would the scale of an area.
#[derive(Debug, Clone, Copy)]
pub struct Distance;

impl Kind for Distance {
    const FACTS: Facts = Facts {
        words: "two points are a known length apart",
        equations: 1,
        between: [Part::Point; 2],
        given: Given::Value,
        is_vector: false,
        dimension: 2,
    };

    #[inline(always)]
    fn misclosure(at: &At, _row: usize) -> Lanes {
        let square = dot(&at.apart, &at.apart);
        if at.measured { square.sqrt() - at.value } else { square - at.value * at.value }
    }

    #[inline(always)]
    fn by_end(at: &At, _row: usize, moved: &Vec3, sign: f64) -> Lanes {
        let along = dot(&at.apart, moved);
        if at.measured {
            // No direction where the points coincide.
            let square = dot(&at.apart, &at.apart).map(|square| square.max(f64::MIN_POSITIVE));
            return along * sign / square.sqrt();
        }
        along * (2.0 * sign)
    }

    #[inline(always)]
    fn by_value(at: &At, _row: usize) -> Lanes {
        if at.measured { -Lanes::ONE } else { at.value * -2.0 }
    }
}
