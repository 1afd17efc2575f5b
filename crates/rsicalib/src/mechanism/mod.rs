//! Mechanisms as data: channels, chains, points, planes, closures, platform, rest.

mod alike;
mod at_target;
mod checked_places;
mod checks;
mod degrees;
mod drawing;
#[cfg(feature = "serde")]
mod exactly;
pub mod hand_controller;
mod law;
mod place_name;
mod places;
mod queries;
mod target;
mod target_names;
#[cfg(feature = "toml")]
mod toml;
mod touched;
mod validation;

/// JSON Schema of a mechanism file: keys, types and what they mean.
#[cfg(feature = "document")]
#[doc(hidden)]
#[must_use]
pub fn schema() -> schemars::Schema {
    schemars::schema_for!(Mechanism)
}

pub use crate::closures::ClosureKind;
pub use drawing::{
    Chain, Channel, Closure, Mechanism, ModelSection, Motion, Point, Rest, Row, Value, Workspace,
};
pub use law::Law;
#[doc(hidden)]
pub use law::{Class, Formula, MOST_PARAMETERS, MOST_VARIABLES, Moves, Per, Variable};
#[doc(hidden)]
pub use place_name::PlaceName;
pub(crate) use place_name::place_name;
pub(crate) use places::around;
pub use places::{Column, Frame, Line, Plane};
pub(crate) use queries::list;
#[doc(hidden)]
pub use target::Target;
#[cfg(all(feature = "toml", feature = "document"))]
#[doc(hidden)]
pub use toml::from_values;
