//! [`LinkSide`].

use crate::kinematics::elements::{Axis, Way};
use crate::mechanism::{Mechanism, Target};
use crate::terms::term::{Acts, Spot, Term};

term! {
    /// A link that is displaced to the side.
    ///
    /// Adds `s` along the common normal of the axis of a joint and of the next one, in a link drawn
    /// as `xyz` and `rpy`, as a URDF has it, where neither length nor offset of the link moves it
    /// so: axes that meet in the drawing pass each other. Of rows of Denavit and Hartenberg it is
    /// the length.
    LinkSide("link_side", Geometry, per Row, needs Nothing) {
        s: "length" ~ 2.5e-3,
    } acts Acts::Geometry(&[(Spot::Side, Axis::X, Way::Slide)])
}

impl Term for LinkSide {
    fn suits_target(&self, mechanism: &Mechanism, target: Target) -> bool {
        matches!(target, Target::Row(chain, row) if mechanism.chains[chain].side(row).is_some())
    }
}
