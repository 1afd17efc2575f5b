//! A part of a mechanism that something may belong to.

use crate::mechanism::drawing::Mechanism;

/// What an instance of a term belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Target {
    /// The whole mechanism.
    All,
    /// A channel.
    Channel(usize),
    /// A row of a chain, counted from 0.
    Row(usize, usize),
    /// A chain.
    Chain(usize),
    /// A closure.
    Closure(usize),
}

impl Target {
    /// As users write it: `a22`, `arm2/2`, `arm2`, `wrist1-wrist2`, `all`.
    #[must_use]
    pub fn name(self, mechanism: &Mechanism) -> String {
        match self {
            Self::All => "all".into(),
            Self::Channel(c) => mechanism.channels[c].name.clone(),
            Self::Chain(c) => mechanism.chains[c].name.clone(),
            Self::Row(c, row) => format!("{}/{}", mechanism.chains[c].name, row + 1),
            Self::Closure(c) => mechanism.closures[c].name.clone(),
        }
    }
}
