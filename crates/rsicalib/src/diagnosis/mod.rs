//! From the residual to the effect that the model lacks.

pub mod calibrate;
pub mod curve;
pub mod detectability;
pub mod doubt;
pub mod held_out;
pub mod isolation;
pub mod localisation;
pub mod options;
pub mod plausibility;
pub mod score;
pub mod stepwise;
pub mod trace;
pub mod verdict;
pub mod whereabouts;
