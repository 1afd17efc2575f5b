//! Blocks of eight samples, the unit that the kernels work on.

use crate::numerics::lanes::{Lanes, WIDTH};

/// Up to eight samples of one group.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Block {
    /// Rows of the table; the last row is repeated where the block is not full.
    pub rows: [usize; WIDTH],
    /// Number of samples; the lanes after them repeat the last one.
    pub live: usize,
    /// Combination of keys that the samples share: index into [`Readings::groups`](crate::Readings::groups).
    pub group: usize,
    /// Time of each sample, from 0 to 1 over the session.
    pub time: Lanes,
    /// Temperature of each sample above the mean (K).
    pub temperature: Lanes,
    /// Number of each sample's pose, from 0.
    pub pose: Lanes,
    /// Number of each sample's session, from 0.
    pub session: Lanes,
}

impl Block {
    /// One in the lanes of the samples of a session, zero in the others.
    #[inline(always)]
    #[must_use]
    pub fn within(&self, session: usize) -> Lanes {
        let session = session as f64;
        self.session.map(|s| if s == session { 1.0 } else { 0.0 })
    }
}
