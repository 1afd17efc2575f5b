//! [`Line`].

use crate::closures::kind::{At, Facts, Given, Kind, Part};
use crate::numerics::lanes::{Lanes, Vec3};

/// A point is on a line through `o`, across which are `u` and `v`.
///
/// ```text
/// f = u · (p - o),  v · (p - o)
/// ```
#[derive(Debug, Clone, Copy)]
pub struct Line;

impl Kind for Line {
    const FACTS: Facts = Facts {
        words: "a point is on a line",
        equations: 2,
        between: [Part::Point, Part::Line],
        given: Given::Nothing,
        is_vector: false,
        dimension: 1,
    };

    #[inline(always)]
    fn by_end(at: &At, row: usize, moved: &Vec3, sign: f64) -> Lanes {
        at.from_surface(row, moved) * sign
    }
}
