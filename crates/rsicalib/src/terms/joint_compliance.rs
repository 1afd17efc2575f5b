//! [`JointCompliance`].

use crate::kinematics::elements::Weight;
use crate::mechanism::{Mechanism, Target};
use crate::terms::targets::targets;
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

impl Term for JointCompliance {
    /// Drives of one make give alike, whatever they move.
    fn shared_by(&self, mechanism: &Mechanism) -> Vec<Target> {
        let loaded = targets(self, mechanism);
        let channels = loaded.into_iter().flat_map(|joint| mechanism.channels_at(joint));
        let drives = channels.filter(|&c| !mechanism.channels[c].passive).collect::<Vec<_>>();
        let alike = |all: &Target| drives.len() > 1 && mechanism.one_make(*all);
        Target::together(drives.iter().copied()).filter(alike).into_iter().collect()
    }
}
