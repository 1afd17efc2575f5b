//! [`ReferenceTemperature`].

use crate::mechanism::Mechanism;
use crate::numerics::lanes::Lanes;
use crate::terms::term::{Acts, Electronics, Site, Term};

term! {
    /// A converter's reference that follows the temperature.
    ///
    /// Multiplies all readings by `1 + rate T`, where `T` is the temperature above
    /// the mean of the session.
    ReferenceTemperature("reference_temperature", Electronics, per All, needs Temperature) {
        rate: "1/K" ~ 3e-4,
    } acts Acts::Electronics(&Self)
}

impl Term for ReferenceTemperature {
    fn suits(&self, mechanism: &Mechanism, channel: usize) -> bool {
        mechanism.channels[channel].is_converted()
    }
}

impl Electronics for ReferenceTemperature {
    fn correction(&self, p: &[f64], site: &Site) -> Lanes {
        site.reading() * site.temperature * p[0]
    }

    fn partials(&self, _p: &[f64], site: &Site, out: &mut [Lanes]) {
        out[0] = site.reading() * site.temperature;
    }

    fn slopes(&self, p: &[f64], site: &Site, out: &mut [Lanes]) {
        out[site.channel] += site.temperature * p[0];
    }
}
