//! Eight samples side by side, as the kernels take them.

use crate::numerics::lanes::{Lanes, WIDTH};

/// Eight samples, or fewer.
#[derive(Debug, Clone)]
pub struct Block {
    /// Rows of the table; the last is repeated where the block is not full.
    pub rows: [usize; WIDTH],
    /// How many are real.
    pub live: usize,
    /// Which combination of keys they share: index into [`Readings::groups`].
    pub group: usize,
    /// Time of each, 0 to 1 over the session.
    pub time: Lanes,
    /// Temperature above the mean [K].
    pub temperature: Lanes,
    /// Number of the pose of each.
    pub pose: Lanes,
    /// Number of the session of each.
    pub session: Lanes,
}

impl Block {
    /// One for each sample of a session, zero for the others.
    #[inline(always)]
    #[must_use]
    pub fn within(&self, session: usize) -> Lanes {
        let session = session as f64;
        self.session.map(|s| if s == session { 1.0 } else { 0.0 })
    }
}
