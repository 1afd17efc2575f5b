//! Readings that are wrong.

use crate::screening::blame::Blame;
use crate::screening::fault::FaultKind;

/// Why readings are left out.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Cause {
    /// Bits of the converter are stuck: the readings stay, and count as noisier.
    StuckBits {
        /// Which bits.
        kind: FaultKind,
        /// Standard deviation of the error (count).
        error: f64,
    },
    /// The converter is clipped.
    Clipped {
        /// Where, and in which poses.
        kind: FaultKind,
        /// True where one entry stands for all rows of a recording.
        whole: bool,
    },
    /// A sample stands off the other samples of its pose.
    Outlier {
        /// By so many standard deviations.
        sigmas: f64,
        /// Whose reading is wrong.
        blame: Blame,
    },
    /// A pose moved while it was sampled.
    Unsteady {
        /// How far its samples differ, in times those of others.
        times: f64,
    },
    /// A reading of one pose is wrong.
    Reading(Blame),
    /// A pose is wrong, and no single channel explains it.
    Pose {
        /// Probability by chance.
        p_value: f64,
    },
    /// A placement does not fit its siblings.
    Placement {
        /// Its residual over theirs.
        times: f64,
    },
    /// The point that is touched, or the tool, moved half-way.
    Moved {
        /// True for the tool.
        tool: bool,
        /// How far [length unit].
        by: f64,
        /// Between which samples of the run, counted from 0.
        between: [usize; 2],
    },
    /// A single sample stands off.
    Sample {
        /// Its number in the run, counted from 0.
        number: usize,
        /// Its misclosure [length unit].
        off: f64,
        /// The same in standard deviations.
        sigmas: f64,
    },
}

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
    pub cause: Cause,
}

impl Excluded {
    /// So many samples, the first of them of this pose; nothing else is known.
    #[must_use]
    pub fn of(pose: Option<usize>, samples: usize, cause: Cause) -> Self {
        Self { pose, placement: None, row: None, channel: None, chain: None, samples, cause }
    }
}
