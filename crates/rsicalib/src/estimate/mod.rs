//! Estimation: a session of readings, its objective, starts, noise and fit.

pub(crate) mod adjusted;
mod algebraic;
pub(crate) mod angles;
pub(crate) mod at_fit;
mod conventions;
pub(crate) mod degrees;
pub mod directions;
mod doubts;
mod eliminated;
mod fit;
mod gauge;
mod implicit;
pub mod noise;
mod note;
mod objective;
mod observations;
mod options;
pub mod paper;
pub mod progress;
mod residuals;
mod rewired;
pub mod search;
pub(crate) mod settle;
mod sized;
pub mod start;
pub mod suspicion;
pub mod tried;
mod wiring;

pub use algebraic::Algebraic;
pub use fit::{Fit, carry_over, fit, free_parameters};
pub use implicit::{Implicit, Misfit};
pub use note::Note;
pub use objective::{Noise, Part};
pub use observations::{Anchor, AnchorKind, LONG, Observations};
pub use options::{FitOptions, Method};
pub use residuals::Residuals;
