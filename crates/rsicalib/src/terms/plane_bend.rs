//! [`PlaneBend`].

use crate::mechanism::{Mechanism, Target};
use crate::numerics::lanes::Lanes;
use crate::terms::term::{Acts, Surface, Term};

term! {
    /// A plane that is not flat.
    ///
    /// Adds `uu u² + uv u v + vv v²` to the offset of the plane, where `u` and `v` are the place
    /// of the point along the plane's own axes, from the middle of all places to half their extent:
    /// a table that sags, a bed that is twisted.
    PlaneBend("plane_bend", Closure, per Closure, needs Nothing) {
        uu: "length" ~ 5e-4,
        uv: "length" ~ 5e-4,
        vv: "length" ~ 5e-4,
    } acts Acts::Surface(&Self)
}

impl Term for PlaneBend {
    fn suits_target(&self, mechanism: &Mechanism, target: Target) -> bool {
        mechanism.closures_of(target).any(|k| mechanism.is_on_plane(k))
    }
}

impl Surface for PlaneBend {
    fn correction(&self, p: &[f64], [u, v]: [Lanes; 2], _row: usize) -> Lanes {
        u * u * p[0] + u * v * p[1] + v * v * p[2]
    }

    fn partials(&self, [u, v]: [Lanes; 2], _row: usize, out: &mut [Lanes]) {
        (out[0], out[1], out[2]) = (u * u, u * v, v * v);
    }

    fn slopes(&self, p: &[f64], [u, v]: [Lanes; 2], _row: usize) -> [Lanes; 2] {
        [u * (2.0 * p[0]) + v * p[1], u * p[1] + v * (2.0 * p[2])]
    }
}
