//! [`Lag`].

use crate::mechanism::{Closure, Mechanism, Target};
use crate::numerics::lanes::Lanes;
use crate::terms::term::{Acts, Electronics, Info, Site, Term};

term! {
    /// Channels that are late.
    ///
    /// In motion, a filter, a message on its way or a servo delays a channel, or all channels of one
    /// side, by `lag`. The reading at the common instant is `a + s(t + lag) - s(t)`, with the
    /// channel's course `s` through the recording.
    Lag("lag", Sensor, per Channel, needs Motion) {
        lag: "s" ~ 1e-3,
    }
}

impl Term for Lag {
    fn info(&self) -> &'static Info {
        &Self::INFO
    }

    fn acts(&self) -> Acts {
        Acts::Electronics(&Self)
    }

    /// A leader that is early is a follower that is late: it is said of the follower.
    fn suits(&self, mechanism: &Mechanism, channel: usize) -> bool {
        let own = &mechanism.channels[channel].name;
        let mut read = mechanism.closures.iter().filter(|c| c.between.contains(own)).peekable();
        let leads = |c: &Closure| c.is_of_channels() && c.between[0] == *own;
        mechanism.moves_joint(channel) || read.peek().is_none() || !read.all(leads)
    }

    fn shared_by(&self, mechanism: &Mechanism) -> Vec<Target> {
        mechanism.sides()
    }
}

impl Electronics for Lag {
    fn correction(&self, p: &[f64], site: &Site) -> Lanes {
        let [before, _] = site.late;
        change(site, before + p[0])[0] - change(site, before)[0]
    }

    fn partials(&self, _p: &[f64], site: &Site, out: &mut [Lanes]) {
        let [_, all] = site.late;
        out[0] = change(site, all)[1];
    }

    fn is_delay(&self) -> bool {
        true
    }

    fn slopes(&self, p: &[f64], site: &Site, out: &mut [Lanes]) {
        let _ = (p, site, out); // the course is context: constant
    }
}

/// `s(t + lag) - s(t)`, and its derivative by `lag`.
fn change(site: &Site, lag: f64) -> [Lanes; 2] {
    site.course.map_or([Lanes::ZERO; 2], |course| course.change(site.channel, lag))
}
