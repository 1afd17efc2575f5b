//! The errors of this crate.

use crate::text::{brief, meant, meant_by, quoted};

/// The known name that may have been meant by what stands in quotation marks.
fn hint(found: &str, known: &str) -> String {
    found.split('"').nth(1).map_or(String::new(), |name| meant(name, known))
}

/// Input from which no answer can be computed.
///
/// The message says what was found and what was needed. A solver that runs out of
/// iterations and parameters that the poses cannot determine are not errors but outcomes,
/// see [`crate::numerics::lm::Termination`] and [`crate::Fit`].
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A mechanism with an entry that cannot be used.
    #[error("mechanism, {place}: found {found}{}; expected {expected}", hint(found, expected))]
    Mechanism {
        /// Which entry, as a path: `closure "wrist1-wrist2", between`.
        place: String,
        /// The entry.
        found: String,
        /// Entries that can be used.
        expected: String,
    },
    /// Text that is not a mechanism in TOML.
    #[error("mechanism: {0}")]
    Toml(String),
    /// A value that has no place in a mechanism.
    #[error("mechanism, {place}: {why}{}", meant_by(why))]
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
        "reading {row}, channel {channel}: found {}; expected a number in [{}, {}]",
        brief(*found), brief(*low), brief(*high)
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
    /// Who was told of the progress has ended the job.
    #[error("the job was ended by its listener")]
    Ended,
    /// No reading is left to work on.
    #[error("no readings: {0}")]
    Empty(String),
    /// An unknown name.
    #[error("there is no {kind} {}{}; there are {}", quoted(found), meant(found, known), if known.is_empty() { "none" } else { known })]
    Unknown {
        /// The kind of name: term, channel, target, ...
        kind: &'static str,
        /// The name asked for.
        found: String,
        /// The known names.
        known: String,
    },
    /// An option with a value that cannot be used.
    #[error("option {name}: found {found}; expected {expected}")]
    Option {
        /// Name of the option.
        name: &'static str,
        /// Its value.
        found: String,
        /// The values that can be used.
        expected: String,
    },
    /// A term that needs a column, or an order, that the readings do not have.
    #[error("term {term}: the readings have no {needs}")]
    Context {
        /// Id of the term.
        term: &'static str,
        /// The column or order that is missing.
        needs: String,
    },
    /// A pose that the chains cannot reach.
    #[error("{}{arm} is out of reach by {by:.4} {unit} ({why})", of_pose(*pose))]
    OutOfReach {
        /// Row of the pose among several, counted from 0.
        pose: Option<usize>,
        /// The chain that does not reach the pose.
        arm: String,
        /// Distance beyond the limit, in `unit`.
        by: f64,
        /// Unit of `by`.
        unit: String,
        /// The limit.
        why: String,
    },
    /// Fewer equations than parameters.
    #[error(
        "{parameters} parameters cannot be found from {equations} equations ({poses} poses{}); {}",
        others(*poses, *different), more(*equations, *poses == *different)
    )]
    TooFew {
        /// Number of parameters.
        parameters: usize,
        /// Number of equations.
        equations: usize,
        /// Number of poses.
        poses: usize,
        /// Those of them that do not repeat the readings of another, digit by digit.
        different: usize,
    },
    /// A mechanism without a section that the computation needs.
    #[error("mechanism {mechanism} has no {needs}; {why}")]
    Missing {
        /// Name of the mechanism.
        mechanism: String,
        /// The missing section.
        needs: &'static str,
        /// The use of that section.
        why: &'static str,
    },
}

impl Error {
    /// An array of a length that cannot be used.
    pub(crate) fn shape(what: impl Into<String>, found: usize, expected: usize) -> Self {
        Self::Shape { what: what.into(), found, expected }
    }

    /// Refuses an array of another length than is expected.
    ///
    /// # Errors
    ///
    /// [`Error::Shape`] with both lengths.
    pub fn same(what: &str, found: usize, expected: usize) -> Result<(), Self> {
        if found == expected { Ok(()) } else { Err(Self::shape(what, found, expected)) }
    }

    /// A mechanism, called `name`, without a section that is needed.
    pub(crate) fn missing(name: &str, needs: &'static str, why: &'static str) -> Self {
        Self::Missing { mechanism: name.into(), needs, why }
    }

    /// An option whose value cannot be used.
    #[must_use]
    pub fn option(name: &'static str, found: impl ToString, expected: impl Into<String>) -> Self {
        Self::Option { name, found: found.to_string(), expected: expected.into() }
    }

    /// The same of the pose with a number among several, counted from 0.
    #[must_use]
    pub fn at_pose(self, number: usize) -> Self {
        match self {
            Self::OutOfReach { arm, by, unit, why, .. } => {
                Self::OutOfReach { pose: Some(number), arm, by, unit, why }
            }
            other => other,
        }
    }
}

/// Where among `all` the one with a name is; [`Error::Unknown`] with the names there are.
pub(crate) fn index_of<T>(
    all: &[T],
    name: impl Fn(&T) -> &str,
    kind: &'static str,
    wanted: &str,
) -> Result<usize, Error> {
    all.iter().position(|one| name(one) == wanted).ok_or_else(|| Error::Unknown {
        kind,
        found: wanted.into(),
        known: all.iter().map(name).collect::<Vec<_>>().join(", "),
    })
}

/// What a message begins with that is about one of several poses.
fn of_pose(pose: Option<usize>) -> String {
    pose.map_or(String::new(), |pose| format!("pose {pose}: "))
}

/// How many poses differ, where some repeat others.
fn others(poses: usize, different: usize) -> String {
    match different {
        _ if different == poses => String::new(),
        1 => ", of which 1 is different".into(),
        _ => format!(", of which {different} are different"),
    }
}

/// What tells the parameters that so many equations do not.
fn more(equations: usize, differ: bool) -> &'static str {
    match (equations, differ) {
        (0, _) => {
            "a pose has as many unknowns as its closures have equations: read one more joint or length"
        }
        (_, true) => "record more poses",
        (_, false) => "record other poses",
    }
}
