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

pub mod algebraic;
pub mod alone;
pub mod apply;
mod arrow;
pub mod bad;
pub mod calibrate;
pub mod chain;
pub mod change;
pub mod check;
mod context;
pub mod curve;
pub mod damage;
mod error;
pub mod excluded;
pub mod faults;
pub mod fit;
pub mod fixture;
pub mod hidden;
mod hunt;
pub mod lanes;
pub mod leftover;
pub mod linear;
pub mod lm;
pub mod mechanism;
pub mod model;
pub mod noise;
pub mod objective;
pub mod observability;
pub mod plan;
pub mod platform;
mod pursue;
pub mod readings;
pub mod result;
pub mod rivals;
pub mod rsi;
pub mod scan;
pub mod session;
pub mod start;
pub mod stats;
mod sums;
pub mod terms;
pub mod trace;
pub mod verdict;
pub mod wiring;

pub use error::Error;
pub use fit::{Fit, Method, Options, fit};
pub use mechanism::Mechanism;
pub use model::{Instance, Model, Target};
pub use readings::{Readings, Table};
pub use session::Session;
