//! Whose reading is wrong, as far as it can be told.

use crate::mechanism::{Mechanism, Target};
use crate::numerics::credible_set::{SURE, probabilities};

/// Channels less likely than this are not listed.
const WORTH_NAMING: f64 = 0.1;

/// Whose reading is wrong, as far as it can be told.
#[derive(Debug, Clone, PartialEq)]
pub struct Blame {
    /// The channel, where that is [`SURE`].
    pub channel: Option<usize>,
    /// The likeliest chain.
    pub chain: Option<usize>,
    /// In words, with the probability of what is not sure.
    pub reason: String,
}

impl Blame {
    /// Of rivals `(value, target)`, of which channels count.
    #[must_use]
    pub fn among(rivals: impl IntoIterator<Item = (f64, Target)>, mechanism: &Mechanism) -> Self {
        let of_channel = |(value, target)| match target {
            Target::Channel(channel) => Some((value, channel)),
            _ => None,
        };
        let channels: Vec<_> = rivals.into_iter().filter_map(of_channel).collect();
        Self::of(&channels, mechanism)
    }

    /// Of rivals `(value, channel)`.
    #[must_use]
    pub fn of(rivals: &[(f64, usize)], mechanism: &Mechanism) -> Self {
        let channels = probabilities(rivals);
        let Some(&(first, sure)) = channels.first() else {
            let reason = "a channel reads wrong; these equations cannot tell which".into();
            return Self { channel: None, chain: None, reason };
        };
        if sure >= SURE {
            let reason = format!("channel {} reads wrong", mechanism.channels[first].name);
            return Self { channel: Some(first), chain: mechanism.chain_of(first), reason };
        }
        let total = |chain: Option<usize>| {
            let of_chain = channels.iter().filter(|c| mechanism.chain_of(c.0) == chain);
            of_chain.map(|c| c.1).sum::<f64>()
        };
        let chains = channels.iter().map(|c| mechanism.chain_of(c.0));
        let chain = chains.max_by(|a, b| total(*a).total_cmp(&total(*b))).flatten();
        let likely: Vec<String> = channels
            .iter()
            .filter(|c| c.1 >= WORTH_NAMING)
            .map(|&(c, p)| format!("{} ({:.0} %)", mechanism.channels[c].name, 100.0 * p))
            .collect();
        let reason = format!(
            "one channel reads wrong, and these equations hardly tell which: {}",
            likely.join(", ")
        );
        Self { channel: None, chain, reason }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A likelihood ratio in units of χ².
    fn times(ratio: f64) -> f64 {
        2.0 * f64::ln(ratio)
    }

    #[test]
    fn a_channel_is_blamed_where_that_is_sure_and_a_chain_by_all_its_channels() {
        let mechanism = Mechanism::rsi();
        let sure = Blame::of(&[(times(9.0), 4), (times(1.0), 0)], &mechanism);
        assert_eq!((sure.channel, sure.chain), (Some(4), Some(1)));
        // a11 is the likeliest channel, arm2 the likeliest chain.
        let unsure = Blame::of(&[(times(4.0), 0), (times(3.0), 4), (times(3.0), 5)], &mechanism);
        assert_eq!((unsure.channel, unsure.chain), (None, Some(1)));
        assert!(unsure.reason.contains("a11 (40 %), a22 (30 %), a23 (30 %)"), "{}", unsure.reason);
        let nobody = Blame::of(&[], &mechanism);
        assert_eq!((nobody.channel, nobody.chain), (None, None));
    }
}
