//! A part of a mechanism that a term acts on, or that is at fault.

use crate::mechanism::drawing::Mechanism;

/// The part of a mechanism that an instance of a term acts on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Target {
    /// The whole mechanism.
    All,
    /// A channel, by its index.
    Channel(usize),
    /// A row of a chain: index of the chain, and of the row within the chain, from 0.
    Row(usize, usize),
    /// A chain, by its index.
    Chain(usize),
    /// A closure, by its index.
    Closure(usize),
}

impl Target {
    /// The name that users write: `a22`, `arm2/2`, `arm2`, `wrist1-wrist2`, `all`.
    ///
    /// A target that the mechanism does not have is named by its kind and index: `channel 12`.
    #[must_use]
    pub fn name(self, mechanism: &Mechanism) -> String {
        match self {
            Self::All => "all".into(),
            Self::Channel(c) => {
                mechanism.channels.get(c).map_or_else(|| format!("channel {c}"), |c| c.name.clone())
            }
            Self::Chain(c) => chain_name(mechanism, c),
            Self::Row(c, row) => format!("{}/{}", chain_name(mechanism, c), row.saturating_add(1)),
            Self::Closure(c) => {
                mechanism.closures.get(c).map_or_else(|| format!("closure {c}"), |c| c.name.clone())
            }
        }
    }

    /// True where the mechanism has this target.
    #[must_use]
    pub fn is_in(self, mechanism: &Mechanism) -> bool {
        match self {
            Self::All => true,
            Self::Channel(c) => c < mechanism.channels.len(),
            Self::Chain(c) => c < mechanism.chains.len(),
            Self::Row(c, row) => mechanism.chains.get(c).is_some_and(|c| row < c.rows.len()),
            Self::Closure(c) => c < mechanism.closures.len(),
        }
    }
}

fn chain_name(mechanism: &Mechanism, chain: usize) -> String {
    mechanism.chains.get(chain).map_or_else(|| format!("chain {chain}"), |c| c.name.clone())
}
