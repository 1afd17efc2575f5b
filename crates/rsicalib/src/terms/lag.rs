//! [`Lag`].

use crate::mechanism::{Mechanism, Target};
use crate::readings::course::Late;
use crate::terms::follows::Follows;
use crate::terms::term::{Acts, Term};

term! {
    /// Channels that are late.
    ///
    /// In motion, a filter, a message on its way or a servo delays a channel, or all channels of one
    /// side, by `lag`. The reading at the common instant is `a + s(t + lag) - s(t)`, with the
    /// channel's course `s` through the recording. What is late by degrees, as a servo, is late by as much in
    /// a steady motion: how much of `lag` that is, `servo` tells.
    Lag("lag", Sensor, per Channel, needs Motion) {
        lag: "s" ~ 1e-3,
    } acts Acts::Electronics(&Self)
}

impl Term for Lag {
    /// A leader that is early is a follower that is late: it is said of the follower.
    fn suits(&self, mechanism: &Mechanism, channel: usize) -> bool {
        !mechanism.leads(channel)
    }

    fn shared_by(&self, mechanism: &Mechanism) -> Vec<Target> {
        mechanism.sides()
    }
}

impl Follows for Lag {
    const BY: usize = 1;

    fn says(&self, parameter: f64) -> Late {
        Late { lag: parameter, square: None }
    }
}
