//! [`BaseBearing`].

use crate::kinematics::elements::{Axis, Way};
use crate::terms::term::{Acts, Info, Spot, Term};

term! {
    /// A chain stands at another bearing of the common base.
    ///
    /// Turns the whole chain about the z axis of the base: an error of the
    /// Denavit-Hartenberg angle of the chain's fixed row.
    BaseBearing("base_bearing", Geometry, per Chain, needs Nothing) {
        rz: "rad" ~ 4e-3,
    }
}

impl Term for BaseBearing {
    fn info(&self) -> &'static Info {
        &Self::INFO
    }

    fn acts(&self) -> Acts {
        Acts::Geometry(&[(Spot::Base, Axis::Z, Way::Turn)])
    }
}
