//! [`PlaneSlip`].

use crate::mechanism::{Mechanism, Target};
use crate::numerics::lanes::Lanes;
use crate::terms::term::{Acts, Placed, Surface, Term};

term! {
    /// A plane that moved once.
    ///
    /// Adds `step + lean1 u + lean2 v` to the offset of the plane from one pose on, where `u` and `v`
    /// are the place of the point along the plane's own axes, from the middle of all places to half
    /// their extent: a table that was pushed, a bed that was levelled again. The p-value is corrected
    /// for the number of poses.
    PlaneSlip("plane_slip", Closure, per Closure, needs Nothing) {
        step: "length" ~ 2.5e-3,
        lean1: "length" ~ 2.5e-3,
        lean2: "length" ~ 2.5e-3,
    } acts Acts::Surface(&Self)
}

impl Term for PlaneSlip {
    fn placed(&self) -> Placed {
        Placed::AtPose
    }

    fn suits_target(&self, mechanism: &Mechanism, target: Target) -> bool {
        mechanism.closures_of(target).any(|k| mechanism.is_on_plane(k))
    }
}

impl Surface for PlaneSlip {
    fn correction(&self, p: &[f64], [u, v]: [Lanes; 2], _row: usize) -> Lanes {
        Lanes::splat(p[0]) + u * p[1] + v * p[2]
    }

    fn partials(&self, [u, v]: [Lanes; 2], _row: usize, out: &mut [Lanes]) {
        (out[0], out[1], out[2]) = (Lanes::ONE, u, v);
    }

    fn slopes(&self, p: &[f64], _place: [Lanes; 2], _row: usize) -> [Lanes; 2] {
        [Lanes::splat(p[1]), Lanes::splat(p[2])]
    }
}
