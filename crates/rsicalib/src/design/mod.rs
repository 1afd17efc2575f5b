//! Which poses to visit, and what they can tell.

pub mod exchange;
pub mod information;
pub mod linear;
pub mod observability;
pub mod reach;
