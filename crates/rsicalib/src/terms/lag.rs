//! [`Lag`].

use crate::numerics::lanes::Lanes;
use crate::terms::term::{Acts, Electronics, Info, Site, Term};

term! {
    /// One channel that is late.
    ///
    /// In motion, a filter delays one channel by `lag`. The reading at the common
    /// instant is `a + lag v`, with the channel's velocity `v`.
    Lag("lag", Sensor, per Channel, needs Motion) {
        lag: "s" ~ 1e-3,
    }
}

impl Term for Lag {
    fn info(&self) -> &'static Info {
        &Self::INFO
    }

    fn acts(&self) -> Acts {
        Acts::Electronics(&Self)
    }
}

impl Electronics for Lag {
    fn correction(&self, p: &[f64], site: &Site) -> Lanes {
        site.velocity[site.channel] * p[0]
    }

    fn partials(&self, _p: &[f64], site: &Site, out: &mut [Lanes]) {
        out[0] = site.velocity[site.channel];
    }

    fn slopes(&self, p: &[f64], site: &Site, out: &mut [Lanes]) {
        let _ = (p, site, out); // the velocity is context: constant
    }
}
