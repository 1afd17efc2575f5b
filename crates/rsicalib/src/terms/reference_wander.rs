//! [`ReferenceWander`].

use crate::mechanism::Mechanism;
use crate::numerics::lanes::Lanes;
use crate::terms::term::{Acts, Electronics, Site, Term};
use crate::terms::waves;

term! {
    /// A converter's reference that wanders, or warms up.
    ///
    /// Multiplies all readings by `1 + Σ_k r_k cos(k π t)`, where `t` runs from 0 to 1 over
    /// the session. Each coefficient is held by its typical size, which falls as `1/k`.
    ReferenceWander("reference_wander", Electronics, per All, needs Order, penalised) {
        r1: "1" ~ 0.004,
        r2: "1" ~ 0.002,
        r3: "1" ~ 0.0013,
        r4: "1" ~ 0.001,
        r5: "1" ~ 0.0008,
        r6: "1" ~ 0.00067,
    } acts Acts::Electronics(&Self)
}

impl Term for ReferenceWander {
    fn suits(&self, mechanism: &Mechanism, channel: usize) -> bool {
        mechanism.channels[channel].is_converted()
    }
}

impl Electronics for ReferenceWander {
    fn correction(&self, p: &[f64], site: &Site) -> Lanes {
        site.reading() * waves::sum(p, site.time)
    }

    fn partials(&self, _p: &[f64], site: &Site, out: &mut [Lanes]) {
        waves::each(site.time, out);
        out.iter_mut().for_each(|out| *out = *out * site.reading());
    }

    fn slopes(&self, p: &[f64], site: &Site, out: &mut [Lanes]) {
        out[site.channel] += waves::sum(p, site.time);
    }
}
