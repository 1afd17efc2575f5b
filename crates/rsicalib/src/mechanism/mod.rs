//! Mechanisms as data: channels, chains, points, closures, platform, rest.

mod drawing;
pub mod hand_controller;
mod queries;
mod target;
#[cfg(feature = "toml")]
mod toml;
mod validation;

pub use drawing::{
    Chain, Channel, Closure, ClosureKind, Mechanism, ModelSection, Motion, Point, Rest, Row, Value,
};
pub(crate) use queries::list;
pub use target::Target;
