//! [`Drag`].

use crate::mechanism::Mechanism;
use crate::numerics::lanes::Lanes;
use crate::terms::term::{Acts, Placed, Sensor, Site, Term};

term! {
    /// A follower that stands short of its goal as long as it moves.
    ///
    /// Adds `h` to the joint coordinate of a follower while its leader's reading rises, `-h` while it falls,
    /// and nothing at rest: friction that a servo makes up for when it has time. Where the follower
    /// stands short at rest, too, it is `hysteresis`.
    Drag("drag", Sensor, per Channel, needs Motion) {
        h: "rad" ~ 1e-3,
    } acts Acts::Sensor(&Self)
}

impl Term for Drag {
    fn placed(&self) -> Placed {
        Placed::AtChannel
    }

    fn suits(&self, mechanism: &Mechanism, channel: usize) -> bool {
        mechanism.leader_of(channel).is_some()
    }

    /// The leader tells the direction: its reading is what the follower is to do, without the follower's noise
    /// and delay.
    fn places(&self, mechanism: &Mechanism, channel: usize, _poses: usize) -> Vec<usize> {
        mechanism.leader_of(channel).into_iter().collect()
    }
}

impl Sensor for Drag {
    fn correction(&self, p: &[f64], site: &Site) -> Lanes {
        direction(site) * p[0]
    }

    fn partials(&self, _p: &[f64], site: &Site, out: &mut [Lanes]) {
        out[0] = direction(site);
    }
}

/// In which direction the leader moves: -1, 0 or 1.
fn direction(site: &Site) -> Lanes {
    site.course.map_or(Lanes::ZERO, |course| course.direction(site.place))
}
