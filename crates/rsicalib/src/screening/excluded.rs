//! Readings that are wrong.

/// Poses and samples that were left out.
#[derive(Debug, Clone, PartialEq)]
pub struct Excluded {
    /// Number of the pose; none for a whole placement.
    pub pose: Option<usize>,
    /// The placement, by one of its rows; none unless it is left out whole.
    pub placement: Option<usize>,
    /// Row of a single bad sample; none: all samples of the pose.
    pub row: Option<usize>,
    /// The channel at fault; none where it cannot be told.
    pub channel: Option<usize>,
    /// The chain at fault; none where it cannot be told.
    pub chain: Option<usize>,
    /// How many samples were left out.
    pub samples: usize,
    /// Why.
    pub reason: String,
}

impl Excluded {
    /// So many samples, the first of them of this pose; nothing else is known.
    #[must_use]
    pub fn of(pose: Option<usize>, samples: usize, reason: String) -> Self {
        Self { pose, placement: None, row: None, channel: None, chain: None, samples, reason }
    }
}
