//! The kinds that there are.

use crate::closures::distance::Distance;
use crate::closures::equal::Equal;
use crate::closures::kind::{At, Facts, Given, Kind, Part};
use crate::closures::line::Line;
use crate::closures::plane::Plane;
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
            pub fn facts(self) -> &'static Facts {
                match self {
                    $(Self::$kind => &$kind::FACTS),*
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
    /// `normal · p = offset`, of a point and a plane: one equation.
    Plane,
    /// A point on a line: two equations.
    Line,
    /// The coordinates of two channels are equal: one equation.
    Equal,
}

impl ClosureKind {
    /// Scalar equations of one closure.
    #[must_use]
    pub fn equations(self) -> usize {
        self.facts().equations
    }

    /// True for a kind with a value, to which terms can add.
    #[must_use]
    pub fn has_value(self) -> bool {
        self.facts().given != Given::Nothing
    }

    /// True for a kind between points alone.
    #[must_use]
    pub fn is_between_points(self) -> bool {
        self.facts().between == [Part::Point; 2]
    }
}
