//! [`Lag`].

use crate::mechanism::{Closure, Mechanism, Target};
use crate::numerics::lanes::Lanes;
use crate::readings::course::Moved;
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
        let to = |lag| {
            moved(site, lag).map_or(Lanes::ZERO, |to| to.change + error(site, &to) * more(&to))
        };
        to(before + p[0]) - to(before)
    }

    fn partials(&self, _p: &[f64], site: &Site, out: &mut [Lanes]) {
        let [_, all] = site.late;
        let here = site.course.map(|course| course.moved(site.channel, all));
        out[0] = here.map_or(Lanes::ZERO, |to| to.velocity + error(site, &to) * to.spreads);
    }

    fn is_delay(&self) -> bool {
        true
    }

    fn slopes(&self, p: &[f64], site: &Site, out: &mut [Lanes]) {
        let [before, _] = site.late;
        let to = |lag| moved(site, lag).map_or(Lanes::ZERO, |to| more(&to));
        out[site.channel] += to(before + p[0]) - to(before);
    }
}

/// The samples of the channel at another instant, (164) and (165); none where that is their own.
fn moved(site: &Site, lag: f64) -> Option<Moved> {
    let course = site.course.filter(|_| lag != 0.0);
    course.map(|course| course.moved(site.channel, lag))
}

/// What of a reading is noise, where the closures have moved it.
fn error(site: &Site, to: &Moved) -> Lanes {
    site.reading() - to.raw
}

/// By how much more that counts: as the noise of all rows that the course is made of.
fn more(to: &Moved) -> Lanes {
    to.spread - Lanes::ONE
}
