//! [`LinkFrame`].

use crate::kinematics::elements::{Axis, Way};
use crate::terms::term::{Acts, Spot, Term};

term! {
    /// The whole frame of a link: three translations and three rotations.
    ///
    /// This term at every row is the complete geometry of a chain. Redundant
    /// directions are determined by the priors.
    LinkFrame("link_frame", Geometry, per Row, needs Nothing, broad) {
        x: "length" ~ 2.5e-3,
        y: "length" ~ 2.5e-3,
        z: "length" ~ 2.5e-3,
        rx: "rad" ~ 3e-3,
        ry: "rad" ~ 3e-3,
        rz: "rad" ~ 3e-3,
    } acts Acts::Geometry(&[
        (Spot::Joint, Axis::X, Way::Slide),
        (Spot::Joint, Axis::Y, Way::Slide),
        (Spot::Joint, Axis::Z, Way::Slide),
        (Spot::End, Axis::X, Way::Turn),
        (Spot::End, Axis::Y, Way::Turn),
        (Spot::End, Axis::Z, Way::Turn),
    ])
}

impl Term for LinkFrame {}
