//! What looks wrong in raw readings, as a value.

/// What looks wrong in raw readings. Rows are counted from 0.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[cfg_attr(feature = "serde", serde(tag = "kind", rename_all = "snake_case"))]
#[non_exhaustive]
pub enum Suspect {
    /// A channel reads one value while another moves.
    Constant {
        /// The channel.
        channel: usize,
        /// What it reads.
        reads: f64,
    },
    /// A channel stops at one reading within its range.
    Clipped {
        /// The channel.
        channel: usize,
        /// The reading.
        at: f64,
        /// First rows of the poses that read nothing else.
        rows: Vec<usize>,
    },
    /// Bits keep one value while higher ones change.
    StuckBit {
        /// Channels with the same bits.
        channels: Vec<usize>,
        /// The bits and their values, lowest first.
        bits: Vec<(u32, bool)>,
    },
    /// Readings at an end of the range.
    EndOfRange {
        /// The channel.
        channel: usize,
        /// The end.
        end: f64,
        /// The rows.
        rows: Vec<usize>,
    },
    /// A held pose scatters far more than the others.
    MovedPose {
        /// Its first row.
        row: usize,
        /// The channel that stands out most.
        channel: usize,
        /// Standard deviation of its readings within the pose.
        scatter: f64,
        /// The median of that over the poses, or what rounding gives.
        typical: f64,
        /// Other channels that stand out.
        others: usize,
    },
    /// Poses are not held: channels move through a good part of their range within them.
    Unheld {
        /// That part.
        part: f64,
        /// Number of poses.
        poses: usize,
    },
    /// Decimals in a small part of the range, where whole counts are declared.
    Units {
        /// The channels.
        channels: Vec<usize>,
        /// The lowest reading.
        low: f64,
        /// The highest reading.
        high: f64,
        /// The part of the range that they span.
        part: f64,
    },
    /// Rows repeat an earlier row of their pose, or the row before, in every channel.
    StaleRows {
        /// The rows.
        rows: Vec<usize>,
    },
    /// A pose has the readings of another, sample by sample.
    CopiedPose {
        /// Its first row.
        row: usize,
        /// The first row of the other.
        of: usize,
    },
}
