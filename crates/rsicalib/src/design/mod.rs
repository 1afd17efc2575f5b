//! Which poses to visit, and what they can tell.

mod configurations;
pub mod exchange;
pub mod identifiability;
pub mod information;
pub mod observability;
pub mod plan;
pub mod reach;
pub mod suppose;
