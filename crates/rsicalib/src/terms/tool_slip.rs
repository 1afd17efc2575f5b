//! [`ToolSlip`].

use crate::kinematics::elements::{Axis, Way};
use crate::terms::term::{Acts, Placed, Spot, Term};

term! {
    /// A tool that moved once on the end of its chain.
    ///
    /// Displaces the points that a chain carries, from one pose on, along the axes of the frame at
    /// the end of the chain: a clamp that gave way. A trace searches for it where chains touch
    /// unknown points; the p-value is corrected for the number of poses.
    ToolSlip("tool_slip", Geometry, per Chain, needs Nothing) {
        x: "length" ~ 0.01,
        y: "length" ~ 0.01,
        z: "length" ~ 0.01,
    } acts Acts::Geometry(&[
        (Spot::Tip, Axis::X, Way::Slide),
        (Spot::Tip, Axis::Y, Way::Slide),
        (Spot::Tip, Axis::Z, Way::Slide),
    ])
}

impl Term for ToolSlip {
    fn placed(&self) -> Placed {
        Placed::AtPose
    }
}
