//! [`TemperatureOffset`].

use crate::numerics::lanes::Lanes;
use crate::terms::term::{Acts, Sensor, Site, Term};

term! {
    /// Offset of a sensor that follows the temperature.
    ///
    /// Adds `rate T` to the joint angle, where `T` is the temperature above the mean
    /// of the session.
    TemperatureOffset("temperature_offset", Sensor, per Channel, needs Temperature) {
        rate: "rad/K" ~ 1e-3,
    } acts Acts::Sensor(&Self)
}

impl Term for TemperatureOffset {}

impl Sensor for TemperatureOffset {
    fn correction(&self, p: &[f64], site: &Site) -> Lanes {
        site.temperature * p[0]
    }

    fn partials(&self, _p: &[f64], site: &Site, out: &mut [Lanes]) {
        out[0] = site.temperature;
    }
}
