//! [`LineBend`].

use crate::mechanism::{Mechanism, Target};
use crate::numerics::lanes::Lanes;
use crate::terms::term::{Acts, Surface, Term};

term! {
    /// A line that is not straight.
    ///
    /// Adds `uu1 u²` and `uu2 u²` to the offsets of the line, where `u` is the place of the point along
    /// it, from the middle of all places to half their extent: a rail that sags.
    LineBend("line_bend", Closure, per Closure, needs Nothing) {
        uu1: "length" ~ 5e-4,
        uu2: "length" ~ 5e-4,
    } acts Acts::Surface(&Self)
}

impl Term for LineBend {
    fn suits_target(&self, mechanism: &Mechanism, target: Target) -> bool {
        mechanism.closures_of(target).any(|k| mechanism.is_on_line(k))
    }
}

impl Surface for LineBend {
    fn correction(&self, p: &[f64], [u, _]: [Lanes; 2], row: usize) -> Lanes {
        u * u * p[row]
    }

    fn partials(&self, [u, _]: [Lanes; 2], row: usize, out: &mut [Lanes]) {
        out[row] = u * u;
    }

    fn slopes(&self, p: &[f64], [u, _]: [Lanes; 2], row: usize) -> [Lanes; 2] {
        [u * (2.0 * p[row]), Lanes::ZERO]
    }
}
