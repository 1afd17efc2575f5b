//! Which poses to visit, and what they can tell.

mod contest;
pub mod exchange;
mod forecast;
pub mod further;
pub mod guided;
mod hidden;
pub mod identifiability;
pub mod information;
mod linearised;
mod moments;
pub mod observability;
pub mod plan;
mod precision;
pub mod purpose;
pub mod reach;
mod reachable;
pub mod suppose;
mod tour;
pub mod until;
pub mod within_limits;
