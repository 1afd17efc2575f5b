//! [`AttachmentSlip`].

use crate::mechanism::{Mechanism, Target};
use crate::terms::term::{Acts, Placed, Term};

term! {
    /// A joint or a mark of a rigid body that moved once on its body.
    ///
    /// Moves the end of a closure that is one of several points of a moving body, or of what a chain carries,
    /// by `x`, `y`, `z` along the axes of this body from one pose on: a ball that was knocked, a pin that gave way.
    /// A point at which several closures end moves for all of them, and has the name of the first. The p-value is
    /// corrected for the number of poses.
    AttachmentSlip("attachment_slip", Closure, per Closure, needs Nothing) {
        x: "length" ~ 2.5e-3,
        y: "length" ~ 2.5e-3,
        z: "length" ~ 2.5e-3,
    } acts Acts::Attachment
}

impl Term for AttachmentSlip {
    fn placed(&self) -> Placed {
        Placed::AtPose
    }

    fn suits_target(&self, mechanism: &Mechanism, target: Target) -> bool {
        matches!(target, Target::Closure(closure) if mechanism.attachment(closure).is_some())
    }
}
