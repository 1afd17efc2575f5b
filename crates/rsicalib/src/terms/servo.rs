//! [`Servo`].

use crate::mechanism::{Mechanism, Target};
use crate::numerics::lanes::Lanes;
use crate::readings::course::Late;
use crate::terms::follows;
use crate::terms::term::{Acts, Electronics, Info, Site, Term};

term! {
    /// Channels that come to their goal by degrees.
    ///
    /// A servo with the time constant `T` is late by `T` in a steady motion, as by a delay, and in a bend it
    /// cuts the corner. Of the `lag` of the channel, `T` is the servo and the rest a delay: the reading at the
    /// common instant is `y + T y'`, of the channel's course `y` at `t + lag - T`. `square` is `T²`.
    Servo("servo", Sensor, per Channel, needs Motion) {
        square: "s^2" ~ 1e-3,
    }
}

impl Term for Servo {
    fn info(&self) -> &'static Info {
        &Self::INFO
    }

    fn acts(&self) -> Acts {
        Acts::Electronics(&Self)
    }

    /// As a delay, it is said of the follower; a filter of first order before a sensor does the same.
    fn suits(&self, mechanism: &Mechanism, channel: usize) -> bool {
        !mechanism.leads(channel)
    }

    fn shared_by(&self, mechanism: &Mechanism) -> Vec<Target> {
        mechanism.sides()
    }
}

impl Electronics for Servo {
    fn correction(&self, _p: &[f64], site: &Site) -> Lanes {
        follows::correction(site)
    }

    fn partials(&self, _p: &[f64], site: &Site, out: &mut [Lanes]) {
        out[0] = follows::partial(2, site);
    }

    fn late(&self, p: &[f64]) -> Option<Late> {
        Some(Late { lag: 0.0, square: Some(p[0]) })
    }

    fn slopes(&self, _p: &[f64], site: &Site, out: &mut [Lanes]) {
        out[site.channel] += follows::slope(site);
    }
}
