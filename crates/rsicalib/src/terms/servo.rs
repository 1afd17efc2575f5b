//! [`Servo`].

use crate::mechanism::{Mechanism, Target};
use crate::readings::course::Late;
use crate::terms::follows::Follows;
use crate::terms::term::{Acts, Term};

term! {
    /// Channels that come to their goal by degrees.
    ///
    /// A servo with the time constant `T` is late by `T` in a steady motion, as by a delay, and in a bend it
    /// cuts the corner. Of the `lag` of the channel, `T` is the servo and the rest a delay: the reading at the
    /// common instant is `y + T y'`, of the channel's course `y` at `t + lag - T`. `square` is `T²`.
    Servo("servo", Sensor, per Channel, needs Motion) {
        square: "s^2" ~ 1e-3,
    } acts Acts::Electronics(&Self)
}

impl Term for Servo {
    /// As a delay, it is said of the follower; a filter of first order before a sensor does the same.
    fn suits(&self, mechanism: &Mechanism, channel: usize) -> bool {
        !mechanism.leads(channel)
    }

    fn shared_by(&self, mechanism: &Mechanism) -> Vec<Target> {
        mechanism.sides()
    }
}

impl Follows for Servo {
    const BY: usize = 2;

    fn says(&self, parameter: f64) -> Late {
        Late { lag: 0.0, square: Some(parameter) }
    }
}
