//! [`ReferenceDrift`].

use crate::mechanism::Mechanism;
use crate::numerics::lanes::Lanes;
use crate::terms::term::{Acts, Electronics, Site, Term};

term! {
    /// Drift of the converter's reference during the session.
    ///
    /// Multiplies all readings by `1 + rate t`, where `t` runs from 0 to 1 over the
    /// session: every channel is read against one reference.
    ReferenceDrift("reference_drift", Electronics, per All, needs Order) {
        rate: "1/session" ~ 2e-3,
    } acts Acts::Electronics(&Self)
}

impl Term for ReferenceDrift {
    fn suits(&self, mechanism: &Mechanism, channel: usize) -> bool {
        mechanism.channels[channel].is_converted()
    }
}

impl Electronics for ReferenceDrift {
    fn correction(&self, p: &[f64], site: &Site) -> Lanes {
        site.reading() * site.time * p[0]
    }

    fn partials(&self, _p: &[f64], site: &Site, out: &mut [Lanes]) {
        out[0] = site.reading() * site.time;
    }

    fn slopes(&self, p: &[f64], site: &Site, out: &mut [Lanes]) {
        out[site.channel] += site.time * p[0];
    }
}
