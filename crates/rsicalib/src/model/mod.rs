//! The model: a mechanism with terms, which gives the misclosure of readings.

pub mod assembly;
#[cfg(feature = "document")]
mod between;
mod compile;
mod compiled;
pub(crate) mod configurations;
mod drives;
mod ends;
mod evaluation;
mod hanging;
mod instance;
mod known;
mod law_at;
mod laws;
mod lean;
mod null;
mod numbering;
mod placed;
mod prior;
mod redundant;
mod scattered;
mod specification;
mod spheres;
mod surfaces;
mod thing;
mod unknown_points;
mod workspace;

pub use crate::mechanism::MOST_PARAMETERS;
pub(crate) use compile::SHARES;
pub use compiled::Model;
pub use instance::Instance;
pub(crate) use instance::{bound_to_session, place_name, places};
pub use numbering::Unknown;
pub(crate) use placed::RANK;
pub use prior::Prior;
pub use specification::{Spec, check_names, instances_of, parse};
pub use thing::{Thing, UNKNOWN_THINGS, is_unknown_thing};
pub use workspace::{Want, Workspace};
