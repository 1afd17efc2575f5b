//! [`Gain`].

use crate::numerics::lanes::Lanes;
use crate::terms::term::{Acts, Role, Sensor, Site, Term};

/// Typical error of a gain of the paper's potentiometers, rad a count.
pub(crate) const TYPICAL_GAIN: f64 = 3e-5;

term! {
    /// Joint angle per reading.
    ///
    /// The electrical angle of a potentiometer and the reference of its converter
    /// vary by per cents. Reported as the paper's `k`, eq. (9).
    Gain("gain", Sensor, per Channel, needs Nothing) {
        gain: "rad/reading" ~ TYPICAL_GAIN,
    } acts Acts::Sensor(&Self)
}

impl Term for Gain {
    fn role(&self) -> Role {
        Role::Gain
    }
}

impl Sensor for Gain {
    fn correction(&self, p: &[f64], site: &Site) -> Lanes {
        (site.reading() - Lanes::splat(site.scale().centre)) * p[0]
    }

    fn partials(&self, _p: &[f64], site: &Site, out: &mut [Lanes]) {
        out[0] = site.reading() - Lanes::splat(site.scale().centre);
    }

    fn slope(&self, p: &[f64], _site: &Site) -> Lanes {
        Lanes::splat(p[0])
    }
}
