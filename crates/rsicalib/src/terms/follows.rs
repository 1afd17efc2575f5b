//! How a channel follows: what it is late by in a motion, (164), and how much of that is by degrees, (157).
//!
//! Effects of one channel add up, and the correction of each is beside those before it.

use crate::numerics::lanes::Lanes;
use crate::readings::course::{Late, Moved};
use crate::terms::term::{Electronics, Site};

/// A term of how a channel follows, with one parameter.
pub(super) trait Follows: Sync {
    /// Which derivative of [`Moved`] is that by its parameter.
    const BY: usize;

    /// What it says of the channel.
    fn says(&self, parameter: f64) -> Late;
}

impl<T: Follows> Electronics for T {
    fn correction(&self, _p: &[f64], site: &Site) -> Lanes {
        let to = |to: &Option<Moved>| {
            to.as_ref().map_or(Lanes::ZERO, |to| to.change[0] + error(site, to) * more(to))
        };
        to(&site.followed.with) - to(&site.followed.before)
    }

    fn partials(&self, _p: &[f64], site: &Site, out: &mut [Lanes]) {
        let all = site.followed.all.as_ref();
        let by = |to: &Moved| to.change[T::BY] + error(site, to) * to.spread[T::BY];
        out[0] = all.map_or(Lanes::ZERO, by);
    }

    fn late(&self, p: &[f64]) -> Option<Late> {
        Some(self.says(p[0]))
    }

    fn slopes(&self, _p: &[f64], site: &Site, out: &mut [Lanes]) {
        let to = |to: &Option<Moved>| to.as_ref().map_or(Lanes::ZERO, more);
        out[site.channel] += to(&site.followed.with) - to(&site.followed.before);
    }
}

/// What of a reading is noise, where the closures have moved it.
fn error(site: &Site, to: &Moved) -> Lanes {
    site.reading() - to.raw
}

/// By how much more that counts: as the noise of all rows that the course is made of.
fn more(to: &Moved) -> Lanes {
    to.spread[0] - Lanes::ONE
}
