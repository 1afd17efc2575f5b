//! [`JointCompliance`].

use crate::kinematics::elements::Weight;
use crate::terms::term::{Acts, Term};

term! {
    /// A joint that gives under the weight of the links.
    ///
    /// Adds `compliance` times the gravity torque of the link masses about the joint
    /// to its coordinate.
    JointCompliance("joint_compliance", Load, per Channel, needs Masses) {
        compliance: "rad/torque" ~ 6e-3,
    } acts Acts::Load(Weight::Links)
}

impl Term for JointCompliance {}
