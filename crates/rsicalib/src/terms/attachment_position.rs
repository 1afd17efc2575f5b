//! [`AttachmentPosition`].

use crate::mechanism::{Mechanism, Target};
use crate::terms::term::{Acts, Term};

term! {
    /// A joint or a mark of a rigid body that sits elsewhere than drawn.
    ///
    /// Moves the end of a closure that is one of several points of a moving body, or of what a chain carries,
    /// by `x`, `y`, `z` along the axes of this body: a joint of a hexapod's plate, an eye of the load of a
    /// cable robot, a reflector that a tracker measures. A point at which several closures end moves for all
    /// of them, and has the name of the first.
    AttachmentPosition("attachment_position", Closure, per Closure, needs Nothing) {
        x: "length" ~ 2.5e-3,
        y: "length" ~ 2.5e-3,
        z: "length" ~ 2.5e-3,
    } acts Acts::Attachment
}

impl Term for AttachmentPosition {
    fn suits_target(&self, mechanism: &Mechanism, target: Target) -> bool {
        matches!(target, Target::Closure(closure) if mechanism.attachment(closure).is_some())
    }
}
