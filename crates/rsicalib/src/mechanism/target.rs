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
    /// All chains that are drawn as this one, the first of them: [`Mechanism::alike`].
    EachChain(usize),
    /// The same row of all of them, from 0.
    EachRow(usize, usize),
    /// The same joint of all of them, from 0.
    EachJoint(usize, usize),
}

impl Target {
    /// The name that users write: `a22`, `arm2/2`, `arm2`, `wrist1-wrist2`, `all`, and of chains that
    /// are drawn alike `each`, `each/2`, `each.2`. A second kind of such chains is named by its first
    /// chain: `each(leg3)/2`.
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
            Self::EachChain(first) => group_name(mechanism, first),
            Self::EachRow(first, row) => {
                format!("{}/{}", group_name(mechanism, first), row.saturating_add(1))
            }
            Self::EachJoint(first, joint) => {
                format!("{}.{}", group_name(mechanism, first), joint.saturating_add(1))
            }
        }
    }

    /// What people call it: the label of a channel, the name of a link.
    #[must_use]
    pub fn label(self, mechanism: &Mechanism) -> Option<String> {
        match self {
            Self::Channel(c) => mechanism.channels.get(c)?.label.clone(),
            Self::Row(c, row) => mechanism.chains.get(c)?.rows.get(row)?.name.clone(),
            _ => None,
        }
    }

    /// True for a target that several chains share.
    #[must_use]
    pub fn is_shared(self) -> bool {
        matches!(self, Self::EachChain(_) | Self::EachRow(..) | Self::EachJoint(..))
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
            shared => mechanism.shared_targets().contains(&shared),
        }
    }
}

fn group_name(mechanism: &Mechanism, first: usize) -> String {
    match mechanism.alike().first().is_some_and(|group| group[0] == first) {
        true => "each".into(),
        false => format!("each({})", chain_name(mechanism, first)),
    }
}

fn chain_name(mechanism: &Mechanism, chain: usize) -> String {
    mechanism.chains.get(chain).map_or_else(|| format!("chain {chain}"), |c| c.name.clone())
}
