//! Torques of drives in closed loops, by sample and joint.

use crate::kinematics::elements::Weight;
use crate::numerics::lanes::Lanes;

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
}

impl Drives {
    /// Torques of blocks, kinds of weight and channels.
    pub(crate) fn new(torques: Vec<[Vec<Lanes>; 2]>, chains: Vec<Option<usize>>) -> Self {
        Self { torques, chains }
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
