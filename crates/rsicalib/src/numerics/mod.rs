//! Numerics that do not depend on mechanisms: vector lanes, least squares, elimination,
//! eigenproblems, distributions.

pub mod bounds;
pub mod component;
pub mod credible_set;
pub mod dense;
pub(crate) mod distributions;
pub(crate) mod draws;
pub mod formula;
pub mod lanes;
pub mod linearization;
pub mod lm;
pub mod median;
pub(crate) mod normal_equations;
pub(crate) mod normals;
#[cfg(feature = "serde")]
pub(crate) mod nullable;
pub(crate) mod order;
pub mod profile;
pub mod random;
pub mod rank;
pub(crate) mod schur;
pub(crate) mod search;
pub(crate) mod small;
pub(crate) mod symmetric;
pub(crate) mod thin;
pub(crate) mod workers;
