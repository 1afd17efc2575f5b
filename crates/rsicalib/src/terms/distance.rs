//! [`Distance`].

use crate::mechanism::{Mechanism, Target};
use crate::terms::term::{Acts, Term};

term! {
    /// A distance between two points that is not the drawn one.
    ///
    /// Adds `d` to the value of a distance closure, for example one side of a handle. `distance@each` adds to
    /// all distances of one make: rods of a delta printer whose length was entered wrongly. Of one make are two
    /// and more whose known values differ by less than a tenth.
    Distance("distance", Closure, per Closure, needs Nothing) {
        d: "length" ~ 2.5e-3,
    } acts Acts::Distance
}

impl Term for Distance {
    /// What a channel reads has an offset, and what is unknown a place.
    fn suits_target(&self, mechanism: &Mechanism, target: Target) -> bool {
        matches!(target, Target::Closure(k) if mechanism.is_drawn(k))
    }
}
