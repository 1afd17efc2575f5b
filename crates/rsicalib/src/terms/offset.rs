//! [`Offset`].

use crate::numerics::lanes::Lanes;
use crate::terms::term::{Acts, Role, Sensor, Site, Term};

term! {
    /// Joint angle at the middle reading.
    ///
    /// A potentiometer is clamped to its shaft by hand, so the angle at which it
    /// reads the middle of its range is not the drawn one. Reported as the paper's
    /// `θ_off`, the angle at reading zero, eq. (9).
    Offset("offset", Sensor, per Channel, needs Nothing) {
        offset: "rad" ~ 0.05,
    } acts Acts::Sensor(&Self)
}

impl Term for Offset {
    fn role(&self) -> Role {
        Role::Offset
    }
}

impl Sensor for Offset {
    fn correction(&self, p: &[f64], _site: &Site) -> Lanes {
        Lanes::splat(p[0])
    }

    fn partials(&self, _p: &[f64], _site: &Site, out: &mut [Lanes]) {
        out[0] = Lanes::ONE;
    }
}
