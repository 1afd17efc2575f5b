//! [`BasePosition`].

use crate::kinematics::elements::{Axis, Way};
use crate::terms::term::{Acts, Spot, Term};

term! {
    /// The base of a chain stands elsewhere than drawn.
    ///
    /// Moves the whole chain along the axes of the common base.
    BasePosition("base_position", Geometry, per Chain, needs Nothing) {
        x: "length" ~ 2.5e-3,
        y: "length" ~ 2.5e-3,
        z: "length" ~ 2.5e-3,
    } acts Acts::Geometry(&[
        (Spot::Base, Axis::X, Way::Slide),
        (Spot::Base, Axis::Y, Way::Slide),
        (Spot::Base, Axis::Z, Way::Slide),
    ])
}

impl Term for BasePosition {}
