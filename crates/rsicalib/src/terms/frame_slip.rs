//! [`FrameSlip`].

use crate::mechanism::{Mechanism, Target};
use crate::terms::term::{Acts, OfInstrument, Placed, Term};

term! {
    /// An instrument that was knocked once.
    ///
    /// Moves all points that it sees of what moves by `x`, `y`, `z` along its own axes and by `rx`, `ry`, `rz`
    /// about them, from one pose on: a tracker or a measuring machine that somebody pushed. It has the name of
    /// the first closure that ends at what the instrument sees. Nothing tells it from the base of a
    /// single arm that moved (`base_slip`). The p-value is corrected for the number of poses.
    FrameSlip("frame_slip", Closure, per Closure, needs Nothing) {
        x: "length" ~ 0.01,
        y: "length" ~ 0.01,
        z: "length" ~ 0.01,
        rx: "rad" ~ 0.01,
        ry: "rad" ~ 0.01,
        rz: "rad" ~ 0.01,
    } acts Acts::Instrument(OfInstrument::Motion)
}

impl Term for FrameSlip {
    fn placed(&self) -> Placed {
        Placed::AtPose
    }

    fn suits_target(&self, mechanism: &Mechanism, target: Target) -> bool {
        matches!(target, Target::Closure(closure) if mechanism.first_seen(closure))
    }
}
