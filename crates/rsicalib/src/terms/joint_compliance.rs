//! [`JointCompliance`].

use crate::kinematics::elements::Weight;
use crate::terms::term::{Acts, Info, Term};

term! {
    /// A joint that gives under the weight of the links.
    ///
    /// Adds `compliance` times the gravity torque of the link masses about the joint
    /// to its coordinate.
    JointCompliance("joint_compliance", Load, per Channel, needs Masses) {
        compliance: "rad/torque" ~ 6e-3,
    }
}

impl Term for JointCompliance {
    fn info(&self) -> &'static Info {
        &Self::INFO
    }

    fn acts(&self) -> Acts {
        Acts::Load(Weight::Links)
    }
}
