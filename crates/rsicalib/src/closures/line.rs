//! [`Line`].

use crate::closures::kind::{At, Given, Kind, Part};
use crate::numerics::lanes::{Lanes, Vec3};

/// A point is on a line through `o`, across which are `u` and `v`.
///
/// ```text
/// f = u · (p - o),  v · (p - o)
/// ```
#[derive(Debug, Clone, Copy)]
pub struct Line;

impl Kind for Line {
    fn equations(&self) -> usize {
        2
    }

    fn between(&self) -> [Part; 2] {
        [Part::Point, Part::Line]
    }

    fn given(&self) -> Given {
        Given::Nothing
    }

    fn words(&self) -> &'static str {
        "a point is on a line"
    }

    #[inline(always)]
    fn by_end(at: &At, row: usize, moved: &Vec3, sign: f64) -> Lanes {
        at.from_surface(row, moved) * sign
    }
}
