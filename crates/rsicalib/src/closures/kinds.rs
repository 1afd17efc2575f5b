//! The kinds that there are.

use crate::closures::distance::Distance;
use crate::closures::kind::{At, Kind};
use crate::closures::touch::Touch;
use crate::numerics::lanes::{Lanes, Vec3};

/// Lists the kinds, and sends each call of the kernel to the kind's own function: through a table
/// of functions it would leave the vector instructions.
macro_rules! kinds {
    ($($(#[$doc:meta])* $kind:ident),* $(,)?) => {
        /// The kind of equation of a closure.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
        #[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
        #[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
        #[cfg_attr(feature = "serde", serde(rename_all = "lowercase"))]
        pub enum ClosureKind {
            $($(#[$doc])* $kind),*
        }

        impl ClosureKind {
            /// All kinds.
            pub const ALL: &[Self] = &[$(Self::$kind),*];

            /// What this kind is.
            #[must_use]
            pub fn facts(self) -> &'static dyn Kind {
                match self {
                    $(Self::$kind => &$kind),*
                }
            }

            /// Misclosure of an equation.
            #[inline(always)]
            pub(crate) fn misclosure(self, at: &At, row: usize) -> Lanes {
                match self {
                    $(Self::$kind => $kind::misclosure(at, row)),*
                }
            }

            /// Change of an equation as an end moves.
            #[inline(always)]
            pub(crate) fn by_end(self, at: &At, row: usize, moved: &Vec3, sign: f64) -> Lanes {
                match self {
                    $(Self::$kind => $kind::by_end(at, row, moved, sign)),*
                }
            }

            /// Derivative of an equation by the value.
            #[inline(always)]
            pub(crate) fn by_value(self, at: &At, row: usize) -> Lanes {
                match self {
                    $(Self::$kind => $kind::by_value(at, row)),*
                }
            }
        }
    };
}

kinds! {
    /// `|a - b|² - value² = 0`, eq. (10): one equation.
    #[default]
    Distance,
    /// `a - b = 0`: three equations.
    Touch,
}

impl ClosureKind {
    /// Scalar equations of one closure.
    #[must_use]
    pub fn equations(self) -> usize {
        self.facts().equations()
    }

    /// True for a kind with a value, to which terms can add.
    #[must_use]
    pub fn has_value(self) -> bool {
        self.facts().has_value()
    }
}
