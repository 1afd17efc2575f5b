//! [`Hysteresis`].

use crate::numerics::lanes::Lanes;
use crate::terms::term::{Acts, Sensor, Site, Term};

term! {
    /// Error of a sensor that depends on the direction of approach.
    ///
    /// Adds `h` to the joint angle where the reading rose to its value, and `-h`
    /// where the reading fell: play between shaft and wiper. `h` is half the width of
    /// the loop.
    Hysteresis("hysteresis", Sensor, per Channel, needs Approach) {
        h: "rad" ~ 1e-3,
    } acts Acts::Sensor(&Self)
}

impl Term for Hysteresis {}

impl Sensor for Hysteresis {
    fn correction(&self, p: &[f64], site: &Site) -> Lanes {
        side(site) * p[0]
    }

    fn partials(&self, _p: &[f64], site: &Site, out: &mut [Lanes]) {
        out[0] = side(site);
    }
}

/// From which side the channel came to where it is; where it is late, to where it is later.
fn side(site: &Site) -> Lanes {
    let course = site.course.filter(|_| site.late != 0.0);
    course.map_or(site.approach[site.channel], |course| course.side(site.channel, site.late))
}
