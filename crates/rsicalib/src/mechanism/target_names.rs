//! Names of targets, and whether a mechanism has them.

use crate::mechanism::drawing::Mechanism;
use crate::mechanism::target::{Target, bits};

impl Target {
    /// The name that users write: `a22`, `arm2/2`, `arm2`, `wrist1-wrist2`, `all`, and of chains that
    /// are drawn alike `each`, `each/2`, `each.2`; `each`, too, of distances of one make. A second kind is named
    /// by the first of its parts: `each(leg3)/2`, `each(rod d)`.
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
            Self::EachChain(first) => chains_name(mechanism, first),
            Self::EachRow(first, row) => {
                format!("{}/{}", chains_name(mechanism, first), row.saturating_add(1))
            }
            Self::EachJoint(first, joint) => {
                format!("{}.{}", chains_name(mechanism, first), joint.saturating_add(1))
            }
            Self::EachClosure(first) => {
                let groups = mechanism.distances_alike();
                let its_first = groups.first().is_some_and(|group| group[0] == first);
                group_name(its_first, || Self::Closure(first).name(mechanism))
            }
            Self::Together(_) if self.is_each(mechanism) => "each".into(),
            Self::Together(_) if self.chain_of_all(mechanism).is_some() => {
                self.chain_of_all(mechanism).map(|c| chain_name(mechanism, c)).unwrap_or_default()
            }
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

    /// True for all channels that read a length, where no chains are called so.
    fn is_each(self, mechanism: &Mechanism) -> bool {
        mechanism.alike().is_empty() && Self::together(mechanism.measuring()) == Some(self)
    }

    /// The chain of which these channels are all.
    fn chain_of_all(self, mechanism: &Mechanism) -> Option<usize> {
        let all = |chain: &usize| Self::together(mechanism.channels_of(*chain)) == Some(self);
        (0..mechanism.chains.len()).find(all)
    }

    /// The channels that stand together, by a name such as `bl+br`, or that of the chain that they are
    /// all of; none for another name.
    #[must_use]
    pub fn named_together(mechanism: &Mechanism, name: &str) -> Option<Self> {
        if let Ok(chain) = mechanism.chain_index(name) {
            let all = Self::together(mechanism.channels_of(chain));
            return all.filter(|target| target.is_in(mechanism));
        }
        let index = |name: &str| mechanism.channel_index(name).ok();
        let channels: Option<Vec<usize>> = name.split('+').map(index).collect();
        Self::together(channels?).filter(|target| target.is_in(mechanism))
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

fn chains_name(mechanism: &Mechanism, first: usize) -> String {
    let is_first = mechanism.alike().first().is_some_and(|group| group[0] == first);
    group_name(is_first, || chain_name(mechanism, first))
}

/// `each` of the first group of its kind, of another with the name of its first part.
fn group_name(is_first: bool, part: impl Fn() -> String) -> String {
    if is_first { "each".into() } else { format!("each({})", part()) }
}

fn chain_name(mechanism: &Mechanism, chain: usize) -> String {
    mechanism.chains.get(chain).map_or_else(|| format!("chain {chain}"), |c| c.name.clone())
}
