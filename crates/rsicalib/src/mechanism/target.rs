//! A part of a mechanism that a term acts on, or that is at fault.

use crate::mechanism::drawing::Mechanism;
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
    /// All chains that are drawn as this one, the first of them: [`Mechanism::alike`].
    EachChain(usize),
    /// The same row of all of them, from 0.
    EachRow(usize, usize),
    /// The same joint of all of them, from 0.
    EachJoint(usize, usize),
    /// Several channels: a bit for each of the first 64.
    Together(u64),
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
            Self::Place(place) => place.text().into(),
            Self::EachChain(first) => group_name(mechanism, first),
            Self::EachRow(first, row) => {
                format!("{}/{}", group_name(mechanism, first), row.saturating_add(1))
            }
            Self::EachJoint(first, joint) => {
                format!("{}.{}", group_name(mechanism, first), joint.saturating_add(1))
            }
            Self::Together(_) if self.is_each(mechanism) => "each".into(),
            Self::Together(channels) => {
                let names = bits(channels).map(|c| Self::Channel(c).name(mechanism));
                names.collect::<Vec<_>>().join("+")
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

    /// Several channels together, by their indices; none for an index beyond the 64th.
    #[must_use]
    pub fn together(channels: impl IntoIterator<Item = usize>) -> Option<Self> {
        let bit = |all: u64, c: usize| 1_u64.checked_shl(u32::try_from(c).ok()?).map(|b| all | b);
        channels.into_iter().try_fold(0, bit).map(Self::Together)
    }

    /// True for all channels that read a length, where no chains are called so.
    fn is_each(self, mechanism: &Mechanism) -> bool {
        mechanism.alike().is_empty() && Self::together(mechanism.measuring()) == Some(self)
    }

    /// The channels that stand together, by a name such as `bl+br`; none for another name.
    #[must_use]
    pub fn named_together(mechanism: &Mechanism, name: &str) -> Option<Self> {
        let index = |name: &str| mechanism.channel_index(name).ok();
        let channels: Option<Vec<usize>> = name.split('+').map(index).collect();
        Self::together(channels?).filter(|target| target.is_in(mechanism))
    }

    /// True for a target that several chains share.
    #[must_use]
    pub fn is_shared(self) -> bool {
        matches!(
            self,
            Self::EachChain(_) | Self::EachRow(..) | Self::EachJoint(..) | Self::Together(_)
        )
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
            Self::Place(place) => mechanism.closures_at(place).next().is_some(),
            Self::Together(channels) => {
                let all = mechanism.channels.len();
                channels.count_ones() > 1 && bits(channels).all(|channel| channel < all)
            }
            shared => mechanism.shared_targets().contains(&shared),
        }
    }
}

/// The numbers of the bits that are set.
pub(super) fn bits(set: u64) -> impl Iterator<Item = usize> {
    (0..u64::BITS).filter(move |bit| set >> bit & 1 == 1).map(|bit| bit as usize)
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
