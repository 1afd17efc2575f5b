//! [`Slip`].

use crate::mechanism::{Mechanism, Target};
use crate::numerics::lanes::Lanes;
use crate::terms::term::{Acts, Placed, Role, Sensor, Site, Term};

term! {
    /// A sensor that jumped once.
    ///
    /// Adds `step` to the joint angle from one pose on: a set screw that gave way. `slip@each` adds to all
    /// channels that read lengths: belts that were wound up anew.
    /// The search tries every pose, and the p-value is corrected for their number.
    Slip("slip", Sensor, per Channel, needs Nothing) {
        step: "rad" ~ 0.01,
    } acts Acts::Sensor(&Self)
}

impl Term for Slip {
    fn placed(&self) -> Placed {
        Placed::AtPose
    }

    /// Belts that are wound up anew begin elsewhere, all of them.
    fn shared_by(&self, mechanism: &Mechanism) -> Vec<Target> {
        Target::together(mechanism.measuring())
            .filter(|t| mechanism.one_make(*t))
            .into_iter()
            .collect()
    }

    fn role(&self) -> Role {
        Role::Shift
    }
}

impl Sensor for Slip {
    fn correction(&self, p: &[f64], site: &Site) -> Lanes {
        after(site) * p[0]
    }

    fn partials(&self, _p: &[f64], site: &Site, out: &mut [Lanes]) {
        out[0] = after(site);
    }
}

/// One from the pose of the slip on, zero before that pose.
fn after(site: &Site) -> Lanes {
    let place = site.place as f64;
    site.pose.map(|pose| if pose >= place { 1.0 } else { 0.0 })
}
