//! How to search.

use crate::{Error, terms};

/// How to search.
#[derive(Debug, Clone)]
pub struct SearchOptions {
    /// Probability of naming anything where nothing is missing.
    pub alpha: f64,
    /// Terms that are no candidates.
    pub without: Vec<String>,
    /// Effects to add at the most.
    pub most: usize,
    /// Candidates to refit in each step.
    pub refits: usize,
    /// Apply every effect that is found, whether or not it helps elsewhere.
    pub apply_all: bool,
    /// Rules that are switched off, to see what each is worth.
    pub off: Vec<Rule>,
}

impl Default for SearchOptions {
    fn default() -> Self {
        Self {
            alpha: OVERSTATED * LEVEL,
            without: Vec::new(),
            most: 8,
            refits: 8,
            apply_all: false,
            off: Vec::new(),
        }
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
    /// [`Error::Option`] for numbers that cannot, [`Error::Unknown`] where there is no such term.
    pub fn check(&self) -> Result<(), Error> {
        if !(self.alpha > 0.0 && self.alpha < 1.0) {
            return Err(Error::option("alpha", self.alpha, "a probability above 0 and below 1"));
        }
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
                let known = || Self::ALL.iter().map(|(name, _)| *name).collect::<Vec<_>>().join(", ");
                let rule = Self::ALL.iter().find(|(name, _)| *name == id).map(|(_, rule)| *rule);
                rule.ok_or_else(|| Error::Unknown { kind: "rule", found: id.into(), known: known() })
            }
        }
    };
}

rules! {
    /// The stepwise search, in place of the beam.
    Stepwise = "stepwise",
    /// Noise that nobody knows of, as an item of an explanation.
    UnknownNoise = "unknown_noise",
    /// A free shape by its marginal likelihood.
    Marginal = "marginal",
    /// Every parameter costs as much.
    Charge = "charge",
    /// One channel in place of a whole pose.
    OneChannel = "one_channel",
    /// One effect for two.
    MergePairs = "merge_pairs",
    /// Two effects for one or two, or none.
    FindPairs = "find_pairs",
    /// Isolation of a single fault.
    Isolation = "isolation",
    /// Joints that give are found together.
    Yielding = "yielding",
    /// No effect turns a gain round.
    Swung = "swung",
    /// Effects that no longer pay are dropped at the end.
    KeepGains = "keep_gains",
    /// What does not stand out of the rest is dropped.
    AgainstTheRest = "against_the_rest",
    /// Readings at an end of the session in place of a slip.
    ReadSlips = "read_slips",
    /// Effects of single chains are united, shared ones parted.
    Share = "share",
    /// Data are judged again beside what was found.
    JudgeAgain = "judge_again",
    /// A few effects first, then isolation, then more.
    FewFirst = "few_first",
    /// The misclosure must not grow.
    Misclosure = "misclosure",
    /// A declared noise of which less is left than chance allows is a bound.
    Bound = "bound",
    /// Joints as they are drawn, where errors of a surface explain as much.
    AsDrawn = "as_drawn",
    /// Errors of a surface beside small errors of everything drawn.
    Tolerances = "tolerances",
    /// No standing point has moved where places of such points are estimated.
    PointsStand = "points_stand",
}

pub use crate::estimate::significance::{CLEAN, LEVEL};

/// The search charges for all candidates that it looks at as if they were independent, and names
/// something in a clean session so many times less often than that sum says:
/// `python -m tests.clean`, docs/limits.md.
const OVERSTATED: f64 = 2.0;

/// More effects than this are a less likely story than one channel, or closure, whose law
/// nobody knows.
pub const FEW_EFFECTS: usize = 2;
