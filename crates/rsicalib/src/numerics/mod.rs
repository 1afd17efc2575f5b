//! Numerics that know nothing of mechanisms: vector lanes, least squares, elimination, eigenproblems, distributions.

pub mod credible_set;
pub mod dense;
pub mod distributions;
pub mod lanes;
pub mod linearization;
pub mod lm;
pub mod lock;
pub mod normal_equations;
pub mod random;
pub mod rank;
pub mod schur;
pub mod symmetric;
