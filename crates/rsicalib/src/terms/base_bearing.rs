//! [`BaseBearing`].

use crate::kinematics::elements::{Axis, Way};
use crate::terms::term::{Acts, Spot, Term};

term! {
    /// A chain stands at another bearing of the common base.
    ///
    /// Turns the whole chain about the z axis of the base: an error of the
    /// Denavit-Hartenberg angle of the chain's fixed row.
    BaseBearing("base_bearing", Geometry, per Chain, needs Nothing) {
        rz: "rad" ~ 4e-3,
    } acts Acts::Geometry(&[(Spot::Base, Axis::Z, Way::Turn)])
}

impl Term for BaseBearing {}
