//! [`PointPosition`].

use crate::kinematics::elements::{Axis, Way};
use crate::terms::term::{Acts, Spot, Term};

term! {
    /// The points that a chain carries sit elsewhere than drawn.
    ///
    /// Moves the points along the axes of the frame at the end of the chain: a tool
    /// whose shape is known only roughly.
    PointPosition("point_position", Geometry, per Chain, needs Nothing, broad) {
        x: "length" ~ 0.05,
        y: "length" ~ 0.05,
        z: "length" ~ 0.05,
    } acts Acts::Geometry(&[
        (Spot::Tip, Axis::X, Way::Slide),
        (Spot::Tip, Axis::Y, Way::Slide),
        (Spot::Tip, Axis::Z, Way::Slide),
    ])
}

impl Term for PointPosition {}
