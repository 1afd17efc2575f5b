//! [`Sag`].

use crate::kinematics::elements::Weight;
use crate::terms::term::{Acts, Term};

term! {
    /// A chain that bends under the weight at its end.
    ///
    /// Each joint of one chain, or of all chains, gives by `compliance` times the
    /// torque of a unit weight at the points that its chain carries.
    Sag("sag", Load, per ChainOrAll, needs Gravity) {
        compliance: "rad/length" ~ 4e-3,
    } acts Acts::Load(Weight::Tip)
}

impl Term for Sag {}
