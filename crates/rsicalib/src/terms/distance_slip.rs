//! [`DistanceSlip`].

use crate::mechanism::{Mechanism, Target};
use crate::terms::term::{Acts, Placed, Term};

term! {
    /// A distance that changed once.
    ///
    /// Adds `step` to the value of a distance closure from one pose on: a clamp of a bar that gave
    /// way, a ball that was seated again. The p-value is corrected for the number of poses.
    DistanceSlip("distance_slip", Closure, per Closure, needs Nothing) {
        step: "length" ~ 2.5e-3,
    } acts Acts::Distance
}

impl Term for DistanceSlip {
    fn placed(&self) -> Placed {
        Placed::AtPose
    }

    /// A distance between unknown points is of no pose, and what a channel reads slips with it.
    fn suits_target(&self, mechanism: &Mechanism, target: Target) -> bool {
        matches!(target, Target::Closure(k)
            if mechanism.slips(k) && !mechanism.is_link(&mechanism.closures[k]))
    }
}
