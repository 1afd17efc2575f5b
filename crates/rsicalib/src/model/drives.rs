//! Torques of drives in closed loops, by sample and joint.

use crate::kinematics::elements::Weight;
use crate::mechanism::{Mechanism, Target};
use crate::numerics::lanes::Lanes;
use crate::terms::term::{Acts, Term};

/// Torques about the joints of closed loops, in every sample of some readings.
///
/// As drawn, and then constant: what a joint gives is small, and what that and the other errors change
/// of a torque is small of that.
#[derive(Debug, Clone)]
pub(crate) struct Drives {
    /// By block, then kind of weight, then channel.
    torques: Vec<[Vec<Lanes>; 2]>,
    /// Of each channel the chain of its joint.
    chains: Vec<Option<usize>>,
    /// By kind of weight, channels whose drives may work against others.
    untold: [Vec<bool>; 2],
}

impl Drives {
    /// Torques of blocks, kinds of weight and channels.
    pub(crate) fn new(
        torques: Vec<[Vec<Lanes>; 2]>,
        chains: Vec<Option<usize>>,
        untold: [Vec<bool>; 2],
    ) -> Self {
        Self { torques, chains, untold }
    }

    /// True where nothing tells the torque on which a term depends at a target: a loop has more drives
    /// than motions.
    pub(crate) fn hide(&self, mechanism: &Mechanism, term: &dyn Term, target: Target) -> bool {
        let (whose, of) = match term.acts() {
            Acts::Load(whose) => (whose, mechanism.channels_at(target)),
            Acts::Coupled(law) => {
                let named = law.weighed(mechanism.channels_at(target), |name| {
                    mechanism.channel_index(name).ok()
                });
                (weight_of(mechanism), named)
            }
            _ => return false,
        };
        of.iter().any(|c| self.untold[whose as usize][*c])
    }

    /// The joints of a chain.
    #[inline(always)]
    pub(crate) fn joints(&self, chain: usize) -> impl Iterator<Item = usize> {
        let mine = move |(_, own): &(usize, &Option<usize>)| **own == Some(chain);
        self.chains.iter().enumerate().filter(mine).map(|(c, _)| c)
    }

    /// The torque about the joint of a channel in one block.
    #[inline(always)]
    pub(crate) fn at(&self, block: usize, whose: Weight, channel: usize) -> Lanes {
        self.torques[block][whose as usize][channel]
    }
}

/// The weight that a torque is of, where a law does not say: of the links, where their masses or what
/// drives carry is known.
pub(crate) fn weight_of(mechanism: &Mechanism) -> Weight {
    let mut rows = mechanism.chains.iter().flat_map(|c| &c.rows);
    let told = mechanism.channels.iter().any(|c| c.torque.is_some());
    if told || rows.any(|row| row.mass.is_some()) { Weight::Links } else { Weight::Tip }
}
