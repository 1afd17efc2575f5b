//! [`BadReading`].

use crate::mechanism::Mechanism;
use crate::numerics::lanes::Lanes;
use crate::terms::term::{Acts, Electronics, Placed, Site, Term};

term! {
    /// A reading that is wrong in one pose.
    ///
    /// Adds `error` to the reading of one channel in all samples of one pose: a
    /// wiper that bounced, or a bit that flipped. The search tries every pose.
    BadReading("bad_reading", Data, per Channel, needs Nothing) {
        error: "reading" ~ 20.0,
    } acts Acts::Electronics(&Self)
}

impl Term for BadReading {
    fn placed(&self) -> Placed {
        Placed::AtPose
    }

    fn places(&self, _mechanism: &Mechanism, _channel: usize, poses: usize) -> Vec<usize> {
        (0..poses).collect()
    }
}

impl Electronics for BadReading {
    fn correction(&self, p: &[f64], site: &Site) -> Lanes {
        site.at_place() * p[0]
    }

    fn partials(&self, _p: &[f64], site: &Site, out: &mut [Lanes]) {
        out[0] = site.at_place();
    }

    fn slopes(&self, p: &[f64], site: &Site, out: &mut [Lanes]) {
        let _ = (p, site, out); // the same in the whole pose
    }
}
