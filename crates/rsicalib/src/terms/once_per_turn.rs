//! [`OncePerTurn`].

use crate::mechanism::Mechanism;
use crate::numerics::lanes::Lanes;
use crate::terms::term::{Acts, Sensor, Site, Term};

term! {
    /// Error of a sensor that repeats once per turn.
    ///
    /// Adds `a sin φ + b cos φ` to the joint angle, where `φ` is the nominal angle of the
    /// sensor from the middle of its range. A track of radius `R` that is centred `e` off the
    /// joint axis has an error of `e/R`.
    OncePerTurn("once_per_turn", Sensor, per Channel, needs Nothing) {
        a: "rad" ~ 0.01,
        b: "rad" ~ 0.01,
    } acts Acts::Sensor(&Self)
}

impl Term for OncePerTurn {
    fn suits(&self, mechanism: &Mechanism, channel: usize) -> bool {
        mechanism.goes_round(channel)
    }
}

impl Sensor for OncePerTurn {
    fn correction(&self, p: &[f64], site: &Site) -> Lanes {
        let (sin, cos) = site.phi().sin_cos();
        sin * p[0] + cos * p[1]
    }

    fn partials(&self, _p: &[f64], site: &Site, out: &mut [Lanes]) {
        let (sin, cos) = site.phi().sin_cos();
        out[0] = sin;
        out[1] = cos;
    }

    fn slope(&self, p: &[f64], site: &Site) -> Lanes {
        let (sin, cos) = site.phi().sin_cos();
        (cos * p[0] - sin * p[1]) * (site.scale().gain)
    }
}
