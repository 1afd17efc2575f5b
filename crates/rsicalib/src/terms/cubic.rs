//! [`Cubic`].

use crate::numerics::lanes::Lanes;
use crate::terms::term::{Acts, Sensor, Site, Term};

term! {
    /// Cubic error of a sensor.
    ///
    /// Adds `c3 u³` to the joint angle, where `u` is the reading from the middle of
    /// its range in half ranges: a symmetric departure from linearity.
    Cubic("cubic", Sensor, per Channel, needs Nothing) {
        c3: "rad" ~ 0.03,
    } acts Acts::Sensor(&Self)
}

impl Term for Cubic {}

impl Sensor for Cubic {
    fn correction(&self, p: &[f64], site: &Site) -> Lanes {
        let u = site.u();
        u * u * u * p[0]
    }

    fn partials(&self, _p: &[f64], site: &Site, out: &mut [Lanes]) {
        let u = site.u();
        out[0] = u * u * u;
    }

    fn slope(&self, p: &[f64], site: &Site) -> Lanes {
        let u = site.u();
        u * u * (3.0 * p[0] / site.scale().half_range)
    }
}
