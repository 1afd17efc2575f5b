//! How to search.

use crate::error::index_of;
use crate::{Error, terms};

/// How to search.
#[derive(Debug, Clone)]
pub struct SearchOptions {
    /// Terms that are no candidates.
    pub without: Vec<String>,
    /// Effects to add at the most.
    pub most: usize,
    /// Apply every effect that is found, whether or not it helps elsewhere.
    pub apply_all: bool,
    /// Rules that are switched off, to see what each is worth.
    #[doc(hidden)]
    pub off: Vec<Rule>,
}

impl Default for SearchOptions {
    fn default() -> Self {
        Self { without: Vec::new(), most: 8, apply_all: false, off: Vec::new() }
    }
}

impl SearchOptions {
    /// True where a rule is in use.
    #[must_use]
    pub fn uses(&self, rule: Rule) -> bool {
        !self.off.contains(&rule)
    }

    /// Checks that the options can be used.
    ///
    /// # Errors
    ///
    /// [`Error::Unknown`] where there is no such term.
    pub fn check(&self) -> Result<(), Error> {
        self.without.iter().try_for_each(|id| terms::find(id).map(|_| ()))
    }
}

/// Declares the rules with the names by which they are switched off.
macro_rules! rules {
    ($($(#[$doc:meta])* $rule:ident = $id:literal,)*) => {
        /// A rule of the search that can be switched off: `python -m tests.ablation`.
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        pub enum Rule {
            $($(#[$doc])* $rule,)*
        }

        impl Rule {
            /// Every rule with its name.
            pub const ALL: &[(&'static str, Self)] = &[$(($id, Self::$rule),)*];

            /// The rule of this name.
            ///
            /// # Errors
            ///
            /// [`Error::Unknown`] where there is no such rule.
            pub fn of(id: &str) -> Result<Self, Error> {
                Ok(Self::ALL[index_of(Self::ALL, |rule| rule.0, "rule", id)?].1)
            }
        }
    };
}

rules! {
    /// Noise that nobody knows of, as an item of an explanation.
    UnknownNoise = "unknown_noise",
    /// Two effects for one or two, or none.
    FindPairs = "find_pairs",
    /// Two wrong readings in one move.
    TwoWrong = "two_wrong",
    /// What chains share is nothing beside the same of one of them.
    Parts = "parts",
    /// A residual may say that noise is larger than it is known.
    LargerNoise = "larger_noise",
    /// An error of a surface is in the tie of one of the arm, whatever else is exchanged.
    AcrossSurfaces = "across_surfaces",
    /// Isolation of a single fault.
    Isolation = "isolation",
    /// Joints that give are found together.
    Yielding = "yielding",
    /// No effect turns a gain round.
    Swung = "swung",
    /// Poses that do not fit their placement are weighed against effects that explain them.
    KeptIn = "kept_in",
    /// Data are judged again beside what was found.
    JudgeAgain = "judge_again",
    /// The misclosure must not grow.
    Misclosure = "misclosure",
    /// A declared noise of which less is left than chance allows is a bound.
    Bound = "bound",
    /// Joints as they are drawn, where errors of a surface explain as much.
    AsDrawn = "as_drawn",
}

pub use crate::estimate::significance::{CLEAN, LEVEL};
