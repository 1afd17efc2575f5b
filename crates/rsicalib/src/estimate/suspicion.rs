//! What looks wrong with the wiring.

/// What looks wrong with the wiring, where no start led to a good fit.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Suspicion {
    /// Channels read the wrong way round.
    Reversed {
        /// The channels.
        channels: Vec<usize>,
        /// How well the loop closes with it.
        closes: Closes,
    },
    /// The readings of two channels are exchanged.
    Exchanged {
        /// The channels.
        channels: [usize; 2],
        /// How well the loop closes with it.
        closes: Closes,
    },
    /// The gap of a potentiometer's track lies within the range of motion.
    Gap {
        /// The channel.
        channel: usize,
        /// What shows the gap.
        shown: Shown,
        /// Rows that may lie beyond the gap.
        rows: usize,
        /// Rows looked at.
        of: usize,
        /// How well the loop closes without those rows.
        closes: Closes,
    },
    /// No start led to a fit in which every joint moves.
    NoStart {
        /// Starts that were tried.
        tried: usize,
    },
}

/// χ² per equation with a suspected mistake taken into account, and as declared.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Closes {
    /// With the mistake.
    pub with: f64,
    /// As declared; infinite where no start led anywhere.
    pub declared: f64,
}

/// What shows the gap of a track.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Shown {
    /// Readings at an end of the range.
    AtEnd,
    /// Nothing between two readings.
    Jump {
        /// The lower reading.
        below: f64,
        /// The upper reading.
        above: f64,
    },
}
