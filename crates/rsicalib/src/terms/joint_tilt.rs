//! [`JointTilt`].

use crate::kinematics::elements::{Axis, Way};
use crate::terms::term::{Acts, Spot, Term};

term! {
    /// A joint axis that is tilted against the one before.
    ///
    /// Turns the far end of a row's body about its x and y axes: the error of the
    /// Denavit-Hartenberg twist, and Hayati's angle.
    JointTilt("joint_tilt", Geometry, per Row, needs Nothing) {
        alpha: "rad" ~ 4e-3,
        beta: "rad" ~ 4e-3,
    } acts Acts::Geometry(&[(Spot::End, Axis::X, Way::Turn), (Spot::End, Axis::Y, Way::Turn)])
}

impl Term for JointTilt {}
