//! [`PointSlip`].

use crate::mechanism::{Mechanism, Target};
use crate::terms::term::{Acts, Placed, Term};

term! {
    /// A point that stands, and was moved once.
    ///
    /// Moves the end of a closure that is on no chain by `x`, `y`, `z` from one pose on: an anchor that
    /// slipped, a socket that was pushed, an instrument that was knocked. The p-value is corrected for
    /// the number of poses.
    PointSlip("point_slip", Closure, per Closure, needs Nothing) {
        x: "length" ~ 2.5e-3,
        y: "length" ~ 2.5e-3,
        z: "length" ~ 2.5e-3,
    } acts Acts::End
}

impl Term for PointSlip {
    fn placed(&self) -> Placed {
        Placed::AtPose
    }

    fn suits_target(&self, mechanism: &Mechanism, target: Target) -> bool {
        mechanism.closures_of(target).any(|k| mechanism.standing_end(k).is_some())
    }
}
