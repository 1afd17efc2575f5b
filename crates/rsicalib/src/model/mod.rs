//! The model: a mechanism with terms, which gives the misclosure of readings.

mod across;
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
pub(crate) mod joined;
pub(crate) mod known;
mod law_at;
mod laws;
mod lean;
mod near;
mod null;
mod numbering;
mod placed;
mod prior;
mod redundant;
mod scattered;
mod shown;
mod specification;
mod spheres;
mod surfaces;
mod thing;
mod told_poses;
mod turning;
mod unknown_points;
mod workspace;

pub use crate::mechanism::MOST_PARAMETERS;
pub(crate) use compile::SHARES;
pub use compiled::Model;
pub use instance::Instance;
pub(crate) use instance::{bound_to_session, place_name, places};
pub(crate) use near::RANK;
pub use numbering::Unknown;
pub use prior::Prior;
pub(crate) use prior::add_squares;
pub use specification::{Spec, check_names, instances_of, parse};
pub use thing::{Thing, UNKNOWN_THINGS, is_unknown_thing};
pub use workspace::{Want, Workspace};
