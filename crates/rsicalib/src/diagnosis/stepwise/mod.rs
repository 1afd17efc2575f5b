//! Stepwise search: add the best effect, drop what is no longer needed, exchange some for others.

mod alternatives;
mod exchange;
mod prune;
pub mod search;
pub mod stepwise;
