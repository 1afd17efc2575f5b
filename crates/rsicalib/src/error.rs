//! Everything that can go wrong before there is an answer.

/// Input from which no answer can be computed.
///
/// What was found and what was needed stand in the message; running out of
/// iterations or parameters that the poses cannot tell apart are not errors
/// but outcomes, see [`crate::lm::Termination`] and [`crate::fit::Fit`].
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A mechanism that contradicts itself.
    #[error("mechanism, {place}: found {found}; expected {expected}")]
    Mechanism {
        /// Which entry, as a path: `closure "wrist1-wrist2", between`.
        place: String,
        /// What stands there.
        found: String,
        /// What could stand there.
        expected: String,
    },
    /// Text that is not a mechanism in TOML.
    #[error("mechanism: {0}")]
    Toml(String),
    /// A value that has no place in a mechanism.
    #[error("mechanism, {place}: {why}")]
    Entry {
        /// Which entry, as a path: `chain[0].dh[2].alpha`.
        place: String,
        /// What is wrong with it.
        why: String,
    },
    /// A table of readings of the wrong shape.
    #[error("readings: {what} has {found} entries; expected {expected}")]
    Shape {
        /// Which array.
        what: String,
        /// Its length.
        found: usize,
        /// The length that agrees with the others.
        expected: usize,
    },
    /// A reading that is not a number in the channel's range.
    #[error(
        "reading {row}, channel {channel}: found {found}; expected a number in [{low}, {high}]"
    )]
    Reading {
        /// Row, counted from 0.
        row: usize,
        /// Name of the channel.
        channel: String,
        /// The reading.
        found: f64,
        /// Lower end of the channel's range.
        low: f64,
        /// Upper end of the channel's range.
        high: f64,
    },
    /// No reading is left to work on.
    #[error("no readings: {0}")]
    Empty(String),
    /// A name that nothing bears.
    #[error("there is no {kind} {found:?}; there are {known}")]
    Unknown {
        /// What kind of thing was looked for: term, channel, target, ...
        kind: &'static str,
        /// The name asked for.
        found: String,
        /// The names there are.
        known: String,
    },
    /// A number of an option that cannot be used.
    #[error("option {name}: found {found}; expected {expected}")]
    Option {
        /// Name of the option.
        name: &'static str,
        /// Its value.
        found: String,
        /// The values that can be used.
        expected: String,
    },
    /// A term that needs what the readings do not have.
    #[error("term {term}: the readings have no {needs}")]
    Context {
        /// Id of the term.
        term: &'static str,
        /// The column or order that is missing.
        needs: &'static str,
    },
    /// A pose that the arms cannot take.
    #[error("pose {pose} is out of reach: {arm} by {by:.4} {unit} ({why})")]
    OutOfReach {
        /// Row of the pose, counted from 0.
        pose: usize,
        /// The chain that fails first.
        arm: String,
        /// How far beyond the limit.
        by: f64,
        /// Unit of `by`.
        unit: String,
        /// Which limit.
        why: String,
    },
    /// Fewer equations than parameters.
    #[error(
        "{parameters} parameters cannot be found from {equations} equations ({poses} poses); record more poses"
    )]
    TooFew {
        /// Parameters asked for.
        parameters: usize,
        /// Equations there are.
        equations: usize,
        /// Poses there are.
        poses: usize,
    },
    /// What this mechanism lacks for what was asked.
    #[error("mechanism {mechanism} has no {needs}; {why}")]
    Missing {
        /// Name of the mechanism.
        mechanism: String,
        /// The section it lacks.
        needs: &'static str,
        /// What it is needed for.
        why: &'static str,
    },
}
