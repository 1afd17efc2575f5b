//! From the residual to the effect that the model lacks.

pub(crate) mod as_drawn;
pub(crate) mod averaged;
pub mod calibrate;
pub(crate) mod curve;
pub(crate) mod curve_law;
pub(crate) mod delays;
pub(crate) mod detectability;
pub(crate) mod doubt;
pub mod elsewhere;
pub mod held_out;
pub(crate) mod isolation;
mod kept_in;
pub(crate) mod left_open;
pub(crate) mod localisation;
pub(crate) mod location;
pub(crate) mod long;
pub mod options;
pub mod plausibility;
mod presumed;
pub(crate) mod price;
pub(crate) mod score;
pub(crate) mod search;
mod sent;
pub(crate) mod stretches;
pub mod trace;
pub(crate) mod unknown_law;
pub mod verdict;

pub use score::candidates::lacking;
