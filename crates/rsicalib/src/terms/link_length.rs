//! [`LinkLength`].

use crate::kinematics::elements::{Axis, Way};
use crate::terms::term::{Acts, Spot, Term};

term! {
    /// A link that is longer than drawn.
    ///
    /// Adds `a` along the x axis after the joint of a row, the Denavit-Hartenberg
    /// length; of a link drawn as `xyz`, as a URDF has it, along the way from its
    /// joint to the next.
    LinkLength("link_length", Geometry, per Row, needs Nothing) {
        a: "length" ~ 2.5e-3,
    } acts Acts::Geometry(&[(Spot::Link, Axis::X, Way::Slide)])
}

impl Term for LinkLength {}
