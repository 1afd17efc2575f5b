//! [`LinkGrowth`].

use crate::kinematics::elements::{Axis, Way};
use crate::mechanism::{Mechanism, Target};
use crate::terms::term::{Acts, Spot, Term};

term! {
    /// A link that grows with the temperature.
    ///
    /// Moves the next joint away from the joint of a row by `rate T`, along the way that leads
    /// there, where `T` is the temperature above the mean of the session: the rate is the
    /// length of the link times its expansion, 12e-6 per kelvin for steel and 23e-6 for aluminium.
    LinkGrowth("link_growth", Geometry, per Row, needs Temperature) {
        rate: "length/K" ~ 2e-5,
    } acts Acts::Geometry(&[(Spot::Along, Axis::X, Way::Slide)])
}

impl Term for LinkGrowth {
    /// What has no length does not grow.
    fn suits_target(&self, mechanism: &Mechanism, target: Target) -> bool {
        matches!(target, Target::Row(chain, row)
            if mechanism.chains[chain].rows[row].along().is_some())
    }
}
