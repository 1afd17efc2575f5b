//! How often readings of one channel repeat the one before, and how rare a run of them is.

/// What the runs of a channel have shown so far.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Repeating {
    /// Rows that repeated the one before, in runs of two and more.
    pub(crate) again: f64,
    /// Rows at which such a run might have ended, or did.
    pub(crate) chances: f64,
}

impl Repeating {
    /// As if one of two had repeated: nothing is known of the converter's steps.
    pub(crate) const UNKNOWN: Self = Self { again: 1.0, chances: 2.0 };

    /// Takes in a run of so many rows that has ended.
    pub(crate) fn end(&mut self, length: u64) {
        if length >= 2 {
            self.again += (length - 2) as f64;
            self.chances += (length - 1) as f64;
        }
    }

    /// The logarithm of the probability that a run of two goes on for so long by chance.
    pub(crate) fn chance(self, length: u64) -> f64 {
        length.saturating_sub(2) as f64 * (self.again / self.chances).ln()
    }
}
