//! [`TwicePerTurn`].

use crate::mechanism::Mechanism;
use crate::numerics::lanes::Lanes;
use crate::terms::term::{Acts, Sensor, Site, Term};

term! {
    /// Error of a sensor that repeats twice per turn.
    ///
    /// Adds `a sin 2φ + b cos 2φ` to the joint angle, where `φ` is the nominal angle of the
    /// sensor from the middle of its range: an oval track, or a shaft coupling at an angle.
    TwicePerTurn("twice_per_turn", Sensor, per Channel, needs Nothing) {
        a: "rad" ~ 0.01,
        b: "rad" ~ 0.01,
    } acts Acts::Sensor(&Self)
}

impl Term for TwicePerTurn {
    fn suits(&self, mechanism: &Mechanism, channel: usize) -> bool {
        mechanism.goes_round(channel)
    }
}

impl Sensor for TwicePerTurn {
    fn correction(&self, p: &[f64], site: &Site) -> Lanes {
        let (sin, cos) = phase(site).sin_cos();
        sin * p[0] + cos * p[1]
    }

    fn partials(&self, _p: &[f64], site: &Site, out: &mut [Lanes]) {
        let (sin, cos) = phase(site).sin_cos();
        out[0] = sin;
        out[1] = cos;
    }

    fn slope(&self, p: &[f64], site: &Site) -> Lanes {
        let (sin, cos) = phase(site).sin_cos();
        (cos * p[0] - sin * p[1]) * (2.0 * site.scale().gain)
    }
}

/// `2φ`, the nominal angle from the middle of the range, doubled.
fn phase(site: &Site) -> Lanes {
    let scale = site.scale();
    (site.reading() - Lanes::splat(scale.middle)) * (2.0 * scale.gain)
}
