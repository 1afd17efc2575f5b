//! How large the noise is, from the readings themselves.

pub mod channels;
mod correlation;
pub(crate) mod open;
pub mod rounding;
pub mod scatter;
pub mod seating;
pub mod source;
