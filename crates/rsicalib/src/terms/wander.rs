//! [`Wander`].

use crate::numerics::lanes::Lanes;
use crate::terms::term::{Acts, Sensor, Site, Term};
use crate::terms::waves;

term! {
    /// Offset of a sensor that wanders during the session.
    ///
    /// Adds `Σ_k w_k cos(k π t)` to the joint angle, where `t` runs from 0 to 1 over the
    /// session: a pot that creeps to and fro, or warms up. Each coefficient is held by its
    /// typical size, which falls as `1/k`.
    Wander("wander", Sensor, per Channel, needs Order, penalised) {
        w1: "rad" ~ 0.01,
        w2: "rad" ~ 0.005,
        w3: "rad" ~ 0.0033,
        w4: "rad" ~ 0.0025,
        w5: "rad" ~ 0.002,
        w6: "rad" ~ 0.0017,
    } acts Acts::Sensor(&Self)
}

impl Term for Wander {}

impl Sensor for Wander {
    fn correction(&self, p: &[f64], site: &Site) -> Lanes {
        waves::sum(p, site.time)
    }

    fn partials(&self, _p: &[f64], site: &Site, out: &mut [Lanes]) {
        waves::each(site.time, out);
    }
}
