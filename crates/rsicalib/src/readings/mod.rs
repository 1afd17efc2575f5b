//! Readings: checked once on the way in, laid out for vector lanes.

mod block;
pub mod codes;
pub mod context;
mod samples;
mod table;

pub use block::Block;
pub use samples::Readings;
pub use table::{Table, average, rows_of};
