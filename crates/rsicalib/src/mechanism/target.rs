//! A part of a mechanism that a term acts on, or that is at fault.

use crate::mechanism::place_name::PlaceName;

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
    /// One of several places of something unknown: what closures have only where they touch it.
    Place(PlaceName),
    /// All chains that are drawn as this one, the first of them: [`crate::Mechanism::alike`].
    EachChain(usize),
    /// The same row of all of them, from 0.
    EachRow(usize, usize),
    /// The same joint of all of them, from 0.
    EachJoint(usize, usize),
    /// All distances that may be of one make, by the first of them.
    EachClosure(usize),
    /// Several channels: a bit for each of the first 64.
    Together(u64),
}

impl Target {
    /// Several channels together, by their indices; none for an index beyond the 64th.
    #[must_use]
    pub fn together(channels: impl IntoIterator<Item = usize>) -> Option<Self> {
        let bit = |all: u64, c: usize| 1_u64.checked_shl(u32::try_from(c).ok()?).map(|b| all | b);
        channels.into_iter().try_fold(0, bit).map(Self::Together)
    }

    /// True for a target that several parts share: one parameter for all of them.
    #[must_use]
    pub fn is_shared(self) -> bool {
        matches!(
            self,
            Self::EachChain(_)
                | Self::EachRow(..)
                | Self::EachJoint(..)
                | Self::EachClosure(_)
                | Self::Together(_)
        )
    }
}

/// The numbers of the bits that are set.
pub(super) fn bits(set: u64) -> impl Iterator<Item = usize> {
    (0..u64::BITS).filter(move |bit| set >> bit & 1 == 1).map(|bit| bit as usize)
}
