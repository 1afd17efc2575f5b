//! Stepwise search: add the best effect, drop what is no longer needed, exchange some for others.

mod alternatives;
mod exchange;
mod known;
pub mod moves;
pub(crate) mod orders;
mod prune;
pub mod rivals;
pub mod search;
mod sharing;
mod tolerances;
