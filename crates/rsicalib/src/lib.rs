//! Calibration of closed kinematic chains from their own joint readings.
//!
//! A closed mechanism with sensed joints satisfies `f(a*, β) = 0` in every pose,
//! where `a*` are the true readings and `β` the parameters: offsets, gains and
//! whatever else is not as drawn. Readings carry noise, `a = a* + e` with
//! `e ~ N(0, Σ)`. The estimate minimises
//!
//! ```text
//! Σ_samples eᵀ Σ⁻¹ e    subject to    f(a - e, β) = 0                      (50)
//! ```

#[cfg(test)]
extern crate self as rsicalib; // devices of the tests name the crate as its users do

mod error;

// Layers: each uses those above it, none below.

pub mod numerics;

pub mod mechanism;

pub mod readings;

pub mod kinematics;

pub mod terms;

pub mod model;

pub mod estimate;

pub mod apply;

pub mod screening;

pub mod diagnosis;

pub mod design;

pub mod report;

pub use error::Error;
pub use estimate::{Fit, FitOptions, Method, Observations, fit};
pub use mechanism::{Mechanism, Target};
pub use model::{Instance, Model};
pub use readings::{Readings, Table};
