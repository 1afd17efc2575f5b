//! [`Sag`].

use crate::kinematics::elements::Weight;
use crate::terms::term::{Acts, Info, Term};

term! {
    /// A chain that bends under the weight at its end.
    ///
    /// Each joint of one chain, or of all chains, gives by `compliance` times the
    /// torque of a unit weight at the points that its chain carries.
    Sag("sag", Load, per ChainOrAll, needs Gravity) {
        compliance: "rad/length" ~ 4e-3,
    }
}

impl Term for Sag {
    fn info(&self) -> &'static Info {
        &Self::INFO
    }

    fn acts(&self) -> Acts {
        Acts::Load(Weight::Tip)
    }
}
