//! [`Drift`].

use crate::numerics::lanes::Lanes;
use crate::terms::term::{Acts, Sensor, Site, Term};

term! {
    /// Steady drift of a sensor during the session.
    ///
    /// Adds `rate (t - 1/2)` to the joint angle, where `t` runs from 0 to 1 over the
    /// session: a pot that slips slowly, or warms up.
    Drift("drift", Sensor, per Channel, needs Order) {
        rate: "rad/session" ~ 5e-3,
    } acts Acts::Sensor(&Self)
}

impl Term for Drift {}

impl Sensor for Drift {
    fn correction(&self, p: &[f64], site: &Site) -> Lanes {
        (site.time - Lanes::splat(0.5)) * p[0]
    }

    fn partials(&self, _p: &[f64], site: &Site, out: &mut [Lanes]) {
        out[0] = site.time - Lanes::splat(0.5);
    }
}
