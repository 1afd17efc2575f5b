//! How large the noise is, from the readings themselves.

pub mod channels;
mod correlation;
pub mod rounding;
pub mod scatter;
pub mod source;
