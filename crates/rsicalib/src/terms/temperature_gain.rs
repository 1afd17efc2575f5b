//! [`TemperatureGain`].

use crate::numerics::lanes::Lanes;
use crate::terms::term::{Acts, Sensor, Site, Term};

term! {
    /// Gain of a sensor that follows the temperature.
    ///
    /// Adds `k (a - middle) rate T` to the joint angle, where `k` is the nominal gain
    /// and `T` the temperature above the mean of the session.
    TemperatureGain("temperature_gain", Sensor, per Channel, needs Temperature) {
        rate: "1/K" ~ 1e-3,
    } acts Acts::Sensor(&Self)
}

impl Term for TemperatureGain {}

impl Sensor for TemperatureGain {
    fn correction(&self, p: &[f64], site: &Site) -> Lanes {
        swing(site) * site.temperature * p[0]
    }

    fn partials(&self, _p: &[f64], site: &Site, out: &mut [Lanes]) {
        out[0] = swing(site) * site.temperature;
    }

    fn slope(&self, p: &[f64], site: &Site) -> Lanes {
        site.temperature * (site.scale().gain * p[0])
    }
}

/// Nominal angle from the middle of the range.
fn swing(site: &Site) -> Lanes {
    let scale = site.scale();
    (site.reading() - Lanes::splat(scale.middle)) * scale.gain
}
