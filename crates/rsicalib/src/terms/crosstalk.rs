//! [`Crosstalk`].

use crate::mechanism::Mechanism;
use crate::numerics::lanes::Lanes;
use crate::terms::term::{Acts, Electronics, Placed, Site, Term};

term! {
    /// A channel that picks up part of a neighbouring one.
    ///
    /// Adds `share (b - middle)` to the reading, with the neighbour's reading `b`: a
    /// multiplexer that does not settle, or a shared return wire.
    Crosstalk("crosstalk", Sensor, per Channel, needs Nothing) {
        share: "1" ~ 5e-3,
    } acts Acts::Electronics(&Self)
}

impl Term for Crosstalk {
    fn placed(&self) -> Placed {
        Placed::AtChannel
    }

    fn places(&self, mechanism: &Mechanism, channel: usize, _poses: usize) -> Vec<usize> {
        // An encoder does not share a converter with a potentiometer.
        let unit = |c: usize| mechanism.channels.get(c).map(|c| &c.unit);
        let beside = [channel.wrapping_sub(1), channel + 1].into_iter();
        // Where bars turn a joint with another one, an error of their ratio reads like crosstalk; of two channels
        // that are to be equal, as of a leader and its follower, a gain does, and a delay that is not sharp.
        let apart = |c: usize| {
            let bars = mechanism.drives(c, channel) || mechanism.drives(channel, c);
            !bars && !mechanism.are_equal(c, channel)
        };
        beside.filter(|&c| unit(c).is_some() && unit(c) == unit(channel) && apart(c)).collect()
    }
}

impl Electronics for Crosstalk {
    fn correction(&self, p: &[f64], site: &Site) -> Lanes {
        neighbour(site) * p[0]
    }

    fn partials(&self, _p: &[f64], site: &Site, out: &mut [Lanes]) {
        out[0] = neighbour(site);
    }

    fn slopes(&self, p: &[f64], site: &Site, out: &mut [Lanes]) {
        out[site.place] += Lanes::splat(p[0]);
    }
}

/// The neighbour's reading from the middle of its range.
fn neighbour(site: &Site) -> Lanes {
    site.readings[site.place] - Lanes::splat(site.scales[site.place].middle)
}
