//! Whose reading is wrong, as far as it can be told.

use crate::mechanism::{Mechanism, Target};
use crate::numerics::credible_set::{SURE, probabilities};
use crate::numerics::order::Ends;

/// Channels less likely than this are not listed.
const WORTH_NAMING: f64 = 0.1;

/// Whose reading is wrong, as far as it can be told.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Blame {
    /// The channel, where that is [`SURE`].
    pub channel: Option<usize>,
    /// The likeliest chain.
    pub chain: Option<usize>,
    /// Channels that may be wrong, with their probabilities, where that is not sure.
    pub likely: Vec<(usize, f64)>,
}

impl Blame {
    /// Of scores `(value, target)`, of which channels count.
    #[must_use]
    pub fn among(scores: impl IntoIterator<Item = (f64, Target)>, mechanism: &Mechanism) -> Self {
        let of_channel = |(value, target)| match target {
            Target::Channel(channel) => Some((value, channel)),
            _ => None,
        };
        let channels: Vec<_> = scores.into_iter().filter_map(of_channel).collect();
        Self::of(&channels, mechanism)
    }

    /// Of scores `(value, channel)`.
    #[must_use]
    pub fn of(scores: &[(f64, usize)], mechanism: &Mechanism) -> Self {
        let channels = probabilities(scores);
        let Some(&(first, sure)) = channels.first() else {
            return Self { channel: None, chain: None, likely: Vec::new() };
        };
        if sure >= SURE {
            let chain = mechanism.chain_of(first);
            return Self { channel: Some(first), chain, likely: Vec::new() };
        }
        let total = |chain: Option<usize>| {
            let of_chain = channels.iter().filter(|c| mechanism.chain_of(c.0) == chain);
            of_chain.map(|c| c.1).sum::<f64>()
        };
        let chains = channels.iter().map(|c| mechanism.chain_of(c.0));
        let chain = chains.greatest_by(|a| total(*a)).flatten();
        let likely = channels.iter().filter(|c| c.1 >= WORTH_NAMING).copied().collect();
        Self { channel: None, chain, likely }
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
        assert_eq!(unsure.likely.iter().map(|l| l.0).collect::<Vec<_>>(), [0, 4, 5]);
        // Likelihood ratios of 4 to 3 to 3.
        let wanted = [0.4, 0.3, 0.3];
        assert!(unsure.likely.iter().zip(wanted).all(|(l, w)| (l.1 - w).abs() < 1e-12));
        let nobody = Blame::of(&[], &mechanism);
        assert_eq!((nobody.channel, nobody.chain), (None, None));
    }
}
