//! [`LinkOffset`].

use crate::kinematics::elements::{Axis, Way};
use crate::terms::term::{Acts, Spot, Term};

term! {
    /// A link that is displaced along its joint axis.
    ///
    /// Adds `d` along the z axis after the joint of a row, the Denavit-Hartenberg
    /// offset; of a link drawn as `xyz`, as a URDF has it, across the link, as
    /// nearly along its joint axis as that goes.
    LinkOffset("link_offset", Geometry, per Row, needs Nothing) {
        d: "length" ~ 2.5e-3,
    } acts Acts::Geometry(&[(Spot::Link, Axis::Z, Way::Slide)])
}

impl Term for LinkOffset {}
