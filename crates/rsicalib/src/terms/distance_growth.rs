//! [`DistanceGrowth`].

use crate::closures::kind::Part;
use crate::mechanism::{Mechanism, Target};
use crate::terms::term::{Acts, Term};

term! {
    /// A distance that grows with the temperature.
    ///
    /// Adds `rate T` to the value of a distance closure, where `T` is the temperature above the
    /// mean of the session: a rod, a bar, a side of a handle. The rate is the length times its
    /// expansion, 12e-6 per kelvin for steel and 23e-6 for aluminium; `distance_growth@each` is that of all
    /// distances of one make.
    DistanceGrowth("distance_growth", Closure, per Closure, needs Temperature) {
        rate: "length/K" ~ 2e-5,
    } acts Acts::Distance
}

impl Term for DistanceGrowth {
    /// What a channel reads has a temperature of its own, a surface is no body, and what is unknown
    /// is of no pose.
    fn suits_target(&self, mechanism: &Mechanism, target: Target) -> bool {
        let Target::Closure(k) = target else { return false };
        let closure = &mechanism.closures[k];
        let of_points = closure.kind.facts().between[1] == Part::Point;
        of_points && mechanism.is_drawn(k) && !mechanism.is_link(closure)
    }
}
