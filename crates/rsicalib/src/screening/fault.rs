//! Faults of a converter, as values.

/// What is wrong with the codes of a channel.
#[derive(Debug, Clone, PartialEq)]
pub enum FaultKind {
    /// Bits that keep one value while higher ones change, lowest first.
    StuckBits(Vec<(u32, bool)>),
    /// Poses, from 0, that all read the same extreme code.
    Clipped {
        /// The code.
        at: f64,
        /// The poses.
        poses: Vec<usize>,
    },
}
