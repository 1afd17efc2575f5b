//! [`AttachmentPosition`].

use crate::mechanism::{Mechanism, Target};
use crate::terms::term::{Acts, Term};

term! {
    /// A joint of a moving body that sits elsewhere than drawn.
    ///
    /// Moves the end of a distance that is a point of a body by `x`, `y`, `z` along the axes of this body: a
    /// joint of a hexapod's plate, an eye of the load of a cable robot. A point at which several distances
    /// end moves for all of them, and has the name of the first.
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
