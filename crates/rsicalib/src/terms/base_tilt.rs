//! [`BaseTilt`].

use crate::kinematics::elements::{Axis, Way};
use crate::terms::term::{Acts, Spot, Term};

term! {
    /// The first joint axis of a chain is tilted.
    ///
    /// Turns the whole chain about the x and y axes of its first joint's frame. A
    /// turn about z is the offset of that joint.
    BaseTilt("base_tilt", Geometry, per Chain, needs Nothing) {
        rx: "rad" ~ 4e-3,
        ry: "rad" ~ 4e-3,
    } acts Acts::Geometry(&[(Spot::Root, Axis::X, Way::Turn), (Spot::Root, Axis::Y, Way::Turn)])
}

impl Term for BaseTilt {}
