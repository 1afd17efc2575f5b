//! [`ChannelSkew`].

use crate::mechanism::{Closure, Mechanism, Target};
use crate::numerics::lanes::Lanes;
use crate::terms::term::{Acts, Electronics, Site, Term};

term! {
    /// Channels that are read one after the other.
    ///
    /// In motion, the n-th channel is read `n skew` after the first. The reading at
    /// the common instant is `a - n skew v`, with the channel's velocity `v`.
    ChannelSkew("channel_skew", Electronics, per All, needs Motion) {
        skew: "s" ~ 2e-4,
    } acts Acts::Electronics(&Self)
}

impl Term for ChannelSkew {
    /// Not where it is a delay of one side: of pairs that are to be equal, all equally far apart.
    fn suits_target(&self, mechanism: &Mechanism, _target: Target) -> bool {
        let number = |name: &String| mechanism.channel_index(name).ok();
        let apart = |c: &Closure| match c.is_of_channels() {
            true => Some(number(&c.between[1])?.wrapping_sub(number(&c.between[0])?)),
            false => None,
        };
        let mut all = mechanism.closures.iter().map(apart);
        let first = all.next().flatten();
        first.is_none() || all.any(|other| other != first)
    }
}

impl Electronics for ChannelSkew {
    fn correction(&self, p: &[f64], site: &Site) -> Lanes {
        order(site) * p[0]
    }

    fn partials(&self, _p: &[f64], site: &Site, out: &mut [Lanes]) {
        out[0] = order(site);
    }

    fn slopes(&self, p: &[f64], site: &Site, out: &mut [Lanes]) {
        let _ = (p, site, out); // the velocity is context: constant
    }
}

/// `-n v`, with `n` counted from the middle channel.
fn order(site: &Site) -> Lanes {
    let n = site.channel as f64 - 0.5 * (site.scales.len() as f64 - 1.0);
    site.velocity[site.channel] * -n
}
