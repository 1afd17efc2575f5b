//! [`Curvature`].

use crate::numerics::lanes::Lanes;
use crate::terms::term::{Acts, Sensor, Site, Term};

term! {
    /// Parabolic error of a sensor.
    ///
    /// Adds `c2 u²` to the joint angle, where `u` is the reading from the middle of
    /// its range in half ranges: a loaded wiper, or a track of uneven width.
    Curvature("curvature", Sensor, per Channel, needs Nothing) {
        c2: "rad" ~ 0.02,
    } acts Acts::Sensor(&Self)
}

impl Term for Curvature {}

impl Sensor for Curvature {
    fn correction(&self, p: &[f64], site: &Site) -> Lanes {
        let u = site.u();
        u * u * p[0]
    }

    fn partials(&self, _p: &[f64], site: &Site, out: &mut [Lanes]) {
        let u = site.u();
        out[0] = u * u;
    }

    fn slope(&self, p: &[f64], site: &Site) -> Lanes {
        site.u() * (2.0 * p[0] / site.scale().half_range)
    }
}
