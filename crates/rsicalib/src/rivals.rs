//! Which of several explanations may be right.

use crate::mechanism::Mechanism;

/// Effects that fit as well as the one named: refitted χ² within this, extra
/// parameters charged.
pub const AS_WELL: f64 = 6.0;

/// Probability with which the right target must be among those named.
pub const SURE: f64 = 0.8;

/// Channels less likely than this are not listed.
const WORTH_NAMING: f64 = 0.1;

/// Probability of each target of rivals `(value, target)`, by its best rival, likeliest
/// first. A value is twice a log-likelihood, parameters charged; before the data every
/// target was as likely as another.
#[must_use]
pub fn probabilities<T: PartialEq + Copy>(rivals: &[(f64, T)]) -> Vec<(T, f64)> {
    let best = rivals.iter().map(|r| r.0).fold(f64::NEG_INFINITY, f64::max);
    let mut targets: Vec<(T, f64)> = Vec::new();
    for &(value, target) in rivals {
        let weight = (0.5 * (value - best)).exp();
        match targets.iter_mut().find(|t| t.0 == target) {
            Some(known) => known.1 = known.1.max(weight),
            None => targets.push((target, weight)),
        }
    }
    let all: f64 = targets.iter().map(|t| t.1).sum();
    targets.iter_mut().for_each(|t| t.1 /= all);
    targets.sort_by(|a, b| b.1.total_cmp(&a.1));
    targets
}

/// Of rivals, those that may be right: targets by falling probability until they are
/// [`SURE`] to hold the truth, in each of them what is within [`AS_WELL`] of the best.
#[must_use]
pub fn credible<T: PartialEq + Copy>(rivals: &[(f64, T)]) -> Vec<bool> {
    let best = rivals.iter().map(|r| r.0).fold(f64::NEG_INFINITY, f64::max);
    let mut targets = probabilities(rivals);
    let mut before = 0.0;
    targets.retain(|t| {
        let needed = before < SURE;
        before += t.1;
        needed
    });
    let kept = |target: &T| targets.iter().any(|t| t.0 == *target);
    rivals.iter().map(|(value, target)| *value > best - AS_WELL && kept(target)).collect()
}

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
