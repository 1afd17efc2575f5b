//! [`Sag`].

use crate::kinematics::elements::Weight;
use crate::terms::term::{Acts, Info, Term};

term! {
    /// A chain that bends under the weight at its end.
    ///
    /// Each joint gives by `compliance` times the torque of a unit weight at the
    /// points that the chain carries: of one chain, or of all alike.
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
