//! [`LineSlip`].

use crate::mechanism::{Mechanism, Target};
use crate::numerics::lanes::Lanes;
use crate::terms::term::{Acts, Placed, Surface, Term};

term! {
    /// A line that moved once.
    ///
    /// Adds `step1 + lean1 u` and `step2 + lean2 u` to the offsets of the line from one pose on, where
    /// `u` is the place of the point along it, from the middle of all places to half their extent: a
    /// rail that was pushed, or loosened at one end. The p-value is corrected for the number of poses.
    LineSlip("line_slip", Closure, per Closure, needs Nothing) {
        step1: "length" ~ 2.5e-3,
        step2: "length" ~ 2.5e-3,
        lean1: "length" ~ 2.5e-3,
        lean2: "length" ~ 2.5e-3,
    } acts Acts::Surface(&Self)
}

impl Term for LineSlip {
    fn placed(&self) -> Placed {
        Placed::AtPose
    }

    fn suits_target(&self, mechanism: &Mechanism, target: Target) -> bool {
        mechanism.closures_of(target).any(|k| mechanism.is_on_line(k))
    }
}

impl Surface for LineSlip {
    fn correction(&self, p: &[f64], [u, _]: [Lanes; 2], row: usize) -> Lanes {
        Lanes::splat(p[row]) + u * p[2 + row]
    }

    fn partials(&self, [u, _]: [Lanes; 2], row: usize, out: &mut [Lanes]) {
        (out[row], out[2 + row]) = (Lanes::ONE, u);
    }

    fn slopes(&self, p: &[f64], _place: [Lanes; 2], row: usize) -> [Lanes; 2] {
        [Lanes::splat(p[2 + row]), Lanes::ZERO]
    }
}
