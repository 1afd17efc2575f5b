//! How a channel follows: what it is late by in a motion, (164), and how much of that is by degrees, (157).
//!
//! Effects of one channel add up, and the correction of each is beside those before it.

use crate::numerics::lanes::Lanes;
use crate::readings::course::Moved;
use crate::terms::term::Site;

/// What an effect adds to the reading of a channel.
pub(super) fn correction(site: &Site) -> Lanes {
    let to = |to: &Option<Moved>| {
        to.as_ref().map_or(Lanes::ZERO, |to| to.change[0] + error(site, to) * more(to))
    };
    to(&site.followed.with) - to(&site.followed.before)
}

/// Its derivative by the lag, 1, or by the square of the time constant, 2.
pub(super) fn partial(by: usize, site: &Site) -> Lanes {
    let all = site.followed.all.as_ref();
    all.map_or(Lanes::ZERO, |to| to.change[by] + error(site, to) * to.spread[by])
}

/// Its derivative by the reading.
pub(super) fn slope(site: &Site) -> Lanes {
    let to = |to: &Option<Moved>| to.as_ref().map_or(Lanes::ZERO, more);
    to(&site.followed.with) - to(&site.followed.before)
}

/// What of a reading is noise, where the closures have moved it.
fn error(site: &Site, to: &Moved) -> Lanes {
    site.reading() - to.raw
}

/// By how much more that counts: as the noise of all rows that the course is made of.
fn more(to: &Moved) -> Lanes {
    to.spread[0] - Lanes::ONE
}
