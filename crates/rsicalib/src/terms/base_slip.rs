//! [`BaseSlip`].

use crate::kinematics::elements::{Axis, Way};
use crate::terms::term::{Acts, Placed, Spot, Term};

term! {
    /// A chain whose base moved once.
    ///
    /// Displaces a whole chain from one pose on, along the axes of the common base and about the
    /// axes of the frame of its first joint: a stand that was pushed, a bolt that gave way. The
    /// p-value is corrected for the number of poses.
    BaseSlip("base_slip", Geometry, per Chain, needs Nothing) {
        x: "length" ~ 0.01,
        y: "length" ~ 0.01,
        z: "length" ~ 0.01,
        rx: "rad" ~ 0.01,
        ry: "rad" ~ 0.01,
        rz: "rad" ~ 0.01,
    } acts Acts::Geometry(&[
        (Spot::Base, Axis::X, Way::Slide),
        (Spot::Base, Axis::Y, Way::Slide),
        (Spot::Base, Axis::Z, Way::Slide),
        (Spot::Root, Axis::X, Way::Turn),
        (Spot::Root, Axis::Y, Way::Turn),
        (Spot::Root, Axis::Z, Way::Turn),
    ])
}

impl Term for BaseSlip {
    fn placed(&self) -> Placed {
        Placed::AtPose
    }
}
