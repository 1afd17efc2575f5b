//! [`JointSag`].

use crate::kinematics::elements::Weight;
use crate::terms::term::{Acts, Term};

term! {
    /// A joint that gives under the weight at the end of its chain.
    ///
    /// Adds `compliance` times the torque of a unit weight at the points that the chain carries,
    /// about this joint alone: a soft bearing or drive where the links are stiff.
    JointSag("joint_sag", Load, per Channel, needs Gravity) {
        compliance: "rad/length" ~ 4e-3,
    } acts Acts::Load(Weight::Tip)
}

impl Term for JointSag {}
